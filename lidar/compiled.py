"""Compilation of kernels: once a machine, kept on disk."""

import contextlib
import hashlib
from collections.abc import Callable, Iterable
from pathlib import Path

import numba
from numba.core import event


def compiler(*files: str | Path) -> Callable:
    """A decorator for functions that call, and take constants from, no files of this project other than these.

    numba compiles the function at its first call, without fast-math, so that every processor rounds alike. The code is
    kept beside the source, or else in the user's cache folder, or in NUMBA_CACHE_DIR, until one of the files changes.
    Where none of them can be written, it is compiled anew in every process.
    """
    stamp = digest(files)

    def compiled(function):
        try:
            dispatcher = numba.njit(cache=True, error_model="numpy")(function)
        except RuntimeError:  # no place to keep it
            return numba.njit(error_model="numpy")(function)
        # numba compiles anew when the function's own file has changed, but does not notice a change of a function or a
        # constant in another file. A test fails when a new numba keeps this stamp elsewhere.
        with contextlib.suppress(AttributeError):
            file = dispatcher._cache._cache_file
            file._source_stamp, file._load_index = stamp, _sound(file._load_index)
        return dispatcher

    return compiled


def _sound(load_index: Callable[[], dict]) -> Callable[[], dict]:
    """The list of compiled versions; an empty one where it names types that an older version of the code had."""

    def load() -> dict:
        try:
            return load_index()
        except (AttributeError, ImportError):
            return {}

    return load


def when_compiling(tell: Callable[[], None]) -> None:
    """Have `tell` called once, when this process begins to compile a kernel, as it does where none is kept."""
    event.register("numba:compile", _First(tell))


class _First(event.Listener):
    """Calls a function at the first event."""

    def __init__(self, tell: Callable[[], None]) -> None:
        self._tell: Callable[[], None] | None = tell

    def on_start(self, event) -> None:
        tell, self._tell = self._tell, None
        if tell:
            tell()

    def on_end(self, event) -> None:
        pass


def digest(files: Iterable[str | Path]) -> str:
    return hashlib.blake2b(b"".join(Path(file).read_bytes() for file in files), digest_size=16).hexdigest()


OWN = sorted(Path(__file__).parent.rglob("*.py"))

compiled = compiler(*OWN)  # for this package
