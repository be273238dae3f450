"""The report says what the tables say."""

from __future__ import annotations

import html.parser
import re
import warnings
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from platoontraffic.analysis import load
from platoontraffic.cli.main import app
from platoontraffic.report import page
from platoontraffic.results import metrics
from tests.support.browser import NoBrowser, chromium, nameless
from tests.support.made_runs import EVIL, made_run


@pytest.fixture(scope="module")
def report(tmp_path_factory) -> Path:
    folder = made_run(tmp_path_factory.mktemp("results") / "ring" / "made")
    return page(folder, folder / "report.html")


class Reader(html.parser.HTMLParser):
    """Tags that stay open, addresses, and rows of tables."""

    void = frozenset({"meta", "link", "img", "br"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open, self.seen, self.addresses, self.rows = [], set(), [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.seen.add(tag)
        self.addresses += [value for name, value in attributes if name in ("src", "href")]
        if tag not in self.void:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("td", "th"):
            self.rows[-1][-1] += data


def test_it_is_one_sound_file_that_asks_for_nothing(report):
    reader = Reader(report.read_text(encoding="utf-8"))
    assert reader.open == []
    assert "script" not in reader.seen
    assert all(address.startswith("data:") for address in reader.addresses)


def test_events_and_metrics_are_those_of_the_tables(report):
    rows = Reader(report.read_text(encoding="utf-8")).rows
    results = load(report.parent)
    assert ["10", "wrong_target", "platoon.1", EVIL, "", ""] in rows  # time, kind, vehicle, other, duration, detail
    assert ["gap_mean", "m", "12", "12"] in rows
    listed = [row for row in rows if len(row) == 6 and re.fullmatch(r"[\d.]+", row[0])]
    assert len(listed) == len(results.events)


def test_many_members_are_not_named_one_by_one(tmp_path, monkeypatch):
    """With a limit of one member the made run's are many: places and shares of them, and the ends by name."""
    monkeypatch.setattr("platoontraffic.analysis.crowd.MOST", 1)
    folder = made_run(tmp_path / "ring" / "made")
    made = page(folder, folder / "report.html")
    names = {file.name for file in folder.glob("report-*.png")}
    assert {"report-road.png", "report-number.png", "report-slow.png"} <= names
    assert not names & {"report-strips.png", "report-lanes.png", "report-distribution.png"}
    rows = Reader(made.read_text(encoding="utf-8")).rows
    values = load(folder).metrics.query("scope == 'vehicle' and metric == 'gap_mean'").set_index("vehicle_id").value
    (row,) = [row for row in rows if row[0] == "gap_mean" and len(row) == 8]
    assert row[1:4] == ["m", str(len(values)), f"{values.min():.4g} ({values.idxmin()})"]


def test_pictures_are_there_as_files(report):
    for name, start in (("png", b"\x89PNG"), ("svg", b"<?xml")):
        for what in ("road", "strips", "acceleration", "distribution"):
            assert (report.parent / f"report-{what}.{name}").read_bytes().startswith(start)


@pytest.fixture(scope="module")
def browser():
    try:
        with chromium() as started:
            yield started
    except NoBrowser as error:
        pytest.skip(str(error))


def test_nothing_is_lost_on_paper(report, browser):
    """On A4 less its margins, no table and no picture is wider than the page."""
    sheet = browser.new_page(viewport={"width": 698, "height": 1000})
    sheet.emulate_media(media="print")
    sheet.goto(report.as_uri())
    right = "[...document.querySelectorAll('table, img')].map(e => e.getBoundingClientRect().right)"
    assert max(sheet.evaluate(right)) <= 698


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_fits_every_screen_and_a_reader_has_a_name_for_all_of_it(report, browser, scheme):
    context, said = browser.new_context(color_scheme=scheme), []
    tab = context.new_page()
    tab.on("console", lambda message: said.append(message.text) if message.type in ("error", "warning") else None)
    tab.on("pageerror", lambda error: said.append(str(error)))
    for width in (390, 1280, 1920):
        tab.set_viewport_size({"width": width, "height": 900})
        tab.goto(report.as_uri())
        assert tab.evaluate("document.documentElement.scrollWidth") <= width
    assert (nameless(tab), said) == ([], [])
    tab.emulate_media(media="print")
    assert tab.evaluate("getComputedStyle(document.body).color") == "rgb(22, 24, 29)"
    context.close()


def test_the_command_that_repeats_the_run_writes_to_the_same_folder(report):
    said = f"repeat it: platoontraffic run {report.parent}/config.toml --out {report.parents[2]} --force</p>"
    assert said in report.read_text(encoding="utf-8")


def test_the_same_run_gives_the_same_bytes(report, tmp_path):
    page(report.parent, tmp_path / "report.html")
    for file in tmp_path.iterdir():
        assert file.read_bytes() == (report.parent / file.name).read_bytes(), file.name


@pytest.mark.parametrize("members", [1, 2])
def test_a_leader_alone_and_a_pair_have_a_report(members, tmp_path):
    folder = made_run(tmp_path / "run", members=members, seconds=2.0, traffic_every=None, scans_every=None)
    assert page(folder, folder / "report.html").is_file()


@pytest.mark.sumo
def test_every_metric_of_a_run_is_explained_in_its_report(one_corner, tmp_path):
    done = CliRunner().invoke(app, ["report", str(one_corner), "--to", str(tmp_path / "report.html")])
    assert done.exit_code == 0, done.stderr
    rows = {tuple(row[:1]): row for row in Reader((tmp_path / "report.html").read_text(encoding="utf-8")).rows}
    for name in load(one_corner).metrics.dropna(subset="value").metric.unique():
        assert rows[(name,)][-1], name


def test_metrics_over_members_name_the_metric_of_the_members():
    meanings = metrics.meanings()
    assert meanings["vehicle"]["ttc_min"] == "minimum of ttc_s over all steps"
    assert meanings["run"]["laps_min"].startswith(
        "least value over the members of laps: |turned_rad| / 2 pi at the end"
    )


def test_it_says_which_of_several_platoons_its_pictures_show(tmp_path):
    folder = made_run(tmp_path / "run", seconds=2.0)
    rows = pd.read_csv(folder / "trajectories.csv")
    small = rows[rows.place < 2]
    small = small.assign(platoon_id="late", vehicle_id="late." + small.place.astype(str))
    pd.concat([rows, small]).to_csv(folder / "trajectories.csv", index=False)
    said = re.findall("<figcaption>(.*?)</figcaption>", page(folder, folder / "report.html").read_text())
    assert "the other members in grey" in said[0]
    assert all("; shows platoon, the largest of 2 platoons" in caption for caption in said[1:])


def test_its_pictures_show_a_platoon_and_not_the_members_that_are_in_none(tmp_path):
    """They outnumber each platoon, and have its table's id, the place 0 and no gaps."""
    folder = made_run(tmp_path / "run", seconds=2.0)
    rows = pd.read_csv(folder / "trajectories.csv")
    leader = rows[rows.place == 0]
    alone = [leader.assign(platoon_id="equip", vehicle_id=f"alone.{i}", gap_m=float("nan")) for i in range(5)]
    pd.concat([*alone, rows]).to_csv(folder / "trajectories.csv", index=False)
    said = re.findall("<figcaption>(.*?)</figcaption>", page(folder, folder / "report.html").read_text())
    assert "the other members in grey" in said[0]
    assert all("; shows platoon, the only one with followers" in caption for caption in said[1:])
    answer = CliRunner().invoke(app, ["plot", str(folder)])
    assert answer.exit_code == 0, answer.output


def test_a_run_of_one_instant_has_a_report_without_warnings(tmp_path):
    folder = made_run(tmp_path / "run", seconds=0.0)
    with warnings.catch_warnings(action="error"):
        page(folder, folder / "report.html")
