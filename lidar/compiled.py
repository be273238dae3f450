"""How this package compiles: once a machine, kept on disk."""

import contextlib
import hashlib
from functools import cache
from pathlib import Path

import numba


def compiled(function):
    """The function, compiled by numba at its first call; without fast-math, so every processor rounds alike.

    The code is kept beside the source, or else in the user's cache folder, or in NUMBA_CACHE_DIR. Where none of them
    can be written, it is compiled anew in every process.
    """
    try:
        dispatcher = numba.njit(cache=True, error_model="numpy")(function)
    except RuntimeError:  # no place to keep it
        return numba.njit(error_model="numpy")(function)
    # numba compiles anew when the function's own file has changed, and would not notice that what it calls, or a
    # constant, has changed in another. A test tells when a new numba keeps this stamp elsewhere.
    with contextlib.suppress(AttributeError):
        dispatcher._cache._cache_file._source_stamp = sources()
    return dispatcher


@cache
def sources() -> str:
    """A digest of all source files of this package."""
    files = sorted(Path(__file__).parent.rglob("*.py"))
    return hashlib.blake2b(b"".join(file.read_bytes() for file in files), digest_size=16).hexdigest()
