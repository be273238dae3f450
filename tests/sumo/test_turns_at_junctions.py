"""Junctions with stop signs, all-way stops, right before left, zipper; members, and members with SUMO's cars.

The junction is the one of `tests/support/nets/cross`, with all roads of one lane, built with another type.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from platoontraffic.observation.observer import Observer
from platoontraffic.road.lane_routes import Line
from platoontraffic.road.netconvert import build_net
from platoontraffic.road.network import Network
from platoontraffic.simulation import Setting, Simulation
from platoontraffic.sumo.conflicts import Conflicts, Walk
from platoontraffic.sumo.ego import Ego
from platoontraffic.sumo.right_of_way import RightOfWay
from platoontraffic.sumo.stoplines import PEOPLE, RIGHT_OF_WAY, StopLines
from platoontraffic.world.contact import Contacts
from platoontraffic.world.fleet import Member
from tests.sumo.test_right_of_way import EYE, NETS, STEP, Staged, deployed, insert
from tests.support.bench import NO_WALLS

ARMS = ("west", "south", "east", "north")
ACROSS = {"west": "east", "south": "north", "east": "west", "north": "south"}
TO_LINE = 60.0  # distance of members from the junction's middle at the start [m]


@pytest.fixture(scope="module")
def net(tmp_path_factory) -> Callable[[str], Network]:
    pytest.importorskip("sumo", reason="netconvert comes with eclipse-sumo: pip install platoontraffic[gui]")

    def built(kind: str) -> Network:
        folder = tmp_path_factory.mktemp(kind)
        nodes, edges = ((NETS / f"cross.{part}.xml").read_text() for part in ("nod", "edg"))
        (folder / "cross.nod.xml").write_text(nodes.replace('type="priority"', f'type="{kind}" radius="9"'))
        priorities = edges if kind == "priority_stop" else edges.replace('priority="3"', 'priority="1"')
        made = priorities.replace('numLanes="2"', 'numLanes="1"')
        (folder / "cross.edg.xml").write_text(made)
        (folder / "cross.netccfg").write_text((NETS / "cross.netccfg").read_text())
        build_net(folder / "cross.netccfg", folder / "made.net.xml")
        return Network.read(folder / "made.net.xml")

    return built


def member(network: Network, arm: str, to: str, back: float = 0.0) -> Member:
    """One that comes from an arm, `back` farther away than TO_LINE."""
    edges = (f"{arm}_in", f"{to}_out")
    lengths = network.edges[edges[0]]
    lane = len(lengths) - 1  # the first one may be a footpath
    made = deployed(network, edges, lengths[lane] - TO_LINE - back, lane, 8.0, EYE)
    return replace(made, id=arm, platoon=arm)


def played(network: Network, members: list[Member], words: Path, seconds: float, stage=lambda: None):
    """For each vehicle the times at which it stood first and at which it entered the junction; events;
    and the least distance of a member from another vehicle."""
    setting = Setting(
        members, NO_WALLS, STEP, steps=round(seconds / STEP), ground=lambda: Staged(network, words, stage),
        observer=lambda: Observer(members, network, Contacts(NO_WALLS, {m.id for m in members})), whole_traffic_every=1,
    )  # fmt: skip
    stood, entered, events, apart = {}, {}, [], np.inf
    with Simulation(setting) as simulation:
        for now in simulation:
            events += now.events
            traffic = now.traffic
            boxes = shapely.polygons(traffic.boxes().corners())
            for i, j in itertools.product(range(len(now.fleet)), range(len(boxes))):
                if i == j:
                    continue
                apart = min(apart, boxes[i].distance(boxes[j]))
            for i, name in enumerate(traffic.ids):
                away = np.hypot(traffic.x[i] - 500, traffic.y[i])
                if traffic.speed[i] < 0.1 and away < 40 and now.time > 1:
                    stood.setdefault(name, now.time)
                if away < 11:
                    entered.setdefault(name, now.time)
    return stood, entered, events, apart


@pytest.mark.sumo
def test_a_member_stands_at_a_stop_sign_and_goes_on_at_once_where_nothing_comes(net, tmp_path):
    network = net("priority_stop")
    stood, entered, events, _ = played(network, [member(network, "north", "south")], tmp_path / "w", 30.0)
    assert 0 < entered["north"] - stood["north"] < 4.0
    assert [e.what for e in events if e.kind == "held"] == ["stop_sign"]


@pytest.mark.sumo
@pytest.mark.parametrize("turn", ["straight", "left"])
def test_four_members_that_come_at_once_to_an_all_way_stop_go_one_after_the_other(net, tmp_path, turn):
    network, words = net("allway_stop"), tmp_path / "w"
    left = {"west": "north", "north": "east", "east": "south", "south": "west"}
    to = ACROSS if turn == "straight" else left
    stood, entered, events, apart = played(network, [member(network, arm, to[arm]) for arm in ARMS], words, 60.0)
    assert set(entered) == set(ARMS)
    assert all(entered[arm] > stood[arm] for arm in ARMS)
    assert max(entered.values()) - min(stood.values()) < 30.0
    assert apart > 0.5
    assert not [e for e in events if e.kind in ("collision", "failed_to_yield", "creeps")]


@pytest.mark.sumo
def test_who_stands_first_at_an_all_way_stop_goes_first(net, tmp_path):
    """Two roads that cross; each order of arrival."""
    network = net("allway_stop")
    for first, second in (("west", "south"), ("south", "west")):
        members = [member(network, first, ACROSS[first]), member(network, second, ACROSS[second], 12.0)]
        stood, entered, *_ = played(network, members, tmp_path / "w", 40.0)
        assert stood[first] < stood[second]
        assert entered[first] < entered[second]


@pytest.mark.sumo
def test_a_member_at_an_all_way_stop_takes_its_turn_among_cars_of_sumo(net, tmp_path):
    """Three cars come from each other arm; none waits for ever, none touches."""
    network, words = net("allway_stop"), tmp_path / "w"

    def stage() -> None:
        for arm in ("south", "east", "north"):
            length = network.edges[f"{arm}_in"][0]
            for k in range(3):
                insert(f"{arm}.{k}", (f"{arm}_in", f"{ACROSS[arm]}_out"), length - TO_LINE - 15.0 * k, 8.0)

    _, entered, events, apart = played(network, [member(network, "west", "east")], words, 90.0, stage)
    before = sum(entered[name] < entered["west"] for name in entered)
    assert before <= 4  # those that stood there first, not whole columns
    assert len(entered) == 10
    assert apart > 0.3
    assert not [e for e in events if e.kind in ("collision", "failed_to_yield")]


@pytest.mark.sumo
@pytest.mark.parametrize(
    "kind", ["right_before_left", "zipper", "priority", "unregulated", "traffic_light_unregulated"]
)
def test_four_members_that_come_at_once_do_not_lock_each_other(net, tmp_path, kind):
    network = net(kind)
    _, entered, events, apart = played(
        network, [member(network, arm, ACROSS[arm]) for arm in ARMS], tmp_path / "w", 60.0
    )
    assert set(entered) == set(ARMS)
    assert apart > 0.3
    assert not [e for e in events if e.kind in ("collision", "failed_to_yield")]


@pytest.mark.sumo
def test_a_member_gives_way_to_the_right_and_not_to_the_left(net, tmp_path):
    network = net("right_before_left")
    for other, goes_first in (("south", False), ("north", True)):
        members = [member(network, "west", "east"), member(network, other, ACROSS[other])]
        _, entered, *_ = played(network, members, tmp_path / "w", 40.0)
        assert (entered["west"] < entered[other]) is goes_first


@pytest.mark.sumo
@pytest.mark.parametrize("late", [-15.0, 0.0, 15.0])
def test_a_member_lets_cars_cross_that_yield_to_nobody(net, tmp_path, late):
    """At an unregulated junction SUMO's drivers look at nobody."""
    network = net("unregulated")

    def stage() -> None:
        for arm in ("south", "north"):
            insert(arm, (f"{arm}_in", f"{ACROSS[arm]}_out"), network.edges[f"{arm}_in"][0] - TO_LINE - late, 8.0)

    _, entered, events, apart = played(network, [member(network, "west", "east")], tmp_path / "w", 30.0, stage)
    assert len(entered) == 3
    assert apart > 0.5
    assert not [e for e in events if e.kind == "collision"]


@pytest.mark.sumo
def test_at_a_green_light_for_paths_that_cross_a_member_gives_way(net):
    """A grid of such junctions, which netgenerate can make: members caused 18 contacts in five runs."""
    network, by_light = net("traffic_light_unregulated"), net("traffic_light")
    *_, lines = network.route_lanes(("west_in", "south_out"), 0)
    assert network.unregulated.issuperset(lines[0].via)
    assert not by_light.unregulated
    for one, at_green in ((network, "="), (by_light, "G")):
        stops = StopLines(one, SimpleNamespace())
        line = stops._at_junction[lines[0]._replace(light="tl", index=1), "car"]
        for state, judged in (("G", at_green), ("r", "r"), ("y", "y")):
            stops._now = SimpleNamespace(lights={"tl": "G" + state})
            assert stops._link_state(line) == judged


def crossed_by(own: tuple[float, float], where, east_of_north: float, speed: float) -> tuple[StopLines, Line]:
    """A line before a pedestrian crossing, at distances beyond it, with someone there."""
    points = np.column_stack([np.linspace(*own, 17), np.zeros(17)])
    conflicts = Conflicts((), (), (Walk(":c0", own, points, 2.6),), np.inf)
    client = SimpleNamespace(
        edge=SimpleNamespace(getLastStepPersonIDs=lambda _: ("someone",)),
        lane=SimpleNamespace(getMaxSpeed=lambda _: 13.9),
        person=SimpleNamespace(
            getPosition=lambda _: where, getSpeed=lambda _: speed, getAngle=lambda _: east_of_north
        ),
    )  # fmt: skip
    lines, line = StopLines(None, client), Line(0.0, "m", "", 0, "in_0", "out_0", (":x_0_0",), 14.0)
    lines._conflicts[line] = conflicts
    return lines, line


@pytest.mark.parametrize(("south", "is_free"), [(3.0, True), (12.0, False), (30.0, True)])
def test_a_crossing_far_beyond_the_line_is_free_where_nobody_is_when_the_vehicle_comes(south, is_free):
    """It needs some 9 s for 50 m from a stand: someone has passed then, is there, or has not come."""
    lines, line = crossed_by((50.0, 55.0), (52.0, -south), 0.0, 1.4)
    assert lines._is_free_of_people(line, 1.0, Ego("m.0", "in_0", 0.0, 4.74)) is is_free


@pytest.mark.parametrize(
    ("where", "east_of_north", "speed", "is_free"),
    [
        ((3.0, 0.0), 0.0, 0.0, False),  # stands in the way
        ((3.0, -6.0), 0.0, 0.0, True),  # stands beside it
        ((3.0, -6.0), 0.0, 1.4, False),  # walks north, into the way
        ((3.0, 6.0), 0.0, 1.4, True),  # has left it
        ((3.0, 6.0), 180.0, 1.4, False),
    ],
)
def test_a_line_is_closed_by_people_who_are_or_will_be_in_the_way(where, east_of_north, speed, is_free):
    """The way leads east, over a pedestrian crossing from 1 to 5 m beyond the line."""
    lines, line = crossed_by((1.0, 5.0), where, east_of_north, speed)
    assert lines._is_free_of_people(line, 1.0, Ego("m.0", "in_0", 0.0, 4.74)) is is_free
    assert lines._is_free_of_people(line, -12.0, Ego("m.0", ":x_0_0", 0.0, 4.74))  # it is past the crossing


@pytest.mark.parametrize(("crossing", "stops_at"), [((1.0, 5.0), 1.0), ((50.0, 55.0), 31.0)])
def test_a_member_waits_for_people_midway_where_they_are_beyond_that_place(monkeypatch, crossing, stops_at):
    """It stood at its line for whole green lights, for people on the crossing at the other end of a large junction."""
    lines, line = crossed_by(crossing, (sum(crossing) / 2, 0.0), 0.0, 0.0)
    (conflicts,) = lines._conflicts.values()
    line = line._replace(via=(":x_0_0", ":x_1_0"))
    lines._conflicts[line] = replace(conflicts, waits=30.0)
    lines._now.max_speed.update({":x_0_0": 9.0, ":x_1_0": 9.0})
    lines._now.on_lane[":x_0_0"] = []
    for name in ("has_way", "may_cross"):
        monkeypatch.setattr(RightOfWay, name, lambda *_, **__: True)
    monkeypatch.setattr(StopLines, "_has_room", lambda *_: True)
    state = lines._at_line(line, 1.0, True, Ego("m.0", "in_0", 0.0, 4.74))
    assert (state.distance, state.open, state.reason) == (stops_at, False, PEOPLE)


@pytest.mark.parametrize(("crossing", "stays"), [((6.0, 10.0), True), ((1.0, 4.0), False)])
def test_a_member_that_waits_midway_stays_there_for_people_ahead_not_for_those_that_it_is_in_the_way_of(
    monkeypatch, crossing, stays
):
    """A van set out midway while someone walked over the crossing beyond, and touched them."""
    lines, line = crossed_by(crossing, (sum(crossing) / 2, 0.0), 0.0, 0.0)
    line = line._replace(via=(":x_0_0", ":x_1_0"))
    (lines._conflicts[line],) = lines._conflicts.values()
    lanes = {":x_0_0": 9.0, ":x_1_0": 9.0}
    lines._now.lane_length.update(lanes)
    lines._now.max_speed.update(lanes)
    lines._now.position["m.0"] = 4.0
    monkeypatch.setattr(RightOfWay, "may_cross", lambda *_, midway: True)
    monkeypatch.setattr(RightOfWay, "stop_before_foes", lambda *_: np.inf)
    monkeypatch.setattr(RightOfWay, "note_waiting", lambda *_: None)
    monkeypatch.setattr(StopLines, "_has_room", lambda *_, midway: True)
    state = lines._passed(line, 4.0, Ego("m.0", ":x_0_0", 0.0, 4.74))
    assert state.open is not stays
    assert state.reason == (PEOPLE if stays else RIGHT_OF_WAY)
