"""A road over another one, in a network without heights."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from platoontraffic.observation.observer import Observer
from platoontraffic.observation.splits import _between
from platoontraffic.observation.standstills import _vehicle_ahead
from platoontraffic.road.network import Network
from platoontraffic.simulation import Setting, Simulation
from platoontraffic.sumo.background import Background
from platoontraffic.sumo.programs import home_of, program
from platoontraffic.world.contact import Contacts
from platoontraffic.world.events import ENCROACHED
from platoontraffic.world.traffic import TrafficSnapshot
from tests.sumo.test_right_of_way import EYE, NO_WALLS, STEP, Staged, deployed, insert, track

pytestmark = pytest.mark.sumo


@pytest.fixture
def bridge(generated_nets) -> Network:
    """Road `under` from west to east, `over` from south to north above its middle."""
    file = Path(generated_nets, "bridge.net.xml")
    ends = {"w": (0, 0), "e": (400, 0), "s": (200, -200), "n": (200, 200)}
    nodes = "".join(f'<node id="{n}" x="{x}" y="{y}"/>' for n, (x, y) in ends.items())
    edges = '<edge id="under" from="w" to="e" speed="13.9"/><edge id="over" from="s" to="n" speed="13.9"/>'
    for kind, text in (("nod", f"<nodes>{nodes}</nodes>"), ("edg", f"<edges>{edges}</edges>")):
        Path(generated_nets, f"bridge.{kind}.xml").write_text(text)
    netconvert = program("netconvert")
    given = [
        f"--{kind}-files={generated_nets / f'bridge.{short}.xml'}" for kind, short in (("node", "nod"), ("edge", "edg"))
    ]
    subprocess.run(
        [netconvert, *given, "--offset.disable-normalization", f"--output-file={file}"],
        env=home_of(netconvert), check=True, capture_output=True,
    )  # fmt: skip
    return Network.read(file)


def test_a_member_does_not_stop_for_a_vehicle_on_the_bridge(bridge, tmp_path):
    """It stands right over its lane: a laser in a flat world would meet it."""
    member = deployed(bridge, ("under",), 60.0, 0, 10.0, EYE)

    def ground() -> Staged:
        return Staged(bridge, tmp_path / "words.log", lambda: insert("c", ("over",), 202.0, 0.0))

    setting = Setting([member], NO_WALLS, STEP, steps=200, ground=ground, whole_traffic_every=1)
    with Simulation(setting) as simulation:
        seen = [now.traffic for now in simulation if now.step and len(now.fleet)]
    _, x, _, speed = track(seen)
    assert x[-1] > 250
    assert speed.min() > 9.0


@pytest.mark.parametrize(("begins", "sees"), [(190.0, True), (10.0, False)])
def test_vehicles_on_both_levels_are_seen_only_where_members_are_on_both(bridge, tmp_path, begins, sees):
    """In a city some member drives on every road. In an open one a platoon on a bridge met the motorway's cars."""
    members = [
        deployed(bridge, ("under",), 60.0, 0, 10.0, EYE),
        replace(deployed(bridge, ("over",), begins, 0, 0.0, EYE), id="other.0", platoon="other"),
    ]

    def ground() -> Staged:
        return Staged(bridge, tmp_path / "words.log", lambda: insert("c", ("over",), 202.0, 0.0))

    setting = Setting(members, NO_WALLS, STEP, steps=30, ground=ground, whole_traffic_every=1)
    with Simulation(setting) as simulation:
        seen = [now.traffic for now in simulation if now.step and len(now.fleet) == 2]
    assert seen
    assert all(("c" in traffic.ids) == sees for traffic in seen)


def test_members_on_both_levels_do_not_see_or_touch_each_other(bridge, tmp_path):
    """One stops behind a car that stands on the bridge; the other one drives through below both."""
    members = [
        deployed(bridge, ("under",), 20.0, 0, 10.0, EYE),
        replace(deployed(bridge, ("over",), 172.0, 0, 6.0, EYE), id="other.0", platoon="other"),
    ]

    def ground() -> Staged:
        return Staged(bridge, tmp_path / "words.log", lambda: insert("c", ("over",), 206.0, 0.0))

    def observer() -> Observer:
        return Observer(members, bridge, Contacts(NO_WALLS, {member.id for member in members}))

    setting = Setting(members, NO_WALLS, STEP, 340, ground=ground, observer=observer, whole_traffic_every=1)
    with Simulation(setting) as simulation:
        log = [now for now in simulation if now.step and len(now.fleet) == 2]
    assert {name for now in log for name in now.traffic.ids} == {"m.0", "other.0", "c"}
    assert log[-1].traffic.x[0] > 250
    assert min(now.traffic.speed[0] for now in log) > 9.0
    stands = log[-1].traffic
    front, rear = stands.y[1] + stands.length[1] / 2, stands.y[2] - stands.length[2] / 2
    assert stands.speed[1] < 0.1
    assert 1.0 < rear - front < 4.0
    passing = next(now.traffic for now in log if abs(now.traffic.x[0] - stands.x[1]) < 1.0)
    assert abs(passing.y[0] - passing.y[1]) < (stands.length[1] + stands.width[0]) / 2  # one over the other
    assert passing.are_apart(0, 1)
    assert passing.are_apart(2, 0)
    assert not passing.are_apart(1, 2)
    assert {event.kind for now in log for event in now.events} == {"standstill"}


def test_who_has_passed_over_a_member_shortly_before_has_not_encroached_upon_it(bridge, tmp_path):
    members = [
        deployed(bridge, ("under",), 20.0, 0, 10.0, EYE),
        replace(deployed(bridge, ("over",), 101.0, 0, 6.0, EYE), id="other.0", platoon="other"),
    ]

    def observer() -> Observer:
        return Observer(members, bridge, Contacts(NO_WALLS, {member.id for member in members}))

    def ground() -> Staged:
        return Staged(bridge, tmp_path / "words.log", lambda: None)

    setting = Setting(members, NO_WALLS, STEP, 250, ground=ground, observer=observer)
    with Simulation(setting) as simulation:
        log = [now for now in simulation if now.step and len(now.fleet) == 2]
    over = next(now.traffic for now in log if now.traffic.y[1] > 0.0)
    under = next(now.traffic for now in log if now.traffic.x[0] > 201.6)
    assert 0.5 < under.time - over.time < 2.5
    assert not [event for now in log for event in now.events]


def test_a_vehicle_that_has_passed_over_a_member_has_not_encroached_upon_it_either(bridge, tmp_path):
    """It has left the bridge by 60 m when the member comes to it."""
    members = [
        deployed(bridge, ("under",), 60.0, 0, 10.0, EYE),
        replace(deployed(bridge, ("over",), 60.0, 0, 0.5, EYE), id="other.0", platoon="other"),
    ]

    def observer() -> Observer:
        return Observer(members, bridge, Contacts(NO_WALLS, {member.id for member in members}))

    def ground() -> Staged:
        return Staged(bridge, tmp_path / "words.log", lambda: insert("c", ("over",), 76.0, 13.0))

    setting = Setting(members, NO_WALLS, STEP, 170, ground=ground, observer=observer, whole_traffic_every=1)
    with Simulation(setting) as simulation:
        log = [now for now in simulation if now.step and len(now.traffic.ids) == 3]
    over = next(now.traffic for now in log if now.traffic.y[2] > 0.0)
    under = next(now.traffic for now in log if now.traffic.x[0] > 201.6)
    assert 2.0 < under.time - over.time < ENCROACHED - 0.2
    assert under.y[2] > 50.0
    assert not [event for now in log for event in now.events]


def test_only_a_member_that_is_on_a_road_or_comes_to_it_counts_as_on_its_level():
    """One came off the upper road, one off the lower road, onto the same lane, and drove through each other there."""
    bridge = ("upper", "lower")
    for edges, lane, driven in [
        (("upper", "ramp", "on"), "upper_0", {"upper"}),
        (("upper", "ramp", "on"), ":end_0_0", {"upper"}),
        (("upper", "ramp", "on"), "ramp_0", set()),
        (("lower", "on"), "on_0", set()),
        (("before", "lower", "on"), "before_0", {"lower"}),
        (("upper", "ramp", "lower"), "ramp_0", {"lower"}),
        (("upper", "ramp", "lower"), "upper_0", {"upper"}),
        (("before", "upper", "lower"), "before_0", set()),
        (("upper", "on"), "", {"upper"}),
    ]:
        sumo = SimpleNamespace(vehicle=SimpleNamespace(getLaneID=lambda _, lane=lane: lane))
        network = SimpleNamespace(entered_from={":end_0_0": "upper_0"})
        member = SimpleNamespace(id="m.0", route=SimpleNamespace(edges=edges))
        assert Background(sumo, network)._driven(member, *bridge) == driven


def test_what_stands_on_the_bridge_is_no_cause_below_it():
    """The last row is right before the first, and between it and the second."""
    at = np.array([(0.0, 0.0), (20.0, 0.0), (5.0, 0.0)])
    traffic = TrafficSnapshot(0.0, ("m.0", "m.1", "c"), *at.T, *np.zeros((2, 3)), np.full(3, 4.0), np.full(3, 2.0))
    apart = traffic.on_levels({0: {"c"}})
    assert (_vehicle_ahead(traffic, 0), _between(traffic, 0, 1)) == ("c", ["c"])
    assert (_vehicle_ahead(apart, 0), _between(apart, 0, 1)) == ("", [])
    assert apart.with_others(traffic).are_apart(0, 2)


def test_levels_are_kept_by_rows_and_a_member_without_any_has_none():
    """A vehicle that was on another level for a member may have been left out for all."""
    traffic = TrafficSnapshot(0.0, ("a", "b", "c", "d"), *np.zeros((6, 4)))
    levels = traffic.on_levels({0: {"c", "d"}, 1: {"d", "c"}, 2: set(), 3: {"a"}}).other_levels
    assert [(members.tolist(), bodies.tolist()) for members, bodies in levels] == [([0, 1], [2, 3]), ([3], [0])]
    assert all(part.dtype.kind == "i" for one in levels for part in one)
