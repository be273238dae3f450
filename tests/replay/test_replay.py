"""The replay's page in a browser: what it draws is what the tables say."""

from __future__ import annotations

import gzip
import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from typer.testing import CliRunner

from platoontraffic.analysis import ResultsError, load
from platoontraffic.cli.main import _finish_run, app
from platoontraffic.errors import InputError
from platoontraffic.replay import page, page_of_two
from platoontraffic.replay.columns import Columns
from platoontraffic.replay.content import packed
from tests.support.browser import NoBrowser, chromium, nameless, until
from tests.support.made_runs import EVIL, LASER, LENGTH, RADIUS, REMEMBERED, angle, made_run, other_pose, pose

# When the first follower's heading goes from π to -π.
ACROSS = (np.pi / 2 - angle(1, 0.0)) / (angle(1, 1.0) - angle(1, 0.0))
CENTIMETRE = 0.01  # to which the page knows places of cars [m]


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """A folder with a run, and its page."""
    folder = made_run(tmp_path_factory.mktemp("results") / "ring" / "made")
    page(folder, folder / "replay.html")
    return folder


# ---- what is written for the page


def unpacked(data: bytes) -> tuple[dict, bytes]:
    whole = gzip.decompress(data)
    n = int.from_bytes(whole[:4], "little")
    return json.loads(whole[4 : 4 + n]), whole[4 + n :]


def read(place: dict, content: bytes) -> np.ndarray:
    """A column, read independently of the page."""
    n = place["n"]
    planes = [np.frombuffer(content, np.uint8, n, place["at"] + i * n).astype(int) for i in range(place["planes"])]
    signed = sum(plane << (8 * i) for i, plane in enumerate(planes))
    whole = np.cumsum(np.where(signed % 2, -(signed + 1) // 2, signed // 2)).astype(float)
    if "lowest" in place:
        whole = np.where(whole == 0, np.nan, whole - 1 + place["lowest"])
    return whole * place["step"]


@pytest.mark.parametrize("scale", [1.0, 1e3, 1e7])
def test_columns_come_back_to_half_a_step(scale):
    rng = np.random.default_rng(1)
    columns, given = Columns(), [scale * rng.normal(size=100), np.array([]), scale * rng.normal(size=7)]
    given[2][[0, 3, 6]] = np.nan
    places = [columns.add(values, 0.01) for values in given]
    _, content = unpacked(columns.packed({}))
    for place, values in zip(places, given, strict=True):
        np.testing.assert_allclose(read(place, content), values, rtol=0, atol=0.005 * (1 + 1e-6))


def test_a_scan_is_written_with_all_that_a_range_can_be(tmp_path):
    folder = made_run(tmp_path / "run", seconds=1.0)
    with np.load(folder / "scans.npz") as archive:
        parts = dict(archive)
    parts["ranges_m"][:3] = np.inf, -np.inf, np.nan
    np.savez(folder / "scans.npz", **parts)
    header, content = unpacked(packed(load(folder)))
    ranges = read(header["scans"]["ranges"], content)
    assert ranges[:3].tolist() == [0, 1, 2]
    finite = np.isfinite(parts["ranges_m"][:720])
    step = 30.0 / header["scans"]["rangeSteps"]
    np.testing.assert_allclose((ranges[:720][finite] - 3) * step, parts["ranges_m"][:720][finite], atol=step / 2 + 1e-6)


def test_the_same_run_gives_the_same_page(made, tmp_path):
    again = page(made, tmp_path / "again.html")
    assert again.read_bytes() == (made / "replay.html").read_bytes()


# ---- in the browser


@pytest.fixture(scope="module")
def browser():
    try:
        with chromium() as started:
            yield started
    except NoBrowser as error:
        pytest.skip(str(error))


@pytest.fixture
def opened(browser):
    """Opens a page from disk; afterwards nothing must have gone wrong in it, and nothing been asked of a network."""
    contexts, said, asked = [], [], []

    def open_page(file: Path, **context):
        contexts.append(browser.new_context(**({"viewport": {"width": 1280, "height": 860}} | context)))
        tab = contexts[-1].new_page()
        tab.on("console", lambda message: said.append(message.text) if message.type in ("error", "warning") else None)
        tab.on("pageerror", lambda error: said.append(str(error)))
        tab.on("dialog", lambda dialog: said.append(f"dialog: {dialog.message}"))
        tab.on("request", lambda request: asked.append(request.url))
        tab.goto(file.as_uri())
        until(tab, "window.replay?.drawn")
        return tab

    yield open_page
    for context in contexts:
        context.close()
    assert said == []
    assert [url for url in asked if not url.startswith("file://")] == []
    assert len(asked) == len(contexts)


def seek(tab, time: float) -> dict:
    tab.evaluate("t => { slider.value = t; slider.dispatchEvent(new Event('input')); }", time)
    until(tab, "t => Math.abs(replay.drawn.time - t) < 1e-3", time)
    return tab.evaluate("replay")


def member(state: dict, name: str) -> dict:
    return next(m for m in state["drawn"]["members"] if m["id"] == name)


def turn(a: float, b: float) -> float:
    return abs((a - b + np.pi) % (2 * np.pi) - np.pi)


def test_a_browser_without_a_base64_of_its_own_reads_the_same(browser, made):
    context = browser.new_context()
    context.add_init_script("delete Uint8Array.fromBase64")
    tab = context.new_page()
    tab.goto((made / "replay.html").as_uri())
    until(tab, "window.replay?.drawn")
    assert len(tab.evaluate("replay.drawn.members")) == 3
    context.close()


@pytest.mark.parametrize("time", [0.0, 6.3, 12.8, 20.0])
def test_members_are_drawn_where_the_table_has_them(opened, made, time):
    state = seek(opened(made / "replay.html"), time)
    rows = pd.read_csv(made / "trajectories.csv")
    for row in rows[np.isclose(rows.time_s, time)].itertuples():
        drawn = member(state, row.vehicle_id)
        assert np.hypot(drawn["x"] - row.x_m, drawn["y"] - row.y_m) < CENTIMETRE
        assert turn(drawn["heading"], row.heading_rad) < 1e-3


@pytest.mark.parametrize("time", [6.35, ACROSS])
def test_between_recorded_instants_vehicles_are_in_between(opened, made, time):
    state = seek(opened(made / "replay.html"), time)
    x, y, heading = pose(angle(1, time))
    drawn = member(state, "platoon.1")
    assert np.hypot(drawn["x"] - x, drawn["y"] - y) < CENTIMETRE
    assert turn(drawn["heading"], heading) < 2e-3


def test_it_plays_and_pauses(opened, made):
    tab = opened(made / "replay.html")
    tab.get_by_role("button", name="Play").click()
    until(tab, "replay.time > 0.3")
    tab.get_by_role("button", name="Pause").click()
    state = tab.evaluate("replay")
    assert not state["playing"]
    x, y, _ = pose(angle(1, state["time"]))
    assert np.hypot(member(state, "platoon.1")["x"] - x, member(state, "platoon.1")["y"] - y) < 0.2
    tab.wait_for_timeout(200)
    assert tab.evaluate("replay.time") == state["time"]


def test_faster_is_faster(opened, made):
    tab = opened(made / "replay.html")
    tab.locator("#speed").select_option("10")
    tab.keyboard.press("Escape")
    tab.get_by_role("button", name="Play").click()
    tab.wait_for_timeout(700)
    assert tab.evaluate("replay.time") > 3
    until(tab, "!replay.playing")
    assert tab.evaluate("replay.time") == 20.0  # and stops at the end


def test_steps_go_from_recorded_instant_to_instant_and_with_shift_from_scan_to_scan(opened, made):
    tab = opened(made / "replay.html")
    times = []
    for key in ("ArrowRight", "ArrowRight", "ArrowLeft", "Shift+ArrowRight", "Shift+ArrowRight", "Shift+ArrowLeft"):
        tab.keyboard.press(key)
        times.append(round(tab.evaluate("replay.time"), 6))
    assert times == [0.1, 0.2, 0.1, 0.5, 1.0, 0.5]


def test_an_event_in_the_list_jumps_there_and_shows_who_is_taken_for_the_predecessor(opened, made):
    tab = opened(made / "replay.html")
    tab.get_by_role("button", name="wrong target").click()
    until(tab, "replay.drawn.time === 10")
    state = tab.evaluate("replay")
    row = pd.read_csv(made / "trajectories.csv").query("vehicle_id == 'platoon.1' and time_s == 10").iloc[0]
    assert state["chosen"] == row.vehicle_id
    target = state["drawn"]["target"]
    assert (target["id"], target["right"]) == (row.target_id, False) == (EVIL, False)
    laser = np.array([row.x_m, row.y_m]) + LASER * np.array([np.cos(row.heading_rad), np.sin(row.heading_rad)])
    bearing = row.heading_rad + row.seen_bearing_rad
    distance = row.seen_gap_m + LENGTH / 2 - LASER  # the gap is from the bumper, the bearing from the laser
    seen = laser + distance * np.array([np.cos(bearing), np.sin(bearing)])
    np.testing.assert_allclose([target["x"], target["y"]], seen, atol=0.03)
    tab.keyboard.press("n")
    assert tab.evaluate("replay.time") == 13.5
    assert tab.evaluate("replay.chosen") == "platoon.2"
    tab.keyboard.press("p")
    assert tab.evaluate("replay.time") == 10


def test_a_mark_over_the_slider_jumps_too(opened, made):
    tab = opened(made / "replay.html")
    box = tab.locator("#marks").bounding_box()
    tab.locator("#marks").click(position={"x": box["width"] * 13.5 / 20 + 3, "y": box["height"] / 2})
    assert tab.evaluate("replay.time") == 13.5


def test_another_vehicle_is_followed(opened, made):
    tab = opened(made / "replay.html")
    assert tab.evaluate("replay.chosen") == "platoon.1"
    tab.get_by_role("button", name="platoon.2").first.click()
    state = seek(tab, 5.0)
    assert (state["chosen"], state["follows"]) == ("platoon.2", "platoon.2")
    row = pd.read_csv(made / "trajectories.csv").query("vehicle_id == 'platoon.2' and time_s == 5").iloc[0]
    np.testing.assert_allclose(state["centre"], [row.x_m, row.y_m], atol=CENTIMETRE)
    assert state["drawn"]["target"]["id"] == "platoon.1"
    tab.keyboard.press("0")  # the number on the vehicle
    assert tab.evaluate("replay.chosen") == "platoon.0"


@pytest.mark.parametrize(("members", "listed"), [(20, 20), (21, 1)])
def test_of_a_crowd_only_the_chosen_one_is_listed_and_all_are_drawn(opened, tmp_path, members, listed):
    folder = made_run(tmp_path / "run", members=members, seconds=2.0)
    tab = opened(page(folder, folder / "replay.html"))
    assert tab.locator("#members tbody tr").count() == listed
    assert tab.locator("#crowd").is_visible() == (listed == 1)
    assert len(tab.evaluate("replay.drawn.members")) == members
    tab.evaluate("location.hash = '#t=1&member=platoon.7'")
    until(tab, "replay.chosen === 'platoon.7'")
    assert "platoon.7" in tab.locator("#members tbody").inner_text()


def test_a_link_leads_to_a_time_and_a_member(opened, made):
    tab = opened(made / "replay.html")
    tab.evaluate("location.hash = '#t=12.5&member=platoon.2'")
    until(tab, "replay.time === 12.5 && replay.chosen === 'platoon.2'")
    seek(tab, 7.0)
    until(tab, "location.hash === '#t=7&member=platoon.2'")


def test_what_is_pointed_at_has_name_speed_and_kind(opened, made):
    tab = opened(made / "replay.html")
    tab.keyboard.press("Home")
    state = seek(tab, 3.0)
    x, y, _ = other_pose(7, 3.0, 20)
    box = tab.locator("#map").bounding_box()
    tab.mouse.move(
        box["x"] + box["width"] / 2 + (x - state["centre"][0]) * state["scale"],
        box["y"] + box["height"] / 2 - (y - state["centre"][1]) * state["scale"],
    )
    until(tab, "!tip.hidden")
    assert tab.locator("#tip").inner_text().startswith("car.7: 11.00 m/s, background traffic, ")


def test_a_measured_length_is_that_on_the_road(opened, made):
    tab = opened(made / "replay.html")
    tab.keyboard.press("m")
    box = tab.locator("#map").bounding_box()
    tab.mouse.move(box["x"] + 100, box["y"] + 100)
    tab.mouse.down()
    tab.mouse.move(box["x"] + 130, box["y"] + 140, steps=4)
    tab.mouse.up()
    assert tab.evaluate("replay.rule * replay.scale") == pytest.approx(50, abs=0.01)


def test_values_are_shown_where_a_strip_is_pointed_at(opened, made):
    tab = opened(made / "replay.html")
    strip = tab.locator(".strip canvas").nth(1)
    box = strip.bounding_box()
    strip.hover(position={"x": 44 + (box["width"] - 52) / 2, "y": 20})
    until(tab, "document.querySelectorAll('.strip output')[1].textContent.startsWith('10.0 s  0: ')")


def test_a_page_without_area_recovers(browser, opened, made, tmp_path):
    """As in a part of a page that is folded at first."""
    frame = "<iframe src='{}' style='width:0;height:0;border:0'></iframe>".format((made / "replay.html").as_uri())
    (tmp_path / "folded.html").write_text(frame)
    tab = browser.new_page()
    failed = []
    tab.on("pageerror", lambda error: failed.append(str(error)))
    tab.goto((tmp_path / "folded.html").as_uri())
    tab.wait_for_timeout(500)
    tab.evaluate("Object.assign(document.querySelector('iframe').style, {width: '900px', height: '800px'})")
    until(tab.frames[1], "window.replay?.drawn && replay.scale > 1")
    tab.close()
    assert failed == []


def test_two_runs_play_together(browser, made, tmp_path):
    other = made_run(tmp_path / "other", seconds=20.0)
    done = CliRunner().invoke(app, ["replay", str(made), "--beside", str(other), "--to", str(tmp_path / "two.html")])
    assert (done.exit_code, done.stderr) == (0, "")
    tab, failed = browser.new_page(viewport={"width": 1600, "height": 800}), []
    tab.on("pageerror", lambda error: failed.append(str(error)))
    tab.on("console", lambda message: failed.append(message.text) if message.type == "error" else None)
    tab.goto((tmp_path / "two.html").as_uri())
    first, second = tab.frames[1:]
    for frame in (first, second):
        until(frame, "window.replay?.drawn")
    assert first.evaluate("replay.time") == second.evaluate("replay.time") == 0
    tab.goto((tmp_path / "two.html").as_uri() + "#t=12.5")
    tab.reload()
    first, second = tab.frames[1:]
    for frame in (first, second):
        until(frame, "window.replay?.drawn && replay.time === 12.5")
    seek(first, 4.0)
    until(second, "replay.time === 4")
    second.locator("#play").click()
    until(first, "replay.playing && replay.time > 4.1")
    first.locator("#play").click()
    until(second, "!replay.playing")
    assert first.evaluate("replay.time") == second.evaluate("replay.time")
    tab.close()
    assert failed == []


@pytest.fixture
def pair(browser, tmp_path):
    """Pages side by side: the frame of each of two runs, of 4 and of 12 s."""
    first, second = (made_run(tmp_path / name, seconds=seconds) for name, seconds in (("short", 4.0), ("long", 12.0)))
    rows = pd.read_csv(second / "trajectories.csv")
    rows[rows.time_s >= 1.0].to_csv(second / "trajectories.csv", index=False)
    tab = browser.new_page(viewport={"width": 1600, "height": 800})
    tab.goto(page_of_two(first, second, tmp_path / "two.html").as_uri())
    for frame in tab.frames[1:]:
        until(frame, "window.replay?.drawn")
    yield tab.frames[1:]
    tab.close()


def times(pair) -> list[float]:
    return [frame.evaluate("replay.time") for frame in pair]


def test_the_shorter_of_two_runs_waits_at_its_end(pair):
    short, long = pair
    long.locator("#slider").evaluate("s => { s.value = 8; s.dispatchEvent(new Event('input')); }")
    until(short, "replay.time === 4")
    long.locator("#play").click()
    until(long, "replay.time > 8.3")
    assert times(pair)[0] == 4.0  # it had begun again
    assert not short.evaluate("replay.playing")
    long.locator("#slider").evaluate("s => { s.value = 2; s.dispatchEvent(new Event('input')); }")
    until(short, "replay.playing && replay.time > 2.2 && replay.time < 4")
    long.locator("#play").click()
    until(short, "!replay.playing")  # while they play, a busy machine draws one later than the other
    assert times(pair)[1] == times(pair)[0]


def test_a_run_that_begins_later_waits_for_the_other(pair):
    short, long = pair
    seek(short, 0.0)
    until(long, "replay.time === 0 && replay.drawn.time === 0")
    assert long.evaluate("replay.drawn.members") == []
    short.locator("#play").click()
    until(short, "replay.time > 0.4")
    short.locator("#play").click()
    until(long, "!replay.playing")
    assert times(pair)[1] == times(pair)[0]


@pytest.mark.parametrize("name", ["run.gif", "frames"])
def test_a_video_has_a_frame_for_each_tenth_of_its_seconds(name, tmp_path):
    folder = made_run(tmp_path / "run", seconds=2.0)
    done = CliRunner().invoke(app, ["replay", str(folder), "--video", str(tmp_path / name), "--speed", "5"])
    assert (done.exit_code, done.stderr) == (0, "")
    if name == "frames":
        assert len(list((tmp_path / name).glob("*.png"))) == 5
    else:
        with Image.open(tmp_path / name) as image:
            assert (image.n_frames, image.info["duration"]) == (5, 100)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--video", "run.avi"], "--video: 'run.avi': must end in .gif, .mp4 or .webm, or be a folder for frames"),
        (["--video", "run.gif", "--speed", "0"], "--speed: 0: must be positive"),
        (["--video", "run.gif", "--speed", "inf"], "--speed: inf: must be positive and finite"),
        (["--video", "run.gif", "--to", "run.html"], "--video: cannot be with --to, --vehicle or --beside"),
    ],
)
def test_what_is_no_video_is_said_in_a_line(arguments, said, made):
    done = CliRunner().invoke(app, ["replay", str(made), *arguments])
    assert done.exit_code == 2
    assert done.stderr.startswith(said)


def test_traffic_lights_have_the_states_of_the_table(opened, tmp_path):
    folder = made_run(tmp_path / "run", seconds=10.0)
    scene = json.loads((folder / "scene.geojson").read_text())
    lines = [[[RADIUS, 0.0], [RADIUS + 3, 0.0]], [[0.0, RADIUS], [0.0, RADIUS + 3]]]
    scene["features"].append({"type": "Feature", "properties": {"kind": "signals", "links": [["a", 0], ["a", 1]]},
                              "geometry": {"type": "MultiLineString", "coordinates": lines}})  # fmt: skip
    (folder / "scene.geojson").write_text(json.dumps(scene))
    (folder / "sumo_signals.csv").write_text("time_s,signal_id,state\n0,a,Gr\n4,a,yr\n6,a,gG\n")
    page(folder, folder / "replay.html")
    tab = opened(folder / "replay.html")
    assert [seek(tab, time)["drawn"]["signals"] for time in (1.0, 3.9, 4.0, 6.0)] == [1, 1, 0, 2]


def test_a_press_on_a_stranger_follows_it(opened, made):
    tab = opened(made / "replay.html")
    tab.keyboard.press("Home")
    state = seek(tab, 3.0)
    x, y, _ = other_pose(7, 3.0, 20)
    box = tab.locator("#map").bounding_box()
    tab.locator("#map").click(
        position={
            "x": box["width"] / 2 + (x - state["centre"][0]) * state["scale"],
            "y": box["height"] / 2 - (y - state["centre"][1]) * state["scale"],
        }
    )
    assert tab.evaluate("replay.follows") == "car.7"


def test_dragging_moves_the_map_and_lets_go(opened, made):
    tab = opened(made / "replay.html")
    before = tab.evaluate("replay")
    box = tab.locator("#map").bounding_box()
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    tab.mouse.move(*middle)
    tab.mouse.down()
    tab.mouse.move(middle[0] + 100, middle[1] + 50, steps=5)
    tab.mouse.up()
    state = tab.evaluate("replay")
    assert state["follows"] is None
    moved = np.subtract(state["centre"], before["centre"]) * state["scale"]
    np.testing.assert_allclose(moved, [-100, 50], atol=0.5)
    tab.mouse.wheel(0, -300)
    until(tab, "s => replay.scale > 1.2 * s", state["scale"])


def test_two_fingers_zoom_and_one_moves(opened, made):
    tab = opened(made / "replay.html", viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    tab.locator("#map").scroll_into_view_if_needed()
    box = tab.locator("#map").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    hand = tab.context.new_cdp_session(tab)

    def touch(kind: str, *offsets: tuple[float, float]) -> None:
        points = [{"x": x + dx, "y": y + dy, "id": i} for i, (dx, dy) in enumerate(offsets)]
        hand.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    before = tab.evaluate("replay.scale")
    touch("touchStart", (-40, 0), (40, 0))
    for apart in (50, 60, 70, 80):
        touch("touchMove", (-apart, 0), (apart, 0))
    touch("touchEnd")
    assert 1.6 < tab.evaluate("replay.scale") / before <= 2.1
    assert tab.evaluate("replay.follows") == "platoon.1"
    touch("touchStart", (0, 0))
    for dx in (10, 20, 40):
        touch("touchMove", (dx, 0))
    touch("touchEnd")
    assert tab.evaluate("replay.follows") is None


def test_the_scan_is_that_of_the_archive(opened, made):
    state = seek(opened(made / "replay.html"), 5.2)
    with np.load(made / "scans.npz") as archive:
        which = np.flatnonzero((archive["time_s"] == 5.0) & (archive["vehicle_id"][archive["vehicle"]] == "platoon.1"))
        begin, end = archive["offset"][which[0] : which[0] + 2]
        returns = np.isfinite(archive["ranges_m"][begin:end]).sum()
    scan = state["drawn"]["scan"]
    assert (scan["time"], scan["beams"], scan["returns"]) == (5.0, 720, returns)
    assert returns > 100
    assert scan["segments"] >= 1


def test_a_member_with_two_lasers_shows_the_scan_of_its_law(opened, tmp_path):
    folder = made_run(tmp_path / "run", seconds=6.0)
    with np.load(folder / "scans.npz") as archive:
        parts = dict(archive)
    n = len(parts["vehicle_id"])
    of_lasers = {name: np.concatenate([parts[name]] * 2) for name in parts if len(parts[name]) == n}
    of_lasers["laser"] = np.repeat(["lidar", "around"], n)
    np.savez(folder / "scans.npz", **parts | of_lasers)
    scan = seek(opened(page(folder, folder / "replay.html")), 5.2)["drawn"]
    assert (scan["scan"]["time"], scan["scan"]["beams"], scan["remembered"]) == (5.0, 720, REMEMBERED)


def test_what_is_seen_with_a_layer_is_gone_without_it(opened, made):
    tab = opened(made / "replay.html")
    assert tab.evaluate("replay.drawn.traffic") > 0
    for name in ("Beams and returns", "Target of the law", "Background traffic"):
        tab.get_by_label(name).uncheck()
    until(tab, "replay.drawn.traffic === 0 && !replay.drawn.scan && !replay.drawn.target")


def test_a_remembered_path_is_written_where_it_is(made):
    header, content = unpacked(packed(load(made)))
    scans, path = header["scans"], header["scans"]["path"]
    offset = read(path["offset"], content).astype(int)
    laser, time = read(scans["laser"], content), read(scans["time"], content)
    (i,) = np.flatnonzero((laser == 1) & (np.abs(time - 5.0) < 1e-6))
    rows = slice(offset[i], offset[i + 1])
    points = np.column_stack([read(path[name], content)[rows] for name in "xy"]) + header["origin"]
    along = angle(1, 5.0) + np.linspace(0, angle(0, 5.0) - angle(1, 5.0), REMEMBERED)
    assert points == pytest.approx(np.column_stack(pose(along)[:2]), abs=2.5 * CENTIMETRE)


def test_the_path_that_a_law_remembers_is_a_layer(opened, made):
    tab = opened(made / "replay.html")
    seek(tab, 5.0)
    assert tab.evaluate("replay.drawn.remembered") == REMEMBERED
    tab.get_by_label("Remembered path").uncheck()
    until(tab, "replay.drawn.remembered === 0")


def test_laws_that_tell_no_path_have_no_layer_of_it(opened, tmp_path):
    folder = made_run(tmp_path / "run", seconds=2.0)
    with np.load(folder / "scans.npz") as archive:
        columns = {name: archive[name] for name in archive if not name.startswith("path")}
    np.savez(folder / "scans.npz", **columns)
    tab = opened(page(folder, tmp_path / "replay.html"))
    assert tab.get_by_label("Remembered path (not recorded)").is_disabled()
    assert tab.evaluate("replay.drawn.remembered") == 0


@pytest.mark.parametrize("kind", ["cut_in", "red_light_run", "collision", "split", "levitated"])
def test_every_kind_of_event_has_a_mark_and_its_name_known_here_or_not(kind, opened, tmp_path):
    folder = made_run(tmp_path / "run", seconds=5.0)
    with (folder / "events.csv").open("a") as file:
        file.write(f"3.0,{kind},platoon.1,,,,0.0,0.0\n")
    tab = opened(page(folder, tmp_path / "replay.html"))
    item = tab.locator(f'#events [data-kind="{kind}"]')
    assert kind.replace("_", " ") in item.inner_text()
    assert item.locator(".bad, .warn").count() == 1
    box = tab.locator("#marks").bounding_box()
    tab.mouse.move(box["x"] + box["width"] * 3 / 5, box["y"] + box["height"] / 2)
    until(tab, f"document.getElementById('marks').title.includes({kind.replace('_', ' ')!r})")


def test_a_name_that_is_a_script_is_text(opened, made):
    tab = opened(made / "replay.html")
    seek(tab, 11.0)
    assert EVIL in tab.locator("#members").inner_text()
    assert EVIL in tab.locator("#events").inner_text()
    assert EVIL in tab.locator("h1").inner_text()
    assert tab.locator("script").count() == 1  # the page's own; that of the data has gone
    assert "alert" not in (made / "replay.html").read_text(encoding="utf-8").split("<style>")[0]


def test_strips_lead_and_follow(opened, made):
    tab = opened(made / "replay.html")
    strip = tab.locator(".strip canvas").nth(1)
    box = strip.bounding_box()
    strip.click(position={"x": 44 + (box["width"] - 52) / 4, "y": 20})
    assert abs(tab.evaluate("replay.time") - 5.0) < 0.1


def test_a_strip_without_any_value_is_left_out(opened, tmp_path):
    """A member without a predecessor has no gap, as those that come singly from the traffic."""
    for members, shown in ((1, ["speed [m/s]"]), (21, ["gap [m]", "speed [m/s]", "spacing error [m]"])):
        folder = made_run(tmp_path / f"{members}", members=members, seconds=2.0)
        tab = opened(page(folder, folder / "replay.html"))
        assert tab.locator(".strip span:visible").all_inner_texts() == shown
    tab.evaluate("location.hash = '#t=1&member=platoon.0'")
    until(tab, "replay.chosen === 'platoon.0'")
    assert tab.locator(".strip span:visible").all_inner_texts() == ["speed [m/s]"]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_on_a_phone_nothing_is_wider_than_the_screen(opened, made, scheme):
    tab = opened(
        made / "replay.html",
        viewport={"width": 390, "height": 844},
        has_touch=True,
        is_mobile=True,
        color_scheme=scheme,
    )
    assert tab.evaluate("document.documentElement.scrollWidth") <= 390
    assert tab.locator("#play").bounding_box()["height"] >= 44
    tab.locator("#play").tap()
    until(tab, "replay.time > 0.1")


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 1920])
def test_on_a_screen_nothing_is_wider_than_it(opened, made, width, scheme):
    tab = opened(made / "replay.html", viewport={"width": width, "height": 900}, color_scheme=scheme)
    assert tab.evaluate("document.documentElement.scrollWidth") <= width


def test_on_paper_a_dark_page_is_light(opened, made):
    """At once, as no frame comes before a page is printed; and afterwards it is dark again."""
    tab = opened(made / "replay.html", color_scheme="dark")
    tab.evaluate(
        """() => {
            const one = new OffscreenCanvas(9, 9).getContext("2d", { willReadFrequently: true });
            window.ground = () => {
                one.drawImage(document.querySelector("#map"), 0, 0);
                return one.getImageData(2, 2, 1, 1).data[0];
            };
            matchMedia("print").addEventListener("change", () => { window.printed ??= ground(); });
        }"""
    )
    assert tab.evaluate("ground()") < 100
    tab.emulate_media(media="print")
    until(tab, "window.printed !== undefined")
    assert tab.evaluate("printed") > 200
    assert tab.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    tab.emulate_media(media="screen")
    until(tab, "ground() < 100")


def test_every_control_has_a_name(opened, made):
    tab = opened(made / "replay.html")
    assert nameless(tab) == []
    tab.get_by_role("slider", name="Time").press("ArrowRight")
    until(tab, "slider.getAttribute('aria-valuetext') === '0.1 s'")
    assert "platoon.1: speed" in tab.locator("#now").inner_text()


def test_without_what_was_not_recorded_the_page_opens_and_says_so(opened, tmp_path):
    folder = made_run(tmp_path / "run", traffic_every=None, scans_every=None, seconds=2.0)
    (folder / "vehicles.csv").unlink()  # as of runs of the first version
    (folder / "provenance.json").unlink()
    tab = opened(page(folder, folder / "replay.html"))
    assert tab.locator("#missing").inner_text() == (
        'Not recorded in this run: other vehicles ("run --replay" or record.traffic_every_s records them); scans, and '
        'so beams, returns and segments ("run --replay" or record.scans_every_s records them).'
    )
    assert tab.get_by_label("Beams and returns").is_disabled()
    assert len(tab.evaluate("replay.drawn.members")) == 3


def test_a_page_of_members_from_the_traffic_does_not_say_that_replay_records_scans(opened, tmp_path):
    folder = made_run(tmp_path / "run", scans_every=None, seconds=2.0)
    (folder / "config.toml").write_text("[[equip]]\nshare = 0.3\n")
    tab = opened(page(folder, folder / "replay.html"))
    assert tab.locator("#missing").inner_text() == (
        "Not recorded in this run: scans, and so beams, returns and segments (record.scans_every_s records them)."
    )


def test_a_leader_alone_has_a_page(opened, tmp_path):
    folder = made_run(tmp_path / "run", members=1, others=1, seconds=2.0)
    tab = opened(page(folder, folder / "replay.html"))
    assert tab.evaluate("replay.chosen") == "platoon.0"
    tab.keyboard.press("End")


def test_members_that_come_and_go_are_drawn_only_while_they_are_there(opened, tmp_path):
    folder = made_run(tmp_path / "run", seconds=4.0)
    rows = pd.read_csv(folder / "trajectories.csv")
    here = (rows.vehicle_id != "platoon.2") | rows.time_s.between(1.0, 2.0) | rows.time_s.between(3.0, 3.5)
    rows[here].to_csv(folder / "trajectories.csv", index=False)
    tab = opened(page(folder, folder / "replay.html"))
    for time, there in ((0.5, False), (1.0, True), (1.95, True), (2.5, False), (3.2, True), (3.9, False)):
        assert any(m["id"] == "platoon.2" for m in seek(tab, time)["drawn"]["members"]) == there, time


def test_a_scan_is_not_drawn_of_a_member_that_has_left(opened, tmp_path):
    folder = made_run(tmp_path / "run", seconds=4.0)
    rows = pd.read_csv(folder / "trajectories.csv")
    rows[(rows.vehicle_id != "platoon.1") | (rows.time_s < 2.2)].to_csv(folder / "trajectories.csv", index=False)
    tab = opened(page(folder, folder / "replay.html"))
    assert seek(tab, 2.1)["drawn"]["scan"]["time"] == 2.0
    assert seek(tab, 2.3)["drawn"]["scan"] is None


def with_gaps(folder: Path) -> Path:
    """Its members are there but from 3 to 6 s, and car.7, the only other vehicle, from 2 to 4 s."""
    rows, others = (pd.read_csv(folder / name) for name in ("trajectories.csv", "traffic.csv"))
    rows[(rows.time_s < 3.05) | (rows.time_s > 5.95)].to_csv(folder / "trajectories.csv", index=False)
    there = (others.vehicle_id == "car.7") & others.time_s.between(2.0, 4.0)
    others[there].to_csv(folder / "traffic.csv", index=False)
    return folder


WITH_GAPS = [(1.0, 3, 0), (2.0, 3, 1), (3.05, 3, 1), (4.4, 0, 1), (4.5, 0, 0), (5.9, 0, 0), (6.0, 3, 0), (9.9, 3, 0)]


def test_nobody_is_on_the_road_where_a_table_has_no_rows(opened, tmp_path):
    folder = with_gaps(made_run(tmp_path / "run", seconds=10.0))
    tab = opened(page(folder, folder / "replay.html"))
    tab.keyboard.press("Home")
    for time, members, others in WITH_GAPS:
        drawn = seek(tab, time)["drawn"]
        assert (len(drawn["members"]), drawn["traffic"]) == (members, others), time
    seek(tab, 4.6)
    assert tab.locator("#members tbody").inner_text().count("not on the road") == 3


def test_a_recording_that_is_sparse_has_no_gaps(opened, tmp_path):
    folder = made_run(tmp_path / "run", seconds=5.0, every=1.0)
    tab = opened(page(folder, folder / "replay.html"))
    assert [len(seek(tab, time)["drawn"]["members"]) for time in (0.5, 3.9, 5.0)] == [3, 3, 3]


def ordered(folder: Path, *orders: tuple, targets: dict[tuple[str, float], str]) -> Path:
    """With orders that were carried out: time, vehicle, other, what; and targets of vehicles from times on."""
    events = pd.read_csv(folder / "events.csv")
    told = [(time, vehicle, other, what) for time, vehicle, other, what in orders]
    more = pd.DataFrame(told, columns=["time_s", "vehicle_id", "other_id", "what"]).assign(kind="told", done=1)
    more.loc[more.what == "arrived", "kind"] = "arrived"
    pd.concat([events, more]).sort_values("time_s").to_csv(folder / "events.csv", index=False)
    rows = pd.read_csv(folder / "trajectories.csv")
    for (vehicle, since), target in targets.items():
        rows.loc[(rows.vehicle_id == vehicle) & (rows.time_s >= since), "target_id"] = target
    gone = {vehicle: time for time, vehicle, _, what in orders if what == "arrived"}
    rows[~(rows.time_s >= rows.vehicle_id.map(gone))].to_csv(folder / "trajectories.csv", index=False)
    return folder


def test_after_an_order_the_target_is_compared_with_the_new_predecessor(opened, tmp_path):
    folder = ordered(
        made_run(tmp_path / "run", members=5, seconds=8.0),
        (2.0, "platoon.1", "", "leave"), (4.0, "platoon.3", "", "split"), (6.0, "platoon.3", "platoon.2", "join"),
        targets={("platoon.2", 2.0): "platoon.0", ("platoon.3", 4.0): "", ("platoon.3", 6.0): "platoon.2"},
    )  # fmt: skip
    tab = opened(page(folder, folder / "replay.html"))

    def targets(time: float) -> list[str]:
        seek(tab, time)
        return tab.locator("#members tbody tr td:last-child").all_inner_texts()

    assert targets(1.9) == ["", "✓ platoon.0", "✓ platoon.1", "✓ platoon.2", "✓ platoon.3"]
    assert targets(2.0) == ["", "platoon.0", "✓ platoon.0", "✓ platoon.2", "✓ platoon.3"]  # 1 follows nobody
    assert targets(5.0) == ["", "platoon.0", "✓ platoon.0", "", "✓ platoon.3"]
    assert targets(8.0) == ["", "platoon.0", "✓ platoon.0", "✓ platoon.2", "✓ platoon.3"]
    tab.get_by_role("button", name="platoon.2").first.click()
    assert seek(tab, 4.9)["drawn"]["target"]["right"] is True
    tab.get_by_role("button", name="platoon.1").first.click()
    assert seek(tab, 5.1)["drawn"]["target"]["right"] is None


def test_a_follower_whose_predecessor_has_arrived_misses_nothing(opened, tmp_path):
    folder = made_run(tmp_path / "run", seconds=8.0)
    folder = ordered(folder, (4.0, "platoon.0", "", "arrived"), targets={("platoon.1", 4.0): ""})
    tab = opened(page(folder, folder / "replay.html"))
    seek(tab, 6.0)
    assert tab.locator("#members tbody tr td:last-child").all_inner_texts() == ["not on the road", "", "✓ platoon.1"]
    assert tab.locator(".sees-wrong").count() == 0


# ---- bad input


def call(*arguments: object):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.mark.parametrize("command", ["replay", "report"])
def test_what_is_no_finished_run_is_said_in_a_line(command, tmp_path):
    unfinished = made_run(tmp_path / "unfinished", seconds=1.0)
    (unfinished / "DONE").unlink()
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").touch()
    runs = made_run(tmp_path / "results" / "mine" / "run", seconds=1.0).parent
    for folder, words in (
        (runs, f"{runs}: not the folder of a run; a run in it is {runs / 'run'}"),
        (runs.parent, f"a run in it is {runs / 'run'}"),
        (unfinished, "an unfinished run"),
        (tmp_path / "empty", "not the folder of a run"),
        (tmp_path / "file", "a file, not the folder of a run"),
        (tmp_path / "missing", "no such folder"),
    ):
        done = call(command, folder)
        assert (done.exit_code, done.stdout) == (2, "")
        assert words in done.stderr
        assert len(done.stderr.splitlines()) == 1


def test_an_unknown_member_is_said_in_a_line(made, tmp_path):
    done = call("replay", made, "--vehicle", "platoon.9", "--to", tmp_path / "page.html")
    assert (done.exit_code, done.stdout) == (2, "")
    assert done.stderr == "--vehicle: no member 'platoon.9' in this run; did you mean 'platoon.2'?\n"
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError):
        packed(load(made), "")


def test_the_page_begins_with_the_member_that_was_asked_for(made, tmp_path):
    done = call("replay", made, "--vehicle", "platoon.2", "--to", tmp_path / "page.html")
    assert (done.exit_code, done.stdout.strip()) == (0, str(tmp_path / "page.html"))
    header, _ = unpacked(packed(load(made), "platoon.2"))
    assert header["chosen"] == "platoon.2"


@pytest.mark.parametrize("command", ["replay", "report"])
def test_a_page_that_cannot_be_written_is_said_in_a_line(command, made, tmp_path):
    done = call(command, made, "--to", tmp_path / "nowhere" / "page.html")
    assert done.exit_code == 2
    assert "cannot be written: No such file or directory" in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("content", [b"", b"no archive", b"PK\x05\x06" + bytes(18)])
def test_scans_that_cannot_be_read_are_named(made, tmp_path, content):
    folder = tmp_path / "run"
    shutil.copytree(made, folder)
    (folder / "scans.npz").write_bytes(content)
    with pytest.raises(ResultsError, match=r"scans.npz: cannot be read"):
        page(folder, tmp_path / "page.html")


def test_a_run_without_any_member_on_the_road_is_a_fault(made, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(made, folder)
    head = (folder / "trajectories.csv").read_text().splitlines()[0]
    (folder / "trajectories.csv").write_text(head + "\n")
    for command in ("replay", "report"):
        done = call(command, folder)
        assert done.exit_code == 2
        assert "no member was ever on the road" in done.stderr


def test_a_run_without_members_has_a_note_in_place_of_its_replay(tmp_path, capsys):
    """`run --replay` ended with exit code 2 behind a run that is done, and did not name its folder."""
    folder = made_run(tmp_path / "run", seconds=1.0)
    head = (folder / "trajectories.csv").read_text().splitlines()[0]
    (folder / "trajectories.csv").write_text(head + "\n")
    _finish_run(folder, replay=True, quiet=False)
    said = capsys.readouterr()
    assert said.out == f"{folder}\n"
    assert "there is no replay: " in said.err


def test_vehicles_may_be_called_like_numbers_or_nothing(tmp_path):
    folder = made_run(tmp_path / "run", seconds=1.0)
    text = (folder / "traffic.csv").read_text()
    (folder / "traffic.csv").write_text(text.replace(EVIL, "NA").replace("car.7", "0012"))
    header, _ = unpacked(packed(load(folder)))
    assert {"NA", "0012"} <= set(header["traffic"]["ids"])


def test_the_ring_is_where_it_should_be(made):
    """What the other tests measure against."""
    rows = pd.read_csv(made / "trajectories.csv")
    np.testing.assert_allclose(np.hypot(rows.x_m, rows.y_m), RADIUS, atol=1e-5)
