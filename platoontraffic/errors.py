"""Errors that the command line tells apart by exit code, and words of messages: hints for unknown names, plurals."""

import difflib
import errno
import os
import stat
from collections.abc import Iterable
from pathlib import Path

LONGEST = 1000  # fault; a longer one is shortened in its middle [characters]


class InputError(ValueError):
    """The user's input is wrong: a file, an argument, a plug-in. Exit code 2.

    faults: one line each, `file:line: key: what is wrong; what is allowed`.
    """

    def __init__(self, *faults: str) -> None:
        self.faults = tuple(shortened(" ".join(fault.splitlines()), LONGEST) for fault in faults)
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


def shortened(text: str, longest: int) -> str:
    """A text of at most about `longest` characters: its begin and its end."""
    if len(text) <= longest:
        return text
    half = longest // 2
    return f"{text[:half]} … ({len(text):,} characters) … {text[-half:]}"


def no_file(path: str | Path) -> str:
    """Why a path is no file: "" if it is one, `is a folder`, `no such file`, or the system's words, such as `File name
    too long`."""
    try:
        mode = os.stat(path).st_mode
        return "" if stat.S_ISREG(mode) else "is a folder" if stat.S_ISDIR(mode) else "no such file"
    except (FileNotFoundError, NotADirectoryError):
        return "no such file"
    except OSError as error:
        return f"cannot be read: {error.strerror}"
    except ValueError:  # a name with a null character
        return "no such file"


def counted(number: int, noun: str) -> str:
    """`1 route`, `2,000 routes`"""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """`; did you mean 'x'?` if a known word is close, else `; known: ` and some of them; "" if none is known."""
    known = sorted(known)
    if close := difflib.get_close_matches(word, known, n=1):
        return f"; did you mean {close[0]!r}?"
    some = ", ".join(known[:8]) + (f", … ({len(known)} in all)" if len(known) > 8 else "")
    return f"; known: {some}" if known else ""
