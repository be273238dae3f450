"""Errors that the command line tells apart by exit code, and hints for unknown names."""

import difflib
import errno
from collections.abc import Iterable


class InputError(ValueError):
    """The user's input is wrong: a file, an argument, a plug-in. Exit code 2.

    faults: one line each, `file:line: key: what is wrong; what is allowed`.
    """

    def __init__(self, *faults: str) -> None:
        self.faults = tuple(" ".join(fault.splitlines()) for fault in faults)
        super().__init__("\n".join(self.faults))


class RunError(RuntimeError):
    """A run failed although its input was sound: SUMO died, the disk is full. Exit code 1."""


class MissingError(RuntimeError):
    """The machine lacks something that is needed: an extra, a display. Exit code 3."""


_OF_NAMES = {errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.EEXIST, errno.ENAMETOOLONG, errno.ELOOP, errno.EINVAL}


def kind_of(error: OSError) -> type[InputError | RunError]:
    """InputError if a name that was given cannot be that of a file, else RunError: the disk is full, or read-only."""
    return InputError if error.errno in _OF_NAMES else RunError


def not_written(error: OSError, file: object = None) -> InputError | RunError:
    """The error to raise for a file that cannot be written; file: if the error does not name it."""
    return kind_of(error)(f"{error.filename or file}: cannot be written: {error.strerror or error}")


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """`; did you mean 'x'?` if a known word is close, else `; known: ` and some of them; "" if none is known."""
    known = sorted(known)
    if close := difflib.get_close_matches(word, known, n=1):
        return f"; did you mean {close[0]!r}?"
    some = ", ".join(known[:8]) + (f", … ({len(known)} in all)" if len(known) > 8 else "")
    return f"; known: {some}" if known else ""
