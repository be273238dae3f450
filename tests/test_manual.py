"""The manual builds without a warning, and every code block of it and of the README runs, or says why not.

A comment before a block says what becomes of it:

    <!-- file: NAME -->        it is written to that file, for the blocks after it
    <!-- with: SCENARIO -->    tables that a shipped scenario may have besides
    <!-- dry: HOW LONG -->     its commands are given --dry-run, because they take so long
    <!-- not run: WHY -->      it is not run

All other blocks of `sh` and `python` run as they stand, those of a page one after another in one folder; `output` is
what the block before it prints.
"""

from __future__ import annotations

import itertools
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pandas as pd
import pytest
from typer.testing import CliRunner

from platoontraffic import shipped
from platoontraffic.cli.main import app
from platoontraffic.cli.net_sources import run_program
from platoontraffic.sumo.programs import program
from tests.support import ROOT
from tests.support.browser import NoBrowser, chromium

DOCS = ROOT / "docs"
PAGES = ["README.md", *sorted(str(page.relative_to(ROOT)) for page in DOCS.rglob("*.md") if "_build" not in page.parts)]
FENCE = re.compile(
    r"(?:^<!-- (?P<mark>file|with|dry|not run): (?P<text>[^\n]+) -->\n)?^```(?P<language>[^\n]+)\n(?P<code>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
CODE = ("sh", "python", "toml", "xml", "bat", "output")
ALONE = ("docs/start/own_network.md", "docs/start/first_study.md")  # tests of their own, in one folder


NAMELESS = """() => [...document.querySelectorAll("a[href], button, input, select, summary")]
    .filter((one) => one.checkVisibility())
    .filter((one) => ![one.ariaLabel, one.title, one.textContent, one.placeholder, one.labels?.[0]?.textContent,
                       ...[...one.querySelectorAll("img")].map((image) => image.alt)].some((name) => name?.trim()))
    .map((one) => one.outerHTML)"""  # controls without a name for a screen reader


class Block(NamedTuple):
    language: str
    code: str
    mark: str
    text: str  # of the mark


def blocks(page: str) -> list[Block]:
    found = FENCE.finditer((ROOT / page).read_text(encoding="utf-8"))
    return [Block(one["language"], one["code"], one["mark"] or "", one["text"] or "") for one in found]


def is_run(block: Block) -> bool:
    return block.mark != "not run" and (block.language in ("sh", "python") or block.mark == "with")


@pytest.mark.parametrize("page", PAGES)
def test_every_block_is_run_or_says_why_not(page):
    for block in blocks(page):
        assert block.language in (*CODE, "text") or block.language.startswith("{"), block
        if block.language in ("toml", "xml"):
            assert block.mark in ("file", "with", "not run"), block
        if block.language == "bat":
            assert block.mark == "not run", block


@pytest.mark.slow
@pytest.mark.sumo
@pytest.mark.parametrize("page", [page for page in PAGES if page not in ALONE and any(map(is_run, blocks(page)))])
def test_blocks_of_a_page_run(page, tmp_path, monkeypatch):
    run_all(page, tmp_path, monkeypatch)


@pytest.mark.slow
@pytest.mark.sumo
def test_a_platoon_on_your_own_network_arrives_without_contact(tmp_path, monkeypatch):
    pytest.importorskip("sumo", reason="netgenerate comes with eclipse-sumo: pip install platoontraffic[gui]")
    run_all(ALONE[0], tmp_path, monkeypatch)
    (lines,) = [block.code for block in blocks(ALONE[0]) if block.text == "platoon.toml"]
    assert lines in (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(lines.splitlines()) == 1 + 3
    (file,) = Path("results/city").glob("*/events.csv")
    events = pd.read_csv(file)
    assert not events.kind.isin(["collision", "red_light", "failed_to_yield", "off_road", "stranded"]).any()
    assert sorted(events.vehicle_id[events.kind == "arrived"]) == [f"platoon.{i}" for i in range(5)]
    assert (file.parent / "replay.html").is_file()


@pytest.mark.soak
@pytest.mark.sumo
def test_a_study_of_your_own_network_gives_a_figure(tmp_path, monkeypatch):
    pytest.importorskip("sumo", reason="netgenerate comes with eclipse-sumo: pip install platoontraffic[gui]")
    for page in ALONE:
        run_all(page, tmp_path, monkeypatch)
    assert Path("results/more_traffic/report.html").is_file()
    assert Path("more_traffic.png").stat().st_size > 5000


def test_your_own_follower_has_twenty_lines():
    for page in ("README.md", "docs/start/first_law.md"):
        (law,) = [block.code for block in blocks(page) if block.text == "my_follower.py"]
        assert len(law.strip().splitlines()) <= 20


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    pytest.importorskip("pydata_sphinx_theme", reason='pip install -e ".[docs]"')
    folder = tmp_path_factory.mktemp("site")
    options = ["-W", "--keep-going", "-q", "-d", folder / "trees"]
    sphinx = [sys.executable, "-m", "sphinx", *options, DOCS, folder / "html"]
    done = subprocess.run(sphinx, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    return folder / "html"


@pytest.mark.slow
def test_it_builds_without_a_warning_and_has_what_the_code_says(site):
    for page, text in {
        "scenario": "Time for which background traffic drives before",
        "study": "replications",
        "command_line": "--retry-failed",
        "laws": "time_headway_s",
        "sensors": "car-tracker",
        "tables": "right_of_middle_m",
        "events": "lock_regained",
        "metrics": "head_to_tail_accel_gain_l2",
        "shipped": "corridor_cut_in",
        "python": "remembered_path",
    }.items():
        assert text in (site / f"reference/{page}.html").read_text(encoding="utf-8"), page


@pytest.mark.slow
def test_its_pages_show_and_print_without_an_error(site):
    """On a phone and on screens, light and dark; nothing is fetched, nothing is wider than the page."""
    pages = ["index", "start/own_network", "reference/scenario", "results/speed", "explanation/loop"]
    said: list[str] = []
    try:
        with chromium() as browser:
            for scheme, width in itertools.product(("light", "dark"), (390, 1280, 1920)):
                tab = browser.new_context(viewport={"width": width, "height": 850}, color_scheme=scheme).new_page()
                tab.on("console", lambda message: said.append(message.text) if message.type == "error" else None)
                tab.on("pageerror", lambda error: said.append(str(error)))
                tab.on("request", lambda request: said.append(request.url) if request.url[:4] == "http" else None)
                tab.on("requestfailed", lambda request: said.append(request.url))
                for page in pages:
                    tab.goto((site / f"{page}.html").as_uri())
                    assert tab.evaluate("document.documentElement.scrollWidth") <= width, page
                    assert tab.evaluate(NAMELESS) == [], page
                tab.goto((site / f"{pages[width % 2]}.html").as_uri())
                assert tab.pdf().startswith(b"%PDF")
    except NoBrowser as reason:
        pytest.skip(str(reason))
    assert said == []


# ---- running blocks


def run_all(page: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    monkeypatch.setenv("MPLBACKEND", "agg")
    shutil.copytree(DOCS / "examples", folder / "docs" / "examples", dirs_exist_ok=True)
    printed = ""
    for block in blocks(page):
        if block.mark == "file":
            Path(block.text).parent.mkdir(exist_ok=True)
            Path(block.text).write_text(block.code, encoding="utf-8")
        elif block.language == "output":
            assert " ".join(printed.split()) == " ".join(block.code.split())
        elif block.mark == "with":
            scenario = shipped.scenarios()[block.text].read_text(encoding="utf-8")
            Path(f"with_{block.text}.toml").write_text(f"{scenario}\n{block.code}", encoding="utf-8")
            _command(f"platoontraffic check with_{block.text}.toml")
        elif is_run(block) and block.language == "python":
            if "gymnasium" in block.code:
                pytest.importorskip("gymnasium", reason='pip install -e ".[learn]"')
            done = subprocess.run([sys.executable, "-c", block.code], capture_output=True, text=True)
            assert done.returncode == 0, f"{block.code}\n{done.stderr}"
            printed = done.stdout
        elif is_run(block):
            lines = block.code.replace("\\\n", " ").splitlines()
            commands = [line for line in lines if line and not line.startswith("#")]
            printed = "".join(_command(line, "--dry-run" if block.mark == "dry" else None) for line in commands)


def _command(line: str, option: str | None = None) -> str:
    """What a command prints; option: one more."""
    name, *arguments = shlex.split(line, comments=True) + [option] * (option is not None)
    if name == "mkdir":
        Path(*arguments).mkdir()
        return ""
    if name == "netgenerate":
        done = run_program(program(name), *arguments, folder=Path())
        assert done.returncode == 0, done.stderr
        return done.stdout
    assert name == "platoontraffic", line
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, f"{line}\n{done.stderr}"
    return done.stdout
