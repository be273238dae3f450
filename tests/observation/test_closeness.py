"""Closeness of bodies against shapely, and against the recorded tables of a run alone."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from shapely import affinity

from platoontraffic.lidar import Boxes, Scene
from platoontraffic.observation.closeness import CLOSE, _about, look_around
from platoontraffic.vehicles.bicycle import CARS
from platoontraffic.world.contact import Contacts
from platoontraffic.world.events import CLEARANCE_REACH, CONTACT_HORIZON
from platoontraffic.world.traffic import TrafficSnapshot
from tests.support.bench import constant, platoon
from tests.support.observed import Observed

CAR = CARS["car"]


def random_scene(rng, bodies: int = 12, spread: float = 25.0) -> TrafficSnapshot:
    x, y = rng.uniform(-spread, spread, (2, bodies))
    heading, speed = rng.uniform(-np.pi, np.pi, bodies), rng.choice([0.0, 1.0, 8.0, 15.0], bodies)
    length, width = rng.uniform(0.5, 12.0, bodies), rng.uniform(0.4, 2.6, bodies)
    return TrafficSnapshot(0.0, tuple(f"b{k}" for k in range(bodies)), x, y, heading, speed, length, width)


def outlines(traffic: TrafficSnapshot) -> np.ndarray:
    return shapely.polygons(traffic.boxes().corners())


def swept(traffic: TrafficSnapshot, shapes: np.ndarray, i: int, k: int, time: float) -> shapely.Geometry:
    """What body k sweeps as seen from body i: the hull of its first and last outline, since it does not turn."""
    vx, vy = (traffic.speed * f(traffic.heading) for f in (np.cos, np.sin))
    moved = affinity.translate(shapes[k], (vx[k] - vx[i]) * time, (vy[k] - vy[i]) * time)
    return shapely.union_all([shapes[k], moved]).convex_hull


def test_clearance_is_the_least_distance_between_outlines():
    rng, overlaps = np.random.default_rng(1), 0
    for _ in range(300):
        traffic = random_scene(rng)
        shapes = outlines(traffic)
        apart = shapely.distance(shapes[:, None], shapes)
        np.fill_diagonal(apart, np.inf)
        n = 5
        clearance, closest, _, _ = look_around(traffic, n, np.full(n, 0.5))
        least = apart[:n].min(axis=1)
        np.testing.assert_allclose(clearance, np.where(least < CLEARANCE_REACH, least, np.nan), atol=1e-9)
        met = np.isfinite(clearance) & (clearance > 0)
        assert (closest[met] == apart[:n].argmin(axis=1)[met]).all()
        overlaps += (clearance == 0).sum()
    assert overlaps > 20


def test_contacts_are_the_same_where_they_are_only_looked_for_if_a_body_is_close():
    rng, members, asked, contacts = np.random.default_rng(3), {"b0", "b1"}, 0, 0
    sizes = random_scene(rng)  # of a body they never change
    always, rarely = Contacts(Scene(np.empty((0, 4))), members), Contacts(Scene(np.empty((0, 4))), members)
    for _ in range(400):
        traffic = random_scene(rng, bodies=int(rng.integers(3, 12)))
        traffic.length[:], traffic.width[:] = (v[: len(traffic.ids)] for v in (sizes.length, sizes.width))
        # A body is 4.5 mm beside the first member, or touches it by as little as counts.
        x, y, cos, sin = traffic.x, traffic.y, np.cos(traffic.heading[0]), np.sin(traffic.heading[0])
        beside = (traffic.width[0] + traffic.width[2]) / 2 + rng.choice([4.5e-3, 1e-12])
        x[2], y[2], traffic.heading[2] = x[0] - beside * sin, y[0] + beside * cos, traffic.heading[0]
        found, close = always.of(traffic), (look_around(traffic, 2, np.full(2, 0.5))[0] < CLOSE).nonzero()[0]
        assert found == (rarely.of(traffic.only(_about(traffic, close))) if len(close) else set())
        asked, contacts = asked + bool(len(close)), contacts + bool(found)
    assert 100 < asked < 400
    assert contacts > 100


def test_contact_comes_when_the_swept_outlines_meet():
    rng, contacts = np.random.default_rng(2), 0
    for _ in range(200):
        traffic = random_scene(rng, bodies=5)
        shapes = outlines(traffic)
        _, _, contact_in, _ = look_around(traffic, 1, np.full(1, 0.5))
        others = range(1, 5)
        if any(shapely.intersects(shapes[0], shapes[k]) for k in others):
            continue
        time = contact_in[0]
        reached = CONTACT_HORIZON if np.isnan(time) else time
        for k in others:  # not a millisecond before
            assert not shapely.intersects(shapes[0], swept(traffic, shapes, 0, k, reached - 1e-3))
        if np.isfinite(time):
            contacts += 1
            assert any(shapely.intersects(shapes[0], swept(traffic, shapes, 0, k, time + 1e-3)) for k in others)
    assert contacts > 20


def test_what_is_near_does_not_depend_on_the_order_or_on_the_frame():
    rng = np.random.default_rng(3)
    traffic = random_scene(rng, bodies=10, spread=12.0)
    n = len(traffic.ids)
    clearance, _, contact_in, pairs = look_around(traffic, n, np.full(n, 2.0))
    turn, order = 0.7, rng.permutation(n)
    x = np.cos(turn) * traffic.x - np.sin(turn) * traffic.y + 1000
    y = np.sin(turn) * traffic.x + np.cos(turn) * traffic.y - 500
    other = TrafficSnapshot(
        0.0, tuple(np.array(traffic.ids)[order]), x[order], y[order], traffic.heading[order] + turn,
        traffic.speed[order], traffic.length[order], traffic.width[order],
    )  # fmt: skip
    again = look_around(other, n, np.full(n, 2.0))
    np.testing.assert_allclose(again[0], clearance[order], atol=1e-9)
    np.testing.assert_allclose(again[2], contact_in[order], atol=1e-9)

    def names(ids, found):
        return {frozenset((ids[i], ids[k])) for i, k in found}

    assert names(other.ids, again[3]) == names(traffic.ids, pairs)


@pytest.mark.parametrize(("apart", "kinds"), [(0.17, ["near_miss_other"]), (0.6, [])])
def test_a_car_that_is_passed_within_arms_length_leaves_an_event(apart, kinds):
    """The cars of the bench stand; the member drives by at 6 m/s."""
    observed = Observed(platoon(constant(0.0), model=CAR))
    y = apart + (CAR.width + 1.8) / 2
    observed.at(0.0, x=0.0, speed=6.0, others=[(30.0, y)])
    found = [observed.at(k + 1.0, x=6.0 * (k + 1), speed=6.0, others=[(30.0, y)]) for k in range(8)]
    assert [kind for seen in found for kind, _ in seen.kinds] == kinds
    assert min(seen.measures.clearance[0] for seen in found) == pytest.approx(apart)
    assert {seen.measures.closest[0] for seen in found[1:]} == {"other.0"}


@pytest.mark.parametrize(("ahead", "expected"), [(1.5, 0.145), (-1.5, 0.145)])
def test_contact_from_the_side_is_foreseen_also_where_the_middles_move_apart(ahead, expected):
    """A car beside a truck of 9.2 m comes nearer sideways by 1 m/s, and is faster by 2 m/s."""
    aside = math.atan(1.0 / 22.0)
    width, length = 1.76 / 2 * math.cos(aside) + 4.74 / 2 * math.sin(aside), np.array([9.2, 4.74])
    traffic = TrafficSnapshot(
        0.0, ("truck", "car"), np.array([0.0, ahead]), np.array([0.0, 1.2 + width + expected]),
        np.array([0.0, -aside]), np.array([20.0, math.hypot(22.0, 1.0)]), length, np.array([2.4, 1.76]),
    )  # fmt: skip
    assert look_around(traffic, 1, np.full(1, 0.5))[2][0] == pytest.approx(expected, abs=1e-9)


def test_contact_is_foreseen_by_closing_speed():
    observed = Observed(platoon(constant(0.0), model=CAR))
    seen = observed.at(0.0, x=0.0, speed=10.0, others=[(30.0 + CAR.length, 0.0)])
    assert seen.measures.contact_in[0] == pytest.approx(3.0)
    assert seen.measures.clearance[0] != seen.measures.clearance[0]  # 30 m is not within reach


def test_boxes_of_the_oracle_are_those_of_lasers():
    traffic = random_scene(np.random.default_rng(4))
    boxes = Boxes(traffic.x, traffic.y, traffic.heading, traffic.length, traffic.width, owner=np.arange(12))
    assert shapely.area(shapely.polygons(boxes.corners())) == pytest.approx(traffic.length * traffic.width)
