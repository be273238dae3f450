"""Fans and targets in sumo-gui stand where lasers and targets are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from platoontraffic.controllers import Target
from platoontraffic.controllers.reactive import ReactiveLeader
from platoontraffic.lidar import PRESETS, LidarModel, Mount, ScanBatch
from platoontraffic.sumo.drawing import fan, scanned, shapes
from platoontraffic.vehicles.differential import DifferentialDrive
from platoontraffic.vehicles.motion import Motion
from platoontraffic.world.fleet import Fleet, Member

LASER = LidarModel(361, -np.pi / 2, np.pi / 2, 0.1, 10.0, mount=Mount(0.3, 0.1, np.pi / 2))


def fleet_of(n: int, lidar: LidarModel = LASER) -> Fleet:
    members = [
        Member(f"r.{i}", "r", i, DifferentialDrive(), lidar, ReactiveLeader(), "e", 0, 0.0, (-2.0 * i, 0.0, 0.0))
        for i in range(n)
    ]
    return Fleet.deployed(members, 0.1)


def test_blades_end_where_beams_do_and_cover_half_of_the_view():
    outline = fan(np.full(361, 5.0), LASER)
    reach = np.hypot(*outline.T)
    assert set(reach.round(9)) == {0.0, 5.0}
    blades = shapely.unary_union([shapely.Polygon(p) for p in np.split(outline, np.flatnonzero(reach == 0)[1:])])
    assert blades.area == pytest.approx(np.pi / 2 * 25 / 2, rel=0.03)


@pytest.mark.parametrize(("measured", "drawn"), [(np.inf, 10.0), (-np.inf, 0.1), (3.0, 3.0)])
def test_a_beam_without_a_return_is_drawn_to_the_longest_range_and_one_too_near_to_the_shortest(measured, drawn):
    assert np.hypot(*fan(np.full(361, measured), LASER).T).max() == pytest.approx(drawn)


def test_lost_beams_are_left_out():
    ranges = np.full(361, np.nan)
    ranges[:100] = 2.0
    outline = fan(ranges, LASER)
    assert np.isfinite(outline).all()
    ends = outline[np.hypot(*outline.T) > 0]
    assert np.arctan2(ends[:, 1], ends[:, 0]).max() <= LASER.angles[99]


@pytest.mark.parametrize("name", PRESETS)
def test_every_laser_has_a_fan_of_few_corners(name):
    model = PRESETS[name]
    assert 6 <= len(fan(np.full(model.samples, model.range_max), model)) <= 600


def test_fans_and_targets_stand_where_lasers_are_now():
    fleet = fleet_of(2)
    fleet = replace(
        fleet,
        motion=Motion.at_rest(np.array([7.0, 0.0]), np.array([1.0, 0.0]), np.array([np.pi / 2, 0.0])),
        target=Target(np.array([np.nan, 4.0]), np.array([np.nan, 0.0])),
    )
    drawn = shapes(fleet, {"r.0": np.full(361, 5.0), "r.1": np.full(361, 5.0)})
    assert drawn.keys() == {"fan of r.0", "fan of r.1", "target of r.1"}
    assert drawn["fan of r.0"].corners[0] == pytest.approx((7.0 - 0.1, 1.0 + 0.3))
    # The laser looks to the left of the vehicle, 4 m away.
    assert drawn["target of r.1"].corners.mean(axis=0) == pytest.approx((0.3, 0.1 + 4.0))


def test_a_member_that_has_not_scanned_has_no_fan():
    fleet = fleet_of(2)
    batch = ScanBatch(LASER, 0.0, ("r.0", "r.1"), np.ones((2, 361)), None, np.zeros(2, dtype=bool))
    assert scanned(fleet, [batch]).keys() == {"r.0", "r.1"}
    assert scanned(fleet, [None]) == {}
    assert shapes(fleet, {}) == {}
