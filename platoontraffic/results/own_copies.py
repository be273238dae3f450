"""Files of a fork: a process and its fork share the offsets of files that were open, until one of them has copies."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def named_for_forks(folder: Path) -> Iterator[Path]:
    """A name for a folder that in a fork names its own copy, once that is taken: SUMO opens some files late.

    Only Linux has such names; elsewhere it is the folder's own.
    """
    if not os.path.isdir("/proc/self/fd"):
        yield folder
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        yield Path(f"/proc/self/fd/{descriptor}")
    finally:
        os.close(descriptor)


def take_own_copies(of: Path, folder: Path) -> None:
    """Copy all files of a folder; what this process has open there goes on in the copy, at the same offset.

    Other files that are open to be read, such as SUMO's routes, are opened anew at the same offset. To be called in the
    fork, while its parent waits. raises: OSError
    """
    import fcntl  # not on Windows, which has no fork

    shutil.copytree(of, folder, symlinks=True, dirs_exist_ok=True)
    before = of.resolve()
    for descriptor, file in _open_files():
        mode = fcntl.fcntl(descriptor, fcntl.F_GETFL) & (os.O_ACCMODE | os.O_APPEND)
        if file.is_relative_to(before):
            own = os.open(folder / file.relative_to(before), mode)
        elif mode == os.O_RDONLY and file.is_file():
            own = os.open(file, mode)
        else:
            continue
        os.lseek(own, os.lseek(descriptor, 0, os.SEEK_CUR), os.SEEK_SET)
        os.dup2(own, descriptor, os.get_inheritable(descriptor))
        os.close(own)


def _open_files() -> Iterator[tuple[int, Path]]:
    """Descriptors of this process that are open on a file or a folder, each with its path."""
    for name in os.listdir("/dev/fd"):
        try:
            file = _path_of(int(name))
        except OSError:  # it has no path; or it was that of the list, and is closed
            continue
        if file.exists():
            yield int(name), file


def _path_of(descriptor: int) -> Path:
    if os.path.isdir("/proc/self/fd"):
        return Path(os.readlink(f"/proc/self/fd/{descriptor}"))
    import fcntl

    return Path(os.fsdecode(fcntl.fcntl(descriptor, fcntl.F_GETPATH, bytes(1024)).rstrip(b"\0")))
