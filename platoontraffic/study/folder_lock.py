"""Advisory locks on parts of a file, held by one process at a time; the system releases them when a process ends."""

from __future__ import annotations

import errno
import hashlib
import os
from contextlib import suppress
from pathlib import Path

SHARES = range(1_000_000)  # parts for runs by their place in the study, held by the batch
TABLES = 1_000_001  # part that is held while tables are written
_RUNS = range(1_000_002, 1_500_000_000)  # parts for runs by their id, held while a run is executed


def share_of(run_id: str) -> int:
    """The part for a run. Two runs may have the same part; then one waits for the other."""
    return _RUNS[int.from_bytes(hashlib.sha256(run_id.encode()).digest()[:6]) % len(_RUNS)]


class Lock:
    """Locks on one file. A process must not open it twice: by POSIX, closing either one releases the locks of both."""

    def __init__(self, file: Path) -> None:
        self._file = os.open(file, os.O_RDWR | os.O_CREAT, 0o666)

    def take(self, start: int, length: int) -> bool:
        """Lock these parts unless another process holds one of them; whether it succeeded."""
        if not length:
            return True
        try:
            if os.name == "nt":
                import msvcrt

                os.lseek(self._file, start, os.SEEK_SET)
                msvcrt.locking(self._file, msvcrt.LK_NBLCK, length)
            else:
                import fcntl

                fcntl.lockf(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB, length, start)
        except OSError as error:
            if error.errno in (errno.EACCES, errno.EAGAIN, errno.EDEADLK):
                return False
            raise
        return True

    def release(self, start: int, length: int) -> None:
        if not length:
            return
        if os.name == "nt":
            import msvcrt

            os.lseek(self._file, start, os.SEEK_SET)
            msvcrt.locking(self._file, msvcrt.LK_UNLCK, length)
        else:
            import fcntl

            fcntl.lockf(self._file, fcntl.LOCK_UN, length, start)

    def is_on(self, file: Path) -> bool:
        """Whether this is the file of that name still."""
        try:
            return os.path.samestat(os.fstat(self._file), file.stat())
        except FileNotFoundError:
            return False

    def close(self) -> None:
        with suppress(OSError):  # a law may have closed it
            os.close(self._file)
