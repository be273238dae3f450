"""A vehicle of SUMO's lets a member in that waits for room on its lane."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from platoontraffic.controllers.law import Body, Sensed, Signals
from platoontraffic.controllers.path import PathLeader
from platoontraffic.sumo import letting_in
from platoontraffic.sumo.client import libsumo as sumo
from platoontraffic.sumo.ego import Ego
from platoontraffic.sumo.letting_in import (
    AFTER,
    BRAKING,
    FORGOTTEN,
    GIVEN_UP,
    GOES_OVER,
    LONGEST,
    OWN_DRIVER,
    SPARE,
    LettingIn,
    Patience,
)
from platoontraffic.sumo.room_to_change import Wanted
from platoontraffic.sumo.stoplines import LineState, StopLines
from tests.support.generated import crossroads

pytestmark = pytest.mark.sumo

STEP, FRONT, BEHIND = 0.1, 100.0, 3.0  # front bumper of the member, and the distance that vehicles keep behind it [m]
MEMBER = {"member": ("wc", "wc_0")}


@pytest.fixture
def column(tmp_path):
    """Cars on the lane beside a member that stands: their fronts [m] and speeds [m/s] in every step, (steps, cars)."""
    net = crossroads(tmp_path)

    def run(starts, seconds, *, begins=np.inf, gives_up=np.inf, urgent=False, where=MEMBER, held=frozenset(), jam=0.0):
        sumo.start(["sumo", "-n", str(net), "--step-length", str(STEP), "--no-step-log", "--no-warnings",
                    "--time-to-teleport", "-1"])  # fmt: skip
        try:
            sumo.route.add("on", ["wc", "ce"])
            sumo.trafficlight.setPhase("c", 2)
            sumo.vehicle.add("member", "on", departLane="0", departPos=str(FRONT))
            for k, start in enumerate(starts):
                sumo.vehicle.add(f"c{k}", "on", departLane="1", departPos=str(start), departSpeed="10")
                sumo.vehicle.setLaneChangeMode(f"c{k}", 0)
            sumo.simulationStep()
            sumo.vehicle.setSpeed("member", 0.0)
            sumo.vehicle.moveTo("member", "wc_0", FRONT)
            letting_in, seen = LettingIn(sumo, STEP), []
            for k in range(round(seconds / STEP)):
                if jam:  # the first one stands until then
                    sumo.vehicle.setSpeed("c0", 0.0 if k * STEP < jam else -1)
                begun = k * STEP >= begins
                wanted = {"member": Wanted("wc_1", BEHIND - SPARE, begun, urgent)} if k * STEP < gives_up else {}
                letting_in.observe(wanted, where, held)
                sumo.simulationStep()
                cars = [f"c{n}" for n in range(len(starts))]
                here = [sumo.vehicle.getPosition(car)[0] - sumo.vehicle.getPosition("member")[0] for car in cars]
                seen.append((np.add(here, FRONT), [sumo.vehicle.getSpeed(car) for car in cars]))
            return tuple(np.array(column) for column in zip(*seen, strict=True))
        finally:
            sumo.close()

    return run


def test_the_first_one_that_can_stop_behind_its_front_does_so_in_comfort(column):
    """The first one comes past before the member has stood for long enough."""
    place, speed = column([60.0, 22.0, 6.0], 15.0)
    assert place[-1][0] > FRONT + 50.0
    assert FRONT - 6.0 < place[-1][1] <= FRONT - BEHIND + 0.01
    assert speed[-1][1:] == pytest.approx([0.0, 0.0], abs=0.01)
    assert place[-1][2] < place[-1][1] - 5.0
    assert (np.diff(speed, axis=0) / STEP).min() > -BRAKING - 0.3


def test_it_stops_at_once_where_the_lane_of_the_member_ends_soon(column):
    """SUMO's drivers do so for each other; members came to a stand first."""
    place, speed = column([60.0, 22.0], 15.0, urgent=True)
    assert FRONT - 6.0 < place[-1][0] <= FRONT - BEHIND + 0.01
    assert speed[-1] == pytest.approx([0.0, 0.0], abs=0.05)
    assert (np.diff(speed[:, 0]) / STEP).min() > -BRAKING - 0.3


def test_it_waits_until_the_member_that_has_begun_is_over_but_not_for_ever(column):
    begins = AFTER + LONGEST - 2.0
    _, speed = column([20.0], begins + GOES_OVER + 2.0, begins=begins)
    time = np.arange(1, len(speed) + 1) * STEP
    assert speed[(time > begins - 1.0) & (time < begins + GOES_OVER - STEP)].max() < 0.1
    assert speed[-1] > 3.0


def test_it_drives_on_when_the_member_has_given_up(column):
    gives_up = AFTER + 8.0
    _, speed = column([20.0], gives_up + GIVEN_UP + 2.0, gives_up=gives_up)
    assert speed[round(gives_up / STEP)] < 0.1
    assert speed[-1] > 3.0


def test_it_does_not_wait_for_a_member_on_its_lane(column):
    """There SUMO's driver sees it."""
    _, speed = column([20.0], 8.0, where={"member": ("wc", "wc_1")})
    assert speed.min() > 8.0


def test_it_waits_once_and_not_for_ever(column):
    _, speed = column([20.0], AFTER + LONGEST + 3.0)
    assert speed[round((AFTER + LONGEST - 1.0) / STEP)] < 0.1
    assert speed[-1] > 4.0


@pytest.mark.parametrize("begins", [np.inf, AFTER + 5.0])
def test_it_is_still_there_when_the_queue_before_it_moves_on(column, begins):
    """In Bologna each car of a queue that stood gave up after 20 s, and one kept its lane closed for minutes; and one
    that had begun to go over stood across both lanes for ever, each after 30 s.
    """
    jam = 3 * LONGEST
    place, speed = column([FRONT - 1.0, 20.0], jam + LONGEST + 5.0, jam=jam, begins=begins)
    moves_on, later = round((jam + 5.0) / STEP), round((jam + LONGEST - 5.0) / STEP)
    assert place[moves_on, 0] > FRONT + 10.0  # there is room now
    assert speed[later, 1] < 0.1
    assert place[later, 1] < FRONT
    assert (speed[-1, 1] > 2.0) == (begins == np.inf)  # but not for ever; for one that has begun, GOES_OVER


@pytest.mark.parametrize("state", ["r", "G"])
@pytest.mark.parametrize(("to_light", "is_close"), [(9.0, True), (15.0, False)])
def test_time_at_a_red_light_close_ahead_leaves_its_patience_alone(state, to_light, is_close):
    """A member stood half over at a light; the car that let it in drove up beside it after 30 s, and against it later.

    At 15 m there is room for it to drive on by a car's length.
    """
    now, seconds = SimpleNamespace(time=100.0), GOES_OVER + 10.0
    client = two_members(FRONT - 8.0, now)
    client.vehicle.getNextTLS = {"polite": (("c", 1, to_light, state),)}.get
    letting_in = LettingIn(client, STEP)
    for _ in range(round(seconds / STEP)):
        now.time += STEP
        letting_in.observe({"member": Wanted("wc_1", BEHIND - SPARE, True)}, WHERE)
    assert bool(letting_in.waiting) == (is_close and state == "r")


@pytest.mark.parametrize("begins", [np.inf, AFTER + 5.0])
def test_it_does_not_wait_for_ever_behind_one_that_has_broken_down(column, monkeypatch, begins):
    monkeypatch.setattr(letting_in, "Patience", partial(Patience, in_queue=50.0))
    asked = []
    monkeypatch.setattr(LettingIn, "_hold", lambda self, foe, *_: asked.append(self._sumo.simulation.getTime()))
    column([FRONT - 5.0, 20.0], 120.0, jam=120.0, begins=begins)
    longest = 50.0 + (begins - AFTER + GOES_OVER if begins < np.inf else LONGEST)  # it drives up to the queue at first
    assert 50.0 < max(asked) - min(asked) < longest + 1.0


def test_obstacles_are_left_alone(column):
    _, speed = column([20.0], 8.0, held={"c0"})
    assert speed.min() > 8.0


WHERE = {"member": ("wc", "wc_0"), "polite": ("wc", "wc_1")}


def two_members(polite: float, now: SimpleNamespace) -> SimpleNamespace:
    """SUMO with two members that stand.

    polite: place of the front of the one that lets the other one in [m]
    now   : its `time` [s]
    """
    place = {"member": FRONT, "polite": polite}
    return SimpleNamespace(
        TraCIException=ValueError,
        simulation=SimpleNamespace(getTime=lambda: now.time),
        lane=SimpleNamespace(getLength=lambda _: 200.0, getLastStepVehicleIDs=lambda _: ["polite"]),
        vehicle=SimpleNamespace(
            getWaitingTime=lambda _: AFTER, getSpeed=lambda _: 0.0, getLength=lambda _: 5.0,
            getLanePosition=place.__getitem__, getRoadID=lambda _: "wc", getNextTLS=lambda _: (),
        ),
    )  # fmt: skip


def test_one_that_could_not_stop_and_has_gone_past_lets_nobody_in_any_more():
    """On a motorway one stood 21 m ahead of the member for 20 s, and the others behind it."""
    client = two_members(20.0, SimpleNamespace(time=100.0))
    letting_in, wanted = LettingIn(client, STEP), {"member": Wanted("wc_1", BEHIND - SPARE, False)}
    for place, waits in ((20.0, True), (FRONT + 0.9, True), (FRONT + 1.1, False), (FRONT + 1.1, False)):
        client.vehicle.getLanePosition = {"member": FRONT, "polite": place}.__getitem__
        letting_in.observe(wanted, WHERE)
        assert ("polite" in letting_in.stops) == waits
        assert letting_in.waiting == ({"member": "polite"} if waits else {})


@pytest.mark.parametrize(("start", "stops_at"), [(20.0, FRONT - 5.0), (FRONT - 4.5, FRONT - BEHIND)])
def test_a_member_is_given_a_line_to_stop_at(start, stops_at):
    """Behind the other one's rear, or nearer where it is farther already."""
    client = two_members(start, SimpleNamespace(time=100.0))
    letting_in = LettingIn(client, STEP)
    wanted = {"member": Wanted("wc_1", BEHIND - SPARE, False)}
    letting_in.observe(wanted, WHERE, {"polite"})
    assert not letting_in.stops
    letting_in.observe(wanted, WHERE)
    assert letting_in.stops == {"polite": ("wc_1", pytest.approx(stops_at), 0.0)}
    lines = StopLines(None, client, letting_in)
    far, near, red = (
        LineState(80.0, True, False, False, 0), LineState(50.0, False, False, False, 1),
        LineState(0.0, False, False, False, 1),
    )  # fmt: skip
    ego = Ego("polite", "wc_1", 0.0, 5.0)
    for state in (far, near):
        told = lines._letting_in(state, ego)
        assert not told.open
        assert told.distance == pytest.approx(min(stops_at - start, 50.0 if state is near else np.inf))
    assert lines._letting_in(red, ego) is red
    assert lines._letting_in(far, ego._replace(lane="wc_0")) is far


@pytest.mark.parametrize(
    ("places", "waits"),
    [
        ({"polite": ("p", 1)}, False),
        ({"polite": ("p", 1), "member": ("q", 0)}, False),
        ({"polite": ("p", 1), "member": ("p", 2)}, False),
        ({"polite": ("p", 2), "member": ("p", 0)}, True),
        ({"polite": ("p", 0), "member": ("q", 1)}, True),
    ],
)
def test_a_follower_lets_in_nobody_but_those_before_it_in_its_platoon(places, waits):
    """A leader stood for 128 s beside its followers, which drove past it on the lane to which it was to change."""
    letting_in = LettingIn(two_members(20.0, SimpleNamespace(time=100.0)), STEP)
    letting_in.observe({"member": Wanted("wc_1", BEHIND - SPARE, False)}, WHERE, frozenset(), places)
    assert letting_in.waiting == ({"member": "polite"} if waits else {})


def test_nobody_waits_for_a_member_that_is_gone_or_off_the_road(column):
    for where in ({}, {"member": ("", "")}, {"member": (":c_0", ":c_0_0")}):
        _, speed = column([20.0], 8.0, where=where)
        assert speed.min() > 8.0


@pytest.mark.parametrize(("speed", "ahead", "drives"), [(0.0, 2.0, False), (1.0, 2.0, True), (0.0, 6.0, True)])
def test_a_vehicle_that_stands_does_not_follow_the_member_until_it_is_abreast(speed, ahead, drives):
    """It may stop 1 m behind the front, and stands 2 m behind it; far behind the member's rear it drives up."""
    speeds: list[float] = []
    vehicle = SimpleNamespace(
        getPosition=lambda name: (FRONT + ahead if name == "member" else FRONT, 0.0), getAngle=lambda _: 90.0,
        getLaneID=lambda _: "road_1", getSpeed=lambda _: speed, getLength=lambda _: 5.0,
        setSpeed=lambda _, value: speeds.append(value),
    )  # fmt: skip
    LettingIn(SimpleNamespace(vehicle=vehicle), STEP)._hold("foe", "member", Wanted("road_1", 1.0, False), {})
    assert (abs(speeds[0]) > 1e-9) == drives


@pytest.mark.parametrize("ahead", [4.0, 12.0, 40.0])
def test_for_a_member_that_drives_on_it_falls_back_to_the_room_that_is_wanted_and_does_not_stop(ahead):
    """The member keeps 20 m/s, the other one would drive 25 m/s."""
    own, behind, place, speed, said = 20.0, 15.0, {"foe": 0.0, "member": ahead}, {"foe": 20.0, "member": 20.0}, []
    vehicle = SimpleNamespace(
        getPosition=lambda name: (place[name], 0.0), getAngle=lambda _: 90.0, getSpeed=speed.__getitem__,
        getLaneID=lambda _: "road_1", getLength=lambda _: 5.0, setSpeed=lambda _, value: said.append(value),
    )  # fmt: skip
    letting_in, speeds = LettingIn(SimpleNamespace(vehicle=vehicle), STEP), [speed["foe"]]
    for _ in range(round(60.0 / STEP)):
        letting_in._hold("foe", "member", Wanted("road_1", behind, False, True, own), {})
        speed["foe"] = min(25.0, speed["foe"] + 2.0 * STEP) if said[-1] == OWN_DRIVER else said[-1]
        for name in place:
            place[name] += speed[name] * STEP
        speeds.append(speed["foe"])
    assert place["member"] - place["foe"] == pytest.approx(behind + own * STEP, abs=0.1)  # it looks a step ahead
    assert speeds[-1] == pytest.approx(own, abs=0.3)
    assert min(speeds) > 8.0
    assert min(np.diff(speeds)) / STEP > -BRAKING - 0.01


@pytest.mark.parametrize(("ahead", "slows"), [(16.0, 0.0), (30.0, 0.0), (16.0, 6.0)])
def test_a_member_that_lets_one_in_which_drives_on_follows_it(ahead, slows):
    """As the law `path` drives before the line that it is given; the other one has 20 m/s, or brakes hard to 10 m/s."""
    place, speed = {"foe": 0.0, "member": ahead}, {"foe": 20.0, "member": 20.0}
    vehicle = SimpleNamespace(
        getLanePosition=place.__getitem__, getSpeed=speed.__getitem__, getLength=lambda _: 4.74,
    )  # fmt: skip
    client = SimpleNamespace(vehicle=vehicle, lane=SimpleNamespace(getLength=lambda _: 1e5))
    law, behind, where = PathLeader(), 15.0, {"member": ("road", "road_0"), "foe": ("road", "road_1")}
    gaps, braking = [], []
    for _ in range(round(40.0 / STEP)):
        speed["member"] = max(speed["member"] - slows * STEP, 10.0 if slows else 20.0)
        wanted = Wanted("road_1", behind, False, True, speed["member"])
        stop = LettingIn(client, STEP)._stop("foe", "member", wanted, where)
        ego = Ego("foe", "road_1", speed["foe"], 4.74)
        far = ego.line_to_follow(stop.speed, stop.place - place["foe"], BRAKING)
        signals = Signals(*(np.array([value]) for value in (far, False, False, False, 0)))
        body = Body(*(np.array([x]) for x in (4.74, 1.76, -1.27, 4.3, 0.15, 0.1, 0.2, 0.2, 9.0)))
        sensed = Sensed(None, np.array([speed["foe"]]), np.zeros(1), body, signals=signals)
        braking.append(float(law.acceleration_for_lines(sensed, np.zeros(1))[0]))
        speed["foe"] += min(braking[-1], 1.0 if speed["foe"] < 25.0 else 0.0) * STEP
        for name in place:
            place[name] += speed[name] * STEP
        gaps.append(place["member"] - place["foe"])
    assert gaps[-1] == pytest.approx(behind, abs=1.0)
    assert speed["foe"] == pytest.approx(speed["member"], abs=0.5)
    assert min(gaps) > 0.5 * behind
    assert min(braking) > -BRAKING - 0.5


def test_a_member_that_drives_on_is_let_in_by_a_vehicle_behind_it():
    """The slow one ahead could stop behind where it could, too."""
    place, speed = {"member": 300.0, "ahead": 350.0, "behind": 265.0}, {"member": 25.0, "ahead": 10.0, "behind": 20.0}
    vehicle = SimpleNamespace(getLanePosition=place.__getitem__, getSpeed=speed.__getitem__, getLength=lambda _: 5.0)
    lane = SimpleNamespace(getLength=lambda _: 1e3, getLastStepVehicleIDs=lambda _: ["behind", "ahead"])
    wish = letting_in.Wish(Wanted("road_1", 17.5, False, True, 25.0), 0.0)
    where = {"member": ("road", "road_0")}
    found = LettingIn(SimpleNamespace(vehicle=vehicle, lane=lane), STEP)._first(
        "member", wish, where, lambda foe, name: False
    )
    assert found == "behind"


def before_the_junction(before: dict[str, str], crossed=(), unregulated=frozenset()) -> LettingIn:
    """A member stands at 2 m on a lane of 20 m; on the lane before that beside it a vehicle, 7 m before its end.

    before: the only lane before each lane
    """
    length = {"on_0": 20.0, "on_1": 20.0, ":n_0_1": 3.0, "in_1": 50.0}
    place = {"member": 2.0, "ahead": 10.0, "foe": 46.0}
    on_lane = {"on_1": ["ahead"], ":n_0_1": [], "in_1": ["foe"]}
    client = SimpleNamespace(
        vehicle=SimpleNamespace(
            getLanePosition=place.get, getSpeed=lambda _: 0.0, getLength=lambda _: 5.0, getNextTLS=lambda _: ()
        ),
        lane=SimpleNamespace(
            getLength=length.get, getLastStepVehicleIDs=on_lane.get, getInternalFoes={":n_0_1": crossed}.get
        ),
    )
    network = SimpleNamespace(only_before=lambda one: before.get(one, ""), unregulated=unregulated)
    return LettingIn(client, STEP, network)


AHEAD_AND_BEFORE = {"on_1": ":n_0_1", ":n_0_1": "in_1"}
ON_TWO_EDGES = {"member": ("on", "on_0"), "foe": ("in", "in_1")}
WISH = letting_in.Wish(Wanted("on_1", 8.0, False, True), 0.0)


def test_where_the_lane_has_just_begun_a_vehicle_on_the_lane_before_lets_it_in():
    """In a city a member stood for five minutes on a lane of 20 m: the queue beside it came from the lane before."""
    asked = before_the_junction(AHEAD_AND_BEFORE)
    assert asked._first("member", WISH, ON_TWO_EDGES, lambda foe, name: False) == "foe"
    assert asked._stop("foe", "member", WISH.wanted, ON_TWO_EDGES) == ("in_1", 2.0 - 8.0 + 53.0, 0.0)
    assert not asked._is_in_queue("foe", "member", "on_1")  # there is room behind the one ahead


@pytest.mark.parametrize(
    "given",
    [{"crossed": (":n_3_0",)}, {"unregulated": {":n_0_1"}}, {"before": {"on_1": "in_1"}}, {"before": {}}],
)
def test_nobody_lets_in_from_where_others_cross_its_path(given):
    asked = before_the_junction(**{"before": AHEAD_AND_BEFORE, **given})
    assert asked._first("member", WISH, ON_TWO_EDGES, lambda foe, name: False) is None


def test_on_a_ring_a_lane_is_not_before_itself():
    asked = before_the_junction({**AHEAD_AND_BEFORE, "in_1": ":n_0_1"})
    assert asked._lanes_to["on_1"] == {"on_1": 0.0, ":n_0_1": -3.0, "in_1": -53.0}
    ring = before_the_junction({"on_1": ":n_0_1", ":n_0_1": "on_1"})
    assert ring._lanes_to["on_1"] == {"on_1": 0.0, ":n_0_1": -3.0}


def test_a_member_keeps_its_stop_while_the_one_that_it_lets_in_is_off_the_road_to_sumo():
    """As a car on a lane for buses: the run ended there."""
    vehicle = SimpleNamespace(
        getLanePosition={"member": 50.0, "foe": 20.0}.get, getLength=lambda _: 5.0, getSpeed=lambda _: 0.0,
        getWaitingTime=lambda _: 10.0, getRoadID=lambda _: "wc", getNextTLS=lambda _: (),
    )  # fmt: skip
    beside = {"wc_1": ("foe",)}

    def length(lane: str) -> float:
        return {"wc_0": 100.0, "wc_1": 100.0}[lane]

    client = SimpleNamespace(
        vehicle=vehicle, simulation=SimpleNamespace(getTime=lambda: 1.0), TraCIException=KeyError,
        lane=SimpleNamespace(getLength=length, getLastStepVehicleIDs=beside.get),
    )  # fmt: skip
    letting_in, wanted = LettingIn(client, STEP), {"member": Wanted("wc_1", -20.0, False, True)}
    where = {"member": ("wc", "wc_0"), "foe": ("wc", "wc_1")}
    letting_in.observe(wanted, where)
    stop = letting_in.stops["foe"]
    letting_in.observe(wanted, where | {"member": ("", "")})
    assert letting_in.stops == {"foe": stop}


def test_one_that_has_waited_for_a_while_waits_again_but_not_for_longer_in_all():
    """A member that looked for room farther on was not let in by those that had stopped for it before."""
    wishes = repeated(Wanted("wc_1", BEHIND - SPARE, False), 8.0, 5.0)
    waited = waited_for(wishes, 4 * LONGEST)
    time = np.arange(len(waited)) * STEP
    expected = (time // 8.0) * (5.0 + GIVEN_UP) + np.minimum(time % 8.0, 5.0 + GIVEN_UP)
    assert waited[time < 16.0] == pytest.approx(expected[time < 16.0], abs=0.4)
    assert waited[-1] == pytest.approx(LONGEST, abs=1.0)


def test_it_does_not_wait_for_longer_in_all_for_one_that_begins_again_and_again():
    """Each new wish after the lane change had begun was waited for anew, for 538 of 600 s."""
    begins = repeated(Wanted("wc_1", BEHIND - SPARE, False), 20.0, 12.0)
    goes_over = repeated(Wanted("wc_1", BEHIND - SPARE, True), 20.0, 17.0)
    waited = waited_for(lambda time: begins(time) or goes_over(time), 600.0)
    assert waited[-1] == pytest.approx(LONGEST + GOES_OVER, abs=2.0)


def test_it_waits_anew_for_one_that_has_long_wanted_nothing():
    wishes = repeated(Wanted("wc_1", BEHIND - SPARE, False), FORGOTTEN + 40.0, 30.0)
    assert waited_for(wishes, 2 * FORGOTTEN + 80.0)[-1] == pytest.approx(2 * LONGEST, abs=1.0)


def test_one_that_then_wants_another_lane_is_let_in_there():
    """The vehicle behind it was held on."""
    now = SimpleNamespace(time=100.0)
    client = two_members(20.0, now)
    client.lane.getLastStepVehicleIDs = {"wc_1": ("polite",), "wc_2": ("third",)}.get
    place = client.vehicle.getLanePosition
    client.vehicle.getLanePosition = lambda name: 10.0 if name == "third" else place(name)
    letting_in, where = LettingIn(client, STEP), WHERE | {"third": ("wc", "wc_2")}
    letting_in.observe({"member": Wanted("wc_1", 2.0, True)}, where)
    assert letting_in.waiting == {"member": "polite"}
    for _ in range(2):
        letting_in.observe({"member": Wanted("wc_2", 2.0, False)}, where | {"member": ("wc", "wc_1")})
        assert letting_in.waiting == {"member": "third"}
        assert letting_in.stops.keys() == {"third"}


def test_a_member_that_is_gone_is_let_in_no_longer():
    """A run with `stuck = "remove"` ended there, since it was asked how long it is."""
    client = two_members(20.0, SimpleNamespace(time=100.0))
    letting_in = LettingIn(client, STEP)
    letting_in.observe({"member": Wanted("wc_1", BEHIND - SPARE, False)}, WHERE)
    assert letting_in.waiting

    def asked(name: str) -> str:
        if name == "member":
            raise ValueError("not known")
        return "wc"

    client.vehicle.getRoadID = client.vehicle.getLength = asked
    client.lane.getLastStepVehicleIDs = lambda _: ["polite", "stands"]
    letting_in.observe({}, {"polite": WHERE["polite"]})
    assert not letting_in.waiting


def test_a_vehicle_that_is_told_its_speed_elsewhere_lets_nobody_in_any_more():
    letting_in = LettingIn(two_members(20.0, SimpleNamespace(time=100.0)), STEP)
    wanted = {"member": Wanted("wc_1", BEHIND - SPARE, False)}
    letting_in.observe(wanted, WHERE)
    assert letting_in.waiting
    letting_in.observe(wanted, WHERE, {"polite"})
    assert not letting_in.waiting


def repeated(wanted: Wanted, period: float, lasts: float) -> Callable[[float], dict[str, Wanted]]:
    """A member's wish at a time since the begin [s]: for `lasts` at the begin of each period [s]."""
    return lambda time: {"member": wanted} if time % period < lasts else {}


def waited_for(wishes: Callable[[float], dict[str, Wanted]], seconds: float) -> np.ndarray:
    """How long the other member has waited, after each step [s]."""
    now = SimpleNamespace(time=100.0)
    letting_in, waits = LettingIn(two_members(20.0, now), STEP), []
    for k in range(round(seconds / STEP)):
        letting_in.observe(wishes(k * STEP), WHERE)
        waits.append(STEP * bool(letting_in.waiting))
        now.time += STEP
    return np.cumsum(waits)


class Refused(Exception):
    """As SUMO's for a lane or vehicle that it does not know."""


@pytest.fixture
def held():
    """The speeds given to a car 5 m before a junction, which was to let a member in on the edge beyond."""

    def speed_given(lane: str) -> list[float]:
        given, places = [], {"member": 2.0, "car": 25.0}

        def length(name: str) -> float:
            if not name:
                raise Refused
            return 5.0 if name[0] == ":" else 30.0

        vehicle = SimpleNamespace(
            getRoadID=lambda _: "e", getLaneID=lambda _: "d_1", getNextTLS=lambda _: [], getLength=lambda _: 4.5,
            getLanePosition=places.get, getSpeed=lambda _: 6.0, setSpeed=lambda _, speed: given.append(speed),
            getPosition={"member": (37.0, 0.0), "car": (25.0, 0.0)}.get, getAngle=lambda _: 90.0,
        )  # fmt: skip
        lanes = SimpleNamespace(getLength=length, getLastStepVehicleIDs=lambda _: [], getInternalFoes=lambda _: [])
        clock = SimpleNamespace(getTime=lambda: 5.0)
        of_sumo = SimpleNamespace(vehicle=vehicle, lane=lanes, simulation=clock, TraCIException=Refused)
        network = SimpleNamespace(only_before={"e_1": ":d_0_0", ":d_0_0": "d_1"}.get, unregulated=())
        room, one = Wanted("e_1", 5.0, False), LettingIn(of_sumo, STEP, network)
        one._wishes["member"], one.waiting["member"] = letting_in.Wish(room, 5.0), "car"
        one.observe({"member": room}, {"member": (lane.rpartition("_")[0], lane)})
        return given

    return speed_given


def test_one_that_is_off_the_road_is_let_in_where_it_is(held):
    """To SUMO it is on no lane, as beside a lane for buses; the run ended with an error."""
    assert held("") == held("e_0") != [OWN_DRIVER]


def test_one_that_has_driven_on_is_let_in_no_longer(held):
    """Its place on the next edge was taken for one on the edge before; the vehicle that waited braked for nothing."""
    assert held("f_0") == [OWN_DRIVER]
