"""Laws that do their process every harm. A test copies this file beside its scenario."""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np

from platoontraffic import Decision, Law, Twist

KEPT = []  # what is never freed
FORKED = []


def ignore_signals() -> None:
    for number in set(signal.Signals) - {signal.SIGKILL, signal.SIGSTOP}:
        signal.signal(number, signal.SIG_IGN)


def sleep() -> None:
    time.sleep(1e6)


@numba.njit
def spin() -> float:
    """Keeps all other threads of Python waiting."""
    x = 1.0
    while x > 0.0:
        x = x + 1.0 if x < 10.0 else 1.0
    return x


def kill(number: int) -> None:
    os.kill(os.getpid(), number)


def fork_once() -> None:
    """Return in both processes, but only once: copies that went on would make copies, and fill the machine."""
    if not FORKED:
        FORKED.append(True)
        os.fork()


def leave(child: Callable[[], None]) -> bool:
    """Leave a child that does this; true."""
    if os.fork() == 0:
        child()
        os._exit(0)
    return True


def own_session() -> None:
    os.setsid()
    sleep()


# What the law does in each step.
KINDS = {
    "fine": lambda: None,
    "hangs": sleep,
    "hangs and ignores signals": lambda: (ignore_signals(), sleep()),
    "hangs in compiled code": spin,
    "stops itself": lambda: kill(signal.SIGSTOP),
    "closes all descriptors": lambda: os.closerange(0, 256),
    "closes stdin": lambda: os.closerange(0, 1),
    "reads stdin": lambda: sys.stdin.read(),
    "forks": fork_once,
    "leaves a child and hangs": lambda: leave(sleep) and sleep(),
    "leaves a child and dies": lambda: leave(sleep) and kill(signal.SIGSEGV),
    "leaves a child of its own session and hangs": lambda: leave(own_session) and sleep(),
    "leaves a thread": lambda: threading.Thread(target=sleep).start(),
    "fills memory": lambda: KEPT.append(np.ones(10_000_000)),
    "fills memory of a child": lambda: leave(lambda: (KEPT.append(np.ones(100_000_000)), sleep())) and sleep(),
    "fills stderr": lambda: sys.stderr.write("x" * 1_000_000),
    "dies": lambda: kill(signal.SIGSEGV),
    "dies of a signal without a name": lambda: kill(40),
    "kills its group": lambda: os.killpg(0, signal.SIGKILL),
    "ends": lambda: os._exit(0),
    "exits": lambda: sys.exit("enough"),
    "fails": lambda: 1 / 0,
    "makes numpy strict": lambda: np.seterr(all="raise"),
    "spoils its process": lambda: setattr(np, "spoilt", True),  # see below
}


@dataclass(frozen=True)
class Bad(Law):
    kind: str = "fine"
    tag: int = 0  # tells runs of one kind apart

    def __call__(self, sensed, memory, dt):
        if self.kind == "fine" and hasattr(np, "spoilt"):
            raise RuntimeError("the process is spoilt")
        KINDS[self.kind]()
        return Decision(Twist(np.zeros(len(sensed.speed)), np.zeros(len(sensed.speed))))
