"""Members that wait at stop lines in SUMO."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from types import SimpleNamespace

import libsumo
import numpy as np
import pytest
import shapely

from platoontraffic import shipped
from platoontraffic.controllers import CLOSED_BY
from platoontraffic.controllers.path import PathLeader
from platoontraffic.controllers.tracking import TrackingFollower
from platoontraffic.lidar import PRESETS, Mount
from platoontraffic.observation.observer import Observer
from platoontraffic.road.gap_acceptance import Pace
from platoontraffic.road.lane_routes import CHANGING, SHORTEST_CHANGE, Line
from platoontraffic.road.network import Network
from platoontraffic.road.route import Route
from platoontraffic.simulation import Setting, Simulation
from platoontraffic.sumo import conflicts
from platoontraffic.sumo.conflicts import LINK_ONTO, LINK_STATE, LINK_VIA, Conflicts, Crossing, Sampled, Walk, _path
from platoontraffic.sumo.ego import Ego
from platoontraffic.sumo.far_lines import FarLines
from platoontraffic.sumo.lane_choice import LaneChoice
from platoontraffic.sumo.letting_in import Stop
from platoontraffic.sumo.reads import Once, Reads
from platoontraffic.sumo.right_of_way import (
    BEFORE_PATH,
    LETS_IN_FOR,
    LETS_IN_LONGEST,
    NEARLY_STANDS,
    Approach,
    RightOfWay,
    _is_past_all,
    _stop_before,
)
from platoontraffic.sumo.room_to_change import RoomToChange, Wanted
from platoontraffic.sumo.stoplines import LIGHT, NO_LINE, NO_ROOM, RIGHT_OF_WAY, LineState, StopLines, _not_made
from platoontraffic.sumo.world import World
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.vehicles.motion import Drive
from platoontraffic.world.contact import Contacts
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.traffic import TrafficSnapshot
from tests.support import ODD_NETS
from tests.support.bench import NO_WALLS
from tests.support.generated import corner, generated, roundabouts, turnabout

NETS = ODD_NETS
STEP = 0.1
CAR = VEHICLES["car"]


class Members(SimpleNamespace):
    """What `StopLines.signals` reads of a fleet."""

    def __len__(self) -> int:
        return len(self.ids)


def test_who_is_past_all_paths_can_stop_before_none_of_them_and_the_other_way_round():
    rng, past = np.random.default_rng(3), 0
    for _ in range(2000):
        paths = []
        for first in rng.random(rng.integers(4)) < 0.5:
            own, touches = (float(rng.uniform(0, 20)), 25.0), float(rng.choice([rng.uniform(0, 20), np.inf]))
            paths.append(Crossing("before", ("via",), own, own, False, bool(first), np.inf, 10.0, touches))
        cut = rng.integers(len(paths) + 1)
        found = Conflicts((), tuple(paths[:cut]), (), np.inf, narrow=tuple(paths[cut:]))
        over, ego = float(rng.uniform(-20, 20)), Ego("ego", "lane", float(rng.uniform(0, 15)), 5.0)
        is_past = _is_past_all(found, over, ego)
        if ego.speed >= NEARLY_STANDS * ego.size:
            assert is_past == all(np.isinf(_stop_before(path, over, ego)) for path in paths)
        past += is_past
    assert 200 < past < 1800


NOBODY = Members(members=(), ids=(), progress=SimpleNamespace(rows=np.arange(0), station=np.zeros(0)))
EYE = replace(PRESETS["car-leader"], mount=Mount(CAR.length / 2))
BLIND = replace(EYE, range_max=0.5)
ROADS = SimpleNamespace(unregulated=frozenset(), entered_from={})  # a network that gives priority everywhere

# ---- leaders that wait for a gap in SUMO


class Staged(World):
    """SUMO with background traffic that is inserted once the members are there."""

    def __init__(self, network: Network, words: Path, stage: Callable[[], None]) -> None:
        super().__init__(network, STEP, 1, words)
        self._stage = stage

    def deploy(self, fleet: Fleet, later: Sequence[Fleet] = ()) -> Fleet:
        fleet = super().deploy(fleet, later)
        self._stage()
        return fleet


@pytest.fixture
def scene(tmp_path):
    """Drives a member with law `path`, blind or seeing, in background traffic; a snapshot a step, and its route."""

    def play(net: str, edges, others, seconds, *, position=200.0, lane=0, speed=10.0, first=lambda: None, eye=EYE):
        network = Network.read(NETS / f"{net}.net.xml")
        member = deployed(network, edges, position, lane, speed, eye)

        def stage() -> None:
            first()
            for other in others:
                insert(*other)

        def ground() -> World:
            return Staged(network, tmp_path / "words.log", stage)

        steps = round(seconds / STEP)
        setting = Setting([member], NO_WALLS, STEP, steps=steps, ground=ground, whole_traffic_every=1)
        with Simulation(setting) as simulation:
            seen = [now.traffic for now in simulation if now.step and len(now.fleet)]
        return seen, member.route

    return play


def deployed(network: Network, edges, position: float, lane: int, speed: float, eye) -> Member:
    x, y, heading = network.lane_pose(edges[0], lane, position)
    pose = (x - CAR.length / 2 * np.cos(heading), y - CAR.length / 2 * np.sin(heading), heading)
    route = Route.along(edges, *network.route_lanes(edges, lane, position=position))
    law = PathLeader(speed=speed)
    return Member("m.0", "m", 0, CAR, eye, law, edges[0], lane, position, pose, route, speed=speed)


def insert(name: str, edges: tuple[str, ...], position: float, speed: float, lane: int = 0) -> None:
    libsumo.vehicletype.copy("DEFAULT_VEHTYPE", name)
    libsumo.vehicletype.setSpeedDeviation(name, 0)
    libsumo.vehicletype.setImperfection(name, 0)
    libsumo.vehicletype.setMaxSpeed(name, max(speed, 1.0))
    libsumo.route.add(name, edges)
    place = {"departLane": str(lane), "departPos": str(position), "departSpeed": str(speed)}
    libsumo.vehicle.add(name, name, name, **place)
    libsumo.vehicle.setLaneChangeMode(name, 0)
    if not speed:
        libsumo.vehicle.setSpeed(name, 0)


def clearance(seen: list[TrafficSnapshot], name: str) -> float:
    """Smallest distance between the member's footprint and another [m]."""
    corners = [t.boxes().corners()[[0, t.ids.index(name)]] for t in seen if name in t.ids and t.ids[0] == "m.0"]
    return float(shapely.distance(*shapely.polygons(np.array(corners)).T).min())


def track(seen: list[TrafficSnapshot], name: str = "m.0") -> tuple[np.ndarray, ...]:
    rows = [(t.time, t.x[i], t.y[i], t.speed[i]) for t in seen if name in t.ids for i in [t.ids.index(name)]]
    return tuple(np.array(rows).T)


MINOR, MAJOR = ("north_in", "south_out"), ("west_in", "east_out")
END, END_Y = 289.6, 10.4  # end of the lane of north_in: position on it, y [m]


@pytest.mark.sumo
@pytest.mark.parametrize("eye", [EYE, BLIND], ids=["seeing", "blind"])
def test_a_member_crosses_from_the_minor_road_in_a_gap_of_the_major_one(scene, eye):
    """A column, one car every 2 s, with a gap; it crosses there whether its laser sees the cars or not."""
    column = [(f"c{k}", MAJOR, 440.0 - 20 * k, 10.0) for k in range(5)]
    after = [(f"d{k}", MAJOR, 220.0 - 20 * k, 10.0) for k in range(2)]
    seen, _ = scene("cross", MINOR, [*column, *after], 33.0, eye=eye)
    time, _, y, speed = track(seen)
    assert speed.min() < 0.5
    assert y[speed < 0.1].min() > 10.4 + CAR.length / 2  # it waits before the line
    crossed = time[y < 0].min()
    its_time = {name: track(seen, name)[0][track(seen, name)[1] > 500].min() for name, *_ in (*column, *after)}
    assert max(its_time[name] for name, *_ in column) < crossed < min(its_time[name] for name, *_ in after)
    for name in its_time:
        assert clearance(seen, name) > 1.0


@pytest.mark.sumo
def test_a_member_slows_down_at_the_minor_line_and_does_not_stop_when_the_road_is_free(scene):
    seen, _ = scene("cross", MINOR, [], 30.0)
    _, _, y, speed = track(seen)
    assert 2.0 < speed[np.abs(y - 10) < 15].min() < 9.0
    assert y[-1] < -60


@pytest.mark.sumo
def test_a_member_a_little_over_the_line_stops_there_for_a_foe(scene):
    """The foe comes 3.5 s later; comfortable braking from 1.5 m/s, 0.2 m before the line, ends 0.5 m too late."""
    seen, _ = scene("cross", MINOR, [("c", MAJOR, 455.0, 10.0)], 25.0, position=END - 0.2, speed=1.5, eye=BLIND)
    _, _, y, speed = track(seen)
    over = END_Y - (y[speed.argmin()] - CAR.length / 2)
    assert speed.min() < 0.05
    assert 0.1 < over < 1.0
    assert clearance(seen, "c") > 2.0
    assert y[-1] < 0


@pytest.mark.sumo
def test_a_member_that_waits_midway_leaves_when_its_light_turns_yellow(scene):
    """42 s after the begin: oncoming cars stop then. It left at 49 s, behind crossing cars that had green from 45 s on;
    in Bologna such a member stood in the junction, and crossing cars struck it."""
    against = [(f"c{k}", ("east_in", "west_out"), 480.0 - 12 * k, 8.0, 1) for k in range(40)]
    cross = [("n", ("north_in", "south_out"), 285.0, 5.0), ("s", ("south_in", "north_out"), 285.0, 5.0)]
    left = ("west_in", "north_out")
    seen, _ = scene("lights", left, [*against, *cross], 55.0, position=470.0, lane=1, speed=8.0, eye=BLIND)
    time, _, y, speed = track(seen)
    waits = (time > 10.0) & (time < 42.0)
    assert speed[waits].max() == 0
    assert 42.5 < time[(time > 42.0) & (speed > 0.1)][0] < 45.0
    assert y[-1] > 10.0
    assert min(clearance(seen, name) for name in ("n", "s", *(f"c{k}" for k in range(40)))) > 0.3


@pytest.mark.sumo
def test_a_left_turning_car_leaves_the_junction_before_a_member_that_stands_a_little_over_its_red_line(scene):
    """To SUMO it was inside the junction, with priority: in Bologna a left-turner waited for it in the next green."""
    turn = ("east_in", "south_out")

    def first() -> None:
        links = libsumo.trafficlight.getControlledLinks("middle")
        goes = [bool(link) and link[0][0][:-2] == turn[0] and link[0][1][:-2] == turn[1] for link in links]
        libsumo.trafficlight.setRedYellowGreenState("middle", "".join("g" if one else "r" for one in goes))

    ahead = ("west_in", "east_out")
    left = [("c", turn, 470.0, 6.0, 1)]
    seen, route = scene("lights", ahead, left, 15.0, position=492.6, speed=1.5, eye=BLIND, first=first)
    _, x, _, speed = track(seen)
    over = x[-1] + CAR.length / 2 - route.lines[0].station
    assert speed[-1] == 0
    assert 0.2 < over < 1.0
    assert track(seen, "c")[2][-1] < -30.0


@pytest.mark.sumo
def test_a_member_on_the_major_road_drives_past_a_vehicle_that_waits(scene):
    seen, _ = scene("cross", MAJOR, [("f", MINOR, 270.0, 5.0)], 30.0, position=380.0)
    *_, speed = track(seen)
    assert speed.min() > 9.5
    assert clearance(seen, "f") > 3.0


@pytest.mark.sumo
def test_a_member_that_turns_left_waits_inside_for_oncoming_vehicles(scene):
    """Its laser sees none of them: SUMO reports them."""
    against = [(f"c{k}", ("east_in", "west_out"), 440.0 - 30 * k, 10.0, 1) for k in range(4)]
    seen, _ = scene("cross", ("west_in", "north_out"), against, 35.0, position=400.0, lane=1, speed=8.0, eye=BLIND)
    time, _, y, speed = track(seen)
    crossed = time[y > 2.0].min()
    for name, *_ in against:
        t, its_x, *_ = track(seen, name)
        assert clearance(seen, name) > 0.5
        assert t[its_x < 500].min() < crossed
    assert speed.min() < 0.5
    assert y[-1] > 30


@pytest.mark.sumo
def test_a_member_gives_way_to_a_vehicle_that_turns_off_the_major_road_before_it(scene):
    """Also after that vehicle has left the place inside the junction where it waits."""
    turning = ("t", ("west_in", "north_out"), 440.0, 4.0, 1)
    for at in (235.0, 245.0, 255.0):
        seen, _ = scene("cross", MINOR, [turning], 30.0, position=at, speed=6.0, eye=BLIND)
        assert clearance(seen, "t") > 0.3, at


@pytest.mark.sumo
@pytest.mark.parametrize(("others", "fails"), [([("c", MAJOR, 436.0, 10.0)], True), ([], False)])
def test_a_member_that_is_made_to_drive_on_fails_to_yield(tmp_path, others, fails):
    network = Network.read(NETS / "cross.net.xml")
    member = deployed(network, MINOR, 240.0, 0, 10.0, BLIND)

    def ground() -> World:
        return Staged(network, tmp_path / "words.log", lambda: [insert(*other) for other in others])

    def observer() -> Observer:
        return Observer([member], network, Contacts(NO_WALLS, {"m.0"}))

    with Simulation(Setting([member], NO_WALLS, STEP, 100, ground=ground, observer=observer)) as simulation:
        simulation.reset()
        kinds = [one.kind for _ in range(60) for one in simulation.step({"m.0": Drive(0.0, 0.0)}).events]
    assert ("failed_to_yield" in kinds) == fails


@pytest.mark.sumo
def test_a_member_waits_at_green_for_a_vehicle_still_in_the_junction(scene):
    """A slow vehicle enters at the end of the major road's green, and is still there at the minor road's."""
    seen, _ = scene("lights", MINOR, [("c", MAJOR, 452.0, 1.0)], 75.0, position=150.0, eye=BLIND)
    time, _, y, _ = track(seen)
    its_time, its_x, *_ = track(seen, "c")
    inside = its_time[(its_x > 490.3) & (its_x < 509.7)]
    assert inside[0] < 44.0
    assert inside[-1] > 55.0
    assert clearance(seen, "c") > 0.5
    assert inside[-1] - 6.0 < time[y < END_Y - 2].min() < inside[-1] + 4.0


@pytest.mark.sumo
@pytest.mark.parametrize(
    ("others", "goes"),
    [
        ([("q", ("south_out",), 12.0, 0.0)], False),  # its rear is 7 m behind the junction: 4.74 m, and 2.4 m to it
        ([("q", ("south_out",), 12.5, 0.0)], True),  # it stood 4 m before the queue: for a cycle where SUMO's went
        ([("q", ("south_out",), 12.5, 0.0), ("before", MINOR, 230.0, 10.0)], False),  # it takes the room
        ([("q", ("south_out",), 20.0, 0.0), ("before", MINOR, 230.0, 10.0)], True),
    ],
)
def test_a_member_does_not_stop_in_the_junction(scene, others, goes):
    seen, _ = scene("cross", MINOR, others, 40.0, eye=EYE)
    _, _, y, speed = track(seen)
    assert speed[-1] < 0.1
    if goes:
        assert y[-1] + CAR.length / 2 < -10.0
    else:
        assert y[-1] - CAR.length / 2 > 10.0


@pytest.mark.sumo
def test_a_member_stops_at_red_and_starts_at_green(scene):
    """The minor road has red for 45 s first."""
    seen, _ = scene("lights", MINOR, [], 60.0, position=150.0)
    time, _, y, speed = track(seen)
    front = y - CAR.length / 2
    waits = (time > 30) & (time < 44.5)
    assert speed[waits].max() < 0.2
    assert 10.4 <= front[waits].min() < 12.4
    assert front[time < 45].min() >= 10.4
    assert speed[time > 48].max() > 1.0
    assert front[-1] < 0
    assert np.diff(speed).min() / STEP > -3.5


@pytest.mark.sumo
@pytest.mark.parametrize(("before", "stops"), [(10.0, False), (70.0, True)])
def test_a_member_stops_at_yellow_where_it_can(scene, before, stops):
    def yellow():
        libsumo.trafficlight.setPhase("middle", 1)
        libsumo.trafficlight.setPhaseDuration("middle", 4.0)

    seen, _ = scene("lights", MAJOR, [], 15.0, position=492.8 - before, speed=12.0, first=yellow)
    _, x, _, speed = track(seen)
    assert (x[-1] + CAR.length / 2 < 492.8) == stops
    assert (speed.min() < 0.2) == stops


@pytest.mark.sumo
def test_a_member_changes_lanes_after_the_vehicles_beside_it_have_passed(scene):
    """Its route begins to change 16 m after its start; a column drives beside it."""
    beside = [(f"c{k}", ("west_in", "east_out"), 24.0 + 20.0 * k, 9.0, 1) for k in range(3)]
    edges = ("west_in", "north_out")
    seen, route = scene("cross", edges, beside, 30.0, position=40.0, speed=9.0)
    (change, *_) = (line for line in route.lines if line.state == CHANGING)
    assert change.station < 80
    alone, _ = scene("cross", edges, [], 30.0, position=40.0, speed=9.0)
    over, at_once = (track(s)[0][track(s)[2] > -3.2].min() for s in (seen, alone))
    assert over > at_once + 1.0
    for name, *_ in beside:
        assert clearance(seen, name) > 0.5


@pytest.mark.sumo
def test_a_member_drives_on_along_its_lane_while_faster_vehicles_pass_on_the_other(scene):
    """It looks for room further on, and does not stop where its route begins to change lanes."""
    passing = [(f"c{k}", ("west_in", "east_out"), 40.0 - 25.0 * (k - 2), 13.0, 1) for k in range(5)]
    seen, route = scene("cross", ("west_in", "north_out"), passing, 25.0, position=40.0, speed=9.0)
    (change, *_) = (line for line in route.lines if line.state == CHANGING)
    _, x, y, speed = track(seen)
    assert speed.min() > 7.0
    begins = x[y > y[0] + 0.5].min()
    assert begins > change.station + 30.0
    for name, *_ in passing:
        assert clearance(seen, name) > 0.5


@pytest.mark.sumo
def test_a_member_whose_room_is_taken_as_it_begins_drives_on_and_changes_lanes_later(scene, monkeypatch):
    """It stopped at the begin of its lane change, and those behind it did too."""
    edges, goes = ("west_in", "north_out"), RoomToChange._goes
    _, route = scene("cross", edges, [], 1.0, position=40.0, speed=9.0)
    (change, *_) = (line for line in route.lines if line.state == CHANGING)

    def taken(room, line, distance, *more):
        is_first = abs(line.to_end - change.to_end) < 1.0
        return not (is_first and distance < -0.5) and goes(room, line, distance, *more)

    monkeypatch.setattr(RoomToChange, "_goes", taken)
    seen, _ = scene("cross", edges, [], 25.0, position=40.0, speed=9.0)
    _, x, y, speed = track(seen)
    assert speed.min() > 6.0
    assert np.ptp(y[x < x[0] + 30.0]) < 0.4
    assert np.ptp(y) > 3.0


@pytest.mark.sumo
def test_a_member_does_not_begin_to_change_lanes_where_a_queue_would_stop_it_across_both(scene):
    edges = ("west_in", "north_out")
    _, route = scene("cross", edges, [], 1.0, position=40.0, speed=9.0)
    (change, *_) = (line for line in route.lines if line.state == CHANGING)
    shortest = SHORTEST_CHANGE * Network.read(NETS / "cross.net.xml").lane_width("west_in", 0)
    for left, goes_over in ((0.9 * shortest, False), (0.9 * change.across, True)):
        stands = change.station + left + 5.0  # its front bumper
        car = "c", ("west_in", "east_out"), stands, 0.0, 1
        seen, _ = scene("cross", edges, [car], 20.0, position=40.0, speed=9.0)
        _, x, y, speed = track(seen)
        assert speed[-1] < 0.1
        if goes_over:  # behind the queue, in less road than it would have taken at speed
            assert np.ptp(y) > 2.9
            assert np.ptp(x[(y > y[0] + 0.3) & (y < y[-1] - 0.3)]) < 0.65 * change.across
        else:
            assert np.ptp(y) < 0.3
        assert clearance(seen, "c") > 0.5


@pytest.mark.sumo
def test_a_member_lets_a_car_in_that_stands_at_the_end_of_its_lane(scene):
    """The car may not change lanes by itself here, so the member waits in vain, and drives on."""
    at_end = [("c", ("west_in", "north_out"), 490.0, 0.0, 0)]
    seen, _ = scene("cross", ("west_in", "east_out"), at_end, 70.0, position=300.0, lane=1, speed=9.0)
    time, x, _, speed = track(seen)
    front, rear = x + CAR.length / 2, track(seen, "c")[1][0] - 2.5
    stands = speed < 0.1
    assert 8.0 < np.ptp(time[stands]) < 20.0
    assert rear - 6.0 < front[stands].max() < rear
    assert front[-1] > rear + 20.0


@pytest.mark.sumo
def test_a_member_gives_way_at_a_light_that_is_off(scene):
    column = [(f"c{k}", MAJOR, 440.0 - 20 * k, 10.0) for k in range(5)]
    seen, _ = scene(
        "lights", MINOR, column, 33.0, eye=BLIND, first=lambda: libsumo.trafficlight.setProgram("middle", "off")
    )
    *_, speed = track(seen)
    assert speed.min() < 0.5
    for name, *_ in column:
        assert clearance(seen, name) > 1.0


@pytest.mark.sumo
def test_a_member_that_enters_a_motorway_knows_of_a_closed_lane_change_beyond_the_next_line(tmp_path):
    """The lane begins some metres before the change, which is reported as soon as the member has to brake for it.

    Beside a vehicle that is as fast it falls back.
    """
    network = Network.read(shipped.networks()["highway"])
    member = deployed(network, ("e_entry_e3", "e3_e4", "e4_e5"), 259.8, 0, 20.0, BLIND)
    junction, change = (line for line in member.route.lines[:2])
    assert (junction.state != CHANGING, change.state) == (True, CHANGING)
    with World(network, STEP, 1, tmp_path / "words.log") as world:
        fleet = world.deploy(Fleet.deployed([member], STEP))
        insert("c", ("e2_e3", "e3_e4", "e4_e5"), 634.0, 20.0)  # as far from the change as it is
        world.place(fleet)
        fleet = world.advance(fleet)
        signals = world.signals(fleet)
    front = fleet.progress.station[0] + CAR.length / 2 - CAR.axle
    assert front < junction.station
    assert not signals.open[0]
    back = Ego.of(member)._replace(speed=20.0).line_at_speed(20.0 - 1.5 * 0.5)
    assert signals.distance[0] == pytest.approx(back)
    assert CLOSED_BY[signals.reason[0]] == "lane change"


def test_a_vehicle_that_has_moved_counts_as_held_up_only_after_it_has_stood_again():
    speeds = [0.0] * 10 + [5.0] * 20 + [0.0] * 40
    now = SimpleNamespace(step=0)
    client = SimpleNamespace(
        vehicle=SimpleNamespace(getSpeed=lambda _: speeds[now.step]),
        simulation=SimpleNamespace(getTime=lambda: 0.1 * now.step),
    )
    reads = Reads(client)
    way, held = RightOfWay(client, reads, {}), []
    for now.step in range(len(speeds)):
        reads.renew()
        held.append(way.held_up("foe", ":inside_0"))
    assert held.index(True) == 30 + 31


def test_at_a_zipper_a_vehicle_that_stands_inside_may_set_out(monkeypatch):
    """The paths cross 8 m ahead of both: after it has set out, not before."""
    line = Line(100.0, "Z", "", 0, "road_0", "next_0", (":a_0",), 20.0)
    crossing = Crossing("side_0", (":a_1",), (8.0, 12.0), (16.0, 20.0), False, True, np.inf, 10.0)
    client = SimpleNamespace(
        lane=SimpleNamespace(getMaxSpeed=lambda _: 10.0),
        vehicle=SimpleNamespace(
            getLength=lambda _: 5.0, getAccel=lambda _: 2.6, getSpeed=lambda _: 0.0, getWaitingTime=lambda _: 0.0
        ),
        simulation=SimpleNamespace(getTime=lambda: 0.0),
    )
    conflicts = Conflicts((), (crossing,), (), np.inf)
    way = RightOfWay(client, Reads(client), {line: conflicts})
    monkeypatch.setattr(RightOfWay, "_coming", lambda *_: [])
    inside = [Approach("c", crossing, -8.0, Pace(0.0))]
    monkeypatch.setattr(RightOfWay, "_inside", lambda *_, first: inside)
    ego = Ego("m.0", "road_0", 0.0, CAR.length)
    assert not way.may_cross(line, 1.0, ego, state="Z")
    inside.clear()
    way.renew()
    assert way.may_cross(line, 1.0, ego, state="Z")


@pytest.mark.parametrize("speed", [0.0, 2.0, 4.0, 6.0])
@pytest.mark.parametrize("state", ["m", "s", "w"])
@pytest.mark.parametrize("distance", [9.0, 11.0, 13.0, 40.0])
def test_a_line_at_which_a_member_gives_way_is_closed_until_it_has_looked(monkeypatch, state, distance, speed):
    """A slow one need not begin to brake yet where it begins to look."""
    line = Line(0.0, state, "", 0, "road_0", "next_0", (":a_0",), 10.0)
    lines = StopLines(ROADS, SimpleNamespace())
    lines._conflicts = defaultdict(lambda: Conflicts((("before_0", 0.0),), (), (), np.inf))
    ego = Ego("m.0", "road_0", speed, CAR.length)
    looked = []
    monkeypatch.setattr(RightOfWay, "has_stood", lambda *_: True)
    monkeypatch.setattr(RightOfWay, "has_way", lambda *_: bool(looked.append(distance)))
    near = distance < ego.checks_from
    assert not lines._at_line(line, distance, near, ego).open
    assert looked == [distance] * (distance < 2.5 * CAR.length)


def test_a_member_that_stops_midway_looks_at_its_line_again(monkeypatch):
    """The place where it stops is far, its line is not."""
    line = Line(110.0, "m", "", 0, "road_0", "next_0", (":a_0",), 10.0)
    lines = StopLines(ROADS, SimpleNamespace())
    lines._at_junction, lines._conflicts = {(line, "car"): line}, {line: Conflicts((), (), (), np.inf)}
    ego = Ego("m.0", "road_0", 2.0, CAR.length)
    lines._far = FarLines([ego])
    monkeypatch.setattr(StopLines, "_ahead", lambda *_: LineState(30.0, False, False, False, 2))
    route = SimpleNamespace(closed=False, lines_about=lambda *_: (None, np.inf, [(line, 5.0)]))
    lines._state(SimpleNamespace(route=route), 105.0, ego, 0)
    assert lines._far.lines == [None]
    route.lines_about = lambda *_: (None, np.inf, [(line, 10.0)])
    lines._state(SimpleNamespace(route=route), 100.0, ego, 0)
    assert lines._far.lines == [line]


@pytest.mark.parametrize(("turns", "signal"), [(True, "priority"), (False, "red")])
def test_a_member_that_turns_at_green_beside_the_middle_of_its_lane_does_not_run_the_red_light_of_straight_on(
    turns, signal
):
    """SUMO takes it for one that goes straight on, from the same lane."""
    links = [("next_0", True, False, False, ":a_0", "G"), ("beyond_0", False, False, False, ":a_1", "r")]
    client = SimpleNamespace(lane=SimpleNamespace(getLinks=lambda _: [(*link, "s", 10.0) for link in links]))
    onto, via = ("next_0", ":a_0") if turns else ("beyond_0", ":a_1")
    line = Line(100.0, "O", "a", 0, "road_0", onto, (via,), 10.0)
    member = SimpleNamespace(id="m.0", model=CAR, law=PathLeader(), route=SimpleNamespace(lines=[line]))
    fleet = SimpleNamespace(
        members=[member], row_of={"m.0": 0}, native=[False], motion=SimpleNamespace(speed=np.ones(1))
    )
    (entered,) = StopLines(ROADS, client).entries(fleet, [("m.0", "road_0", ":a_1")])
    assert (entered.row, entered.lane, entered.signal) == (0, "road_0", signal)


@pytest.mark.parametrize(("speed", "has_gap"), [(0.0, True), (0.8, False)])
def test_a_vehicle_that_has_just_set_out_inside_is_expected_to_accelerate(speed, has_gap):
    """It has 9 m to the conflict area: 11 s at 0.8 m/s, but 2.3 s by 2.6 m/s2. One that stands there waits."""
    line = Line(100.0, "w", "", 0, "road_0", "next_0", (":a_0",), 20.0)
    crossing = Crossing("side_0", (":a_1",), (6.0, 11.0), (10.0, 15.0), False, True, np.inf, 10.0)
    conflicts = Conflicts((), (crossing,), (), np.inf)
    way = RightOfWay(SimpleNamespace(), Reads(SimpleNamespace()), {line: conflicts})
    way._now = SimpleNamespace(
        on_lane=Once({":a_1": ["c"]}.__getitem__), lane_length={":a_1": 20.0}, max_speed={":a_0": 10.0},
        position={"c": 1.0}, speed={"c": speed}, acceleration={"c": 2.6}, length={"c": 5.0},
    )  # fmt: skip
    ego = Ego("m.0", "road_0", 0.0, CAR.length)
    assert way._has_gap_among([*way.on(crossing)], line, 0.8, ego, 0.0, 0.8) == has_gap
    # Itself it does not wait for, where SUMO has it on the lane beside its own.
    assert way._has_gap_among([*way.on(crossing)], line, 0.8, ego._replace(id="c"), 0.0, 0.8)


@pytest.mark.parametrize(
    ("own", "over", "foe_speed", "its", "stop"),
    [
        (4.0, 3.0, 2.0, 1.0, 6.5),  # its path begins 10 m beyond the line; the foe is there in 2 s
        (4.0, 3.0, 0.0, 1.0, np.inf),  # that one stands midway
        (4.0, 3.0, 2.0, 9.0, np.inf),  # it is past already
        (9.0, 3.0, 2.0, 1.0, np.inf),  # it cannot stop any more
        (4.0, 9.8, 2.0, 1.0, np.inf),
    ],
)
def test_a_vehicle_in_the_junction_stops_for_one_with_priority_that_sets_out_there(own, over, foe_speed, its, stop):
    """A left-turner had stood midway, and counted as held up; it set out with the member, which struck it."""
    line = Line(100.0, "m", "", 0, "road_0", "next_0", (":a_0",), 20.0)
    crossing = Crossing("side_0", (":a_1",), (10.0, 18.0), (5.0, 12.0), False, True, np.inf, 10.0)
    conflicts = Conflicts((), (crossing,), (), np.inf)
    way = RightOfWay(SimpleNamespace(simulation=SimpleNamespace(getTime=lambda: 9.0)), Reads(SimpleNamespace()),
                     {line: conflicts})  # fmt: skip
    way._now = SimpleNamespace(
        on_lane=Once({":a_1": ["c"]}.__getitem__), lane_length={":a_1": 20.0}, max_speed={":a_0": 10.0},
        position={"c": its if its < 5.0 else 18.0}, speed={"c": foe_speed}, acceleration={"c": 2.6}, length={"c": 5.0},
    )  # fmt: skip
    ego = Ego("m.0", ":a_0", own, CAR.length)
    assert way.stop_before_foes(line, over, ego, "m") == pytest.approx(stop)
    assert way.stop_before_foes(line, over, ego) == np.inf


@pytest.mark.parametrize(
    ("passed", "own", "over", "to_line", "foe_speed", "stop"),
    [
        ("m", 2.0, 3.0, 30.0, 12.0, 6.5),  # at a constant speed it would be past in 9 s; the foe is there in 3 s
        ("=", 2.0, 3.0, 30.0, 12.0, 6.5),
        ("g", 2.0, 3.0, 30.0, 12.0, 6.5),
        ("m", 0.0, 3.0, 30.0, 12.0, 6.5),
        ("m", 2.0, 3.0, 150.0, 12.0, np.inf),
        ("m", 2.0, 3.0, 0.5, 0.0, np.inf),  # that one stands at its line
        ("m", 9.0, 6.0, 30.0, 12.0, np.inf),  # it cannot stop any more
        ("M", 2.0, 3.0, 30.0, 12.0, np.inf),
        ("w", 2.0, 3.0, 30.0, 12.0, np.inf),  # that one is to stand first
        ("Z", 2.0, 3.0, 30.0, 12.0, np.inf),
        ("r", 2.0, 3.0, 30.0, 12.0, np.inf),  # the light has changed: it is to leave
        ("y", 2.0, 3.0, 30.0, 12.0, np.inf),
    ],
)
def test_a_vehicle_in_the_junction_that_is_slower_than_it_was_to_be_stops_for_those_that_come(
    monkeypatch, passed, own, over, to_line, foe_speed, stop
):
    """One that had set out in a gap was held up by a vehicle that stood inside, and drove on before the next one."""
    line = Line(100.0, passed, "", 0, "road_0", "next_0", (":a_0",), 20.0)
    crossing = Crossing("side_0", (":a_1",), (10.0, 18.0), (5.0, 12.0), False, True, np.inf, 10.0)
    way = RightOfWay(SimpleNamespace(), Reads(SimpleNamespace()), {line: Conflicts((), (crossing,), (), np.inf)})
    way._now = SimpleNamespace(on_lane=Once(lambda _: []), length={"c": 5.0})
    monkeypatch.setattr(RightOfWay, "_coming", lambda *_: [Approach("c", crossing, to_line, Pace(foe_speed))])
    monkeypatch.setattr(RightOfWay, "pace", lambda *_: Pace(own, 1.0 if own == 0 else 0.0, 5.0))
    ego = Ego("m.0", ":a_0", own, CAR.length)
    assert way.stop_before_foes(line, over, ego, passed) == pytest.approx(stop)


@pytest.mark.parametrize(
    ("own", "over", "before", "name", "waits", "stop"),
    [
        (6.0, -3.9, "side_0", "c", np.inf, 13.4),  # it cannot stop at the line, but before its path
        (6.0, -4.1, "side_0", "c", np.inf, 4.1),  # it can
        (0.0, -0.5, "side_0", "c", np.inf, 0.5),  # it stands there
        (9.0, 3.0, "side_0", "c", np.inf, 6.5),  # it brakes hard for one that should have given way
        (9.0, 5.0, "side_0", "c", np.inf, 6.5),  # nearer to it, it stops before where its front would touch it
        (9.0, 8.0, "side_0", "c", np.inf, np.inf),  # it cannot stop any more
        (0.7, 11.7, "side_0", "c", np.inf, 0.035),  # it has braked too gently, but its front is not in the way yet
        (0.7, 12.1, "side_0", "c", np.inf, 0.035),  # it is a little, and is passed there
        (0.7, 12.6, "side_0", "c", np.inf, np.inf),  # it has to leave that path
        (6.0, -3.9, "side_0", "c", 2.0, np.inf),  # it will wait midway
        (6.0, -3.9, "side_0", "c", 0.5, 13.4),  # it is beyond that place
        (6.0, -3.9, "road_1", "c", np.inf, np.inf),  # it is beside it
        (6.0, -3.9, "side_0", "m.1", np.inf, np.inf),  # a member that heeds lines will stop itself
        (6.0, -3.9, "side_0", "m.2", np.inf, 13.4),  # another one will not
    ],
)
def test_a_vehicle_with_priority_stops_for_one_that_has_set_out_inside(own, over, before, name, waits, stop):
    """SUMO's drivers do not see a member that comes onto the lane of its turn just before the line.

    One that had nearly stopped 0.25 m before the path of a left-turner drove on again, and was touched.
    """
    line = Line(100.0, "M", "", 0, "road_0", "next_0", (":a_0",), 20.0)
    crossing = Crossing(before, (":a_1",), (10.0, 18.0), (5.0, 12.0), False, False, waits, 10.0, touches=12.0)
    conflicts = Conflicts((), (crossing,), (), np.inf)
    way = RightOfWay(SimpleNamespace(simulation=SimpleNamespace(getTime=lambda: 9.0)), Reads(SimpleNamespace()),
                     {line: conflicts})  # fmt: skip
    way.members, way.obedient = {"m.0", "m.1", "m.2"}, {"m.0", "m.1"}
    way._now = SimpleNamespace(
        on_lane=Once({":a_1": [name]}.__getitem__), lane_length={":a_1": 20.0}, max_speed={":a_0": 10.0},
        position={name: 1.0}, speed={name: 3.0}, acceleration={name: 2.6}, length={name: 5.0},
    )  # fmt: skip
    ego = Ego("m.0", "road_0" if over < 0 else ":a_0", own, CAR.length)
    assert way.stop_before_foes(line, over, ego) == pytest.approx(stop)


@pytest.mark.parametrize(
    ("state", "over", "name", "merges", "stop"),
    [
        ("Z", 2.0, "c", False, 7.5),  # it has 7 m to where the paths meet, this one 8 m
        ("Z", 4.0, "c", False, np.inf),  # this one has 6 m
        ("Z", 2.0, "m.1", False, 7.5),
        ("Z", 4.0, "m.1", False, np.inf),
        ("Z", 2.0, "c", True, np.inf),  # it follows that one, or the other way round
        ("m", 4.0, "c", False, 5.5),
    ],
)
def test_inside_a_zipper_the_one_that_has_farther_to_go_stops(state, over, name, merges, stop):
    """Where paths cross at such a junction, SUMO's drivers enter whoever is inside, and do not stop there."""
    line = Line(100.0, state, "", 0, "road_0", "next_0", (":a_0",), 20.0)
    crossing = Crossing("side_0", (":a_1",), (10.0, 18.0), (8.0, 15.0), merges, True, np.inf, 10.0, touches=12.0)
    conflicts = Conflicts((), (crossing,), (), np.inf)
    way = RightOfWay(SimpleNamespace(simulation=SimpleNamespace(getTime=lambda: 9.0)), Reads(SimpleNamespace()),
                     {line: conflicts})  # fmt: skip
    way.members, way.obedient = {"m.0", "m.1"}, {"m.0", "m.1"}
    way._now = SimpleNamespace(
        on_lane=Once({":a_1": [name]}.__getitem__), lane_length={":a_1": 20.0}, max_speed={":a_0": 10.0},
        position={name: 1.0}, speed={name: 3.0}, acceleration={name: 2.6}, length={name: 5.0},
    )  # fmt: skip
    ego = Ego("m.0", ":a_0", 3.0, CAR.length)
    assert way.stop_before_foes(line, over, ego, "m") == pytest.approx(stop)


@pytest.mark.parametrize(
    ("over", "name", "position", "speed", "stop"),
    [
        (-6.0, "m.1", 6.0, 3.0, 6.0),  # it has 4 m to where it is narrow, this one 11 m: it can stop at its line
        (1.0, "m.1", 7.0, 3.0, 3.5),  # 3 m and 4 m: before that place
        (3.0, "m.1", 7.0, 3.0, np.inf),  # 3 m and 2 m: that one stops
        (1.0, "m.1", 6.0, 3.0, np.inf),  # 4 m each: the lane decides
        (1.0, "m.1", 7.0, 0.0, np.inf),  # it stands
        (1.0, "m.1", 28.0, 3.0, np.inf),  # it is past
        (1.0, "c", 5.0, 3.0, 3.5),  # SUMO's cars drive through: they go first, though this one comes later
        (1.0, "c", 28.0, 3.0, np.inf),
        (-6.0, "c", -5.0, 8.0, 6.0),  # it enters next
        (-6.0, "c", -20.0, 8.0, np.inf),
        (-6.0, "m.1", -5.0, 8.0, np.inf),
        (-6.0, "r", -5.0, 8.0, np.inf),
        (-6.0, "s", -5.0, 8.0, np.inf),
        (-6.0, "y", -5.0, 8.0, 6.0),  # it cannot stop at yellow any more
        (-6.0, "y", -5.0, 6.0, np.inf),
    ],
)
def test_of_two_that_turn_left_against_each_other_one_stops(over, name, position, speed, stop):
    """Of two members the one that comes later. position: beyond the other one's line [m]"""
    line = Line(100.0, "g", "", 0, "road_0", "next_0", (":a_0",), 20.0)
    narrow = Crossing("side_0", (":a_1",), (5.0, 12.0), (10.0, 18.0), False, False, np.inf, 10.0)
    conflicts = Conflicts((), (), (), np.inf, narrow=(narrow,))
    way = RightOfWay(SimpleNamespace(simulation=SimpleNamespace(getTime=lambda: 9.0)), Reads(SimpleNamespace()),
                     {line: conflicts})  # fmt: skip
    way.members = way.obedient = {"m.0", "m.1"}
    way._now = SimpleNamespace(
        on_lane=Once({":a_1": [name] if position > 0 else [], "side_0": [] if position > 0 else [name]}.__getitem__),
        lane_length={":a_1": 20.0, "side_0": 100.0}, max_speed={":a_0": 10.0},
        position={name: position if position > 0 else 100.0 + position}, speed={name: speed},
        acceleration={name: 2.6}, length={name: 5.0},
    )  # fmt: skip
    way._links_ahead = lambda *_: ((":a_1",), name if name in "rsy" else "g")
    ego = Ego("m.0", "road_0" if over < 0 else ":a_0", 4.0, CAR.length)
    assert way.stop_before_foes(line, over, ego) == pytest.approx(stop)


@pytest.mark.sumo
def test_left_turns_against_each_other_are_narrow_where_sumo_lets_cars_drive_through_each_other(generated_nets):
    network = Network.read(generated(generated_nets, "grid", "priority_stop"))
    libsumo.start(["sumo", "-n", str(network.path), "--no-step-log", "--no-warnings"])
    try:
        narrow = {}
        for link in libsumo.lane.getLinks("B0B1_0"):
            via, onto = tuple(name for name in inside_lanes(link[LINK_VIA])), link[LINK_ONTO]
            line = Line(0.0, link[LINK_STATE], "", 0, "B0B1_0", onto, via, 10.0)
            narrow[onto] = [one.before for one in Conflicts.at(line, network, libsumo).narrow]
    finally:
        libsumo.close()
    assert narrow == {"B1A1_0": ["B2B1_0"], "B1B2_0": [], "B1C1_0": []}


def test_a_link_without_lanes_inside_is_not_narrow():
    """Some networks have a few of them; the run would end there."""
    line = Line(0.0, "m", "", 0, "road_0", "next_0", (":a_0",), 10.0)
    links = {"side_0": [("far_0", True, True, False, "", "M", "s", 5.0)]}
    client = SimpleNamespace(
        lane=SimpleNamespace(getWidth=lambda _: 3.2, getLinks=links.__getitem__, getMaxSpeed=lambda _: 10.0)
    )
    network = SimpleNamespace(entered_from={":a_1": "side_0"}, inside_with=lambda _: [":a_1"])
    paths = conflicts.Paths(client)
    paths[line.via, line.onto, conflicts.SAMPLED * 3.2] = None  # it is not looked at
    assert list(conflicts._narrow(line, set(), set(), network, client, paths)) == []


@pytest.mark.parametrize("lane", ["", ":a_1", ":a_2", ":a_3"])
def test_a_path_is_occupied_where_a_vehicle_is_on_any_of_its_lanes_inside(lane):
    """SUMO is asked once for each lane, by all that look there in a step, and again after the next step."""
    line, asked = Line(0.0, "m", "", 0, "road_0", "next_0", (":a_0",), 10.0), []
    paths = tuple(crossed(via[0])._replace(via=via) for via in ((":a_1", ":a_2"), (":a_3",)))
    client = SimpleNamespace(
        lane=SimpleNamespace(getLastStepVehicleIDs=lambda name: asked.append(name) or ("c",) * (name == lane))
    )
    reads = Reads(client)
    way = RightOfWay(client, reads, {line: Conflicts((), paths, (), np.inf)})
    for steps in (1, 2):
        expected = [one for one in paths if lane in one.via]
        assert way._occupied[line] == way._occupied[line._replace()] == expected
        assert [*reads.on_lane] == [":a_1", ":a_2", ":a_3"]
        assert sorted(asked) == sorted([":a_1", ":a_2", ":a_3"] * steps)
        reads.renew()
        way.renew()


def inside_lanes(via: str) -> list[str]:
    """Lanes inside a junction, from this one on."""
    onward = next(iter(libsumo.lane.getLinks(via)))[LINK_VIA]
    return [via, *(inside_lanes(onward) if onward else [])]


@pytest.mark.parametrize("state", ["m", "M", "w", "=", "Z"])
@pytest.mark.parametrize("stop", [4.0, np.inf])
def test_the_line_behind_a_vehicle_is_closed_where_it_must_stop_in_the_junction(state, stop):
    line = Line(100.0, state, "", 0, "road_0", "next_0", (":a_0",), 20.0)
    lines, asked = StopLines(ROADS, None), []

    def stop_before_foes(*given: object) -> float:
        asked.append(given[-1])
        return stop

    lines._way = SimpleNamespace(
        has_way=lambda *_: True, stop_before_foes=stop_before_foes, note_waiting=lambda *_: None
    )
    found = lines._passed(line, 3.0, Ego("m.0", ":a_0", 4.0, CAR.length))
    assert asked == [state]
    assert (found is not None) == (stop < np.inf)
    assert found is None or (found.distance, found.open) == (stop, False)


@pytest.mark.parametrize(
    ("distance", "spare", "may", "may_go_on"),
    [(9.0, 1.1, True, True), (9.0, 0.9, False, True), (9.0, 0.4, False, False), (3.0, 0.1, False, True)],
)
def test_a_member_that_had_a_gap_goes_on_with_half_the_margin_or_without_any_where_it_cannot_stop(
    distance, spare, may, may_go_on
):
    """It braked 5 m before its line at 7 m/s since its margin had become 0.99 s, crossed slowly, and was touched.

    At 6 m/s it stops within 4 m. A vehicle at 10 m/s comes so many seconds after it is past, 6 m beyond its line.
    """
    line = Line(100.0, "m", "", 0, "side_0", "main_0", (":a_0",), 10.0)
    crossing = Crossing("before_0", (":a_1",), (3.0, 6.0), (3.0, 6.0), False, True, np.inf, 10.0)
    client = SimpleNamespace(
        lane=SimpleNamespace(getMaxSpeed=lambda _: 6.0),
        vehicle=SimpleNamespace(getLength=lambda _: 5.0, getSpeed=lambda _: 10.0),
        simulation=SimpleNamespace(getTime=lambda: 100.0),
    )
    way = RightOfWay(client, Reads(client), {line: Conflicts((), (crossing,), (), np.inf)})
    ego = Ego("m.0", "side_0", 6.0, CAR.length)
    way._outside[line] = way._first_inside[line] = []

    def has_gap(seconds: float) -> bool:
        comes = (distance + 6.0 + CAR.length) / 6.0 + seconds
        way._patiently[line] = [Approach("c", crossing, 10.0 * comes - 3.0, Pace(10.0))]
        way.begin_look()
        return way.may_cross(line, distance, ego, state="m")

    assert has_gap(spare) == may
    assert has_gap(1.1)
    assert has_gap(spare) == may_go_on
    assert has_gap(spare) == may_go_on
    way.begin_look()
    assert has_gap(spare) == may  # at the last look it was not judged


@pytest.mark.parametrize(
    ("to_line", "waits", "may"),
    [
        (-10.0, np.inf, True),  # it is inside, and far ahead where the paths meet
        (-10.0, 30.0, False),  # it may wait inside, before they meet
        (-10.0, 5.0, True),  # it is past the place where it might have waited
        (30.0, np.inf, False),  # it will enter later, and would brake for who is inside
    ],
)
def test_where_paths_merge_far_beyond_the_line_a_member_follows_those_that_are_inside(to_line, waits, may):
    """In Bologna paths merge 50 m beyond the line; one waited for 121 s until each vehicle of a stream was gone."""
    line = Line(100.0, "m", "", 0, "side_0", "main_0", (":a_0",), 80.0)
    crossing = Crossing("before_0", (":a_1",), (50.0, 80.0), (50.0, 80.0), True, True, waits, 13.9)
    client = SimpleNamespace(
        lane=SimpleNamespace(getMaxSpeed=lambda _: 13.9),
        vehicle=SimpleNamespace(getLength=lambda _: 5.0, getSpeed=lambda _: 0.0, getWaitingTime=lambda _: 0.0),
        simulation=SimpleNamespace(getTime=lambda: 100.0),
    )
    way = RightOfWay(client, Reads(client), {line: Conflicts((), (crossing,), (), np.inf)})
    way._outside[line] = way._patiently[line] = []
    way._first_inside[line] = [Approach("c", crossing, to_line, Pace(12.0))]
    assert way.may_cross(line, 1.0, Ego("m.0", "side_0", 0.0, CAR.length), state="m") == may


@pytest.mark.parametrize(
    ("waits", "speed", "to_line", "may"),
    [(19.0, 2.0, 4.0, False), (21.0, 2.0, 4.0, True), (21.0, 5.0, 20.0, False), (21.0, 3.9, 2.0, False)],
)
def test_a_queue_that_creeps_past_lets_in_a_member_that_has_waited_for_long(waits, speed, to_line, may):
    """It stood at the end of its side street for the rest of the run. The paths meet 3 m beyond both lines."""
    line = Line(100.0, "m", "", 0, "side_0", "main_0", (":a_0",), 10.0)
    crossing = Crossing("before_0", (":a_1",), (3.0, 10.0), (3.0, 10.0), True, True, np.inf, 10.0)
    client = SimpleNamespace(
        lane=SimpleNamespace(getMaxSpeed=lambda _: 10.0),
        vehicle=SimpleNamespace(getLength=lambda _: 5.0, getSpeed=lambda _: 0.0, getWaitingTime=lambda _: waits),
        simulation=SimpleNamespace(getTime=lambda: 100.0),
    )
    way = RightOfWay(client, Reads(client), {line: Conflicts((), (crossing,), (), np.inf)})
    way._outside[line] = []
    way._patiently[line] = [Approach("c", crossing, to_line, Pace(speed, 2.6, 13.9))]
    way._first_inside[line] = []
    ego = Ego("m.0", "side_0", 0.0, CAR.length)
    assert way.may_cross(line, 1.0, ego, state="m") == may
    assert way.may_enter(line, "m", ego._replace(speed=2.0)) or not may  # that is no failure to yield


def test_a_member_in_a_queue_is_asked_to_let_another_one_in_and_counted_on_when_it_stands():
    """It did not know that it was counted on: in Bologna members that turned onto the same road touched each other."""
    line = Line(100.0, "m", "", 0, "side_0", "main_0", (":a_0",), 10.0)
    crossing = Crossing("before_0", (":a_1",), (3.0, 10.0), (3.0, 10.0), True, True, np.inf, 10.0)
    now = SimpleNamespace(time=100.0, speed=2.0)
    client = SimpleNamespace(
        lane=SimpleNamespace(getMaxSpeed=lambda _: 10.0),
        vehicle=SimpleNamespace(
            getLength=lambda _: 5.0, getSpeed=lambda name: now.speed if name == "m.1" else 0.0,
            getWaitingTime=lambda _: 30.0,
        ),
        simulation=SimpleNamespace(getTime=lambda: now.time),
    )  # fmt: skip
    way = RightOfWay(client, Reads(client), {line: Conflicts((), (crossing,), (), np.inf)})
    way.members = {"m.0", "m.1"}
    ego = Ego("m.0", "side_0", 0.0, CAR.length)

    def may_cross(to_line: float, *others: Approach) -> bool:
        way.renew()
        way._now.renew()
        way._outside[line] = way._first_inside[line] = []
        way._patiently[line] = [Approach("m.1", crossing, to_line, Pace(now.speed, 2.6, 13.9)), *others]
        return way.may_cross(line, 1.0, ego, state="m")

    assert not may_cross(3.0, Approach("c", crossing, 20.0, Pace(10.0)))
    assert not way.is_asked("m.1", "before_0")  # it would stop for nothing: another vehicle is in the way
    assert not may_cross(8.0)
    assert not way.is_asked("m.1", "before_0")  # not at its line yet
    assert not may_cross(3.0)
    assert way.is_asked("m.1", "before_0")
    assert not way.is_asked("m.1", "elsewhere_0")
    now.speed, now.time = 0.0, 103.0
    assert may_cross(1.0)
    now.time = 100.0 + LETS_IN_LONGEST + 0.1
    assert not way.is_asked("m.1", "before_0")  # it does not wait for ever
    now.time = 130.0
    assert may_cross(1.0)
    now.time += LETS_IN_FOR + 0.1
    assert not way.is_asked("m.1", "before_0")


@pytest.mark.parametrize(
    ("waits", "speed", "to_line", "members", "may"),
    [
        (11.0, 2.0, 38.0, set(), True),
        (9.0, 2.0, 38.0, set(), False),
        (11.0, 2.0, 38.0, {"c"}, False),
        (11.0, 4.5, 38.0, set(), False),
        (11.0, 2.0, 14.0, set(), False),
    ],
)
def test_who_waits_does_not_expect_the_end_of_a_queue_at_full_throttle(waits, speed, to_line, members, may):
    """A left-turner stood for 74 s before opposed ones, for vehicles that crept up to the end of their queue."""
    line = Line(100.0, "m", "", 0, "side_0", "main_0", (":a_0",), 18.0)
    crossing = Crossing("before_0", (":a_1",), (5.0, 13.0), (9.0, 16.0), False, True, np.inf, 10.0)
    client = SimpleNamespace(
        lane=SimpleNamespace(getMaxSpeed=lambda _: 10.0),
        vehicle=SimpleNamespace(getLength=lambda _: 5.0, getSpeed=lambda _: 0.0, getWaitingTime=lambda _: waits),
        simulation=SimpleNamespace(getTime=lambda: 100.0),
    )
    way = RightOfWay(client, Reads(client), {line: Conflicts((), (crossing,), (), np.inf)})
    way.members = frozenset(members)
    way._outside[line], way._first_inside[line] = [], []
    way._patiently[line] = [Approach("c", crossing, to_line, Pace(speed, 2.6, 13.9))]
    assert way.may_cross(line, 1.0, Ego("m.0", "side_0", 0.0, CAR.length), state="m") == may


@pytest.mark.parametrize(("state", "has_gap"), [("m", False), ("s", True)])
def test_a_foe_that_comes_to_a_stop_sign_stops_there_first(state, has_gap):
    """36 m before its line it drives 4 m/s: it comes within 12 s, but not if it stops; the member is gone after 7 s."""
    line = Line(100.0, "s", "", 0, "side_0", "main_0", (":a_0",), 15.0)
    crossing = Crossing("before_0", (":a_1",), (10.0, 16.0), (7.0, 12.0), False, True, np.inf, 10.0)
    now = SimpleNamespace(
        on_lane={"before_0": ["c"]}, lane_length={"before_0": 100.0}, position={"c": 64.0}, speed={"c": 4.0},
        acceleration={"c": 2.6}, length={"c": 5.0}, max_speed={"before_0": 13.9, ":a_0": 8.0},
        best_lanes={"c": ()}, next_links={"c": [("beyond_0", True, True, False, ":a_1", state)]},
    )  # fmt: skip
    conflicts = Conflicts((("before_0", 0.0),), (crossing,), (), np.inf)
    way = RightOfWay(SimpleNamespace(), now, {line: conflicts})
    ego = Ego("m.0", "side_0", 0.0, CAR.length)
    assert way._has_gap_among(way._patiently[line], line, 1.0, ego, 1.0, 1.0) == has_gap


@pytest.mark.parametrize(
    ("name", "inside", "counts"),
    [
        ("c", (":a_1", ":b_0"), False),  # it stops at the yellow light of this junction
        ("c", (":b_0", ":a_1"), True),  # that light is at the junction before
        ("m.1", (":a_1", ":b_0"), False),  # a member that heeds lines
        ("m.2", (":a_1", ":b_0"), True),  # one that follows its predecessor over them
    ],
)
def test_a_vehicle_that_stops_at_its_yellow_light_does_not_come(monkeypatch, name, inside, counts):
    line = Line(100.0, "m", "", 0, "side_0", "main_0", (":a_0",), 15.0)
    crossing = Crossing("before_0", (":a_1",), (10.0, 16.0), (7.0, 12.0), False, True, np.inf, 10.0)
    now = SimpleNamespace(
        on_lane={"before_0": [name]}, lane_length={"before_0": 100.0}, position={name: 60.0}, speed={name: 10.0},
        acceleration={name: 2.6}, max_speed={"before_0": 13.9},
    )  # fmt: skip
    conflicts = Conflicts((("before_0", 0.0),), (crossing,), (), np.inf)
    way = RightOfWay(SimpleNamespace(), now, {line: conflicts})
    way.members, way.obedient = {"m.1", "m.2"}, {"m.1"}
    monkeypatch.setattr(RightOfWay, "_links_ahead", lambda *_: (inside, "y"))
    assert bool(way._foes_outside(line)) == counts


@pytest.mark.parametrize(
    ("first", "place", "stands_for", "opens", "come"),
    [
        (0.0, 99.0, 9.0, True, ["c.1"]),  # it stands at its open line, held up by something else
        (0.0, 99.0, 9.0, False, ["c.1"]),
        (0.0, 99.0, 1.0, True, ["c.1", "c.2"]),  # it may set out
        (0.0, 80.0, 1.0, True, ["c.1"]),  # it stands in a queue
        (0.5, 99.0, 0.0, True, ["c.1", "c.2"]),  # it drives
    ],
)
@pytest.mark.parametrize("state", ["m", "="])
def test_a_vehicle_behind_one_that_stands_does_not_come(monkeypatch, state, first, place, stands_for, opens, come):
    """A member waited for each car that came up to a queue: for 38 s at a junction that SUMO's own did not stop at."""
    line = Line(100.0, state, "", 0, "side_0", "main_0", (":a_0",), 15.0)
    crossing = Crossing("before_0", (":a_1",), (10.0, 16.0), (7.0, 12.0), False, True, np.inf, 10.0)
    names, time = ("c.1", "c.2"), SimpleNamespace(simulation=SimpleNamespace(getTime=lambda: 50.0))
    now = SimpleNamespace(
        on_lane=Once(lambda lane: ["c.2", "c.1"] if lane == "before_0" else []), lane_length={"before_0": 100.0},
        position={"c.1": place, "c.2": 40.0}, speed={"c.1": first, "c.2": 12.0},
        acceleration=dict.fromkeys(names, 2.6), length=dict.fromkeys(names, 5.0), max_speed={"before_0": 13.9},
        next_links={"c.1": [("main_0", True, opens)]},
    )  # fmt: skip
    way = RightOfWay(time, now, {line: Conflicts((("before_0", 0.0),), (crossing,), (), np.inf)})
    way._standing["c.1", ""] = 50.0 - stands_for, 49.9
    monkeypatch.setattr(RightOfWay, "_links_ahead", lambda *_: ((":a_1",), "M"))
    ego = Ego("m.0", "side_0", 0.0, CAR.length)
    assert [foe.id for foe in way._coming(line, ego, state)] == come


@pytest.mark.parametrize(("policy", "heeds"), [("convoy", False), ("obey", True)])
def test_a_member_of_a_convoy_is_not_expected_to_stop_at_lines(policy, heeds):
    assert TrackingFollower(policy=policy, on_loss="drive").heeds_lines == heeds
    assert PathLeader().heeds_lines


def test_a_member_that_comes_to_a_line_again_stands_there_again():
    """On its second lap it drove over the stop sign at 2 m/s."""
    line = Line(100.0, "s", "", 0, "side_0", "main_0", (":a_0",), 15.0)
    way, at = RightOfWay(SimpleNamespace(simulation=SimpleNamespace(getTime=lambda: at.time)), Reads(None), {}), None
    stood = []
    for at in (
        SimpleNamespace(time=10.0, to_line=0.5, speed=0.0), SimpleNamespace(time=12.0, to_line=0.4, speed=1.0),
        SimpleNamespace(time=13.0, to_line=-1.0, speed=3.0), SimpleNamespace(time=90.0, to_line=30.0, speed=9.0),
        SimpleNamespace(time=94.0, to_line=1.0, speed=2.0), SimpleNamespace(time=96.0, to_line=0.5, speed=0.0),
    ):  # fmt: skip
        way._now = SimpleNamespace(speed={"m.0": at.speed}, waited={"m.0": 0.0})
        way._still["m.0", "side_0"] = 12.0
        stood.append(way.has_stood(line, at.to_line, Ego("m.0", "side_0", at.speed, CAR.length)))
        if at.time == 90.0:
            assert ("m.0", "side_0") not in way._still
    assert stood == [True, True, True, False, False, True]


@pytest.mark.parametrize(("own", "its", "has_gap"), [(1.6, 0.3, True), (0.8, 1.5, False), (1.6, 0.0, True)])
def test_at_an_all_way_stop_who_sets_out_later_has_waived_the_right_of_way(monkeypatch, own, its, has_gap):
    """The other one had stood for longer, but did not drive when its turn came."""
    line = Line(100.0, "w", "", 0, "road_0", "next_0", (":a_0",), 10.0)
    crossing = Crossing("side_0", (":a_1",), (8.0, 12.0), (16.0, 20.0), False, True, np.inf, 10.0)
    way = RightOfWay(SimpleNamespace(), Reads(SimpleNamespace()), {})
    monkeypatch.setattr(RightOfWay, "_at_lines", lambda *_: [Approach("c", crossing, 0.1, Pace(its))])
    way._stood = {"c": ("side_0", 10.0), "m.0": ("road_0", 12.0)}
    assert way.may_enter(line, "w", Ego("m.0", ":a_0", own, CAR.length)) == has_gap


@pytest.mark.parametrize(
    ("lane", "before", "over", "heeds"),
    [
        (":a_0", "road_0", 4.0, True),
        (":a_1", "road_0", 4.0, True),
        (":a_1", "road_1", 4.0, True),
        (":a_1", "side_0", 4.0, False),
        (":a_1", "road_0", 7.0, False),
    ],
)
def test_a_member_waits_midway_also_where_sumo_takes_it_for_one_on_the_lane_beside(
    monkeypatch, lane, before, over, heeds
):
    """Both lanes begin at the end of its edge; its own one leads to the waiting place, 6 m on.

    One that changed lanes just before its line was on the lane beside to SUMO, and did not wait.
    """
    line = Line(100.0, "m", "", 0, "road_0", "next_0", (":a_0", ":a_2"), 20.0)
    entered_from = {":a_0": "road_0", ":a_1": before}
    lines = StopLines(SimpleNamespace(unregulated=frozenset(), entered_from=entered_from), SimpleNamespace())
    lengths = {":a_0": 6.0, ":a_1": 20.0}
    lines._now = SimpleNamespace(lane_length=lengths, position={"m.0": over})
    lines._conflicts = defaultdict(lambda: SimpleNamespace(crossings=(), walks=(), waits=9.0))
    monkeypatch.setattr(RightOfWay, "may_cross", lambda *_, midway: False)
    monkeypatch.setattr(RightOfWay, "stop_before_foes", lambda *_: np.inf)
    monkeypatch.setattr(RightOfWay, "note_waiting", lambda *_: None)
    monkeypatch.setattr(StopLines, "_link_state", lambda *_: "M")
    member = SimpleNamespace(route=SimpleNamespace(lines_about=lambda *_: (line, over, [])))
    state = lines._state(member, 100.0 + over, Ego("m.0", lane, 3.0, CAR.length), 0)
    assert (not state.open and state.distance == pytest.approx(6.0 - over)) == heeds


@pytest.mark.parametrize(("falls_back_within", "stops_after"), [(2.0, 2.0), (9.0, 5.0)])
def test_a_member_that_falls_back_in_its_lane_change_heeds_its_line_all_the_same(
    monkeypatch, falls_back_within, stops_after
):
    """One drove over its line at 6 m/s, on the wrong lane."""
    change = Line(60.0, CHANGING, "", 0, "road_0", "road_1", (), 20.0, 40.0)
    line = Line(100.0, "M", "", 0, "road_1", "next_0", (":a_0",), 10.0)
    lines = StopLines(ROADS, SimpleNamespace())
    monkeypatch.setattr(lines._change, "may_change", lambda *_: falls_back_within)
    monkeypatch.setattr(lines._change, "may_put_off", lambda *_, **__: False)
    monkeypatch.setattr(lines._change, "is_beside", lambda *_: False)
    monkeypatch.setattr(StopLines, "_ahead", lambda *_: LineState(5.0, False, False, False, LIGHT))
    lines._conflicts = {change._replace(station=0.0): None}
    member = SimpleNamespace(
        route=SimpleNamespace(lines=[change, line], lines_about=lambda *_: (change, 35.0, [(line, 5.0)]))
    )
    state = lines._state(member, 95.0, Ego("m.0", "road_0", 6.0, CAR.length), 0)
    assert (state.distance, state.open) == (stops_after, False)


@pytest.mark.parametrize(
    ("over", "first", "light", "changes", "stops_at"),
    [
        (1.0, (True, True), "G", 20.0, 4.0),
        (4.5, (True, True), "G", 20.0, 4.0),  # a little farther, and still out of the way
        (5.5, (True, True), "G", 20.0, 7.0),  # it is in the way of the first path already, but not of the second
        (8.5, (True, True), "G", 20.0, 9.0),
        (1.0, (True, True), "r", 20.0, 9.0),  # nobody comes from there
        (1.0, (True, True), "r", 3.0, 4.0),  # but will: it would not be gone by then
        (5.5, (True, True), "r", 3.0, 7.0),
        (1.0, (False, True), "G", 20.0, 7.0),
        (1.0, (False, False), "G", 20.0, 9.0),
    ],
)
def test_a_member_waits_midway_before_the_paths_of_those_with_priority(
    monkeypatch, over, first, light, changes, stops_at
):
    """SUMO's place midway, 9 m on, lies in them: in Bologna a column drove through the front of a member there."""
    line = Line(0.0, "g", "a", 0, "road_0", "next_0", (":a_0", ":a_2"), 20.0)
    lines = StopLines(ROADS, SimpleNamespace(simulation=SimpleNamespace(getTime=lambda: 100.0)))
    met = [
        Crossing("other_0", (via,), (touches - 1, 15.0), (5.0, 10.0), False, one, np.inf, 10.0, touches)
        for via, touches, one in zip((":b_0", ":b_1"), (4.0, 7.0), first, strict=True)
    ]
    links = {"other_0": [("",) * LINK_VIA + (one.via[0], light) for one in met]}
    switch = {"a": 100.0 + changes}
    lines._now = SimpleNamespace(lane_length={":a_0": 9.0}, position={"m.0": over}, links=links, next_switch=switch)
    lines._conflicts = defaultdict(lambda: SimpleNamespace(crossings=met, walks=(), waits=9.0))
    monkeypatch.setattr(RightOfWay, "may_cross", lambda *_, midway: False)
    monkeypatch.setattr(RightOfWay, "stop_before_foes", lambda *_: np.inf)
    monkeypatch.setattr(RightOfWay, "note_waiting", lambda *_: None)
    state = lines._passed(line, over, Ego("m.0", ":a_0", 3.0, CAR.length))
    assert state.distance == pytest.approx(stops_at - over)


@pytest.mark.parametrize(
    ("second", "waits", "passes", "stops_at"),
    [
        (20.0, 29.0, True, 20.0),
        (20.0, 29.0, False, 4.0),
        (20.0, 17.0, True, 17.0),  # SUMO's place is nearer
        (12.0, 29.0, True, 29.0),  # it would stand on the first path, and waits beyond the last one
        (12.0, 22.0, True, 4.0),
        (40.0, 29.0, True, 29.0),
        (20.0, 9.0, True, 4.0),
        (20.0, 50.0, True, 50.0),  # also beyond the others
        (20.0, 50.0, 30.0, 20.0),
    ],
)
def test_a_member_waits_midway_beyond_paths_that_it_may_pass(monkeypatch, second, waits, passes, stops_at):
    """In a large junction one left-turner entered in each green, since bicycles could come close behind its line."""
    line = Line(0.0, "g", "a", 0, "road_0", "next_0", (":a_0", ":a_2"), 60.0)
    lines = StopLines(ROADS, SimpleNamespace(simulation=SimpleNamespace(getTime=lambda: 100.0)))
    met = [
        Crossing("other_0", (via,), (begins - 1.0, begins + 5.0), (5.0, 10.0), False, True, np.inf, 10.0, begins)
        for via, begins in ((":b_0", 4.0), (":b_1", second), (":b_2", second + 2.0))
    ]
    links = {"other_0": [("",) * LINK_VIA + (one.via[0], "G") for one in met]}
    lines._now = SimpleNamespace(links=links, next_switch={"a": 130.0})
    lines._conflicts = {line: SimpleNamespace(crossings=met, waits=waits)}
    until_then = {True: np.inf, False: 0.0}.get(passes, passes)  # a member has a gap before the places until there
    asked, ego = [], Ego("m.0", "road_0", 3.0, CAR.length)
    monkeypatch.setattr(RightOfWay, "may_cross", lambda *_, midway, until: asked.append(until) or until < until_then)
    assert lines._midway(line, 0.0, 2.0, ego) == stops_at
    assert all(4.0 < until < np.inf for until in asked)
    asked.clear()
    lines._midway(line, 0.0, 2.0, ego, is_open=True)
    assert not asked  # that asks others to let it in


@pytest.mark.parametrize(("until", "counts"), [(20.0, ["near"]), (35.0, ["near", "far"]), (np.inf, ["near", "far"])])
def test_what_a_member_meets_before_a_place_midway(until, counts):
    line = Line(0.0, "g", "a", 0, "road_0", "next_0", (":a_0", ":a_2"), 60.0)
    way = RightOfWay(SimpleNamespace(), Reads(SimpleNamespace()), {line: SimpleNamespace(waits=40.0)})
    foes = [
        Approach(name, crossed(f":{name}")._replace(own=(own, own + 6.0), touches=own + 1.0), 20.0, Pace(9.0))
        for name, own in (("behind", 1.0), ("near", 12.0), ("far", 30.0))
    ]
    assert [foe.id for foe in way._met(line, foes, -9.0, midway=True, until=until)] == counts


@pytest.mark.parametrize(
    ("inside", "midway", "waits"),
    [
        ([], 29.0, False),
        ([("b", 15.0, 0.0)], 29.0, True),  # it would stand 3 to 8 m beyond the line
        ([("b", 22.0, 0.0)], 29.0, False),
        ([("b", 22.0, 3.0)], np.inf, False),  # which leaves
        ([("b", 10.0, 3.0), ("c", 22.0, 0.0)], np.inf, True),  # both will stand
        ([("b", 10.0, 3.0), ("c", 18.0, 3.0)], 22.0, True),
        ([("b", 10.0, 3.0), ("c", 18.0, 3.0)], np.inf, False),
        ([("b", 4.0, 0.0)], 29.0, True),
        ([("b", 13.1, 0.2), ("c", 20.5, 0.0)], np.inf, True),  # one that still creeps
    ],
)
def test_a_member_does_not_stand_on_a_pedestrian_crossing_behind_others_that_wait_midway(inside, midway, waits):
    """People walked into one that stood there when their light was green."""
    line, walk = Line(0.0, "g", "a", 0, "road_0", "next_0", (":a_0", ":a_2"), 60.0), Walk(":c0", (0.0, 6.0), None, 2.6)
    lines = StopLines(ROADS, None)
    lines._now = SimpleNamespace(
        on_lane={":a_0": ["m.0", *(name for name, _, _ in inside)]},
        position={"m.0": 0.0} | {name: place for name, place, _ in inside},
        speed={"m.0": 4.0} | {name: speed for name, _, speed in inside},
        length=defaultdict(lambda: 5.0),
    )
    lines._conflicts = {line: Conflicts((), (), (walk,), 29.7)}
    assert lines._queues_on_walk(line, midway, Ego("m.0", "road_0", 4.0, CAR.length)) is waits
    lines._conflicts = {line: Conflicts((), (), (), 29.7)}
    assert not lines._queues_on_walk(line, midway, Ego("m.0", "road_0", 4.0, CAR.length))


@pytest.mark.parametrize(("keeps", "waits"), [(2.5, False), (6.0, True)])
def test_where_a_member_stands_behind_others_depends_on_the_distance_that_it_keeps(keeps, waits):
    line, walk = Line(0.0, "g", "a", 0, "road_0", "next_0", (":a_0", ":a_2"), 60.0), Walk(":c0", (0.0, 6.0), None, 2.6)
    lines = StopLines(ROADS, None)
    lines._now = SimpleNamespace(
        on_lane={":a_0": ["b"]}, position={"b": 19.0}, speed={"b": 0.0}, length={"b": 5.0}
    )  # fmt: skip
    lines._conflicts = {line: Conflicts((), (), (walk,), 29.7)}
    assert lines._queues_on_walk(line, 29.0, Ego("m.0", "road_0", 4.0, CAR.length, keeps=keeps)) is waits


@pytest.mark.parametrize(("speed", "margins"), [(3.0, [1.0, 0.5]), (9.0, [1.0, 0.0])])
def test_before_a_place_midway_a_member_goes_on_without_a_margin_only_where_it_cannot_stop(monkeypatch, speed, margins):
    """It is 4 m beyond the line, and 9 m before the other path."""
    line = Line(0.0, "g", "a", 0, "road_0", "next_0", (":a_0", ":a_2"), 60.0)
    crossing = crossed(":b_0")._replace(own=(12.0, 18.0), touches=13.0)
    way, found = (
        RightOfWay(SimpleNamespace(), Reads(SimpleNamespace()), {line: Conflicts((), (crossing,), (), 30.0)}),
        [],
    )
    way._patiently[line], way._first_inside[line] = [Approach("c", crossing, 90.0, Pace(9.0))], []
    monkeypatch.setattr(RightOfWay, "_waited", lambda *_: 0.0)
    monkeypatch.setattr(RightOfWay, "_has_gap_among", lambda *given: found.append(given[5]) or True)
    for _ in range(2):
        way.begin_look()
        way.may_cross(line, -4.0, Ego("m.0", ":a_0", speed, CAR.length), midway=True, until=25.0)
    assert found == margins


@pytest.mark.parametrize(("place", "come"), [(None, 2), (-20.0, 1)])
def test_those_behind_one_that_stands_between_two_places_come_to_the_first_of_them(monkeypatch, place, come):
    """Its path meets the member's 5 and 25 m beyond its line; it stands midway, 20 m beyond it."""
    line = Line(0.0, "m", "", 0, "road_0", "next_0", (":a_0",), 60.0)
    near, far = (
        Crossing("side_0", (":b_0", ":b_1"), own, its, False, True, 40.0, 10.0, own[0], blocks=its[0])
        for own, its in (((30.0, 36.0), (5.0, 10.0)), ((4.0, 9.0), (25.0, 30.0)))
    )
    now = SimpleNamespace(
        on_lane={"side_0": ["c"], ":b_0": [], ":b_1": []}, lane_length={"side_0": 100.0}, position={"c": 60.0},
        speed={"c": 9.0}, acceleration={"c": 2.6}, max_speed={"side_0": 13.9},
    )  # fmt: skip
    way = RightOfWay(SimpleNamespace(), now, {line: Conflicts((("side_0", 0.0),), (near, far), (), np.inf)})
    way._occupied[line] = [near, far]
    stands = [] if place is None else [place]
    monkeypatch.setattr(RightOfWay, "on", lambda _, crossing: [Approach("w", crossing, at, Pace(0.0)) for at in stands])
    monkeypatch.setattr(RightOfWay, "_links_ahead", lambda *_: ((":b_0",), "M"))
    assert [foe.crossing for foe, *_ in way._foes_outside(line)] == [near, far][:come]


@pytest.mark.parametrize(
    ("foe", "speed", "before", "stops"),
    [("c", 4.0, "w", True), ("m.1", 4.0, "w", False), ("c", 0.0, "w", False), ("c", 4.0, "=", False)],
)
def test_at_an_all_way_stop_a_member_stops_for_a_car_that_sets_out_after_it(monkeypatch, foe, speed, before, stops):
    """On a random network one turned left in the place of a car that had stood for longer, and that drove into it."""
    line = Line(0.0, before, "", 0, "road_0", "next_0", (":a_0",), 20.0)
    crossing = crossed(":b_0")._replace(own=(10.0, 14.0), touches=10.5, first=True)
    way = RightOfWay(SimpleNamespace(), Reads(SimpleNamespace()), {line: Conflicts((), (crossing,), (), np.inf)})
    way.members = way.obedient = frozenset(("m.0", "m.1"))
    way._all_inside[line], way._patiently[line], way._outside[line] = (
        [Approach(foe, crossing, -1.0, Pace(speed))],
        [],
        [],
    )
    monkeypatch.setattr(RightOfWay, "_has_gap_among", lambda *_: False)
    found = way.stop_before_foes(line, 1.0, Ego("m.0", ":a_0", 2.0, CAR.length), before)
    assert found == (pytest.approx(10.0 - 1.0 - BEFORE_PATH) if stops else np.inf)


@pytest.mark.parametrize("light", ["=", "y", "r"])
def test_of_two_members_inside_a_junction_whose_lights_are_green_for_both_none_stops_as_they_turn(monkeypatch, light):
    """Each would stop for the other, and both for ever."""
    line = Line(0.0, "=", "a", 0, "road_0", "next_0", (":a_0",), 20.0)
    crossing = crossed(":b_0")._replace(own=(10.0, 14.0), touches=10.5)
    way = RightOfWay(SimpleNamespace(), Reads(SimpleNamespace()), {line: Conflicts((), (crossing,), (), np.inf)})
    way._all_inside[line], way._patiently[line], way._outside[line] = (
        [Approach("m.1", crossing, -3.0, Pace(4.0))],
        [],
        [],
    )
    monkeypatch.setattr(RightOfWay, "_has_gap_among", lambda *_: False)
    assert way.stop_before_foes(line, 3.0, Ego("m.0", ":a_0", 4.0, CAR.length), light) == np.inf


@pytest.mark.sumo
def test_a_path_that_turns_about_meets_one_across_it_twice(tmp_path):
    pytest.importorskip("sumo", reason="netconvert comes with eclipse-sumo: pip install platoontraffic[gui]")
    network = Network.read(turnabout(tmp_path))
    libsumo.start(["sumo", "-n", str(network.path), "--no-step-log", "--no-warnings"])
    try:
        *_, lines = network.route_lanes(("wc", "ce"), 0)
        found = [one for one in Conflicts.at(lines[0], network, libsumo).crossings if one.before == "nc_0"]
        assert len(found) == 2
        near, far = found
        assert near.own[1] + CAR.length < far.own[0]
        assert near.its[1] < far.its[0]
        assert far.own[0] - near.own[0] == pytest.approx(24.0, abs=0.6)
        assert [near.merges, far.merges] == [False, False]
        assert near.own[0] < near.touches < near.own[1]
        assert far.own[0] < far.touches < far.own[1]
    finally:
        libsumo.close()


@pytest.mark.parametrize("apart", [25.0, 12.0, 8.0])
def test_paths_meet_several_times_where_a_vehicle_has_room_between_the_places(apart):
    """Bicycles that turn about cross a path twice. Against shapely."""
    at = np.array([(0.0, 0.0), (60.0, 0.0)]), [(15.0 + apart, -9.0), (15.0 + apart, 9.0), (15.0, 9.0), (15.0, -9.0)]
    own, its = (conflicts._sampled(np.array(points), 0.25) for points in at)
    near = shapely.LineString(at[0]).intersection(shapely.LineString(at[1]).buffer(2.56))
    expected = [(part.bounds[0], part.bounds[2]) for part in shapely.get_parts(near)]
    places = [*conflicts._places(own, its, 2.56, CAR.length)]
    if expected[1][0] - expected[0][1] < CAR.length:
        expected = [(expected[0][0], expected[1][1])]
    assert len(places) == (1 if apart == 8.0 else 2)
    np.testing.assert_allclose([place.own for place in places], expected, atol=0.3)
    front = conflicts._front_along(own, CAR.width / 2)
    touches = [conflicts._touches(front, place.its_line, 1.6) for place in places]
    np.testing.assert_allclose(touches, [place.own[0] + 0.96 for place in places], atol=0.3)
    whole = conflicts._met(own, its, 2.56)
    assert whole[0] == (places[0].own[0], places[-1].own[1])
    assert whole[1] == (min(place.its[0] for place in places), max(place.its[1] for place in places))


@pytest.mark.parametrize(
    ("ends", "onto"), [([(40.0, -9.0), (50.0, 0.0), (60.0, 0.0)], "on_0"), ([(40.0, 9.0)], "off_0")]
)
def test_of_the_places_where_paths_meet_only_the_last_one_merges_and_each_blocks_by_itself(ends, onto):
    """A path crosses the own one at 10 m, turns back, and merges with it or crosses it again at 40 m."""
    line = Line(0.0, "m", "", 0, "road_0", "on_0", (":a_0",), 60.0)
    paths, step = conflicts.Paths(None), conflicts.SAMPLED * 3.2
    across = [(10.0, 9.0), (10.0, -9.0), *([(40.0, -9.0)] if onto == "off_0" else []), *ends]
    for via, leads_to, points in (((":a_0",), "on_0", [(0.0, 0.0), (60.0, 0.0)]), ((":b_0", ":b_1"), onto, across)):
        paths[via, leads_to, step] = conflicts._sampled(np.array(points), step)
    paths.links["side_0"] = [((":b_0", ":b_1"), onto)]
    lane = SimpleNamespace(
        getFoes=lambda *_: ("side_0",), getInternalFoes=lambda _: (":b_0",), getWidth=lambda _: 3.2,
        getLength=lambda _: 70.0, getMaxSpeed=lambda _: 10.0,
    )  # fmt: skip
    network = SimpleNamespace(
        entered_from={":a_0": "road_0", ":b_0": "side_0"}, unregulated=frozenset(), inside_with=lambda _: (),
        upstream=lambda name, _: [(name, 0.0)],
    )  # fmt: skip
    near, far = Conflicts.at(line, network, SimpleNamespace(lane=lane), paths).crossings
    assert [near.merges, far.merges] == [False, onto == "on_0"]
    assert near.own == pytest.approx((10 - 2.56, 10 + 2.56), abs=0.5)
    assert near.its == pytest.approx((9 - 2.56, 9 + 2.56), abs=0.5)
    reaches = conflicts.TOUCHES * 3.2
    assert near.blocks == pytest.approx(9 - reaches, abs=0.5)
    if onto == "off_0":
        assert far.blocks == pytest.approx(18 + 30 + 9 - reaches, abs=0.5)
        assert far.own == pytest.approx((40 - 2.56, 40 + 2.56), abs=0.5)
    else:
        assert far.blocks == np.inf  # it is not let in, but joins


@pytest.mark.parametrize(
    ("own", "touches", "enters"),
    [
        (5.0, 7.0, False),
        (8.7, 10.9, True),  # as in Bologna, where SUMO's drivers wait 10.7 m on
        (12.0, 14.0, True),
        (8.7, np.inf, False),
        (12.0, np.inf, True),
    ],
)
def test_a_member_enters_to_wait_midway_where_others_pass_close_before_its_front(own, touches, enters):
    """In Bologna one stood at its line through the whole green, and a queue of 350 m behind it."""
    line = Line(0.0, "g", "a", 0, "road_0", "next_0", (":a_0", ":a_2"), 20.0)
    crossing = Crossing("against_0", (":b_0",), (own, 18.0), (11.0, 18.0), False, True, np.inf, 14.0, touches)
    way = RightOfWay(SimpleNamespace(), Reads(SimpleNamespace()), {line: SimpleNamespace(waits=10.7)})
    foes = [Approach("c", crossing, 20.0, Pace(14.0))]
    assert way._met(line, foes, 1.0, midway=False) == ([] if enters else foes)
    assert way._met(line, foes, -9.5, midway=True) == (foes if enters else [])  # it has come so far


@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize("lane", ["road_1", ""])
def test_a_member_that_was_set_back_onto_a_lane_beside_is_still_held(monkeypatch, lane, held):
    """The look after that found no closed line, and it would have driven on at red."""
    line = Line(0.0, "G", "a", 0, "road_0", "next_0", (":a_0",), 20.0)
    lines, red = StopLines(ROADS, None), LineState(0.6, False, False, False, LIGHT)
    lines._were_over_line = frozenset({"m.0"} if held else ())
    monkeypatch.setattr(StopLines, "_passed", lambda *_: red)
    member = SimpleNamespace(route=SimpleNamespace(lines_about=lambda *_: (line, 0.4, ())))
    state = lines._state(member, 100.4, Ego("m.0", lane, 0.0, CAR.length), 0)
    assert state == (red if held else NO_LINE)


@pytest.mark.parametrize("via", [(":a_0",), (":a_0", ":a_2")])
@pytest.mark.parametrize(
    ("light", "over", "speed", "stays"),
    [
        ("r", 0.4, 0.0, True),
        ("u", 0.4, 0.5, True),
        ("r", 0.4, 4.0, False),  # it cannot stop there
        ("r", 1.1, 0.0, False),
        ("y", 0.4, 0.0, False),
    ],
)
def test_a_member_whose_front_is_a_little_over_the_line_stays_there_when_it_is_red(
    monkeypatch, via, light, over, speed, stays
):
    """In Bologna one crept over its line behind a left-turner, and drove on at red: nobody else could leave."""
    line = Line(0.0, "G", "a", 0, "road_0", "next_0", via, 20.0)
    lines = StopLines(ROADS, SimpleNamespace())
    lines._now = SimpleNamespace(lane_length={":a_0": 9.0}, position={"m.0": over}, lights={"a": light})
    lines._conflicts = defaultdict(lambda: SimpleNamespace(crossings=(), walks=(), waits=9.0))
    monkeypatch.setattr(RightOfWay, "may_cross", lambda *_, midway: True)
    monkeypatch.setattr(RightOfWay, "has_way", lambda *_: True)
    monkeypatch.setattr(RightOfWay, "stop_before_foes", lambda *_: np.inf)
    monkeypatch.setattr(RightOfWay, "note_waiting", lambda *_: None)
    state = lines._passed(line, over, Ego("m.0", ":a_0", speed, CAR.length))
    closed = state is not None and not state.open
    assert closed == stays
    assert not stays or (state.distance, state.reason) == (pytest.approx(1.0 - over), LIGHT)
    assert lines.over_line == ({"m.0": over} if stays and speed == 0 else {})


@pytest.mark.parametrize(
    ("changed", "speed", "place", "name", "waited", "distance", "stop"),
    [
        ({}, 3.0, 2.0, "c", 0.0, 20.0, 4.5),  # 0.5 m before the path of the member, which begins 7 m on
        ({}, 3.0, 2.0, "c", 0.0, -12.0, 4.5),
        ({}, 3.0, -4.0, "c", 0.0, 20.0, 10.5),  # it is next to enter
        ({}, 1.0, -4.0, "c", 0.0, 20.0, None),  # but goes elsewhere
        ({}, 3.0, -16.0, "c", 0.0, 20.0, None),  # or is far away
        ({}, 13.0, -16.0, "c", 0.0, 20.0, 22.5),  # from there it has to brake
        ({}, 3.0, 2.0, "c", 4.0, 0.5, 4.5),  # it has just come to a stand
        ({}, 3.0, 2.0, "c", 6.0, 0.5, None),  # it does not come
        ({"touches": 12.0}, 3.0, 2.0, "c", 6.0, -13.0, 4.5),  # it stands there, in a queue
        ({"touches": 12.0}, 3.0, 2.0, "c", 6.0, -11.0, None),
        ({}, 3.0, 2.0, "c", 0.0, -24.0, None),  # it is past
        ({}, 6.5, 2.0, "c", 0.0, 20.0, 4.5),  # it stops by a little more than 4.5 m/s2
        ({}, 9.0, 2.0, "c", 0.0, 20.0, None),  # it cannot stop any more
        ({}, 0.0, 6.6, "c", 0.0, 20.0, -0.1),  # it stands there, a little farther
        ({}, 3.0, 8.0, "c", 0.0, 20.0, None),  # it is there already
        ({}, 0.0, 7.4, "c", 0.0, 20.0, None),
        ({"blocks": 7.6}, 0.0, 7.4, "c", 0.0, 20.0, -0.9),  # it stands where the member can pass it
        ({"blocks": 7.3}, 0.0, 7.4, "c", 0.0, 20.0, None),
        ({"blocks": 7.6}, 0.5, 7.4, "c", 0.0, 20.0, None),
        ({}, 3.0, 2.0, "m.1", 0.0, 20.0, None),  # a member knows its own places
        ({"first": True}, 3.0, 2.0, "c", 0.0, 20.0, None),  # it does not wait for this one
        ({"merges": True}, 3.0, 2.0, "c", 0.0, 20.0, None),
        ({"waits": 6.0}, 3.0, 2.0, "c", 0.0, 20.0, None),  # its place midway is out of the way
        ({"waits": np.inf}, 3.0, 2.0, "c", 0.0, 20.0, None),  # it has none
    ],
)
def test_who_would_wait_midway_in_the_way_of_a_member_stops_before_its_path(
    monkeypatch, changed, speed, place, name, waited, distance, stop
):
    """In Bologna a bus and a member waited for each other there, and closed the junction for minutes."""
    line = Line(0.0, "M", "", 0, "road_0", "next_0", (":a_0",), 20.0)
    crossing = Crossing("side_0", (":a_1", ":a_2"), (10.0, 18.0), (7.0, 14.0), False, False, 9.0, 10.0)
    crossing = crossing._replace(**changed)
    conflicts = Conflicts((), (crossing,), (), np.inf)
    way = RightOfWay(SimpleNamespace(), Reads(SimpleNamespace()), {line: conflicts})
    way.members = {"m.0", "m.1"}
    inside, lengths = place > 0, {":a_1": 9.0, ":a_2": 9.0, "side_0": 50.0}
    on_lane = Once(lambda _: [])
    on_lane.update({":a_1": [name] * inside, "side_0": ["b", name][: 2 - inside]})
    way._now = SimpleNamespace(
        on_lane=on_lane, lane_length=lengths,
        position={name: place if inside else 50.0 + place, "b": 10.0}, speed={name: speed, "b": 9.0},
        acceleration={name: 2.6}, length={name: 5.0}, waited={"m.0": waited},
        next_links={name: [("",) * LINK_VIA + (":a_1" if speed > 1.5 else ":a_7", "", "")], "b": []},
        best_lanes={name: [], "b": []},
    )  # fmt: skip
    monkeypatch.setattr(RightOfWay, "_drives_on", lambda *_: True)
    ego = Ego("m.0", "road_0" if distance > 0 else ":a_0", 8.0, CAR.length)
    way.note_waiting(line, distance, ego)
    assert way.stops == ({} if stop is None else {name: pytest.approx(stop)})
    monkeypatch.setattr(RightOfWay, "_drives_on", lambda *_: False)  # then others do not block the path either
    way.note_waiting(line, distance, ego)
    stays = stop is None and (waited > 5.0 or changed.get("first"))
    assert way.stops == ({name: pytest.approx(4.5)} if stays else {} if stop is None else {name: pytest.approx(stop)})


@pytest.mark.parametrize(
    ("speed", "rate", "gap", "drives_on"),
    [
        (3.0, 1.0, True, True),
        (3.0, 1.0, False, False),
        (3.0, -3.0, True, False),  # it brakes before its place midway
        (3.0, -1.0, True, True),  # it dawdles
        (12.0, -3.0, True, True),  # it brakes for the bend
        (0.0, 0.0, True, True),
    ],
)
def test_a_vehicle_drives_on_if_it_has_a_gap_and_does_not_brake(monkeypatch, speed, rate, gap, drives_on):
    crossing = Crossing("side_0", (":a_1", ":a_2"), (10.0, 18.0), (7.0, 14.0), False, True, 9.0, 10.0)
    conflicts = defaultdict(lambda: Conflicts((), (), (), 9.0))
    way, judged = RightOfWay(SimpleNamespace(), Reads(SimpleNamespace()), conflicts), []
    way._now = SimpleNamespace(
        accelerates_by={"c": rate}, length={"c": 5.0}, acceleration={"c": 2.6}, lane_length={":a_1": 9.0, ":a_2": 6.0},
        links={"side_0": [("b_0", True, True, False, ":a_7", "M", "s", 9.0), ("a_9", 0, 0, 0, ":a_1", "m", "l", 9.0)]},
        on_lane=Once({}.__getitem__),
    )  # fmt: skip

    def has_gap(_, foes, line, to_line, ego, *rest):
        judged.append((line, to_line, *rest))
        return gap

    monkeypatch.setattr(RightOfWay, "_has_gap_among", has_gap)
    assert way._drives_on(Approach("c", crossing, -2.0, Pace(speed))) == drives_on
    for line, *rest in judged:
        assert (line.lane, line.onto, line.via, line.across) == ("side_0", "a_9", (":a_1", ":a_2"), 15.0)
        assert rest == [-2.0, 1.0, 7.0]  # from the line, margin, and to where it may wait


@pytest.mark.parametrize(
    ("found", "distance", "noted"),
    [
        ((5.0, True, True, False, RIGHT_OF_WAY), 5.0, True),
        ((5.0, False, True, False, RIGHT_OF_WAY), 5.0, True),  # it waits at its line
        ((5.0, False, False, False, RIGHT_OF_WAY), 5.0, False),  # until the junction is cleared at its green light
        ((5.0, False, True, False, LIGHT), 5.0, False),
        ((15.0, False, True, False, RIGHT_OF_WAY), 15.0, False),  # it only comes, and will wait
    ],
)
def test_who_waits_midway_is_looked_for_where_a_member_comes_or_gives_way(monkeypatch, found, distance, noted):
    line, looked = Line(0.0, "m", "", 0, "road_0", "next_0", (":a_0",), 20.0), []
    lines = StopLines(ROADS, SimpleNamespace())
    monkeypatch.setattr(StopLines, "_at_line", lambda *_: LineState(*found))
    monkeypatch.setattr(RightOfWay, "note_waiting", lambda *_: looked.append(1))
    monkeypatch.setattr(RightOfWay, "stop_before_foes", lambda *_: np.inf)
    lines._ahead(line, distance, True, Ego("m.0", "road_0", 2.0, CAR.length), None)
    assert bool(looked) == noted


@pytest.mark.parametrize(
    ("speed", "place", "counts"),
    [
        (0.0, 3.0, False),  # it waits before the path of the member, and those behind it with it
        (1.0, 3.0, True),  # it drives
        (0.0, 4.5, True),  # it blocks the path
        (0.0, 5.5, True),  # it is beyond its place midway
    ],
)
def test_who_comes_behind_one_that_waits_midway_does_not_count(speed, place, counts):
    """In a left-hand grid a queue of turners that crept up to one another let nobody cross for 42 s."""
    line = Line(0.0, "m", "", 0, "road_0", "next_0", (":a_0",), 20.0)
    crossing = Crossing(
        "side_0", (":a_1", ":a_2"), (10.0, 18.0), (3.3, 9.0), False, True, 5.0, 10.0, blocks=4.0
    )  # fmt: skip
    conflicts = Conflicts((("side_0", 0.0),), (crossing,), (), np.inf)
    way = RightOfWay(SimpleNamespace(), Reads(SimpleNamespace()), {line: conflicts})
    way.members = frozenset()
    way._controlled = frozenset()
    on_lane = Once(lambda _: [])
    on_lane.update({":a_1": ["first"], "side_0": ["second"]})
    way._now = SimpleNamespace(
        on_lane=on_lane, lane_length={":a_1": 5.0, ":a_2": 9.0, "side_0": 50.0},
        position={"first": place, "second": 40.0}, speed={"first": speed, "second": 0.6}, max_speed={"side_0": 14.0},
        acceleration={"first": 2.6, "second": 2.6}, length={"first": 5.0, "second": 5.0}, best_lanes={"second": []},
        next_links={"second": [("",) * LINK_VIA + (":a_1", "M", "")]},
    )  # fmt: skip
    assert bool(way._outside[line]) == counts


@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_a_member_that_stands_over_a_line_that_closed_is_before_it_for_sumo(monkeypatch, speed):
    """SUMO's drivers gave way to one that stood inside, and it to them."""
    line = Line(0.0, "m", "", 0, "road_0", "next_0", (":a_0",), 20.0)
    lines = StopLines(ROADS, SimpleNamespace())
    lines._conflicts = defaultdict(lambda: Conflicts((), (), (), np.inf))
    monkeypatch.setattr(RightOfWay, "has_way", lambda *_: False)
    monkeypatch.setattr(RightOfWay, "note_waiting", lambda *_: None)
    state = lines._passed(line, 0.2, Ego("m.0", ":a_0", speed, CAR.length))
    assert not state.open
    assert lines.over_line == ({"m.0": 0.2} if speed == 0 else {})


@pytest.mark.parametrize(
    ("speed", "distance", "is_held"), [(0.0, 0.0, True), (0.0, 0.09, True), (0.0, 0.5, False), (1.0, 0.05, False)]
)
def test_a_member_that_stands_on_a_line_at_red_is_before_it_for_sumo(monkeypatch, speed, distance, is_held):
    """On edges of 4 m SUMO inserts cars with their fronts on the line: they had run a red light, and were inside."""
    line = Line(0.0, "r", "light", 0, "road_0", "next_0", (":a_0",), 20.0)
    lines = StopLines(ROADS, SimpleNamespace())
    lines._conflicts = defaultdict(lambda: Conflicts((), (), (), np.inf))
    monkeypatch.setattr(lines, "_link_state", lambda _: "r")
    assert not lines._at_line(line, distance, True, Ego("m.0", "road_0", speed, CAR.length)).open
    assert lines.over_line == ({"m.0": -distance} if is_held else {})


@pytest.mark.parametrize(("lane", "heeds"), [("road_0", True), (":a_0", True), ("next_0", False)])
@pytest.mark.parametrize("way", [True, False])
def test_a_member_whose_front_is_a_little_over_its_line_gives_way_wherever_sumo_has_it(monkeypatch, lane, heeds, way):
    """It had stopped with its front a centimetre over the line, SUMO had it before that, and it set out at once."""
    line, looked = Line(0.0, "m", "", 0, "road_0", "next_0", (":a_0",), 20.0), []
    lines = StopLines(ROADS, SimpleNamespace())
    lines._conflicts = defaultdict(lambda: Conflicts((), (), (), np.inf))
    monkeypatch.setattr(RightOfWay, "has_way", lambda *_: way)
    monkeypatch.setattr(RightOfWay, "stop_before_foes", lambda *_: np.inf)
    monkeypatch.setattr(RightOfWay, "note_waiting", lambda *_: looked.append(lane))
    state = lines._passed(line, 0.01, Ego("m.0", lane, 0.0, CAR.length))
    assert (state is not None and not state.open) == (heeds and not way)
    assert looked == [lane] * heeds


@pytest.mark.parametrize("lane", ["road_0", ":a_0", ":a_2", "next_0"])
def test_they_are_looked_for_by_members_that_come_and_that_are_inside(monkeypatch, lane):
    line, looked = Line(0.0, "M", "", 0, "road_0", "next_0", (":a_0", ":a_2"), 20.0), []
    lines = StopLines(ROADS, SimpleNamespace())
    lines._conflicts = defaultdict(lambda: Conflicts((), (), (), np.inf))
    lines._now = SimpleNamespace(lane_length={":a_0": 6.0}, position={"m.0": 1.0})
    for name, value in {"may_cross": True, "stop_before_foes": np.inf}.items():
        monkeypatch.setattr(RightOfWay, name, lambda *_, value=value, **__: value)
    monkeypatch.setattr(StopLines, "_has_room", lambda *_: True)
    monkeypatch.setattr(RightOfWay, "note_waiting", lambda *given: looked.append(given[2]))
    ego = Ego("m.0", lane, 5.0, CAR.length)
    if lane == "road_0":
        lines._ahead(line, 12.0, True, ego, None)
        lines._ahead(line, 40.0, False, ego, None)  # too far away
    else:
        lines._passed(line, 1.0, ego)
    assert looked == {"road_0": [12.0], "next_0": []}.get(lane, [-1.0])


@pytest.mark.parametrize("stop", [2.0, 6.0, np.inf])
def test_a_member_that_may_wait_midway_stops_before_that_for_a_vehicle_that_has_set_out(monkeypatch, stop):
    line = Line(0.0, "g", "", 0, "road_0", "next_0", (":a_0", ":a_2"), 20.0)
    lines = StopLines(ROADS, SimpleNamespace())
    lines._now = SimpleNamespace(lane_length={":a_0": 6.0}, position={"m.0": 1.0})
    lines._conflicts = defaultdict(lambda: Conflicts((), (), (), np.inf))
    monkeypatch.setattr(RightOfWay, "may_cross", lambda *_, midway: True)
    monkeypatch.setattr(RightOfWay, "stop_before_foes", lambda *_: stop)
    monkeypatch.setattr(RightOfWay, "note_waiting", lambda *_: None)
    state = lines._passed(line, 1.0, Ego("m.0", ":a_0", 3.0, CAR.length))
    assert (state.open, state.distance) == (stop == np.inf, min(stop, 5.0))


@pytest.mark.parametrize(
    ("at", "speed", "has_gap", "last", "state"),
    [
        (10.0, 0.0, True, 30.0, (True, RIGHT_OF_WAY, 2.0)),
        (10.0, 0.0, True, 6.0, (False, NO_ROOM, 2.0)),
        (12.2, 0.0, True, 6.0, (False, NO_ROOM, 0.0)),  # a little over its place
        (10.0, 0.0, False, 6.0, (False, RIGHT_OF_WAY, 2.0)),
        (10.0, 6.0, True, 6.0, (True, RIGHT_OF_WAY, 2.0)),  # it cannot stop any more
    ],
)
def test_a_member_waits_midway_until_there_is_room_beyond(monkeypatch, at, speed, has_gap, last, state):
    """While one waited there for a gap, others filled the lane beyond: it stood in their way, and was struck."""
    line = Line(0.0, "g", "", 0, "road_0", "next_0", (":a_0", ":a_2"), 30.0)
    lines = StopLines(ROADS, SimpleNamespace())
    met = (crossed(":b_0", merges=True),)
    lines._conflicts = defaultdict(lambda: SimpleNamespace(crossings=met, walks=(), waits=9.0))
    names = {"m.0": at, "behind": 3.0, "last": last}
    lines._now = SimpleNamespace(
        on_lane={":a_0": ["behind", "m.0"], ":a_2": [], ":b_0": [], "next_0": ["last"]}, position=names,
        lane_length={":a_0": 12.0}, speed=dict.fromkeys(names, 0.0), length=dict.fromkeys(names, 5.0),
        links={"side_0": []},
    )  # fmt: skip
    monkeypatch.setattr(RightOfWay, "may_cross", lambda *_, midway: has_gap)
    monkeypatch.setattr(RightOfWay, "stop_before_foes", lambda *_: np.inf)
    monkeypatch.setattr(RightOfWay, "note_waiting", lambda *_: None)
    found = lines._passed(line, 10.0, Ego("m.0", ":a_0", speed, CAR.length))
    assert (found.open, found.reason, found.distance) == pytest.approx(state)


@pytest.mark.parametrize(
    ("near", "has_room", "stop", "is_open", "stops_at"),
    [
        (True, True, 12.0, False, 12.0),
        (False, True, 12.0, True, 7.0),
        (True, False, 12.0, False, 7.0),  # there is no room beyond: it stays at the line
        (True, False, np.inf, False, 7.0),
        (True, True, np.inf, True, 7.0),
    ],
)
def test_a_line_with_priority_is_closed_while_a_vehicle_that_has_set_out_crosses(
    monkeypatch, near, has_room, stop, is_open, stops_at
):
    """And so it is without room beyond."""
    line = Line(0.0, "M", "", 0, "road_0", "next_0", (":a_0",), 10.0)
    lines = StopLines(ROADS, SimpleNamespace())
    lines._conflicts = defaultdict(lambda: Conflicts((), (), (), np.inf))
    monkeypatch.setattr(RightOfWay, "stop_before_foes", lambda *given: stop if given[2] == -7.0 else np.inf)
    monkeypatch.setattr(RightOfWay, "note_waiting", lambda *_: None)
    monkeypatch.setattr(StopLines, "_has_room", lambda *_: has_room)
    state = lines._ahead(line, 7.0, near, Ego("m.0", "road_0", 2.0, CAR.length), None)
    assert (state.open, state.distance) == (is_open, stops_at)


@pytest.mark.parametrize(
    ("at_line", "stop", "state"),
    [
        ((15.0, False), 12.0, (12.0, False)),  # it would go on to its place midway, but has to stop before
        ((15.0, False), 18.0, (15.0, False)),
        ((7.0, True), 12.0, (12.0, False)),
        ((7.0, False), 12.0, (7.0, False)),
    ],
)
def test_of_two_places_at_which_a_member_must_stop_the_nearer_one_counts(monkeypatch, at_line, stop, state):
    line = Line(0.0, "M", "", 0, "road_0", "next_0", (":a_0",), 10.0)
    lines = StopLines(ROADS, SimpleNamespace())
    monkeypatch.setattr(StopLines, "_at_line", lambda *_: LineState(*at_line, False, False, 2))
    monkeypatch.setattr(RightOfWay, "note_waiting", lambda *_: None)
    monkeypatch.setattr(RightOfWay, "stop_before_foes", lambda *_: stop)
    assert lines._ahead(line, 7.0, True, Ego("m.0", "road_0", 2.0, CAR.length), None)[:2] == state


def test_nobody_is_kept_waiting_when_there_is_no_member_any_more():
    lines = StopLines(ROADS, SimpleNamespace())
    lines._way.stops["bus"], lines._fleet = 2.0, ("gone",)
    assert lines.signals(NOBODY, []) is None
    assert lines.waiting_places == {}


def crossed(via: str, merges: bool = False) -> Crossing:
    return Crossing("side_0", (via,), (3.0, 12.0), (4.0, 16.0), merges, True, np.inf, 10.0)


@pytest.mark.parametrize(("merges", "speed", "waits"), [(True, 0.0, True), (False, 0.0, False), (True, 3.0, False)])
def test_room_behind_a_junction_is_left_to_those_that_stand_inside_and_go_to_the_same_lane(merges, speed, waits):
    """There is room for one more. In a jammed junction a member drove up to them, and stood in everybody's way."""
    line = Line(100.0, "m", "", 0, "road_0", "next_0", (":a_0",), 10.0)
    lines = StopLines(ROADS, SimpleNamespace())
    lines._conflicts = defaultdict(lambda: SimpleNamespace(crossings=(crossed(":b_0", merges),), walks=(), waits=9.0))
    on_lane = {":a_0": [], ":b_0": ["inside"], "next_0": ["last"]}
    lines._now = SimpleNamespace(
        on_lane=on_lane, position={"last": 16.0, "inside": 8.0}, speed={"last": 0.0, "inside": speed},
        length={"last": 5.0, "inside": 5.0},
    )  # fmt: skip
    assert lines._has_room(line, Ego("m.0", "road_0", 0.0, CAR.length)) == (not waits)


@pytest.mark.parametrize(
    ("before", "changes", "drives_up"),
    [("road_0", False, True), ("road_0", True, False), ("side_0", False, False)],
)
def test_paths_that_part_from_the_own_one_are_no_cross_traffic(before, changes, drives_up):
    """In Bologna a member stood for 72 s at such a line, and SUMO's cars drove up to the queue beyond it."""
    line = Line(100.0, "M", "", 0, "road_0", "next_0", (":a_0",), 10.0)
    lines = StopLines(ROADS, SimpleNamespace())
    met = crossed(":b_0")._replace(before=before)
    lines._conflicts = defaultdict(lambda: SimpleNamespace(crossings=(met,), walks=(), waits=9.0))
    lines._now = SimpleNamespace(
        on_lane={":a_0": [], ":b_0": [], "next_0": ["last"]}, position={"last": 6.0}, speed={"last": 0.0},
        length={"last": 5.0},
    )  # fmt: skip
    route = SimpleNamespace(lines=[line, line._replace(lane="next_0", state=CHANGING)] if changes else [line])
    assert lines._has_room(line, Ego("m.0", "road_0", 0.0, CAR.length, route=route)) == drives_up


@pytest.mark.parametrize(("inside", "has_room"), [("m.0", True), ("c", False)])
def test_a_member_finds_room_at_the_place_midway_where_sumo_takes_it_to_be_there_itself(inside, has_room):
    """It stands at its line, which SUMO places a little before. It waited for itself, for ever."""
    line = Line(100.0, "m", "", 0, "road_0", "next_0", (":a_0", ":a_2"), 20.0)
    lines = StopLines(ROADS, SimpleNamespace())
    lines._conflicts = defaultdict(lambda: SimpleNamespace(crossings=(crossed(":b_0"),), walks=(), waits=9.0))
    on_lane = {":a_0": [inside], ":a_2": [], "next_0": []}
    lines._now = SimpleNamespace(on_lane=on_lane, position={inside: 0.2}, speed={inside: 0.0}, length={inside: 5.0})
    assert lines._has_room(line, Ego("m.0", ":a_0", 0.0, CAR.length)) == has_room


@pytest.mark.parametrize(
    ("speeds", "places", "has_room"),
    [
        ((0.0,), (9.0,), False),
        ((1.8,), (9.0,), True),  # slow in the bend, with the road before it
        ((1.8, 8.0), (9.0, 18.0), True),
        ((1.8, 0.0), (9.0, 18.0), False),  # it comes up to a queue
        ((1.8, 0.0), (9.0, 60.0), True),
        ((1.8,), (90.0,), True),
        ((0.5,), (9.0,), False),
    ],
)
def test_a_vehicle_that_leaves_the_bend_slowly_is_no_queue(speeds, places, has_room):
    """Each follower stood until its predecessor was round the bend: 8 s each, where SUMO's own cars take 3 s."""
    line = Line(100.0, "m", "", 0, "road_0", "next_0", (":a_0",), 10.0)
    lines = StopLines(ROADS, SimpleNamespace())
    conflicts = SimpleNamespace(crossings=(crossed(":b_0"),), walks=(), waits=9.0, entering=())
    lines._conflicts = defaultdict(lambda: conflicts)
    names = [f"c{k}" for k in range(len(speeds))]
    speed, position = (dict(zip(names, values, strict=True)) for values in (speeds, places))
    on_lane, length = {":a_0": [], "next_0": names}, dict.fromkeys(names, 5.0)
    lane_length = {"next_0": 100.0}
    lines._now = SimpleNamespace(
        on_lane=on_lane, position=position, speed=speed, length=length, lane_length=lane_length
    )
    assert lines._has_room(line, Ego("m.0", "road_0", 0.0, CAR.length)) == has_room


@pytest.mark.parametrize(
    ("kind", "state", "speed", "long", "has_room"),
    [
        ("truck", "m", 1.5, True, True), ("truck", "m", 1.5, False, False), ("truck", "m", 0.0, True, False),
        ("truck", "M", 1.5, True, True), ("car", "w", 1.5, True, True), ("car", "M", 1.5, True, False),
    ],
)  # fmt: skip
def test_a_queue_that_moves_is_expected_to_move_on_where_others_come_in_first(kind, state, speed, long, has_room):
    """Behind one that crept past at 1.4 m/s a truck stood for 546 s, and a car for 77 s: SUMO's cars came in first."""
    line = Line(100.0, state, "", 0, "road_0", "next_0", (":a_0",), 20.0)
    lines = StopLines(ROADS, SimpleNamespace())
    conflicts = SimpleNamespace(crossings=(crossed(":b_0"),), walks=(), waits=9.0, entering=(("side_0", 0.0),))
    lines._conflicts = defaultdict(lambda: conflicts)
    lines._now = SimpleNamespace(
        on_lane={":a_0": [], ":b_0": [], "next_0": ["last", "first"]}, position={"last": 16.0, "first": 24.0},
        speed={"last": speed, "first": speed}, length={"last": 5.0, "first": 5.0}, lane_length={"next_0": 100.0},
    )  # fmt: skip
    lines._way = SimpleNamespace(
        watches_queues=lambda *_: long, members=frozenset(), pace=lambda *_: SimpleNamespace(time_for=lambda _: 8.0)
    )
    lines._now.position["last"] += VEHICLES[kind].length - VEHICLES["truck"].length  # each lacks as much room
    assert lines._has_room(line, Ego("m.0", "road_0", 0.0, VEHICLES[kind].length, kind=kind), 1.0) == has_room


def test_a_change_back_to_the_lane_before_has_been_made_on_that_lane():
    first = Line(60.0, CHANGING, "", 0, "road_0", "road_1", (), 20.0, 140.0)
    back = first._replace(station=90.0, lane="road_1", onto="road_0", to_end=110.0)
    route = SimpleNamespace(lines=[first, back])
    assert [_not_made(back, 40.0, lane, route) for lane in ("road_0", "road_1")] == [(back, 40.0)] * 2


@pytest.mark.parametrize(("lane", "found"), [("road_0", 0), ("road_1", 1), ("road_2", 1), (":a_0", 1)])
def test_of_two_changes_that_are_passed_the_one_from_the_own_lane_is_still_to_be_made(lane, found):
    """One that had driven past both went over two lanes without a look."""
    first = Line(60.0, CHANGING, "", 0, "road_0", "road_1", (), 20.0, 140.0)
    second = first._replace(station=90.0, lane="road_1", onto="road_2", to_end=110.0)
    before = Line(30.0, "M", "", 0, "road_0", "road_0", (), 5.0)  # of another edge, on a lane of the same name here
    route = SimpleNamespace(lines=[before, first, second])
    expected = ((first, 70.0), (second, 40.0))[found]
    assert _not_made(second, 40.0, lane, route) == expected
    lines, heeded = StopLines(ROADS, SimpleNamespace()), []
    lines._at_junction = {(line, "car"): line for line in (first, second)}
    lines._passed = lambda line, over, ego: heeded.append((line, over))
    lines._change.may_put_off = lambda *_, **__: False
    route.lines_about = lambda *_: (second, 40.0, [])
    lines._state(SimpleNamespace(route=route), 130.0, Ego("m.0", lane, 3.0, CAR.length), 0)
    assert heeded == [expected]


@pytest.mark.parametrize(("state", "via"), [("M", ()), (CHANGING, ("road_1",))])
def test_a_line_without_lanes_inside_leaves_a_member_where_sumo_takes_it_to_be(monkeypatch, state, via):
    """A line between two edges without a junction inside, or a lane change; SUMO has it inside a junction."""
    line, lines = (
        Line(100.0, state, "", 0, "road_0", "next_0", via, 20.0),
        StopLines(ROADS, SimpleNamespace()),
    )
    lines._now = SimpleNamespace(lane_length={}, position={})
    monkeypatch.setattr(RoomToChange, "may_change", lambda *_: np.inf)
    member = SimpleNamespace(route=SimpleNamespace(lines=[line], lines_about=lambda *_: (line, 2.0, [])))
    assert lines._state(member, 102.0, Ego("m.0", ":a_1", 3.0, CAR.length), 0).open


@pytest.mark.parametrize(
    ("front", "speed", "waits"),
    [(4.0, 0.0, True), (4.9, 0.0, True), (5.4, 0.0, True), (5.6, 0.0, False), (5.3, 0.9, True), (5.1, 2.0, False)],
)
def test_a_member_that_waits_midway_lets_those_pass_that_pass_closely_before_its_front(
    monkeypatch, front, speed, waits
):
    """Before its place in the junction, their path is near, but does not touch it before 5 m.

    One that stood a little too far on there, where a stream passed it for 22 s, drove on, and touched three of them.
    """
    line = Line(100.0, "m", "", 0, "road_0", "next_0", (":a_0", ":a_2"), 20.0)
    crossing = Crossing("side_0", (":a_1",), (3.0, 12.0), (4.0, 16.0), False, True, np.inf, 10.0, 5.0)
    client = SimpleNamespace(
        lane=SimpleNamespace(getMaxSpeed=lambda _: 10.0), vehicle=SimpleNamespace(getLength=lambda _: 5.0)
    )
    conflicts = Conflicts((), (crossing,), (), 6.0)
    way = RightOfWay(client, Reads(client), {line: conflicts})
    coming = [Approach("c", crossing, 4.0, Pace(8.0))]
    monkeypatch.setattr(RightOfWay, "_coming", lambda *_: coming)
    monkeypatch.setattr(RightOfWay, "_inside", lambda *_, first: [])
    monkeypatch.setattr(RightOfWay, "_waited", lambda *_: 0.0)
    ego = Ego("m.0", ":a_0", speed, CAR.length)
    assert way.may_cross(line, -front, ego, midway=True) == (not waits)


@pytest.mark.sumo
@pytest.mark.parametrize(
    ("turn", "kind", "swings"),
    [
        (30.0, "car", False),
        (90.0, "car", False),
        (120.0, "car", False),
        (160.0, "car", True),
        (30.0, "truck", False),
        (90.0, "truck", True),
    ],
)
def test_a_sharp_turn_on_the_inner_lane_waits_for_vehicles_that_its_front_would_swing_over(
    tmp_path, turn, kind, swings
):
    network = Network.read(corner(tmp_path, turn))
    libsumo.start(["sumo", "-n", str(network.path), "--no-step-log", "--no-warnings"])
    try:
        for lane, expected in ((0, [("wc_1", True)] if swings else []), (1, [])):
            *_, lines = network.route_lanes(("wc", "cx"), lane, position=20.0)
            crossings = Conflicts.at(lines[0]._replace(kind=kind), network, libsumo).crossings
            assert [(one.before, one.first) for one in crossings if one.swings] == expected
    finally:
        libsumo.close()


def test_the_body_of_a_car_of_sumos_cuts_the_bends_of_its_lane():
    """In a circle of 7 m by the sagitta of an arc as long as the car."""
    at = np.linspace(0.0, 2 * np.pi, 400)
    middles = conflicts._middles(Sampled(7.0 * at, 7.0 * np.column_stack([np.cos(at), np.sin(at)])), 5.0)
    assert np.hypot(*middles.points.T) == pytest.approx(7.0 * np.cos(2.5 / 7.0), abs=0.02)
    assert middles.stations[0] == pytest.approx(2.5, abs=0.1)


@pytest.mark.sumo
def test_a_sharp_turn_into_a_roundabout_waits_for_a_car_beside_whose_body_cuts_the_bend(tmp_path):
    """The lane beside stays farther from the corner of the member's front than the middle of a car's body comes."""
    pytest.importorskip("sumo", reason="netconvert comes with eclipse-sumo: pip install platoontraffic[gui]")
    network = Network.read(roundabouts(tmp_path, lanes=2, arms=7, count=1))
    libsumo.start(["sumo", "-n", str(network.path), "--no-step-log", "--no-warnings"])
    try:
        *_, lines = network.route_lanes(("i0.0", "c0.0"), 0, position=20.0)
        crossings = Conflicts.at(lines[0], network, libsumo).crossings
        assert [one.before for one in crossings if one.swings] == ["i0.0_1"]
    finally:
        libsumo.close()


@pytest.mark.parametrize(
    ("waited", "speed", "foe_at", "goes"),
    [
        (2.0, 0.8, 20.0, False),
        (6.0, 0.8, 20.0, True),
        (6.0, 0.0, 20.0, False),
        (6.0, 0.0, 200.0, True),
        (31.0, 0.0, 20.0, True),
    ],
)
def test_a_front_swings_out_after_a_stand_where_nobody_comes_and_once_it_has_begun(
    monkeypatch, waited, speed, foe_at, goes
):
    """SUMO's waiting time is 0 as soon as it moves: it drove one metre, and then stood for 5 s more."""
    line = Line(100.0, "m", "", 0, "road_0", "next_0", (":a_0",), 20.0)
    crossing = Crossing("side_0", (":a_1",), (3.0, 12.0), (4.0, 16.0), False, True, np.inf, 10.0, 3.0, swings=True)
    client = SimpleNamespace(
        lane=SimpleNamespace(getMaxSpeed=lambda _: 10.0),
        vehicle=SimpleNamespace(getLength=lambda _: 5.0, getWaitingTime=lambda _: 0.0),
    )
    conflicts = Conflicts((), (crossing,), (), np.inf, swings=True)
    way = RightOfWay(client, Reads(client), {line: conflicts})
    monkeypatch.setattr(RightOfWay, "_coming", lambda *_: [Approach("c", crossing, foe_at, Pace(8.0))])
    monkeypatch.setattr(RightOfWay, "_inside", lambda *_, first: [])
    monkeypatch.setattr(RightOfWay, "_waited", lambda *_: waited)
    assert way.may_cross(line, -0.5, Ego("m.0", ":a_0", speed, CAR.length)) == goes


@pytest.mark.parametrize(
    ("length", "kind"), [(4.0, "car"), (4.74, "car"), (5.5, "van"), (9.2, "truck"), (12.0, "truck")]
)
def test_a_member_is_judged_as_the_shortest_kind_of_vehicle_that_is_as_long(length, kind):
    law = SimpleNamespace(acceleration=1.5, lateral_acceleration=2.0)
    ego = Ego.of(SimpleNamespace(id="m", law=law, model=replace(CAR, length=length)))
    line = Line(100.0, "m", "", 0, "road_0", "next_0", (":a_0",), 20.0)
    assert tuple(StopLines(ROADS, None)._at_junction[line, ego.kind]) == line._replace(station=0.0, kind=kind)


@pytest.mark.parametrize(("kind", "acceleration"), [("car", 2.5), ("van", 2.5), ("truck", 1.45)])
def test_a_gap_is_judged_by_what_the_engine_has(kind, acceleration):
    """A truck merged before cars by the 2.5 m/s2 that its law wants."""
    ego = Ego.of(SimpleNamespace(id="m", law=PathLeader(), model=VEHICLES[kind], seen_ahead_of_gap=0.0))
    assert ego.acceleration == pytest.approx(acceleration, abs=0.01)


@pytest.mark.parametrize(
    ("law", "keeps"),
    [(PathLeader(), 2.59), (PathLeader(stand_off=4.0), 4.22), (TrackingFollower(), 3.22), (None, 4.0)],
)
def test_room_in_a_queue_is_judged_by_the_distance_that_a_law_keeps(law, keeps):
    """Half a length, or a distance from the laser, 3 cm behind the bumper, and 0.25 m; 4 m where a law names none."""
    ego = Ego.of(SimpleNamespace(id="m", law=law, model=VEHICLES["car"], seen_ahead_of_gap=0.03))
    assert ego.keeps == pytest.approx(keeps, abs=0.01)


@pytest.mark.sumo
def test_where_one_that_may_wait_midway_blocks_a_path(generated_nets):
    """Against shapely: where the strip about its line, as wide as its front, is half a lane from the own path."""
    network, seen = Network.read(generated(generated_nets, "grid", "priority", 2, "--lefthand")), 0
    libsumo.start(["sumo", "-n", str(network.path), "--no-step-log", "--no-warnings"])
    try:
        for lane in [name for name in libsumo.lane.getIDList() if name[:2] in ("B1", "C1")]:
            for link in [one for one in libsumo.lane.getLinks(lane) if one[LINK_VIA]]:
                line = Line(0.0, link[LINK_STATE], "", 0, lane, link[LINK_ONTO], (link[LINK_VIA],), 10.0)
                own = shapely.LineString(_path(line.via, line.onto, libsumo))
                for crossing in Conflicts.at(line, network, libsumo).crossings:
                    if crossing.waits == np.inf or crossing.merges or crossing.before == lane:
                        continue
                    seen += 1
                    onto = libsumo.lane.getLinks(crossing.via[-1])[0][LINK_ONTO]
                    its = shapely.LineString(_path(crossing.via, onto, libsumo))
                    near = its.buffer(CAR.width / 2, cap_style="flat").intersection(own.buffer(1.6, cap_style="flat"))
                    first = min(its.project(shapely.Point(xy)) for xy in shapely.get_coordinates(near))
                    assert abs(crossing.blocks - first) < 0.3
                    assert crossing.blocks > crossing.its[0]
    finally:
        libsumo.close()
    assert seen > 4


@pytest.mark.sumo
def test_a_sharp_turn_beside_a_footpath(generated_nets):
    """A run ended with a KeyError where the lane beside is one for people."""
    sidewalks = "--sidewalks.guess", "--crossings.guess", "--default.sidewalk-width=2"
    network = Network.read(generated(generated_nets, "spider", "priority", 2, *sidewalks))
    libsumo.start(["sumo", "-n", str(network.path), "--no-step-log", "--no-warnings"])
    try:
        lanes = [name for name in libsumo.lane.getIDList() if name[0] != ":" and "_0" not in name]
        lines = [
            Line(0.0, link[LINK_STATE], "", 0, name, link[LINK_ONTO], (link[LINK_VIA],), 10.0)
            for name in lanes for link in libsumo.lane.getLinks(name) if link[LINK_VIA]
        ]  # fmt: skip
        assert any(Conflicts.at(line, network, libsumo).walks for line in lines)
    finally:
        libsumo.close()


@pytest.mark.parametrize("asked", [True, False])
def test_the_line_of_a_member_that_is_asked_to_let_another_one_in_is_closed(monkeypatch, asked):
    line = Line(0.0, "M", "", 0, "road_0", "next_0", (":a_0",), 10.0)
    lines = StopLines(ROADS, SimpleNamespace())
    lines._conflicts = defaultdict(lambda: Conflicts((), (), (), np.inf))
    monkeypatch.setattr(RightOfWay, "is_asked", lambda *given: asked and given[1:] == ("m.0", "road_0"))
    monkeypatch.setattr(RightOfWay, "stop_before_foes", lambda *_: np.inf)
    monkeypatch.setattr(RightOfWay, "note_waiting", lambda *_: None)
    monkeypatch.setattr(StopLines, "_has_room", lambda *_: True)
    assert lines._ahead(line, 3.0, True, Ego("m.0", "road_0", 2.0, CAR.length), None).open == (not asked)


def test_a_member_that_lets_another_one_in_is_given_its_line(monkeypatch):
    law, model = SimpleNamespace(needs={"signals"}, heeds_lines=True), CAR
    members = tuple(SimpleNamespace(id=f"m.{k}", law=law, model=model, route=None) for k in (0, 1))
    fleet = Members(
        members=members, ids=("m.0", "m.1", "native"), progress=SimpleNamespace(rows=np.arange(2), station=np.zeros(2)),
        model=SimpleNamespace(length=np.full(2, 5.0), axle=np.zeros(2)),
        motion=SimpleNamespace(speed=np.full(2, 2.0), acceleration=np.zeros(2)), goes_round=np.zeros(2, bool),
    )  # fmt: skip
    client = SimpleNamespace(
        vehicle=SimpleNamespace(getLanePosition=lambda _: 30.0), simulation=SimpleNamespace(getTime=lambda: 0.0)
    )
    monkeypatch.setattr(LaneChoice, "look", lambda *_: None)
    letting_in = SimpleNamespace(stops={"m.1": Stop("road_0", 36.0)}, waiting={})
    lines = StopLines(ROADS, client, letting_in)
    monkeypatch.setattr(StopLines, "_state", lambda *_: NO_LINE)
    signals = lines.signals(fleet, ["road_0", "road_0"])
    assert lines._way.obedient == {"m.0", "m.1"}
    assert lines.heedless == {"native"}
    assert signals.open.tolist() == [True, False, True]
    assert signals.distance[1] == pytest.approx(6.0)


def test_a_gap_of_a_member_that_goes_round_a_body_is_judged_by_its_speed_there(monkeypatch):
    """At 2 m/s it took 12 s through a junction, with a gap for 4 s, and a car that had come touched it."""

    law, limits = SimpleNamespace(needs={"signals"}, heeds_lines=True), np.array([12.0, 2.0, 12.0])
    route = Route.along(("road",), np.array([[0.0, 0.0], [20.0, 0.0], [40.0, 0.0]]), limits)
    members = tuple(SimpleNamespace(id=f"m.{k}", law=law, model=CAR, route=route) for k in (0, 1))
    fleet = Members(
        members=members, ids=("m.0", "m.1"),
        progress=SimpleNamespace(rows=np.arange(2), station=np.full(2, 39.0)),  # of the axle; the front is beyond 40 m
        model=SimpleNamespace(length=np.full(2, 5.0), axle=np.zeros(2)),
        motion=SimpleNamespace(speed=np.full(2, 2.0), acceleration=np.zeros(2)), goes_round=np.array([False, True]),
    )  # fmt: skip
    egos = []
    monkeypatch.setattr(StopLines, "_state", lambda _, __, ___, ego, ____: egos.append(ego) or NO_LINE)
    monkeypatch.setattr(LaneChoice, "look", lambda *_: None)
    client = SimpleNamespace(simulation=SimpleNamespace(getTime=lambda: 0.0))
    StopLines(ROADS, client).signals(fleet, ["road_0"] * len(fleet.ids))
    free, beside = (ego.profile().time_for(20.0) for ego in egos)
    assert (free < 6.0, beside) == (True, pytest.approx(10.0, rel=0.01))


@pytest.mark.parametrize("step", [0.1, 0.2])
def test_nothing_is_left_of_a_look_once_the_last_member_that_heeds_lines_has_left(step):
    """Vehicles waited for a member that was removed: one beside it for its lane change, one midway in a junction.

    Also between two looks.
    """
    client = SimpleNamespace(simulation=SimpleNamespace(getTime=lambda: 0.1))
    lines = StopLines(ROADS, client, step=step)
    gone = SimpleNamespace(id="gone", law=SimpleNamespace(needs=frozenset()), model=None, route=None)
    lines._fleet, lines._rows, lines._asking = (gone,), np.zeros(1, int), [SimpleNamespace(id="gone", size=1.0)]
    lines._change.wanted["gone"], lines._way.stops["bus"] = Wanted("road_1", 5.0, False), 3.0
    lines.over_line["gone"] = 0.2
    assert lines.signals(NOBODY, []) is None
    assert not {**lines.room_wanted, **lines.waiting_places, **lines.over_line}


@pytest.mark.sumo
def test_links_ahead_of_foes_are_those_that_sumo_judges():
    seen = []
    with Simulation.load("grid_platoons", "sumo.warm_up_s=100") as simulation:
        for _ in islice(simulation, 0, 150, 10):
            reads = Reads(simulation.sumo)
            way = RightOfWay(simulation.sumo, reads, {})
            for name in simulation.sumo.vehicle.getIDList():
                links = simulation.sumo.vehicle.getNextLinks(name)[:3]
                expected = [link[LINK_VIA] for link in links], links[0][LINK_STATE] if links else ""
                inside, state = way._links_ahead(name, simulation.sumo.vehicle.getLaneID(name))
                assert ([*inside], state) == expected
                seen.append(name not in reads.next_links)
    assert sum(seen) > 50  # for so many it did not need to be judged


@pytest.mark.parametrize(
    ("waits", "before"),
    [(25.0, ["near", "none"]), (8.0, ["near"]), (np.inf, ["near", "far", "none", "beyond"])],
)
def test_in_a_large_junction_it_waits_before_the_first_path_that_it_touches(waits, before):
    """It stood at the line for a cycle: SUMO's place midway was 25 m beyond that, paths were touched from 20 m on."""
    way = object.__new__(RightOfWay)
    way._conflicts = {"line": SimpleNamespace(waits=waits)}
    # Where their paths meet the own one, and where its front touches them [m].
    places = {"near": (4.0, 6.0), "far": (18.0, 20.0), "none": (9.0, np.inf), "beyond": (30.0, 32.0)}
    foes = [
        SimpleNamespace(id=name, crossing=SimpleNamespace(own=(own, own + 5.0), touches=touches))
        for name, (own, touches) in places.items()
    ]
    met = way._met("line", foes, 0.0, False, 5.0)
    assert [foe.id for foe in met] == before
    assert {foe.id for foe in way._met("line", foes, 0.0, True, 5.0)} == set(places)


def test_vehicles_that_are_to_stop_have_less_room_after_a_step_and_those_that_have_left_need_none():
    speeds = {"comes": 8.0, "stands": 0.0}
    client = SimpleNamespace(vehicle=SimpleNamespace(getSpeed=speeds.__getitem__), TraCIException=KeyError)
    way = RightOfWay(client, Reads(client), {})
    way.stops.update(comes=20.0, stands=3.0, gone=5.0)
    way.follow_stops(0.1)
    assert way.stops == {"comes": pytest.approx(19.2), "stands": 3.0}
