"""Exit codes of commands: 0 fine, 1 a run failed, 2 bad input, 3 the machine lacks something, 130 interrupted."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable
from functools import wraps

import typer

from platoontraffic.cli.last_resort import line_of
from platoontraffic.cli.signals import command_begins, is_of_control_c
from platoontraffic.errors import InputError, MissingError, RunError

MOST_FAULTS = 50  # that are printed
OF_A_NAME = (errno.ENAMETOOLONG, errno.EACCES, errno.EPERM, errno.ELOOP, errno.EISDIR, errno.ENOTDIR)


def commands_of(app: typer.Typer) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A decorator that makes a function a command of `app`. Errors become one line per fault on stderr.

    The name of the command is that of the function up to an underscore, as in `list_`, which must not hide `list`.
    """

    def command(function: Callable[..., None]) -> Callable[..., None]:
        @wraps(function)
        def guarded(*args: object, **kwargs: object) -> None:
            try:
                command_begins()
                function(*args, **kwargs)
                if sys.stdout:
                    sys.stdout.flush()
            except InputError as error:
                raise _ended(2, *error.faults) from None
            except RunError as error:
                raise _ended(1, str(error), *getattr(error, "__notes__", ())) from None
            except MissingError as error:
                raise _ended(3, str(error)) from None
            except KeyboardInterrupt as error:
                raise _ended(130, str(error) or "interrupted", *getattr(error, "__notes__", ())) from None
            except (typer.Exit, typer.Abort, BrokenPipeError):
                raise
            except Exception as error:
                if is_of_control_c(error):
                    raise _ended(130, "interrupted", *getattr(error, "__notes__", ())) from None
                _leave_full_stdout()
                raise _ended(_code(error), line_of(error), *getattr(error, "__notes__", ())) from None

        return app.command(function.__name__.partition("_")[0])(guarded)

    return command


def _code(error: Exception) -> int:
    """2 for a file name of the user's that the system refuses; else 1."""
    return 2 if isinstance(error, OSError) and error.filename and error.errno in OF_A_NAME else 1


def _ended(code: int, *lines: str) -> typer.Exit:
    for line in lines[:MOST_FAULTS]:
        print(line, file=sys.stderr)
    if len(lines) > MOST_FAULTS:
        print(f"and {len(lines) - MOST_FAULTS:,} more", file=sys.stderr)
    return typer.Exit(code)


def _leave_full_stdout() -> None:
    """Where stdout takes no more, let Python not try again at its end."""
    try:
        if sys.stdout:
            sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
