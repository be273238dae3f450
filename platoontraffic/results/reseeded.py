"""Results of a run that stand for an equal run with another seed, where nothing depends on the seed."""

from __future__ import annotations

import csv
import io
import json
import secrets
import shutil
import tomllib
from collections.abc import Callable
from fnmatch import fnmatchcase
from pathlib import Path

import tomli_w

from platoontraffic.results.recorder import MADE_OF_RESULTS, as_json, is_done


def copy_with_seed(done: Path, folder: Path, seed: int) -> None:
    """Make the results of a run from those of an equal run; files that hold a seed get the other one.

    done   : folder of the run that was simulated; provenance.json of the copy names it
    folder : of the copy, beside it, so that relative paths stay true; it must not exist yet
    raises : OSError
    """
    partial = folder.with_name(f"{folder.name}.{secrets.token_hex(4)}.partial")
    try:
        partial.mkdir()
        for file in sorted(done.iterdir()):
            if file.is_file() and not any(fnmatchcase(file.name, pattern) for pattern in MADE_OF_RESULTS):
                shutil.copyfile(file, partial / file.name)
        _write(partial / "config.toml", lambda text: tomli_w.dumps(tomllib.loads(text) | {"seed": seed}))
        _write(partial / "summary.csv", lambda text: _with_seed(text, seed))
        _write(
            partial / "provenance.json", lambda text: as_json(json.loads(text) | {"seed": seed, "equal_to": done.name})
        )
        partial.rename(folder)
    except OSError:
        shutil.rmtree(partial, ignore_errors=True)
        if not is_done(folder):  # another process may have executed the run in the meantime
            raise


def _write(file: Path, changed: Callable[[str], str]) -> None:
    file.write_text(changed(file.read_text(encoding="utf-8")), encoding="utf-8", newline="\n")


def _with_seed(summary: str, seed: int) -> str:
    names, values = csv.reader(io.StringIO(summary, newline=""))
    values[names.index("seed")] = str(seed)
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows([names, values])
    return text.getvalue()
