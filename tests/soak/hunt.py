"""Checks and runs mutants, each in a fork of one process that has imported everything.

    python -m tests.soak.hunt FIRST COUNT FOLDER

prints a line of JSON for each mutant: its number, kind, exit code, seconds, and what is wrong ("" if nothing is).
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import sys
import time
from importlib import import_module
from pathlib import Path
from typing import Any

from platoontraffic import recording as runs
from platoontraffic import scenario
from platoontraffic.cli.entry import main as command
from tests.soak import mutants

LIMIT = 60.0  # processor time that no command may take [s]
ENDLESS = 240.0  # time after which a command is ended, however busy the machine is [s]
MEMORY = 4_000_000_000  # address space of a mutant [bytes]
RUN = ("run.duration_s=1", "-q")


def hunt(number: int, folder: Path) -> dict[str, Any]:
    """Check a mutant, and run it where it is sound. The folder is removed unless something is wrong."""
    mutant = mutants.write(number, folder)
    report = {"number": number, "kind": mutant.kind, "code": None, "run": None, "seconds": 0.0, "wrong": ""}
    check = ("code", ["check", *mutant.arguments])
    run = ("run", ["run", *mutant.arguments, *RUN, "--out", str(folder / "out")])
    # A run checks all that `check` does.
    commands = [check] if not mutant.runs else [check, run] if number % 3 == 0 else [run]
    for key, words in commands:
        code, seconds = _forked(words, mutant.environment, folder)
        report[key], report["seconds"] = code, round(report["seconds"] + seconds, 1)
        report["wrong"] = _wrong(words[0], code, seconds, folder)
        report["words"] = (folder / "stderr").read_text(errors="replace")[-600:]
        if report["wrong"] or code != 0:
            break
    if not report["wrong"]:
        shutil.rmtree(folder)
    return report


def warm_up(folder: Path) -> None:
    """Import and compile all that runs use, so that forks need not."""
    for name in ("cli.foreign_code", "study.batch", "study.study", "observation.sight", "observation.tested"):
        import_module(f"platoontraffic.{name}")
    for name in ("paper_loop", "corridor_platoon"):
        checked = scenario.load(name, ["run.duration_s=1", "sumo.warm_up_s=0"])
        runs.run(runs.prepare(checked), folder / name)
    shutil.rmtree(folder)


def _forked(words: list[str], environment: dict[str, str], folder: Path) -> tuple[int, float]:
    """Exit code of a command, minus the number of a signal, and the processor time it took [s]."""
    began = time.monotonic()
    child = os.fork()
    if child == 0:
        _become(words, environment, folder)
    while True:
        done, status, used = os.wait4(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime
        if time.monotonic() - began > ENDLESS:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return -signal.SIGKILL, ENDLESS
        time.sleep(0.01)


def _become(words: list[str], environment: dict[str, str], folder: Path) -> None:
    """Turn this fork into the command; does not return."""
    code = 120
    try:
        for name, descriptor in (("stdout", 1), ("stderr", 2)):
            os.dup2(os.open(folder / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), descriptor)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if environment:  # it must be there when Python starts
            arguments = [sys.executable, "-m", "platoontraffic", *words]
            os.execve(sys.executable, arguments, os.environ | environment)
        sys.argv[1:] = words
        command()
        code = 0
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else int(error.code is not None)
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(code)


def _wrong(command: str, code: int, seconds: float, folder: Path) -> str:
    """What is wrong with how a command ended; "" if nothing is."""
    words = (folder / "stderr").read_text(errors="replace")
    left = [str(file) for file in folder.rglob("*.partial")]
    if seconds >= LIMIT:
        return "takes too long"
    if "Traceback" in words or "details, to report it" in words:
        return "an exception that has no words of its own"
    if code < 0 and (command != "run" or "the process died" not in words):
        return "died without a word"
    if code not in (0, 1, 2, 3) and code > 0:
        return f"exit code {code}"
    if code > 0 and not words.strip():
        return "failed without a word"
    if max((len(line) for line in words.splitlines()), default=0) > 5000 or words.count("\n") > 100:
        return "says too much"
    if left and code >= 0:
        return "half-written: " + left[0]
    if command == "run" and code == 0 and not list(folder.glob("out/*/*/DONE")):
        return "no results"
    return ""


def main() -> None:
    first, count, folder = int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3])
    warm_up(folder / "warm_up")
    for number in range(first, first + count):
        print(json.dumps(hunt(number, folder / str(number))), flush=True)


if __name__ == "__main__":
    main()
