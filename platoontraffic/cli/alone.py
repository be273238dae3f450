"""A run that one process at a time executes, and what killed processes left of it."""

from __future__ import annotations

import contextlib
import glob
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

from platoontraffic.study.batch_folder import LOCK, STUDY
from platoontraffic.study.folder_lock import Lock, share_of


@contextlib.contextmanager
def alone(folder: Path, wait: Callable[[], None], say: Callable[[str], None]) -> Iterator[None]:
    """Wait until no other process executes a run, and remove what killed ones left of it.

    A process is alive while it holds a lock. Its id says nothing: in another container there may be one with the same.

    folder : of the run
    wait   : called once if another process executes it
    say    : called with a line on each thing that is removed
    """
    made = [parent for parent in folder.parents if not parent.exists()]  # innermost first
    with contextlib.ExitStack() as after:
        # Where no file can be locked, or none be made, the run does without; unless nothing can be written at all.
        with contextlib.suppress(OSError):
            folder.parent.mkdir(parents=True, exist_ok=True)
            after.callback(_remove_empty, made)
            in_batch = (folder.parent / STUDY).is_file()
            file = folder.parent / (LOCK if in_batch else f".{folder.name}.lock")
            after.enter_context(closing(_held(file, share_of(folder.name), wait)))
            if not in_batch:
                after.callback(_remove, file)
            for left in folder.parent.glob(f"{glob.escape(folder.name)}.*.partial"):
                shutil.rmtree(left)
                say(f"{left}: was left by a run that was killed; it is removed")
        yield


def _held(file: Path, part: int, wait: Callable[[], None]) -> Lock:
    """A lock on the file, once no other process has it. raises: OSError"""
    told = False
    while True:
        lock = Lock(file)
        if lock.take(part, 1) and lock.is_on(file):  # else its last holder has removed the file
            return lock
        lock.close()
        if not told:
            wait()
            told = True
        time.sleep(0.2)


def _remove(file: Path) -> None:
    with contextlib.suppress(OSError):  # Windows keeps files that are open
        file.unlink()


def _remove_empty(folders: list[Path]) -> None:
    for folder in folders:
        with contextlib.suppress(OSError):  # it holds results
            folder.rmdir()
