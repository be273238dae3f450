"""The benchmark of the loop: that it measures all of it, and what its towns are. Never how fast."""

import json
import xml.etree.ElementTree as ET
from itertools import pairwise

import pytest

from platoontraffic import scenario, shipped, simulation
from platoontraffic.cli import bench, bench_floor
from platoontraffic.cli.bench import ROUTE_EDGES, SIZE, STAGES, Plan, Spent, Town
from platoontraffic.cli.bench_floor import COUNTED, WARM_UP, Above, above
from platoontraffic.errors import MissingError, RunError
from platoontraffic.sumo import programs

PLATOONS = """
[[platoon]]
size = 2
gap_m = 6.0
vehicle = "car"
start = { edge = "east_north", position_m = 80.0 }
to = "south_east"
leader = { law = "path", lidar = "car-leader" }
follower = { law = "tracking", policy = "obey", on_loss = "drive" }
"""
SMALL = Town(roads=4, background=20, platoons=2, warm_up=2, lasts=10)


def spent(cpu, clock=2.0, peak=100.0, step=1.0):
    parts = {part: 0.0 for parts in STAGES.values() for part in parts}
    return Spent(cpu, clock, 25, peak, parts | {"step": step, "signals": 1.0, "decide": 2.0})


def row(town, what="", **changes):
    return bench.whole(town, what, [spent(1.0)], [spent(2.0)])._replace(**changes)


# ---- the figures


def test_ratios_are_of_one_turn_and_times_are_medians():
    town = Town(20, 1000, 20, 20, 30)
    found = bench.whole(town, "", [spent(1.0), spent(2.0), spent(4.0)], [spent(3.0), spent(3.0), spent(20.0)])
    assert (found.town, found.vehicles) == ("1000 + 100", 25)
    assert (found.sumo_ms, found.loop_ms) == pytest.approx((2e3 / 300, 3e3 / 300))
    assert (found.ratio, found.real_time, found.wall_real_time) == pytest.approx((3, 10, 15))
    assert found.member_us == pytest.approx(2e6 / 300 / 100)


def test_stages_share_out_the_time_of_the_loop():
    rows = {found.stage: found for found in bench.stages(SMALL, [spent(2.0)])}
    assert list(rows) == list(STAGES)
    assert sum(found.ms for found in rows.values()) == pytest.approx(20)
    assert rows["decide"].share == pytest.approx(3 / 4)


def test_bars_tell_what_is_kept():
    large, largest, _ = bench.FULL.towns[1:]
    rows = [row(large, ratio=1.5, real_time=4.0, member_us=100.0), row(largest, real_time=1.0, member_us=121.0)]
    met = [bar.met for bar in bench.bars([*rows, row(large, "with noise", ratio=9.0)])]
    assert met == [True, False, True, True, False]
    assert len(bench.bars([row(largest, peak_mb=None)])) == 1
    assert bench.bars([row(SMALL)]) == []


def test_a_step_is_judged_above_its_floor():
    floors = [
        Above(bench.LAB.name, 5, 0.4, 1.0, 0.6, 120.0, 351.0),
        Above(bench.LARGE, 100, 15.0, 17.1, 2.1, 21.0, 900.0),
    ]
    found = {bar.wanted: bar.met for bar in bench.bars([], floors)}
    assert found == {
        "lab, 5 robots: at most 0.6 ms above the floor": True,
        "lab, 5 robots: at most 350 calls": False,
        "1000 + 100: at most 20.0 us a member above the floor": False,
    }


def test_a_report_is_compared_with_one_that_was_kept(tmp_path):
    large = bench.FULL.towns[1]
    floors = [Above(bench.LAB.name, 5, 0.4, 1.0, 0.6, 120.0, 700.0)]
    report = bench.Report({"processor": "P", "commit": "C"}, [row(large)], [], floors, [])
    figures = json.loads(report.json())
    figures["whole"][0]["loop_ms"] *= 2
    figures["above"][0]["calls"] = 2100.0
    (tmp_path / "kept.json").write_text(json.dumps(figures), encoding="utf-8")
    kept = bench.kept(tmp_path / "kept.json")
    ratios = {one.figure: one.ratio for one in report.beside(kept)}
    assert ratios == pytest.approx(
        {"1000 + 100, loop [ms]": 0.5, "lab, 5 robots, above the floor [ms]": 1.0, "lab, 5 robots, calls": 1 / 3}
    )
    lines = bench.compared(report, kept).splitlines()
    assert lines[0] == "Beside C on P"
    assert max(map(len, lines)) <= 120


def test_the_plans_are_what_is_promised():
    assert [town.name for town in bench.FULL.towns] == ["100 + 5", "1000 + 100", "5000 + 500", "5000, 20% equipped"]
    for town in (*bench.FULL.towns, *bench.QUICK.towns):
        assert town.lasts % bench.EVERY == 0
        edges = 4 * town.roads * (town.roads - 1)
        assert town.background / edges == pytest.approx(0.63, abs=0.04)  # one density
    assert set(bench.FULL.extras) == {"with noise", "a row a second"}


# ---- towns


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    pytest.importorskip("sumo", reason="netgenerate comes with eclipse-sumo: pip install platoontraffic[gui]")
    folder = tmp_path_factory.mktemp("town")
    bench.build(SMALL, folder)
    return folder


def vehicles(file):
    return {v.get("id"): v.find("route").get("edges").split() for v in ET.parse(file).iter("vehicle")}


def test_members_have_the_same_ways_in_both_runs(folder):
    native = vehicles(folder / "members.rou.xml")
    prepared = simulation.prepare(scenario.load(folder / "town.toml"))
    assert {m.id: list(m.route.edges) for m in prepared.members} == native
    assert len(native) == SMALL.members == 2 * SIZE


def test_ways_follow_connections_and_traffic_begins_where_no_platoon_stands(folder):
    onward = bench._onward(folder / "town.net.xml")
    traffic, members = vehicles(folder / "traffic.rou.xml"), vehicles(folder / "members.rou.xml")
    assert len(traffic) == SMALL.background
    for way in (*traffic.values(), *members.values()):
        assert len(way) == ROUTE_EDGES
        assert all(to in onward[edge].values() for edge, to in pairwise(way))
    assert not {way[0] for way in traffic.values()} & {way[0] for way in members.values()}


def test_a_share_of_the_traffic_is_measured_above_its_floor(tmp_path):
    pytest.importorskip("sumo", reason="netgenerate comes with eclipse-sumo: pip install platoontraffic[gui]")
    town = Town(roads=4, background=30, platoons=0, warm_up=10, lasts=10, share=0.5)
    bench.build(town, tmp_path)
    assert len(vehicles(tmp_path / "traffic.rou.xml")) == 30
    assert vehicles(tmp_path / "members.rou.xml") == {}
    seconds = f"run.duration_s={(WARM_UP + 20 + COUNTED) * bench.STEP}"
    found = above(town.name, str(tmp_path / "town.toml"), (seconds,), 20)
    assert 8 < found.members < 22  # chosen by their ids
    assert 0 < found.floor_ms < found.loop_ms


def test_lidars_have_720_beams_and_no_errors_unless_asked_for(folder):
    for arguments, noisy in (((), False), (bench.NOISE, True)):
        prepared = simulation.prepare(scenario.load(folder / "town.toml", arguments))
        assert {(m.lidar.samples, m.lidar.noise.sigma > 0) for m in prepared.members} == {(720, noisy)}


def test_the_same_seed_makes_the_same_town(folder, tmp_path):
    bench.build(SMALL, tmp_path)
    for name in ("traffic.rou.xml", "town.toml", "members.rou.xml"):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()


def test_without_eclipse_sumo_it_says_what_is_missing(monkeypatch):
    monkeypatch.setattr(programs.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingError, match="netgenerate comes with eclipse-sumo"):
        bench.run(Plan((SMALL,), 1, {}))


# ---- a small run


@pytest.mark.slow
@pytest.mark.sumo
def test_the_whole_loop_is_measured_against_sumo_alone(folder):
    said = []
    report = bench.run(Plan((SMALL,), 1, {}), said.append)
    assert said == ["20 + 10: the town", "20 + 10: 1 of 1"]
    (found,) = report.whole
    assert min(found.sumo_ms, found.loop_ms, found.ratio, found.real_time, found.wall_ratio) > 0
    assert 0 < found.vehicles <= 30
    assert [part.stage for part in report.stages] == list(STAGES)
    assert all(part.ms > 0 or part.stage == "watchers" for part in report.stages)  # to watch takes some 10 us
    assert sum(part.share for part in report.stages) == pytest.approx(1)

    rows = json.loads(report.json())
    assert rows["whole"][0]["town"] == "20 + 10"
    assert rows["machine"]["libsumo"]
    assert "at most" not in bench.text(report)
    lines = bench.text(report, targets=True).splitlines()
    assert [line.split("  ")[0] for line in lines if "%" in line] == list(STAGES)
    assert max(map(len, lines)) <= 120


@pytest.mark.slow
@pytest.mark.sumo
def test_the_floor_of_a_step_is_that_of_the_same_movements(folder):
    seconds = f"run.duration_s={(WARM_UP + 20 + COUNTED) * bench.STEP}"
    found = above("a town", folder / "town.toml", (seconds,), 20)
    assert (found.scene, found.members) == ("a town", SMALL.members)
    assert min(found.floor_ms, found.loop_ms) > 0
    assert found.above_ms == pytest.approx(found.loop_ms - found.floor_ms)
    assert found.calls > 10 * SMALL.members


@pytest.mark.slow
def test_a_floor_that_dies_is_an_error():
    with bench_floor._floor_of("nowhere.toml", (), None) as moved, pytest.raises(RunError, match="died: the floor"):
        moved([])


@pytest.mark.slow
@pytest.mark.sumo
def test_a_configuration_with_platoons_is_measured_above_its_floor(tmp_path, monkeypatch):
    monkeypatch.setattr(bench, "CITY", 20)
    ring, platoons = shipped.networks()["ring"].with_name("ring.sumocfg"), tmp_path / "platoons.toml"
    platoons.write_text(PLATOONS, encoding="utf-8")
    report = bench.run(bench.city(ring, platoons))
    (found,), (bar,) = report.above, report.bars
    assert (found.scene, found.members) == ("ring/ring.sumocfg", 2)
    assert found.loop_ms > found.floor_ms > 0
    assert bar == bench.Bar("ring/ring.sumocfg: at most 35.0 us a member above the floor", found.member_us, bar.met)
    assert "ring/ring.sumocfg" in bench.text(report, targets=True)


def test_extras_and_bars_are_printed():
    large = bench.FULL.towns[1]
    rows = [row(large, what) for what in ("", *bench.FULL.extras)]
    report = bench.Report({}, rows, bench.stages(large, [spent(2.0)]), [], bench.bars(rows))
    assert "at most" not in bench.text(report)
    lines = bench.text(report, targets=True).splitlines()
    assert "1000 + 100: at most 1.6 times SUMO alone" in "".join(lines)
    assert max(map(len, lines)) <= 120
