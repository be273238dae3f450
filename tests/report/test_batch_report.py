"""The report of a batch says what runs.csv and summary.csv say, whole or not."""

from __future__ import annotations

import re
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from platoontraffic.analysis import load
from platoontraffic.cli.main import app
from platoontraffic.report.figures import heat_map, lines, values_of
from tests.report.test_report import Reader
from tests.support.browser import NoBrowser, chromium, nameless
from tests.support.made_runs import EVIL, made_batch, made_run

KEY, OTHER = "platoon.size", "platoon.follower.law"


@pytest.fixture
def batch(tmp_path) -> Path:
    return made_batch(tmp_path / "study", {KEY: [2, 3], OTHER: ["printed", EVIL]})


def report(folder: Path, *arguments: str) -> str:
    done = CliRunner().invoke(app, ["report", str(folder), *arguments])
    assert (done.exit_code, done.stderr) == (0, "")
    return Path(done.stdout.strip()).read_text(encoding="utf-8")


def test_it_is_one_sound_file_that_asks_for_nothing(batch):
    reader = Reader(report(batch))
    assert reader.open == []
    assert "script" not in reader.seen
    assert all(address.startswith("data:") for address in reader.addresses)


def test_it_lists_what_was_varied(batch):
    rows = Reader(report(batch)).rows
    assert [KEY, "2", "2, 3"] in rows
    assert [OTHER, "2", f"printed, {EVIL}"] in rows


def test_metrics_by_point_are_means_and_spreads_of_the_runs_that_are_done(batch):
    rows = Reader(report(batch)).rows
    assert ["2", "printed", "2", "2.5", "0.7071", "2", "3"] in rows  # the first seed failed: 2 and 3 remain
    assert ["3", "printed", "3", "22", "1", "21", "23"] in rows
    assert ["3", EVIL, "2", "31.5", "0.7071", "31", "32"] in rows  # the last seed is not done


def test_failed_runs_are_listed_with_their_errors_and_others_as_missing(batch):
    rows = Reader(report(batch)).rows
    assert ["run0-s1", "1", "2", "printed", f"{EVIL} is not a number"] in rows
    assert ["run3-s3", "3", "3", EVIL] in rows


@pytest.mark.parametrize(
    ("varied", "drawn"),
    [
        ({KEY: [2, 3]}, "over platoon.size"),
        ({OTHER: ["printed", EVIL, "tracking"]}, "over platoon.follower.law"),
        ({KEY: [2, 3], OTHER: ["printed", "tracking"]}, "over platoon.size and platoon.follower.law"),
        ({KEY: [2, 3], OTHER: ["a", "b"], "seedling": [True, False]}, "mean over all values of seedling"),
    ],
)
def test_pictures_suit_the_number_of_keys_and_are_files(varied, drawn, tmp_path):
    folder = made_batch(tmp_path / "study", varied)
    assert drawn in re.sub(r"\s+", " ", report(folder))
    assert (folder / "report-gap_mean_m.png").read_bytes().startswith(b"\x89PNG")
    assert (folder / "report-gap_mean_m.svg").read_bytes().startswith(b"<?xml")
    assert not (folder / "report-collisions.png").exists()  # the same in all runs


def test_of_shares_of_the_traffic_the_delay_of_everybody_is_drawn(tmp_path):
    """Vehicles that are no members are others at each share, and so is the mean of their delays."""
    folder = made_batch(tmp_path / "study", {"equip.share": [0.0, 0.5]})
    table = pd.read_csv(folder / "summary.csv")
    table["gap_min_m"] = table.gap_mean_m - 1
    table["traffic_delay_mean_finished_s"] = table["everybody_delay_mean_finished_s"] = table.gap_mean_m
    table.to_csv(folder / "summary.csv", index=False)
    report(folder)
    drawn = {file.stem for file in folder.glob("report-*.png")}
    assert drawn == {"report-everybody_delay_mean_finished_s", "report-gap_mean_m"}


def test_several_keys_have_lines_with_intervals_and_a_map(batch):
    assert "means with their 95 % intervals" in report(batch)
    assert (batch / "report-gap_mean_m-map.png").is_file()


def test_keys_of_whole_numbers_have_whole_numbers_at_their_axes(batch):
    table = load(batch)
    for made in (lines(table, [KEY, OTHER], "gap_mean_m", "m"), heat_map(table, KEY, OTHER, "gap_mean_m", "m")):
        made.canvas.draw()
        labels = made.axes[0].get_xticklabels()
        assert {label.get_text() for label in labels} >= {"2", "3"}
        assert {label.get_rotation() for label in labels} == {0}
        assert all(label.get_text().isdigit() for label in labels)


@pytest.mark.parametrize(
    ("out", "where", "folder", "words"),
    [
        ("results", ".", "results/study", "results/study/study.toml"),
        ("other", ".", "other/study", "other/study/study.toml --out other"),
        ("results", "results/study", ".", "study.toml --out .."),
    ],
)
def test_the_command_that_repeats_the_batch_writes_to_the_same_folder(tmp_path, monkeypatch, out, where, folder, words):
    made_batch(tmp_path / out / "study", {KEY: [2, 3]})
    monkeypatch.chdir(tmp_path / where)
    assert f"repeat it: platoontraffic batch {words}</p>" in report(Path(folder))


def test_the_command_is_that_of_any_folder_where_the_batch_is_named_by_its_whole_path(batch):
    assert f"repeat it: platoontraffic batch {batch}/study.toml --out {batch.parent}</p>" in report(batch)


def test_metrics_may_be_chosen(batch):
    report(batch, "--metric", "collisions,gap_mean_m")
    assert (batch / "report-collisions.svg").is_file()
    assert (batch / "report-collisions.svg").is_file()
    assert (batch / "report-gap_mean_m.svg").is_file()


def test_runs_that_a_running_batch_has_finished_since_are_in_its_report(batch):
    folder = batch / "run3-s3"
    folder.mkdir()
    (folder / "summary.csv").write_text(f"scenario,seed,{KEY},collisions,gap_mean_m\nx,3,3,0,77.5\n")
    rows = Reader(report(batch)).rows
    assert ["3", EVIL, "2", "31.5", "0.7071", "31", "32"] in rows  # it is not done yet
    (folder / "DONE").touch()
    rows = Reader(report(batch)).rows
    assert ["3", EVIL, "3", "46.83", "26.56", "31", "77.5"] in rows
    assert ["run3-s3", "3", "3", EVIL] not in rows


def test_it_says_that_the_seed_changes_nothing(tmp_path):
    folder = made_batch(tmp_path / "study", {KEY: [2, 3]})
    assert "the seed changes nothing" not in report(folder)
    table = pd.read_csv(folder / "summary.csv").assign(gap_mean_m=lambda t: t[KEY] + 0.25)
    table.to_csv(folder / "summary.csv", index=False)
    assert "the seed changes nothing" in report(folder)


def test_keys_that_move_together_are_one(tmp_path):
    folder = made_batch(tmp_path / "study", {KEY: [2, 3, 4]})
    for name in ("runs.csv", "summary.csv"):
        lines = (folder / name).read_text().splitlines()
        at = lines[0].split(",").index(KEY)
        rows = [line.split(",") for line in lines]
        rows = [[*row[: at + 1], "gap" if row[at] == KEY else f"g{row[at]}", *row[at + 1 :]] for row in rows]
        (folder / name).write_text("".join(",".join(row) + "\n" for row in rows))
    assert f"gap_mean_m over {KEY}: each run" in report(folder)


def test_the_same_batch_gives_the_same_bytes(batch, tmp_path):
    first = report(batch, "--to", str(tmp_path / "report.html"))
    assert report(batch, "--to", str(tmp_path / "report.html")) == first


@pytest.mark.parametrize(("failed", "waiting"), [(0, 12), (12, 0)])
def test_a_batch_without_a_run_that_is_done_has_a_report(failed, waiting, tmp_path):
    folder = made_batch(tmp_path / "study", {KEY: [2, 3, 4, 5]}, failed=failed, waiting=waiting)
    text = report(folder)
    assert ">12 of 12<" in text


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--metric", "gap_mean"], "--metric: 'gap_mean': no metric in summary.csv; did you mean 'gap_mean_m'?"),
        (["--to", "no/where.html"], "cannot be written: No such file or directory"),
    ],
)
def test_wrong_use_is_one_line(arguments, said, batch, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["report", str(batch), *arguments])
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert said in done.stderr


def test_a_run_has_no_metric_to_choose(tmp_path):
    folder = made_run(tmp_path / "run", seconds=1.0)
    done = CliRunner().invoke(app, ["report", str(folder), "--metric", "gap_mean_m"])
    assert (done.exit_code, done.stderr) == (2, "--metric: is only for batches; the report of a run has all metrics\n")


def test_a_folder_that_is_not_there_is_named_before_its_metric():
    done = CliRunner().invoke(app, ["report", "nosuch", "--metric", "gap_mean_m"])
    assert (done.exit_code, done.stderr) == (2, "nosuch: no such folder\n")


def test_a_batch_without_its_tables_is_one_line(batch):
    (batch / "runs.csv").unlink()
    done = CliRunner().invoke(app, ["report", str(batch)])
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert "runs.csv is missing" in done.stderr


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_in_a_browser_names_are_text_and_the_page_fits_a_phone(scheme, batch):
    report(batch)
    try:
        with chromium() as browser:
            tab = browser.new_context(viewport={"width": 390, "height": 800}, color_scheme=scheme).new_page()
            said = []
            tab.on("dialog", lambda dialog: said.append(dialog.message))
            tab.on("request", lambda request: said.append(request.url) if request.url.startswith("http") else None)
            tab.goto((batch / "report.html").as_uri())
            assert EVIL in tab.inner_text("h1")
            assert tab.evaluate("document.documentElement.scrollWidth") <= 390
            images = "[...document.images].every(image => image.complete && image.naturalWidth > 0)"
            assert tab.evaluate(images)
            assert nameless(tab) == []
            assert said == []
    except NoBrowser as error:
        pytest.skip(str(error))


def test_a_metric_of_which_no_run_has_a_value_is_said(batch):
    """There was no page, and it said that no run is done."""
    summary = pd.read_csv(batch / "summary.csv")
    summary["gap_mean_m"] = float("nan")
    summary.to_csv(batch / "summary.csv", index=False)
    assert "gap_mean_m: no run has a value of it." in report(batch, "--metric", "collisions,gap_mean_m")


def test_the_replay_of_a_batch_is_refused_in_a_line(batch):
    done = CliRunner().invoke(app, ["replay", str(batch)])
    assert done.exit_code == 2
    assert len(done.stderr.splitlines()) == 1
    assert "unexpected" not in done.stderr


@pytest.mark.parametrize(
    ("varied", "seeds", "said"),
    [
        ({}, 3, "None, because only the seed varies."),
        ({KEY: [2]}, 1, "None, because no key of the scenario varies."),
        ({KEY: [2, 3]}, 3, ""),
    ],
)
def test_why_there_is_no_picture_is_said(varied, seeds, said, tmp_path):
    """It was "no run is done", where all were."""
    folder = made_batch(tmp_path / "study", varied, seeds=seeds, failed=0, waiting=0)
    pictures = report(folder).partition("<h2>Pictures</h2>")[2].partition("<h2>")[0]
    assert re.findall("None, because [^<]*", pictures) == ([said] if said else [])
    assert ("--metric NAME,NAME" in pictures) == (not said)


def test_one_seed_has_no_intervals(tmp_path):
    folder = made_batch(tmp_path / "study", {KEY: [2, 3]}, seeds=1, failed=0, waiting=0)
    assert f"gap_mean_m over {KEY}: one seed, so without intervals" in report(folder)


def test_counts_have_exact_intervals_with_one_seed_too(tmp_path):
    """The picture had bars, and its caption said that there are none."""
    folder = made_batch(tmp_path / "study", {KEY: [2, 3]}, seeds=1, failed=0, waiting=0)
    package = folder / "datapackage.json"
    text = package.read_text(encoding="utf-8")
    package.write_text(
        text.replace('"name": "collisions"', '"name": "collisions", "statistic": "count"'), encoding="utf-8"
    )
    caption = f"collisions over {KEY}: each run, and means with their 95 % intervals"
    assert f"{caption}. Also as" in report(folder, "--metric", "collisions")


def leaders(*tables: str) -> list[str]:
    return [f'{{"law": "path", "speed_mps": 8.0, {table}}}' for table in tables]


@pytest.mark.parametrize(
    ("values", "labels", "meaning"),
    [
        (leaders('"amplitude_mps": 1.0', '"amplitude_mps": 2.0'), ["amplitude_mps = 1.0", "amplitude_mps = 2.0"], ""),
        (leaders('"a": {"b": [1, 2]}', '"a": {"b": [1, 3]}'), ["a.b.1 = 2", "a.b.1 = 3"], ""),
        (leaders('"a": 1', '"c": 1'), ["a = 1", "c = 1"], ""),
        (
            leaders('"amplitude_mps": 1.0, "rate_mps2": 4.0', '"amplitude_mps": 2.0, "rate_mps2": 5.0'),
            ["1", "2"],
            f"{OTHER}: 1: amplitude_mps = 1.0, rate_mps2 = 4.0; 2: amplitude_mps = 2.0, rate_mps2 = 5.0",
        ),
        (["x" * 40, "x" * 40 + "y"], ["1", "2"], f"{OTHER}: 1: {'x' * 40}; 2: {'x' * 40}y"),
        (["tracking", "printed"], ["tracking", "printed"], ""),
        ([True, False], ["true", "false"], ""),
        ([3, 1], ["1", "3"], ""),
    ],
)
def test_values_that_differ_have_labels_that_differ(values, labels, meaning, tmp_path):
    folder = made_batch(tmp_path / "study", {OTHER: values}, failed=0, waiting=0)
    found = values_of(load(folder), OTHER)
    assert (found.labels, found.meaning) == (labels, meaning)
    if meaning:
        assert meaning.replace('"', "&quot;") in report(folder)


@pytest.mark.parametrize(
    ("values", "style"), [(["tracking", "printed", "path"], "None"), ([True, False], "None"), ([1, 2, 3], "-")]
)
def test_only_numbers_are_joined(values, style, tmp_path):
    folder = made_batch(tmp_path / "study", {OTHER: values, KEY: ["a", "b"]}, failed=0, waiting=0)
    axes = lines(load(folder), [OTHER, KEY], "gap_mean_m", "m").axes[0]
    assert {container[0].get_linestyle() for container in axes.containers} == {style}
    first, second = (container[0].get_xdata() for container in axes.containers)
    assert (first != second).all() == (style == "None")  # otherwise equal values hide each other
    assert len(axes.get_xticklabels()) == len(values) or style == "-"


def test_a_heat_map_names_booleans_and_writes_numbers_out(tmp_path):
    folder = made_batch(tmp_path / "study", {"on": [True, False], KEY: [1, 2]}, failed=0, waiting=0)
    table = pd.read_csv(folder / "summary.csv").assign(gap_mean_m=6216.0)
    table.to_csv(folder / "summary.csv", index=False)
    axes = heat_map(load(folder), "on", KEY, "gap_mean_m", "m").axes[0]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["true", "false"]
    assert {text.get_text() for text in axes.texts} == {"6216"}
