"""String gains computed a second time, from the CSV files and the data dictionary's words alone, by plain loops."""

from __future__ import annotations

import csv
import math
from itertools import pairwise
from pathlib import Path

import pytest

from tests.support.runs import run

SCENARIOS = {  # name -> changes, and how many followers' gains are defined at least
    "highway_tracking": (("run.duration_s=60",), 9),
    "corridor_cut_in": (("obstacle.time_s=30", "run.duration_s=70"), 0),
    "corridor_manoeuvres": (("run.duration_s=190",), 5),
    "corridor_tracking": (("run.duration_s=60", "record.every_s=0.5"), 4),
    "paper_loop": (("run.duration_s=70", "record.every_s=0.1"), 4),
}
SLOW = {"corridor_manoeuvres", "paper_loop"}


def read(file: Path) -> list[dict[str, str]]:
    with file.open(encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines))


class Recorded:
    """A run's tables: speeds by member and time, events by member."""

    def __init__(self, folder: Path) -> None:
        self.speed: dict[str, dict[float, float]] = {}
        for row in read(folder / "trajectories.csv"):
            self.speed.setdefault(row["vehicle_id"], {})[float(row["time_s"])] = float(row["speed_mps"])
        self.events = read(folder / "events.csv")
        self.end = max(float(e["time_s"]) for e in self.events if e["kind"] == "end")
        members = [row for row in read(folder / "vehicles.csv") if row["place"]]
        self.place = {row["vehicle_id"]: (row["platoon_id"], int(row["place"])) for row in members}
        self.leaves = {e["vehicle_id"]: float(e["time_s"]) for e in self.events if e["kind"] in ("arrived", "stranded")}

    def acceleration(self, vehicle: str) -> dict[float, float]:
        """Mean over the last second, or over the recording interval if that is longer."""
        times = sorted(self.speed[vehicle])
        every = min((b - a for a, b in pairwise(times)), default=1.0)
        steps = max(1, round(1.0 / every))
        speeds = [self.speed[vehicle][t] for t in times]
        return {
            t: (speeds[i] - speeds[max(i - steps, 0)]) / (steps * every) for i, t in enumerate(times)
        }  # fmt: skip

    def predecessor(self, vehicle: str, time: float) -> str | None:
        """Whom the member follows just after a time; None: nobody, or one of them is not on the road."""
        ahead = {v: self._at(platoon, place - 1) for v, (platoon, place) in self.place.items()}
        for e in self.events:
            if e["kind"] != "told" or e["done"] != "1" or float(e["time_s"]) > time:
                continue
            own = e["vehicle_id"]
            if e["what"] == "leave":
                for other in ahead:
                    ahead[other] = ahead[own] if ahead[other] == own else ahead[other]
            ahead[own] = e["other_id"] if e["what"] == "join" else None
        found = ahead[vehicle]
        gone = found is None or any(time >= self.leaves.get(v, math.inf) for v in (vehicle, found))
        return None if gone else found

    def _at(self, platoon: str, place: int) -> str | None:
        return next((v for v, where in self.place.items() if where == (platoon, place)), None)

    def in_string(self, vehicle: str, time: float) -> str | None:
        """Its predecessor, if it has once been locked on it and is not split off."""
        ahead = self.predecessor(vehicle, time)
        own = [e for e in self.events if e["vehicle_id"] == vehicle]
        locked = [float(e["time_s"]) for e in own if e["kind"] == "locked" and e["other_id"] == ahead]
        if ahead is None or not locked or time < min(locked):
            return None
        ends = [float(e["time_s"]) for e in own if e["kind"] == "rejoined"]
        begins = [float(e["time_s"]) - 2.0 for e in own if e["kind"] == "split"]
        begins += [float(e["time_s"]) for e in own if e["kind"] == "told" and e["done"] == "1" and e["what"] == "join"]
        off = any(a <= time < min([t for t in ends if t >= a], default=math.inf) for a in begins)
        return None if off else ahead


def gains(run: Recorded, head: str, tail: str, inside: dict[float, bool], response: float) -> list[tuple[float, float]]:
    """Accelerations of head and tail at all instants of all windows; inside: whether it is a string, by instant."""
    own, ahead = run.acceleration(tail), run.acceleration(head)
    times = sorted(t for t in own if t in ahead)
    windows: list[list[float]] = []
    for t in times:
        if abs(ahead[t]) >= 0.05:
            if not windows or round(t - windows[-1][1], 3) > response:
                windows.append([t, t])
            windows[-1][1] = t
    periods: list[list[float]] = []
    until = min(run.leaves.get(head, run.end), run.leaves.get(tail, run.end))
    for t, following in zip(times, [*times[1:], until], strict=True):
        if inside[t]:
            if periods and periods[-1][1] == t:
                periods[-1][1] = following
            else:
                periods.append([t, following])
    found = []
    for begin, end in periods:
        stand = all(run.speed[v][begin] <= 0.05 for v in (head, tail))
        begin = begin if stand else begin + 20.0
        for a, b in windows:
            first, last = round(max(a, begin), 3), round(min(b + response, end), 3)
            if first < last and (
                (first, last) == (a, round(b + response, 3)) or round(last - first, 3) >= 10 * response
            ):
                found += [(ahead[t], own[t]) for t in times if first <= t <= last]
    return found


def norms(pairs: list[tuple[float, float]]) -> tuple[float, float]:
    if not pairs:
        return math.nan, math.nan
    sums = [math.sqrt(math.fsum(a[i] ** 2 for a in pairs)) for i in (0, 1)]
    tops = [max(abs(a[i]) for a in pairs) for i in (0, 1)]
    return sums[1] / sums[0], tops[1] / tops[0]


@pytest.mark.sumo
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] if name in SLOW else []) for name in SCENARIOS]
)
def test_gains_agree_with_those_of_the_tables_alone(name, tmp_path):
    changes, least = SCENARIOS[name]
    folder = run(tmp_path / name, name, *changes)
    tables = Recorded(folder)
    of: dict[tuple[str, str], float] = {}
    for row in read(folder / "metrics.csv"):
        if "accel_gain" in row["metric"]:
            of[row["vehicle_id"] or row["platoon_id"], row["metric"]] = float(row["value"] or "nan")
    members = {v: {t: tables.in_string(v, t) for t in tables.speed[v]} for v in tables.place if v in tables.speed}
    defined = 0
    for vehicle, ahead in members.items():
        pairs = []
        for other in sorted({a for a in ahead.values() if a}):
            pairs += gains(tables, other, vehicle, {t: a == other for t, a in ahead.items()}, 5.0)
        expected = norms(pairs)
        defined += not math.isnan(expected[0])
        for metric, value in zip(("accel_gain_l2", "accel_gain_linf"), expected, strict=True):
            assert of.get((vehicle, metric), math.nan) == pytest.approx(value, rel=1e-6, nan_ok=True), (vehicle, metric)
    assert defined >= least
    for platoon in {platoon for platoon, _ in tables.place.values()}:
        string = sorted((v for v in members if tables.place[v][0] == platoon), key=lambda v: tables.place[v][1])
        whole = {t: all(members[v].get(t) == a for a, v in pairwise(string)) for t in members[string[-1]]}
        expected = norms(gains(tables, string[0], string[-1], whole, 5.0 + 2.0 * (len(string) - 2)))
        found = of[platoon, "head_to_tail_accel_gain_l2"], of[platoon, "head_to_tail_accel_gain_linf"]
        assert found == pytest.approx(expected, rel=1e-6, nan_ok=True)


@pytest.mark.sumo
def test_ten_cars_on_the_highway_damp_what_their_leader_does(tmp_path):
    folder = run(tmp_path / "run", "highway_tracking", "run.duration_s=60")
    of = [float(row["value"]) for row in read(folder / "metrics.csv") if "accel_gain" in row["metric"]]
    assert len(of) == 9 * 2 + 2 * 4
    assert max(of) < 1
    assert min(of) > 0.85


@pytest.mark.sumo
def test_gap_and_cross_track_follow_from_the_tables_by_the_words_of_the_dictionary(tmp_path):
    """Along the path of the predecessor's axle, straight from the follower's axle before its start."""
    folder = run(tmp_path / "run", "corridor_tracking", "run.duration_s=45")
    axle: dict[str, list[complex]] = {}
    told: dict[str, list[tuple[float, float]]] = {}
    vehicles = {row["vehicle_id"]: {k: float(v or "nan") for k, v in row.items() if k.endswith("_m")}
                for row in read(folder / "vehicles.csv")}  # fmt: skip
    for row in read(folder / "trajectories.csv"):
        own = vehicles[row["vehicle_id"]]
        x, y, heading = (float(row[name]) for name in ("x_m", "y_m", "heading_rad"))
        axle.setdefault(row["vehicle_id"], []).append(
            complex(x, y) + own["axle_x_m"] * complex(math.cos(heading), math.sin(heading))
        )
        told.setdefault(row["vehicle_id"], []).append(tuple(float(row[n] or "nan") for n in ("gap_m", "cross_track_m")))
    assert all(own["wheelbase_m"] == pytest.approx(2.7) for own in vehicles.values())
    for ahead, own in pairwise(sorted(axle)):
        for i in range(0, len(axle[own]), 15):
            path, foot = [axle[own][0], *axle[ahead][: i + 1]], axle[own][i]
            left, aside = along(path, foot)
            offsets = vehicles[own]["length_m"] / 2 - vehicles[own]["axle_x_m"]
            offsets += vehicles[ahead]["length_m"] / 2 + vehicles[ahead]["axle_x_m"]
            gap, cross_track = told[own][i]
            assert gap == pytest.approx(left - offsets, abs=0.005)
            assert cross_track == pytest.approx(aside, abs=0.005)


def along(path: list[complex], point: complex) -> tuple[float, float]:
    """Length of a path from the foot of a point to the path's end, and the point's offset to the left."""
    best = (math.inf, 0.0, 0.0)
    left = math.fsum(abs(b - a) for a, b in pairwise(path))
    for a, b in pairwise(path):
        if a != b:
            t = min(max(((point - a) * (b - a).conjugate()).real / abs(b - a) ** 2, 0.0), 1.0)
            off = point - a - t * (b - a)
            side = math.copysign(abs(off), ((b - a).conjugate() * off).imag)
            best = min(best, (abs(off), left - t * abs(b - a), side))
        left -= abs(b - a)
    return best[1:]
