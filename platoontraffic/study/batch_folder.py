"""The folder of a batch, which alone holds the state of its runs: state, claims on runs, removal of leftovers."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import time
import tomllib
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, TextIO

from platoontraffic.errors import InputError
from platoontraffic.results.recorder import UNFINISHED, as_json, is_done
from platoontraffic.study.folder_lock import SHARES, Lock, share_of
from platoontraffic.study.silence import Outcome
from platoontraffic.study.study import Study

STUDY, LOCK = "study.toml", ".lock"
FAILURE = "failure.json"  # in RUN.unfinished: why the run failed
DONE, FAILED, WAITING = "done", "failed", "waiting"
PATIENCE = 5.0  # longest wait for another batch that starts or writes its tables [s]


def state(folder: Path, run_id: str) -> str:
    """DONE, FAILED or WAITING."""
    if is_done(folder / run_id):
        return DONE
    return FAILED if (folder / (run_id + UNFINISHED) / FAILURE).is_file() else WAITING


def failure(folder: Path, run_id: str) -> dict[str, Any]:
    """The failure of a run: error (one line), traceback, wall_s. raises: InputError"""
    return read_json(folder / (run_id + UNFINISHED) / FAILURE)


def note_failure(folder: Path, run_id: str, outcome: Outcome) -> None:
    """Write the cause of a failure beside the tables that the run recorded, which are kept."""
    kept = folder / (run_id + UNFINISHED)
    if not kept.exists():
        for partial in folder.glob(f"{run_id}.*.partial"):  # its process died
            partial.replace(kept)
            break
    kept.mkdir(exist_ok=True)
    with replacing(kept / FAILURE) as file:
        file.write(as_json(outcome))


def tidy(folder: Path, lock: Lock, ids: Collection[str], suffix: str) -> None:
    """Remove leftovers of earlier attempts of these runs, unless a worker still holds them, as dask's may."""
    for entry in os.scandir(folder):
        run_id = entry.name.partition(".")[0]
        if entry.name.endswith(suffix) and run_id in ids and lock.take(share_of(run_id), 1):
            shutil.rmtree(entry.path, ignore_errors=True)
            lock.release(share_of(run_id), 1)


@contextlib.contextmanager
def claimed(study: Study, folder: Path, block: range) -> Iterator[Lock]:
    """Claim a block of runs of this study exclusively, by their places in `Study.shuffled`; makes the folder.

    raises: InputError if the folder holds something else, or if another batch holds some of these runs
    """
    _check(study, folder)
    folder.mkdir(parents=True, exist_ok=True)
    text, file = study.text(folder), folder / STUDY
    until = time.monotonic() + PATIENCE
    with contextlib.closing(Lock(folder / LOCK)) as lock:
        while True:
            if lock.take(block.start, len(block)):
                if file.is_file() and file.read_text(encoding="utf-8") == text:
                    break
                lock.release(block.start, len(block))
            if lock.take(0, len(SHARES)):  # no batch runs the old version of the study
                _check(study, folder)
                with replacing(file) as opened:
                    opened.write(text)
                lock.release(0, len(SHARES))
                continue
            if time.monotonic() > until:
                raise InputError(f"{folder}: another batch is at work there; wait until it ends, or stop it")
            time.sleep(0.1)
        yield lock


def _check(study: Study, folder: Path) -> None:
    """raises: InputError if the folder holds something other than this study"""
    if not folder.exists():
        return
    file = folder / STUDY
    if not file.is_file():
        if any(entry.name != LOCK and not entry.name.startswith(f".{STUDY}.") for entry in os.scandir(folder)):
            raise InputError(f"{folder}: is not the folder of a batch; must be empty, or another one by --out")
        return
    try:
        there = tomllib.loads(file.read_text(encoding="utf-8"))
        name, base = there["name"], Path(there["base"]).name
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{file}: is not the study of a batch: {' '.join(str(error).split())}") from None
    if (name, base) != (study.name, Path(study.base).name):
        this = f"{study.name!r} on {Path(study.base).name!r}"
        raise InputError(f"{folder}: holds another study, {name!r} on {base!r}; for {this} use another --out")


def read_json(file: Path) -> dict[str, Any]:
    """raises: InputError if it is missing or damaged"""
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise InputError(f"{file}: is missing or damaged; remove {file.parent} to repeat the run") from None


@contextlib.contextmanager
def replacing(file: Path) -> Iterator[TextIO]:
    """Write a new version of a file, which replaces the old one when it is complete."""
    new = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        with new.open("w", encoding="utf-8", newline="") as opened:
            yield opened
        new.replace(file)
    except BaseException:
        new.unlink(missing_ok=True)
        raise
