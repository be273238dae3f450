"""The field's controllers: what they are given, the gap that they keep, and their formulas."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from platoontraffic import scenario
from platoontraffic.controllers import Decision, Law, Sensed
from platoontraffic.controllers.field import FieldLaw, Own
from platoontraffic.controllers.law import Known, Neighbour
from platoontraffic.controllers.path import PathLeader
from platoontraffic.controllers.registry import find_law, law_names
from platoontraffic.controllers.tracking import TrackingFollower
from platoontraffic.errors import InputError
from platoontraffic.lidar import PRESETS, Mount, Noise
from platoontraffic.road.route import Route
from platoontraffic.scenario import Channel
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.vehicles.motion import Drive
from platoontraffic.world.manoeuvres import Order
from tests.support.bench import BLIND, NO_WALLS, Log, Prescribed, StopLine, drive, platoon

CAR = VEHICLES["car"]
EYE = replace(PRESETS["car-tracker"], mount=Mount(CAR.length / 2 - 0.03), noise=Noise())
FIELD = {name: kind for name in law_names() if issubclass(kind := find_law(name, Path()).kind, FieldLaw)}


@dataclass(frozen=True)
class Peeps(Law):
    """Notes what it is given."""

    wants: frozenset[str]
    given: ClassVar[list[Sensed]] = []

    @property
    def needs(self) -> frozenset[str]:
        return self.wants

    def __call__(self, sensed: Sensed, memory: None, dt: float) -> Decision:
        self.given.append(sensed)
        return Decision(Drive(np.zeros(len(sensed.speed)), np.zeros(len(sensed.speed))))


def peeped(*needs: str) -> Sensed:
    leader = Prescribed(lambda time: Drive(0.5, 0.0))
    Peeps.given.clear()
    members = platoon(leader, Peeps(frozenset(needs)), 2, distance=10.0, model=CAR, eye=EYE, speed=20.0)
    drive(members, NO_WALLS, 1.0, 0.1)
    return Peeps.given[-1]


def test_what_is_not_declared_cannot_be_read():
    for needs in ((), ("truth",), ("messages",), ("truth", "leader"), ("messages", "leader"), ("truth", "members")):
        sensed = peeped(*needs)
        assert (sensed.truth is not None) == ("truth" in needs)
        assert (sensed.messages is not None) == ("messages" in needs)
        for known in filter(None, (sensed.truth, sensed.messages)):
            assert (known.leader is not None) == ("leader" in needs)
            assert (known.members is not None) == (known.ahead is not None) == ("members" in needs)


def test_the_truth_is_the_motion_of_predecessor_and_leader():
    truth = peeped("truth", "leader").truth
    moved, slower = 0.25, 0.5 / (1 + 0.1 / CAR.lag)  # after 1 s; the drive's lag leaves less
    first = truth.predecessor.speed[0]
    assert 20 + slower * 0.5 < first < 20 + 0.5
    assert truth.predecessor.speed[1] == truth.leader.speed[1] - first + 20.0
    assert truth.predecessor.demand == pytest.approx([0.5, 0.0])
    assert truth.predecessor.relative_speed == pytest.approx(truth.predecessor.speed - 20.0)
    bumper = 10.0 + 0.03 - 0.06  # the laser stands behind the bumper, and the bench's distance counts from it
    assert truth.predecessor.gap[1] == pytest.approx(bumper, abs=0.04)
    assert bumper < truth.predecessor.gap[0] < bumper + moved + 0.04
    between = truth.predecessor.gap[0] + CAR.length + truth.predecessor.gap[1]
    assert truth.leader.gap == pytest.approx([truth.predecessor.gap[0], between])
    assert truth.place.tolist() == [1, 2]
    assert not truth.predecessor.lost.any()


def test_all_members_are_known_by_truth_whether_ahead_or_behind():
    truth = peeped("truth", "leader", "members").truth
    assert truth.ahead.tolist() == [[1, 0, -1], [2, 1, 0]]
    assert truth.members.lost.tolist() == [[False, True, False], [False, False, True]]
    for known, one in ((truth.members.gap, truth.leader.gap), (truth.members.speed, truth.leader.speed)):
        assert known[:, 0].tolist() == one.tolist()
    assert truth.members.gap[1, 1] == truth.predecessor.gap[1]
    assert truth.members.gap[0, 2] == pytest.approx(-truth.predecessor.gap[1] - 2 * CAR.length)  # front to rear


def test_consensus_takes_the_mean_over_all_that_it_hears():
    """Worked by hand: two members between, 20 and 47 m ahead with 4.74 m of vehicle, of which one may be lost."""
    law, each, far = FIELD["consensus"](feed="truth", hears="all"), 15 + 0.8 * 19.0, np.array([[4, 3, 2, 1, 0, -1]])
    gaps = np.array([[130.0, 95.0, 60.0, 20.0, np.nan, -30.0]])
    pairs = 0.86 * (20 - each) + 0.08 * (130 - 4 * each - 3 * 4.74)
    two, three = (0.08 * (gap - k * each - (k - 1) * 4.74) for k, gap in ((2, 60.0), (3, 95.0)))
    for lost, mean in ((False, (pairs + two + three) / 4), (True, (pairs + two) / 3)):
        members = Neighbour(gaps, *np.full((5, 1, 6), np.nan), np.array([[False, lost, False, False, True, False]]))
        first = FIRST._replace(gap=np.array([130.0]))
        found = law.demand(OWN, Known(KNOWN, first, np.array([4]), members, far), np.zeros(1), 0.1)
        assert found == pytest.approx(-1.8 + mean)


def cars(law: Law, speed: float, seconds: float, at=lambda time: (0.0, 0.0)) -> Log:
    members = platoon(
        Prescribed(lambda time: Drive(*at(time))),
        law,
        3,
        distance=float(law.desired_distance(speed)) + 0.03,
        model=CAR,
        leader_eye=replace(BLIND, rate=10.0),
        eye=EYE,
        speed=speed,
    )
    return drive(members, NO_WALLS, seconds, 0.1)


@pytest.mark.parametrize("name", FIELD)
def test_a_steady_gap_is_the_desired_one_by_truth(name):
    law = FIELD[name](feed="truth")
    log = cars(law, 20.0, 4.0)
    gaps = log.x[:, :-1] - log.x[:, 1:] - CAR.length
    assert gaps == pytest.approx(float(law.desired_distance(20.0)), abs=1e-6)
    assert log.speed == pytest.approx(20.0, abs=1e-6)


@pytest.mark.parametrize("name", ["acc", "idm", "constant_spacing"])  # `cacc_ploeg` has no desired acceleration by scan
def test_twins_differ_by_little_where_the_laser_has_no_errors(name):
    def dips(time: float) -> tuple[float, float]:
        return (-1.0 if 2.0 <= time < 4.0 else 1.0 if 6.0 <= time < 8.0 else 0.0), 0.0

    scan, truth = (cars(FIELD[name](feed=feed), 20.0, 12.0, dips) for feed in ("scan", "truth"))
    assert np.ptp(truth.speed[:, 1]) > 0.5
    assert np.abs(scan.x - truth.x).max() < 0.5
    assert 1e-4 < np.abs(scan.speed - truth.speed).max() < 0.3


KNOWN = Neighbour(*np.array([[20.0], [-1.5], [18.5], [0.3], [0.4], [0.0]]), np.zeros(1, bool))
FIRST = Neighbour(*np.array([[47.0], [-1.0], [19.0], [0.2], [0.1], [0.0]]), np.zeros(1, bool))
OWN = Own(np.array([20.0]), np.array([0.25]), np.array([4.74]))


@pytest.mark.parametrize(
    ("name", "demand"),
    [  # worked by hand from the equations of the papers, at these values
        ("acc", (-1.5 + 0.1 * (20 - 2 - 30)) / 1.5),
        ("acc_commercial", 0.23 * (20 - 2 - 32) + 0.07 * -1.5),
        ("idm", 0.73 * (1 - (20 / (120 / 3.6)) ** 4 - ((2 + 32 + 20 * 1.5 / (2 * (0.73 * 1.67) ** 0.5)) / 20) ** 2)),
        ("cacc_path", 0.5 * 0.3 + 0.5 * 0.2 - 1.5 * 0.2 * 1.5 - 0.1 * 1.0 - 0.04 * (5 - 20)),
        ("consensus", -1.8 + (0.86 * (20 - 15 - 15.2) + 0.08 * (47 - 2 * (15 + 15.2) - 4.74)) / 2),
    ],
)
def test_the_formula_is_that_of_the_paper(name, demand):
    law = FIELD[name](feed="truth")
    found = law.demand(OWN, Known(KNOWN, FIRST, np.array([2])), np.zeros(1), 0.1)
    assert found == pytest.approx(demand)


@pytest.mark.parametrize(
    ("name", "rate"),
    [  # u' where the last command was -0.2, times the filter's lag
        ("cacc_ploeg", 0.2 + 0.2 * (20 - 2 - 14) + 0.7 * (-1.5 - 0.7 * 0.25) + 0.4),
        ("constant_spacing", 0.2 + 1.0 * (20 - 5) + 2.0 * -1.5),
    ],
)
def test_the_filter_begins_at_the_rate_of_the_paper(name, rate):
    law, dt = FIELD[name](feed="truth"), 1e-6
    lag = law.time_headway if name == "cacc_ploeg" else law.filter
    found = law.demand(OWN, Known(KNOWN, FIRST, np.array([2])), np.full(1, -0.2), dt)
    assert (found + 0.2) / dt * lag == pytest.approx(rate, rel=1e-4)


@pytest.mark.parametrize("name", FIELD)
def test_the_declared_linearisation_is_the_slope_of_the_law(name):
    law, speed = FIELD[name](feed="truth"), 20.0
    gap, acc = float(law.desired_distance(speed)), np.zeros(1)
    still = dict.fromkeys(("acceleration", "ahead_acceleration", "ahead_demand", "leader_acceleration"), 0.0)
    steady = still | {"gap": gap, "leader_gap": 2 * gap + 4.74} | dict.fromkeys(("speed", "ahead", "leader"), speed)

    def demand(**changes: float) -> float:
        v = steady | changes
        own = Own(np.array([v["speed"]]), np.array([v["acceleration"]]), np.array([4.74]))
        one = (v["gap"], v["ahead"] - v["speed"], v["ahead"], v["ahead_acceleration"], v["ahead_demand"], 0.0)
        two = (v["leader_gap"], v["leader"] - v["speed"], v["leader"], v["leader_acceleration"], 0.0, 0.0)
        ahead, leader = (Neighbour(*np.array(values)[:, None], np.zeros(1, bool)) for values in (one, two))
        return float(law.demand(own, Known(ahead, leader, np.array([2])), acc, 1e6)[0])

    linear = law.linear(speed, 2)
    names = {"ahead_speed": "ahead", "leader_speed": "leader"}
    assert demand() == pytest.approx(0.0, abs=1e-9)
    for field in (f for f in linear._fields if f not in ("lag", "commands", "member_gap")):
        key, h = names.get(field, field), 1e-5
        slope = (demand(**{key: steady[key] + h}) - demand(**{key: steady[key] - h})) / (2 * h)
        assert slope == pytest.approx(getattr(linear, field), abs=1e-6), field


def test_a_law_that_needs_the_leader_cannot_be_fed_by_scan():
    with pytest.raises(InputError, match='feed = "scan": the laser does not measure the leader; must be "messages" or'):
        scenario.load("highway_tracking", ["platoon.follower.law=cacc_path", "platoon.follower.feed=scan"])


ALONE = TrackingFollower(policy="obey", on_loss="drive")
ROAD = Route.along(("road",), np.array([[-200.0, 0.0], [150.0, 0.0], [900.0, 0.0]]), np.array([30.0, 5.0, 5.0]))


@pytest.mark.parametrize("spacing", [5.0, 10.0])
def test_an_obedient_follower_stops_at_a_closed_line_whatever_its_gap(spacing):
    """`tracking` braked for the predecessor, since the gap was shorter than its own, and the line counted no more."""
    law, line, closes = FIELD["cacc_path"](feed="truth", spacing=spacing, steering=ALONE), 121.87, 10.0
    members = platoon(PathLeader(speed=12.0), law, 4, model=CAR, eye=EYE, distance=spacing + 0.03, speed=12.0)
    members = [replace(member, route=ROAD) for member in members]
    log = drive(members, NO_WALLS, 30.0, 0.1, ground=partial(StopLine, 0.1, line, lambda time: time < closes))
    front, could_stop = log.x + CAR.length / 2, log.speed[round(closes / 0.1)] ** 2 / 2 / 4.0
    stops = line - front[round(closes / 0.1)] > could_stop
    assert stops.sum() >= 3
    assert front[-1, stops].max() < line
    assert front[-1, 0] > line + 100.0


def test_one_that_leads_now_does_not_hold_its_speed_for_want_of_messages():
    """After a split it drove on at 10 m/s, into a street of 5 m/s."""
    law = FIELD["acc"](feed="messages", on_radio_loss="hold", steering=ALONE)
    members = platoon(PathLeader(speed=10.0), law, 1, model=CAR, eye=EYE, distance=17.0, speed=10.0)
    split = Order(3.0, "split", "robot.1", "", None)
    members = [replace(member, route=ROAD) for member in members]
    log = drive(members, NO_WALLS, 25.0, 0.1, orders=[split], channel=Channel(), ground=partial(StopLine, 0.1))
    assert log.speed[round(10.0 / 0.1), 1] == pytest.approx(10.0, abs=0.3)
    assert log.speed[-1, 1] == pytest.approx(5.0, abs=0.2)


def test_the_law_that_steers_leaves_the_trail():
    """A member whose predecessor changed lanes in a queue followed it over, beside a car there."""
    law, memories = FIELD["acc"](steering=ALONE), []

    class Watched(type(law)):
        def __call__(self, sensed, memory, dt):
            memories.append(memory)
            return super().__call__(sensed, memory, dt)

    watched = Watched(steering=ALONE)
    members = platoon(PathLeader(speed=10.0), watched, 2, model=CAR, eye=EYE, distance=17.0, speed=10.0)
    drive([replace(member, route=ROAD) for member in members], NO_WALLS, 1.0, 0.1)
    memory = memories[-1]
    assert memory.steering.never_lost.tolist() == [True, True]
    assert law.off_trail(memory, np.array([1])).steering.never_lost.tolist() == [True, False]
    assert PathLeader().off_trail(memory, np.array([1])) is memory


@pytest.mark.parametrize("policy", ["convoy", "obey"])
def test_lines_are_heeded_as_by_the_law_that_steers(policy):
    steering = TrackingFollower(policy=policy, on_loss="drive")
    assert FIELD["acc"](steering=steering).heeds_lines == steering.heeds_lines == (policy == "obey")
