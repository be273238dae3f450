"""Files that are there whole, or as they were before."""

from __future__ import annotations

import contextlib
import os
import secrets
import stat
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def replacing(file: Path) -> Iterator[Path]:
    """A path beside `file`, with its suffix, for a new version of it, which then takes its place.

    A link is replaced as well, and what it leads to is left alone. A device or a pipe is written itself.

    raises: OSError naming `file`, which is then as it was
    """
    new = file if _is_stream(file) else file.with_name(f".{secrets.token_hex(8)}{file.suffix}")
    try:
        yield new
        if new != file:
            new.replace(file)
    except BaseException as error:
        if new != file:
            with contextlib.suppress(OSError):
                new.unlink()
        if isinstance(error, OSError):
            error.filename, error.filename2 = os.fspath(file), None
        raise


def write(file: Path, content: bytes) -> Path:
    """Write a file; returns it. raises: OSError as `replacing`"""
    with replacing(file) as new:
        new.write_bytes(content)
    return file


def _is_stream(file: Path) -> bool:
    """Whether it is a character device or a pipe, such as /dev/stdout."""
    try:
        mode = file.stat().st_mode
    except OSError:
        return False
    return stat.S_ISCHR(mode) or stat.S_ISFIFO(mode)
