"""Locks: the surface of a law's target, and the beams on a predecessor; against slow counts and real scans."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from platoontraffic.lidar import Boxes, Carriers, LidarModel, Mount, ScanBatch, scan
from platoontraffic.observation.locks import Sight, look
from platoontraffic.world.events import Noted
from platoontraffic.world.traffic import TrafficSnapshot
from platoontraffic.world.under_way import Seen
from tests.support.bench import NO_WALLS, batch_of
from tests.support.observed import Observed, cars

AHEAD, OTHER, WALL, NOTHING = [0] * 20, [2] * 20, [-1] * 20, [-2] * 20  # rows that 20 beams meet


def test_lock_events_follow_from_what_the_target_lies_on():
    observed = Observed(cars())
    expected = [
        (NOTHING, []),
        (WALL, [("wrong_target", "wall", "")]),
        (AHEAD, [("locked", "robot.0", "")]),
        (AHEAD, []),
        (OTHER, [("wrong_target", "other.0", ""), ("lock_lost", "other.0", "taken")]),
        (OTHER, []),
        (NOTHING, []),
        (AHEAD, [("lock_regained", "robot.0", "")]),
        (NOTHING, [("lock_lost", "", "out_of_sight")]),
    ]
    for k, (hits, noted) in enumerate(expected):
        seen = observed.at(float(k), x=[0.0, -20.0], others=[(40.0, 0.0)], hits=hits)
        others = ("departed", "split", "rejoined")
        assert [(e.kind, e.other, e.what) for e in seen.events if e.kind not in others] == noted, k
        assert seen.measures.beams[1] == (20 if hits is AHEAD else 0)
        if k == 7:
            (regained,) = (e for e in seen.events if e.kind == "lock_regained")
            assert regained.duration == 3
    seen = observed.at(9.0, x=[0.0, -20.0], hits=AHEAD, bearing=np.nan)
    assert seen.measures.target[1] == ""


def test_a_target_keeps_its_id_when_rows_change():
    observed = Observed(cars())
    observed.at(0.0, x=[0.0, -20.0], others=[(40.0, 0.0), (60.0, 0.0)], hits=[3] * 20)
    assert observed.at(0.1, x=[0.0, -20.0]).measures.target[1] == "other.1"


def test_a_lock_that_is_lost_with_beams_on_the_predecessor_was_not_recognised():
    observed = Observed(cars())
    observed.at(0.0, x=[0.0, -20.0], hits=AHEAD)
    (lost,) = observed.at(0.1, x=[0.0, -20.0], hits=AHEAD, bearing=np.nan).events
    assert (lost.kind, lost.what, lost.detail) == (
        "lock_lost",
        "not_recognised",
        "not recognised, though 20 beams hit it",
    )


def test_a_lock_that_is_lost_with_a_broken_laser_is_put_down_to_that_until_its_repair():
    observed, broken = Observed(cars()), Noted(1, "breaks_down", "laser", what="laser")
    observed.at(0.0, x=[0.0, -20.0], hits=AHEAD)
    events = observed.at(0.1, x=[0.0, -20.0], hits=NOTHING, noted=[broken]).events
    assert [(e.kind, e.vehicle, e.what) for e in events] == [
        ("breaks_down", "robot.1", "laser"),
        ("lock_lost", "robot.1", "broken"),
    ]
    observed.at(0.2, x=[0.0, -20.0], hits=AHEAD, noted=[broken._replace(kind="repaired")])
    assert [e.what for e in observed.at(0.3, x=[0.0, -20.0], hits=NOTHING).events] == ["out_of_sight"]


def looked(batch: ScanBatch, row: int, ahead: int, bearing: float, *boxes: np.ndarray) -> list[int]:
    """The only scan of a batch: surface of the target, beams on the predecessor, beams on it were it alone."""
    n = len(boxes[0])
    traffic = TrafficSnapshot(0.0, tuple(map(str, range(n))), *boxes[:3], np.zeros(n), *boxes[3:])
    found, rows = np.full((3, n), -9), np.array([row])
    look(batch, Seen(traffic, rows), rows, np.full(n, bearing), np.array([ahead]), Sight(*found))
    assert (np.delete(found, row, axis=1) == -9).all()
    return found[:, row].tolist()


def test_surface_about_a_bearing_is_that_of_a_slow_count():
    rng = np.random.default_rng(2)
    model = LidarModel(40, -0.4, 0.4, 0.0, 9.0)
    hits = rng.integers(-2, 3, (300, 40)).astype(np.int32)
    hits.setflags(write=False)
    ranges = np.where(rng.random(hits.shape) < 0.2, np.nan, np.where(hits == -2, np.inf, 1.0)).astype(np.float32)
    bearing = np.where(rng.random(300) < 0.1, np.nan, rng.uniform(-0.6, 0.6, 300))
    for row in range(300):
        batch = replace(batch_of(ranges[[row]], model), hits=hits[row : row + 1])
        found, *_ = looked(batch, 0, -1, bearing[row], *np.zeros((5, 1)))
        votes: dict[int, int] = {}
        if not np.isnan(bearing[row]):
            beam = round((bearing[row] - model.angle_min) / model.angle_increment)
            for k in range(max(beam - 3, 0), min(beam + 4, 40)):
                if np.isfinite(ranges[row, k]):
                    votes[hits[row, k]] = votes.get(hits[row, k], 0) + 1
        most = max(votes.values(), default=0)
        assert found == min((on for on, count in votes.items() if count == most), default=-2)


@pytest.mark.parametrize("model", [LidarModel(400, -0.8, 0.8, 0.1, 12.0, mount=Mount(1.0, 0.2, 0.1)),
                                   LidarModel(721, -np.pi, np.pi, 0.0, 30.0)])  # fmt: skip
def test_beams_across_a_lone_vehicle_are_those_that_a_scan_of_it_has(model):
    rng = np.random.default_rng(3)
    met = 0
    for _ in range(60):
        pose = np.array([rng.uniform(-8, 8, 2), rng.uniform(-8, 8, 2), rng.uniform(-np.pi, np.pi, 2)])
        size = np.full(2, 4.0), np.full(2, 1.8)
        boxes = Boxes(*pose, *size, np.arange(2))
        batch = scan(model, NO_WALLS, boxes, Carriers.of(boxes, [0]))
        _, on, alone = looked(batch, 0, 1, 0.0, *pose, *size)
        assert on == np.count_nonzero(batch.hits == 1)
        assert abs(alone - on) <= 1  # a beam through a corner, or at the end of the range
        met += alone
    assert met > 1000


def test_a_vehicle_in_between_that_covers_half_of_the_predecessor_hides_half_of_its_beams():
    """The follower is 20 m behind; half the width of a car is in between."""
    eye = LidarModel(2001, -0.2, 0.2, 0.0, 60.0)
    leader, between = np.array([20.0, 0.0, 0.0]), np.array([10.0, 1.5, 0.0])
    poses = np.array([leader, np.zeros(3), between]).T
    size = np.full(3, 4.0), np.array([2.0, 2.0, 3.0])
    boxes = Boxes(*poses, *size, np.arange(3))
    batch = scan(eye, NO_WALLS, boxes, Carriers.of(boxes, [1]))
    _, on, alone = looked(batch, 1, 0, 0.0, *poses, *size)
    assert on / alone == pytest.approx(0.5, abs=0.01)
