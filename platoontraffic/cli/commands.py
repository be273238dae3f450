"""Exit codes of commands: 0 fine, 1 a run failed, 2 bad input, 3 the machine lacks something, 130 interrupted."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import wraps

import typer

from platoontraffic.cli.signals import command_begins
from platoontraffic.errors import InputError, MissingError, RunError


def commands_of(app: typer.Typer) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A decorator that makes a function a command of `app`. Expected errors become one line per fault on stderr.

    The name of the command is that of the function up to an underscore, as in `list_`, which must not hide `list`.
    """

    def command(function: Callable[..., None]) -> Callable[..., None]:
        @wraps(function)
        def guarded(*args: object, **kwargs: object) -> None:
            try:
                command_begins()
                function(*args, **kwargs)
            except InputError as error:
                raise _ended(2, *error.faults) from None
            except RunError as error:
                raise _ended(1, str(error), *getattr(error, "__notes__", ())) from None
            except MissingError as error:
                raise _ended(3, str(error)) from None
            except KeyboardInterrupt as error:
                raise _ended(130, str(error) or "interrupted", *getattr(error, "__notes__", ())) from None

        return app.command(function.__name__.partition("_")[0])(guarded)

    return command


def _ended(code: int, *lines: str) -> typer.Exit:
    for line in lines:
        print(line, file=sys.stderr)
    return typer.Exit(code)
