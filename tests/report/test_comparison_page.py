"""The page of runs beside each other, of made runs."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pandas as pd
import pytest

from platoontraffic.analysis import load
from platoontraffic.analysis.comparison import LEAST_AXIS, difference_figure
from platoontraffic.report import comparison_page
from tests.support.made_runs import made_run


def made(folder: Path, **options) -> Path:
    """A run that has no branch."""
    made_run(folder, seconds=2.0, **options)
    (folder / "config.toml").touch()
    return folder


@pytest.fixture
def first(tmp_path) -> Path:
    return made(tmp_path / "first")


def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8").partition("<h2>What differs</h2>")[2]


def test_runs_without_a_common_member_are_named_and_not_drawn(first, tmp_path):
    """There was no page, but "platoon 'platoon': not in the table"."""
    other = made(tmp_path / "other", platoon="convoy")
    page = text_of(comparison_page([first, other], tmp_path / "page.html"))
    assert "Not drawn, without a member that first has too: other." in page
    assert "<img" not in page
    assert "gap_mean" in page  # the members of both have their tables
    third = Path(shutil.copytree(first, tmp_path / "third"))
    rows = pd.read_csv(third / "trajectories.csv")
    rows.assign(speed_mps=rows.speed_mps + 1).to_csv(third / "trajectories.csv", index=False)
    page = text_of(comparison_page([first, other, third], tmp_path / "page.html"))
    assert "first has too: other." in page
    assert page.count("<img") == 1


def test_of_equal_runs_it_says_that_nothing_differs(first, tmp_path):
    equal = shutil.copytree(first, tmp_path / "equal")
    page = text_of(comparison_page([first, equal], tmp_path / "page.html"))
    assert "the runs have equal gaps and speeds" in page
    assert "No metric differs." in page
    assert "<table" not in page
    assert "<img" not in page


def test_the_keys_in_which_runs_differ_are_there(first, tmp_path):
    other = made(tmp_path / "other")
    for folder, law in ((first, 'law = "acc"'), (other, 'law = "idm"\nexponent = 4.0')):
        (folder / "config.toml").write_text(f"seed = 1\n[[platoon]]\nsize = 3\n[platoon.follower]\n{law}\n")
    page = text_of(comparison_page([first, other], tmp_path / "page.html"))
    cells = [re.sub("<.*?>", " ", row).split() for row in re.findall("<tr>(.*?)</tr>", page, re.DOTALL)]
    assert ["platoon.0.follower.law", "acc", "idm"] in cells
    assert ["platoon.0.follower.exponent", "4.0"] in cells
    assert not any(row[:1] in (["seed"], ["platoon.0.size"]) for row in cells)


def test_a_folder_that_is_given_twice_has_two_names(first, tmp_path):
    page = comparison_page([first, first], tmp_path / "page.html").read_text(encoding="utf-8")
    assert re.findall(r'<th scope="row">(.*?)</th>', page)[:2] == ["first (1)", "first (2)"]


def test_tiny_differences_are_not_blown_up(first, tmp_path):
    other = Path(shutil.copytree(first, tmp_path / "other"))
    rows = pd.read_csv(other / "trajectories.csv")
    rows.assign(speed_mps=rows.speed_mps + 1e-6).to_csv(other / "trajectories.csv", index=False)
    for axes in difference_figure(load(first), [load(other)], ["other"]).axes:
        low, high = axes.get_ylim()
        assert low <= -LEAST_AXIS
        assert high >= LEAST_AXIS
