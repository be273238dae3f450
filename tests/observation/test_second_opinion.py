"""Closeness, exposure and blame, computed a second time from the recorded tables of a run alone."""

from __future__ import annotations

import cmath
import itertools
import json
import math

import numpy as np
import pandas as pd
import pytest
import shapely

from platoontraffic.observation.encroachments import TRAIL
from platoontraffic.world.events import CLEARANCE_REACH, ENCROACHED, LANE_CHANGE_BLAME, LANE_CHANGE_TIME
from tests.support.runs import run

# Followers repeat lane changes blindly in the first one, so there are contacts to be put down to somebody.
RUNS = {
    "highway_traffic": ("run.duration_s=310", "seed=3"),
    "corridor_two_platoons": ("run.duration_s=70",),  # a car crosses before a platoon at 63 s
    "corridor_cut_in": ("run.duration_s=25",),
}


@pytest.fixture(scope="module", params=RUNS)
def tables(request, tmp_path_factory):
    """Trajectories and background traffic of each step with sizes, events, the drivable area, and metrics."""
    folder = tmp_path_factory.mktemp(request.param)
    changes = [*RUNS[request.param], "record.every_s=0.1", "record.traffic_every_s=0.1"]
    run(folder / "run", request.param, *changes)
    names = "trajectories", "traffic", "vehicles", "events", "metrics"
    found = {name: pd.read_csv(folder / "run" / f"{name}.csv") for name in names}
    members = found["trajectories"]
    columns = ["time_s", "vehicle_id", "x_m", "y_m", "heading_rad", "speed_mps"]
    bodies = pd.concat([members[columns], found["traffic"][columns]])
    bodies = bodies.merge(found["vehicles"][["vehicle_id", "length_m", "width_m"]], on="vehicle_id")
    scene = json.loads((folder / "run" / "scene.geojson").read_text())
    return members, bodies, found["events"], scene, found["metrics"]


def outline(row) -> shapely.Geometry:
    along = np.array([np.cos(row.heading_rad), np.sin(row.heading_rad)]) * row.length_m / 2
    left = np.array([-np.sin(row.heading_rad), np.cos(row.heading_rad)]) * row.width_m / 2
    middle = np.array([row.x_m, row.y_m])
    return shapely.Polygon([middle + a * along + b * left for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))])


@pytest.mark.slow
@pytest.mark.sumo
def test_clearance_is_that_of_the_recorded_outlines(tables):
    members, bodies, *_ = tables
    checked = 0
    for time, here in bodies.groupby("time_s"):
        if round(time * 10) % 20:
            continue
        shapes = np.array([outline(row) for row in here.itertuples()])
        ids = here.vehicle_id.to_numpy()
        for row in members[members.time_s == time].itertuples():
            away = shapely.distance(shapes[ids == row.vehicle_id][0], shapes[ids != row.vehicle_id])
            least = away.min(initial=np.inf)
            if least < CLEARANCE_REACH - 1e-3:
                assert row.clearance_m == pytest.approx(least, abs=1e-5)
                checked += 1
            elif least > CLEARANCE_REACH + 1e-3:
                assert np.isnan(row.clearance_m)
    assert checked > 20


@pytest.mark.slow
@pytest.mark.sumo
def test_exposure_and_extremes_are_those_of_the_recorded_motion(tables):
    """Gaps are taken from the table; no order changes the predecessor of a member."""
    members, *_, metrics = tables
    found = metrics[metrics.scope == "vehicle"].set_index(["vehicle_id", "metric"]).value
    speed_of = members.set_index(["vehicle_id", "time_s"]).speed_mps
    checked = 0
    for vehicle, rows in members.groupby("vehicle_id"):
        ahead = f"{rows.platoon_id.iloc[0]}.{rows.place.iloc[0] - 1}"
        ttc, drac, before = [], [], None
        path, jerks = 0.0, [0.0]
        for row in rows.itertuples():
            if before is not None:
                path += math.hypot(row.x_m - before.x_m, row.y_m - before.y_m)
                jerks.append((row.accel_mps2 - before.accel_mps2) / 0.1)
            before = row
            nearing = row.speed_mps - speed_of.get((ahead, row.time_s), math.inf)
            if nearing > 1e-3 and row.gap_m > 0:
                ttc.append(row.gap_m / nearing)
                drac.append(nearing**2 / (2 * row.gap_m))
        exposed = [time for time in ttc if time < 3.0]
        own = {
            "distance": path,
            "jerk_max": max(map(abs, jerks)),
            "jerk_rms": math.sqrt(sum(jerk**2 for jerk in jerks) / len(jerks)),
            "lateral_accel_max": (rows.speed_mps * rows.yaw_rate_radps).abs().max(),
            "speed_mean": rows.speed_mps.mean(),
        }
        if ttc:
            own |= {"ttc_min": min(ttc), "drac_max": max(drac)}
            own |= {"tet": 0.1 * len(exposed), "tit": 0.1 * sum(3.0 - time for time in exposed)}
        checked += len(own)
        for name, value in own.items():
            assert found[vehicle, name] == pytest.approx(value, rel=1e-3, abs=1e-3), (vehicle, name)
    assert checked > 30


def trail_ages(bodies, members) -> dict[tuple[str, str], dict[int, list[int]]]:
    """(second, first) -> step -> how many steps before the first's outline was where the second's is, up to TRAIL.

    Pairs of a member and a body that is not of its platoon; steps are of 0.1 s.
    """
    rows = bodies.assign(step=(bodies.time_s * 10).round().astype(int)).query("step >= 1").reset_index(drop=True)
    shapes = np.array([outline(row) for row in rows.itertuples()])
    platoon = dict(zip(members.vehicle_id, members.platoon_id, strict=True))
    own = np.flatnonzero(rows.vehicle_id.isin(platoon.keys()))
    of_members, others = shapely.STRtree(shapes).query(shapes[own], predicate="intersects")
    found: dict[tuple[str, str], dict[int, list[int]]] = {}
    ids, steps = rows.vehicle_id.to_numpy(), rows.step.to_numpy()
    for i, k in zip(own[of_members], others, strict=True):
        for second, first in ((i, k), (k, i)) if ids[k] not in platoon else ((i, k),):
            age = steps[second] - steps[first]
            if 0 <= age <= round(TRAIL * 10) and platoon.get(ids[i]) != platoon.get(ids[k]):
                found.setdefault((ids[second], ids[first]), {}).setdefault(steps[second], []).append(age)
    return found


def post_encroachment(
    ages: dict[int, list[int]],
    arc: dict[int, float],
    headings: tuple[dict[int, float], dict[int, float]],
    width: float,
    came: int,
    there: tuple[int, int],
) -> list[float]:
    """Post-encroachment times of one pair, in whole steps [s]; each is up to two steps too long.

    ages  : as from `trail_ages`
    arc   : length of the second's path, by step [m]
    headings : of the second and the first, by step [rad]
    came  : first step of the second
    there : first step of the first's trail, and last step with both of them
    """
    times, least, entered = [], math.inf, None
    for step in range(min(ages), there[1] + 1):
        within = step in ages
        if within and step - 1 not in ages:
            oldest = min(round(TRAIL * 10), step - there[0])
            second, first = headings[0][step], headings[1][step - oldest]
            follows = oldest in ages[step] and math.cos(second - first) > 0.5
            entered = None if follows or step == came else arc[step]
        elif entered is not None and not (within and arc[step] - entered <= width):
            times.append(least)
            least, entered = math.inf, None
        if within and 0 in ages[step]:
            least, entered = math.inf, None
        if entered is not None:
            least = min(least, min(ages[step]) / 10)
    return times


def agree(members, bodies, events) -> int:
    """Number of events encroachment, which are those of the outlines; each table has a row for every step of 0.1 s."""
    width = dict(zip(bodies.vehicle_id, bodies.width_m, strict=True))
    arc, heading, there = {}, {}, {}
    for vehicle, rows in bodies.groupby("vehicle_id"):
        steps = (rows.time_s * 10).round().astype(int)
        way = np.hypot(rows.x_m.diff(), rows.y_m.diff()).fillna(0.0).cumsum()
        heading[vehicle] = dict(zip(steps, rows.heading_rad, strict=True))
        arc[vehicle], there[vehicle] = dict(zip(steps, way, strict=True)), (max(steps.min(), 1), steps.max())
    again: dict[tuple[str, str], list[float]] = {}
    for (second, first), ages in trail_ages(bodies, members).items():
        both = there[first][0], min(there[first][1], there[second][1])
        turned = heading[second], heading[first]
        again[second, first] = post_encroachment(ages, arc[second], turned, width[second], there[second][0], both)
    noted: dict[tuple[str, str], list[float]] = {}
    for event in events[events.kind == "encroachment"].itertuples():
        pair = event.vehicle_id, event.other_id
        noted.setdefault(pair[::-1] if event.what == "first" else pair, []).append(event.duration_s)
    for pair in again.keys() | noted.keys():
        left = sorted(again.get(pair, []))
        for time in sorted(noted.get(pair, [])):
            same = [whole for whole in left if whole - 0.2 - 1e-3 <= time <= whole + 1e-3]
            assert same, (pair, noted[pair], again.get(pair))
            left.remove(same[0])
        assert all(whole > ENCROACHED - 1e-3 for whole in left), (pair, noted.get(pair), again[pair])
    return sum(map(len, noted.values()))


@pytest.mark.slow
@pytest.mark.sumo
def test_post_encroachment_times_are_those_of_the_recorded_outlines(tables):
    members, bodies, events, *_ = tables
    assert agree(members, bodies, events) > 0


def to_border(border: shapely.Geometry, row, side: int) -> float:
    """Distance of the border to the left (1) or right (-1) of a vehicle [m]; NaN where there is none within 50 m."""
    away = row.heading_rad + side * math.pi / 2
    end = row.x_m + 50 * math.cos(away), row.y_m + 50 * math.sin(away)
    met = shapely.LineString([(row.x_m, row.y_m), end]).intersection(border)
    return math.nan if met.is_empty else shapely.Point(row.x_m, row.y_m).distance(met)


def moved(border: shapely.Geometry, rows: list) -> float:
    """How far a vehicle has moved to its left across the road [m]."""
    total = 0.0
    for before, after in itertools.pairwise(rows):
        front = [complex(row.x_m, row.y_m) + cmath.rect(row.length_m / 2, row.heading_rad) for row in (before, after)]
        mean = cmath.rect(1, before.heading_rad) + cmath.rect(1, after.heading_rad)
        aside = ((front[1] - front[0]) * mean.conjugate() / abs(mean)).imag
        limit = 3.0 * (after.time_s - before.time_s)
        steps = [-side * (to_border(border, after, side) - to_border(border, before, side)) for side in (-1, 1)]
        total += aside if abs(aside) > 2.0 else next((step for step in steps if abs(step) < limit), 0.0)
    return total


def blamed(one: list, other: list, border: shapely.Geometry) -> str:
    """The vehicle that came into the other's lane, by the rows of both up to the contact, or ""."""

    def offset(a, b) -> float:
        mean = math.atan2(
            math.sin(a.heading_rad) + math.sin(b.heading_rad), math.cos(a.heading_rad) + math.cos(b.heading_rad)
        )
        return (b.y_m - a.y_m) * math.cos(mean) - (b.x_m - a.x_m) * math.sin(mean)

    def in_line(a, b) -> bool:
        narrow = abs(offset(a, b)) < (a.width_m + b.width_m) / 2
        return narrow and math.cos(a.heading_rad - b.heading_rad) >= 0.5

    k = len(one) - 1
    if not in_line(one[k], other[k]):
        return ""
    while k > 0 and in_line(one[k - 1], other[k - 1]):
        k -= 1
    if k == 0 or one[-1].time_s - one[k].time_s > LANE_CHANGE_BLAME - 1e-6:
        return ""
    first = next(i for i, row in enumerate(one) if row.time_s >= one[k].time_s - LANE_CHANGE_TIME - 1e-6)
    left = math.copysign(1.0, offset(one[k - 1], other[k - 1]))
    moves = [left * moved(border, one[first:]), -left * moved(border, other[first:])]
    if max(moves) < 0.5:
        return ""
    return (one if moves[0] >= moves[1] else other)[0].vehicle_id


@pytest.mark.slow
@pytest.mark.sumo
def test_blame_is_that_of_the_recorded_poses(tables):
    _, bodies, events, scene, _ = tables
    area = shapely.union_all(
        [shapely.geometry.shape(f["geometry"]) for f in scene["features"] if f["properties"]["kind"] == "road"]
    )
    of = {name: {round(row.time_s, 3): row for row in rows.itertuples()} for name, rows in bodies.groupby("vehicle_id")}
    for event in events[(events.kind == "collision") & (events.other_id != "wall")].itertuples():
        one, other = of[event.vehicle_id], of[event.other_id]
        window = LANE_CHANGE_BLAME + LANE_CHANGE_TIME + 1e-6
        times = [t for t in sorted(one.keys() & other.keys()) if event.time_s - window <= t <= event.time_s + 1e-6]
        cause = blamed([one[t] for t in times], [other[t] for t in times], area.boundary)
        words = {event.vehicle_id: "changed_lanes", event.other_id: "other_changed_lanes"}
        if cause:
            assert event.what == words[cause], event
        else:
            assert event.what not in words.values(), event
