"""No mutant of what is read ends in a traceback, without a word, with a half-written file, or after a minute."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.soak.mutants import KINDS, write
from tests.support import ROOT


@pytest.mark.sumo
@pytest.mark.parametrize(
    ("first", "count"),
    [
        pytest.param(0, 25, id="some"),
        *(pytest.param(first, 500, id=f"{first} on", marks=pytest.mark.soak) for first in (0, 500, 1000, 1500)),
    ],
)
def test_every_mutant_ends_in_words(first: int, count: int, tmp_path: Path):
    words = [sys.executable, "-m", "tests.soak.hunt", str(first), str(count), str(tmp_path)]
    done = subprocess.run(
        words, stdout=subprocess.PIPE, text=True, cwd=ROOT, env=os.environ | {"TMPDIR": str(tmp_path)}
    )
    reports = [json.loads(line) for line in done.stdout.splitlines()]
    assert [(report["number"], report["wrong"], report["words"]) for report in reports if report["wrong"]] == []
    assert [report["number"] for report in reports] == list(range(first, first + count))
    assert any(report["run"] == 0 for report in reports)


def test_a_number_is_a_mutant(tmp_path: Path):
    for number in range(len(KINDS)):
        made = []
        for _ in range(2):
            mutant = write(number, tmp_path / str(number))
            made.append((mutant, {file.name: file.read_bytes() for file in (tmp_path / str(number)).iterdir()}))
        assert made[0] == made[1]
