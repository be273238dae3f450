"""What the README says is true: its commands, its example, its picture."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from tests.support import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", README, re.MULTILINE | re.DOTALL)


def test_there_is_one_command_to_run_and_one_to_test():
    run, test = (block.strip() for block in blocks("sh")[:2])
    assert run.startswith("python3 -m venv .venv && ")
    assert run.endswith("platoontraffic run paper_loop")
    assert test.startswith("python3 -m venv .venv && ")
    assert test.endswith("pytest")


def test_ten_lines_draw_a_scan(tmp_path, monkeypatch):
    text = (ROOT / "lidar/README.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    assert len([line for line in code.splitlines() if line]) <= 10
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    subprocess.run([sys.executable, "-c", code], check=True)
    assert (tmp_path / "scan.png").stat().st_size > 5000


@pytest.mark.parametrize("file", ["README.md", "lidar/README.md", "analysis/README.md", "CONTRIBUTING.md"])
def test_links_and_pictures_are_there(file):
    for target in re.findall(r"\]\(([^)#]+)\)", (ROOT / file).read_text(encoding="utf-8")):
        assert target.startswith("https://") or (ROOT / file).parent.joinpath(target).exists(), target
