"""Files of a fork: a process and its fork share the offsets of files that were open, until one of them has copies."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path


def take_own_copies(of: Path, folder: Path) -> None:
    """Copy all files of a folder; what this process has open there goes on in the copy, at the same offset.

    To be called in the fork, while its parent waits. raises: OSError
    """
    import fcntl  # not on Windows, which has no fork

    shutil.copytree(of, folder, symlinks=True, dirs_exist_ok=True)
    for descriptor, file in _open_files_in(of.resolve()):
        mode = fcntl.fcntl(descriptor, fcntl.F_GETFL) & (os.O_ACCMODE | os.O_APPEND)
        copy = os.open(folder / file, mode)
        os.lseek(copy, os.lseek(descriptor, 0, os.SEEK_CUR), os.SEEK_SET)
        os.dup2(copy, descriptor, os.get_inheritable(descriptor))
        os.close(copy)


def _open_files_in(folder: Path) -> Iterator[tuple[int, Path]]:
    """Descriptors of this process, each with the path of its file in a folder."""
    for name in os.listdir("/dev/fd"):
        try:
            file = _path_of(int(name))
        except OSError:  # it has no path; or it was that of the list, and is closed
            continue
        if file.is_relative_to(folder) and file.is_file():
            yield int(name), file.relative_to(folder)


def _path_of(descriptor: int) -> Path:
    if os.path.isdir("/proc/self/fd"):
        return Path(os.readlink(f"/proc/self/fd/{descriptor}"))
    import fcntl

    return Path(os.fsdecode(fcntl.fcntl(descriptor, fcntl.F_GETPATH, bytes(1024)).rstrip(b"\0")))
