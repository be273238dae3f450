"""Platoons in traffic against SUMO's own cars: their scenarios, what is read from runs, and the bars."""

from __future__ import annotations

import json
import math
import shutil
import xml.etree.ElementTree as ET
from types import MappingProxyType, SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from platoontraffic import scenario as scenarios
from platoontraffic import shipped
from platoontraffic.cli.main import app
from platoontraffic.cli.prove import _print_verdict, road_of
from platoontraffic.errors import InputError
from platoontraffic.lidar import Scene
from platoontraffic.prove import demand, plans, rides
from platoontraffic.prove.demand import write_demand
from platoontraffic.prove.plans import LASER, SUMO, Road, planned
from platoontraffic.prove.rides import NO_REASON, Ride, Stand, _incidents, _long_on, _stands
from platoontraffic.prove.traffic import Pair, Verdict
from platoontraffic.prove.trips import Trip
from platoontraffic.road.network import Line, Network
from platoontraffic.shipped import networks
from platoontraffic.vehicles.bicycle import CARS
from platoontraffic.world.deployment import deploy
from tests.support.generated import generated

CORRIDOR = shipped.networks()["corridor"]


@pytest.fixture(scope="module")
def network() -> Network:
    return Network.read(CORRIDOR)


@pytest.fixture
def plan(network, tmp_path):
    road = Road("corridor", CORRIDOR, {"net": "corridor"}, has_traffic=True)
    return planned(road, network, 1, tmp_path, vehicle="car", warm_up=60.0, duration=100.0)


def test_sumos_own_cars_start_in_the_places_of_the_members(plan, network):
    poses = {}
    for which, file in plan.files.items():
        members = deploy(scenarios.load(file), network, Scene.from_shapely())
        poses[which] = np.array([member.pose for member in members])
        assert [member.route.edges for member in members] == [t.edges for t in plan.trips for _ in range(plan.size)]
        assert [member.id for member in members] == list(plan.trip_of)
        assert {member.law.native for member in members} == {which == SUMO}
    assert len(poses[LASER]) == 10
    np.testing.assert_allclose(poses[LASER], poses[SUMO], atol=1e-6)


def test_both_runs_have_the_same_traffic_and_lane_changes(plan):
    laser, sumo = (scenarios.load(plan.files[which]) for which in (LASER, SUMO))
    assert laser.route_files == sumo.route_files
    assert laser.seed == sumo.seed == 1
    assert laser.spec.sumo.warm_up_s == sumo.spec.sumo.warm_up_s == 60.0
    assert sumo.spec.sumo.lane_change_s == 0.0  # SUMO's own default, which the platoons' run has


def test_a_random_demand_follows_its_seed_and_drives_on_roads(network, tmp_path):
    files = [tmp_path / f"{i}.rou.xml" for i in range(3)]
    counts = [write_demand(network, file, seed, 0.0, 600.0) for file, seed in zip(files, (1, 1, 2), strict=True)]
    texts = [file.read_text() for file in files]
    assert texts[0] == texts[1] != texts[2]
    assert counts[0] == texts[0].count("<vehicle ") > 20


def events(*rows: tuple) -> pd.DataFrame:
    columns = ["time_s", "kind", "vehicle_id", "other_id", "edge_id", "what", "detail", "duration_s"]
    return pd.DataFrame(rows, columns=columns)


def test_a_random_demand_begins_with_sumo(network, tmp_path):
    write_demand(network, tmp_path / "demand.rou.xml", 1, begin=3600.0, duration=60.0)
    vehicles = ET.parse(tmp_path / "demand.rou.xml").getroot().iter("vehicle")
    departures = [float(vehicle.get("depart")) for vehicle in vehicles]
    assert 3600 <= min(departures) < max(departures) <= 3660


def test_a_random_demand_turns_back_only_where_there_is_no_other_route(network, tmp_path, monkeypatch):
    radii = []

    def none(*_: object, radius: float, **__: object) -> None:
        radii.append(radius)
        raise InputError("no route")

    monkeypatch.setattr(demand, "draw", none)
    assert write_demand(network, tmp_path / "demand.rou.xml", 1, 0.0, 60.0) == 0
    assert radii == [CARS["car"].turning_radius, 0.0]


@pytest.mark.sumo
def test_a_random_demand_is_so_thin_that_sumos_own_cars_flow(tmp_path):
    """On random networks with six cars a kilometre of lane they stood for minutes, and times of arrival were chance."""
    network = Network.read(shipped.networks()["grid"])
    dense, thin = tmp_path / "dense.rou.xml", tmp_path / "thin.rou.xml"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demand, "DENSITY", 40.0)
        count = write_demand(network, thin, 1, 0.0, 400.0)
        assert demand._flows(network, thin, 1, 0.0, 400.0)
        patch.setattr(demand, "THINNER", 0.0)
        assert write_demand(network, dense, 1, 0.0, 400.0) > count > 20
    assert not demand._flows(network, dense, 1, 0.0, 400.0)


def test_a_configuration_has_traffic_in_its_additional_files_too(tmp_path):
    shutil.copy(CORRIDOR, tmp_path / "c.net.xml")
    text = "<additional>{}</additional>"
    config = """<configuration><input><net-file value="c.net.xml"/><additional-files value="more.add.xml"/></input>
        <time><begin value="100"/></time></configuration>"""
    (tmp_path / "c.sumocfg").write_text(config)
    for inside, has in (("", False), ('<flow id="f" begin="0" end="9" period="3" from="e0_e1" to="e1_e2"/>', True)):
        (tmp_path / "more.add.xml").write_text(text.format(inside))
        road = road_of(str(tmp_path / "c.sumocfg"))
        assert (road.has_traffic, road.begin) == (has, 100.0)


def test_standstills_last_to_their_end_or_that_of_the_run_or_of_the_trip():
    found = events(
        (30.0, "standstill", "p0.0", "", "", "held", "since 20.000 s, held by light", np.nan),
        (45.0, "standstill_end", "p0.0", "", "", "", "", 25.0),
        (60.0, "standstill", "p0.0", "", "", "", "since 50.000 s", np.nan),
        (70.0, "standstill", "p0.1", "", "", "behind", "since 60.000 s, behind x", np.nan),
    )
    found = found.assign(x_m=0.0, y_m=0.0)
    stands = list(_stands(found, 100.0, pd.Series({"p0.1": 90.0}), Lanes(), {"p0.0": TRIP, "p0.1": TRIP}))
    assert stands == [
        Stand("p0.0", 25.0, "held: held by light", "lane 0", begins=20.0),
        Stand("p0.0", 50.0, NO_REASON, "lane 0", begins=50.0),
        Stand("p0.1", 30.0, "behind: behind x", "lane 0", begins=60.0),
    ]


TRIP = Trip((), 0, 0.0, np.zeros((2, 2)), np.zeros(2), ())


class Lanes:
    """Parallel lanes, one for each metre of y."""

    def lanes_at(self, x, y):
        return [f"lane {round(one)}" for one in y]

    longest_closed = MappingProxyType({("tl", 1): 69.0})


def test_lanes_on_which_traffic_stands_for_long():
    """Times of one car do not add up with those of the next one, nor over a short drive."""
    seconds = np.arange(0.0, 200.0)
    speed = {
        "a": np.where((seconds >= 10) & (seconds <= 71), 0.0, 5.0),  # for 61 s
        "b": np.where((seconds >= 100) & (seconds <= 160), 0.0, 5.0),  # for 60 s
        "c": np.where(seconds == 160, 1.0, 0.0),  # for 159 s, and for 38 s
        "d": np.where(seconds < 40, 0.0, 5.0),
    }
    rows = [
        pd.DataFrame({"time_s": seconds, "vehicle_id": name, "x_m": 0.0, "y_m": float(k), "speed_mps": one})
        for k, (name, one) in enumerate(speed.items())
    ]
    waits = rows[0].assign(vehicle_id="person.0", y_m=7.0, speed_mps=0.0)
    traffic = pd.concat([*rows, waits]).sort_values("time_s", kind="stable")
    assert _long_on(traffic, Lanes()) == ("lane 0", "lane 2")
    network = Network.read(CORRIDOR)
    assert _long_on(traffic.iloc[:0].astype(object), network) == ()
    assert _long_on(waits.assign(vehicle_id="tram", x_m=-1e4), network) == ()


def test_a_point_is_on_the_lane_whose_centre_line_is_nearest():
    network = Network.read(CORRIDOR)
    edge, lane, length = network.lanes_for_cars()[0]
    x, y, heading = network.lane_pose(edge, lane, length / 2)
    aside = 0.4 * network.lane_width(edge, lane)
    points = [(x + k * aside * math.sin(heading), y - k * aside * math.cos(heading)) for k in (-1, 0, 1)]
    assert network.lanes_at(*zip(*points, strict=True)) == [f"{edge}_{lane}"] * 3
    assert network.lanes_at([-1e4], [0.0]) == [""]


def test_a_contact_is_an_incident_unless_another_vehicle_made_it():
    found = events(
        (1.0, "collision", "p0.0", "x", "e", "struck_from_behind", "", np.nan),
        (2.0, "collision", "p0.0", "p0.1", "e", "struck_from_behind", "", np.nan),
        (3.0, "collision", "p0.0", "x", "e", "other_changed_lanes", "", np.nan),
        (4.0, "collision", "p0.0", "x", "e", "beside", "", np.nan),
        (5.0, "collision", "p0.0", "wall", "e", "", "", np.nan),
        (6.0, "red_light", "p0.0", "", "e", "", "lane", np.nan),
        (7.0, "collision", "p0.0", "x", "e", "lanes_overlap", "", np.nan),
        (8.0, "collision", "p0.0", "p0.1", "e", "lanes_overlap", "", np.nan),
    )
    assert [one.time for one in _incidents(found, {"p0.0", "p0.1"})] == [2.0, 4.0, 5.0, 6.0]


def test_of_lanes_that_overlap_a_vehicle_is_on_the_one_that_leads_where_it_is_headed(network):
    edge, lane, _ = next(one for one in network.lanes_for_cars() if one[2] > 60.0)
    x, y, heading = network.lane_pose(edge, lane, 30.0)
    middle = network.lane_headed(x, y, heading + 0.2)
    assert middle.coords[0] == pytest.approx(network.lane_pose(edge, lane, 0.0)[:2])
    assert network.lane_headed(x, y, heading + math.pi) is None
    assert network.lane_headed(-1e4, 0.0, heading) is None


def ride(**changes) -> Ride:
    stand = Stand("p0.0", 20.0, "held: held by light", "a_0")
    return Ride(2, (100.0, 110.0), 20.0, 0.1, 0, 0, 0, 0, 0, (stand,), ())._replace(**changes)


def verdict(platoons: Ride | None, sumo: Ride | None = None, error: str = "", lasts: float = 300.0) -> Verdict:
    return Verdict.of([Pair(1, 2, (), platoons, sumo or ride(), lasts, 0, error)])


@pytest.mark.parametrize(
    "changes",
    [
        {"arrivals": (100.0, 138.0)},
        {"arrivals": (100.0,)},
        {"caused": 1},
        {"red_lights": 1},
        {"failures_to_yield": 1},
        {"stands": (Stand("p0.0", 61.0, "held: held by light", "a_0"),)},
        {"stands": (Stand("p0.0", 20.0, NO_REASON, "a_0"),)},
    ],
)
def test_each_bar_can_fail(changes):
    assert verdict(ride()).holds
    assert len(verdict(ride(**changes)).faults) == 1


@pytest.mark.parametrize(
    "sumo",
    [{"long_on": ("a_0",)}, {"stands": (Stand("p0.1", 61.0, NO_REASON, "a_0"),)}],
)
def test_a_member_may_stand_for_long_where_sumos_cars_do(sumo):
    long = ride(stands=(Stand("p0.0", 61.0, "held: held by light", "a_0"),))
    elsewhere = ride(stands=(Stand("p0.0", 61.0, "held: held by light", "b_0"),))
    assert verdict(long, ride(**sumo)).holds
    assert len(verdict(elsewhere, ride(**sumo)).faults) == 1


def test_a_wait_for_a_light_that_is_closed_for_long_is_no_fault():
    red = Stand("p0.0", 69.0, rides.LIGHT, "a_0", one_red=True)
    assert verdict(ride(stands=(red, Stand("p0.1", 67.0, "behind: behind p0.0", "a_0")))).holds
    assert not verdict(ride(stands=(red._replace(one_red=False),))).holds
    line = Line(50.0, "o", "tl", 1, "lane 0", "b_0", (":j_0_0",), 8.0)
    found = events(
        (12.0, "standstill", "p0.0", "", "", "held", "since 2.000 s, held by light", np.nan),
        (72.0, "standstill_end", "p0.0", "", "", "", "", 70.0),
        (112.0, "standstill", "p0.0", "", "", "held", "since 102.000 s, held by light", np.nan),
        (182.0, "standstill_end", "p0.0", "", "", "", "", 80.0),
        (212.0, "standstill", "p0.0", "", "", "held", "since 202.000 s, held by no room behind the junction", np.nan),
        (272.0, "standstill_end", "p0.0", "", "", "", "", 70.0),
    ).assign(x_m=0.0, y_m=0.0)
    stands = _stands(found, 300.0, pd.Series(dtype=float), Lanes(), {"p0.0": TRIP._replace(lines=(line,))})
    assert [stand.one_red for stand in stands] == [True, False, False]
    # Inside a junction before an edge that is shorter than the distance from its line at which a member stops.
    lines = Line(40.0, "M", "", 0, "a_0", "c_0", ("lane 0",), 8.0), line._replace(lane="c_0")
    stands = _stands(found[:2], 300.0, pd.Series(dtype=float), Lanes(), {"p0.0": TRIP._replace(lines=lines)})
    assert [stand.one_red for stand in stands] == [True]


def test_a_queue_behind_a_member_that_stands_where_sumos_cars_do_is_no_fault():
    stands = [Stand("p0.0", 90.0, "held: held by light", "a_0"), Stand("p0.1", 80.0, "behind: behind p0.0", "b_0")]
    last = Stand("p1.0", 70.0, "behind: behind p0.1", "c_0")
    own = ride(long_on=("a_0",))
    assert verdict(ride(stands=(last, *stands)), own).holds
    assert not verdict(ride(stands=(last, *stands)), ride()).holds
    assert not verdict(ride(stands=(*stands, last._replace(why="behind: behind car.7"))), own).holds
    assert not verdict(ride(stands=(*stands, stands[0]._replace(lane="d_0"))), own).holds
    ring = [Stand("p0.0", 90.0, "behind: behind p0.1", "b_0"), Stand("p0.1", 90.0, "behind: behind p0.0", "b_0")]
    assert not verdict(ride(stands=tuple(ring)), own).holds


def test_one_behind_a_car_of_sumos_may_stand_as_long_as_that_does_while_no_other_member_stands():
    """On a random network one stood for 81 s behind a car that waited for a gap, and arrived before SUMO's own."""
    first = Stand("p0.0", 81.0, "behind: behind car.306", "a_0", begins=100.0)
    behind, light = first._replace(vehicle="p0.1", why="behind: behind p0.0"), "held: held by light"
    assert verdict(ride(stands=(first, behind)), ride()).holds
    assert not verdict(ride(stands=(first, behind), arrivals=(100.0, 138.0)), ride()).holds
    other = Stand("p1.0", 50.0, light, "b_0", begins=110.0)  # the car may wait for this one
    assert not verdict(ride(stands=(first, behind, other)), ride()).holds
    assert verdict(ride(stands=(first, behind, other._replace(begins=170.0))), ride()).holds
    assert not verdict(ride(stands=(first._replace(why=light), behind)), ride()).holds


def test_a_queue_behind_one_that_waits_beside_a_queue_is_no_fault_if_that_one_waits_for_a_little_less_than_long():
    """In Bologna it waited for 58 s, and the one behind it stood for 62 s."""
    queue = Stand("p0.1", 79.0, "behind: behind x", "a_1")
    waits = Stand("p1.3", 58.0, rides.LANE_CHANGE, "a_0", onto="a_1", begins=100.0)
    behind = Stand("p1.4", 62.0, "behind: behind p1.3", "a_0", begins=98.0)
    own = ride(stands=(queue,))
    assert verdict(ride(stands=(waits, behind)), own).holds
    assert not verdict(ride(stands=(waits._replace(onto="b_1"), behind)), own).holds
    assert not verdict(ride(stands=(waits, behind._replace(begins=140.0))), own).holds  # that one has left


def test_a_member_that_lets_one_in_beside_a_queue_is_no_fault():
    """In Bologna one let in its predecessor, which stood behind one that waited for 60 s to change to a queue."""
    queue = Stand("p0.1", 79.0, "behind: behind x", "a_2")
    waits = Stand("p1.0", 60.0, rides.LANE_CHANGE, "a_1", onto="a_2", begins=5.0)
    lets_in = Stand("p1.3", 64.0, rides.LETTING_IN, "a_1", begins=10.0)
    behind = Stand("p1.4", 63.0, "behind: behind p1.3", "a_1", begins=12.0)
    own = ride(stands=(queue,))
    assert verdict(ride(stands=(waits, lets_in, behind)), own).holds
    assert not verdict(ride(stands=(waits, lets_in._replace(begins=50.0))), own).holds
    assert not verdict(ride(stands=(waits, lets_in._replace(lane="b_1"))), own).holds
    assert not verdict(ride(stands=(waits, lets_in._replace(why=rides.RIGHT_OF_WAY))), own).holds


def test_a_member_that_keeps_a_junction_clear_of_such_a_queue_is_no_fault():
    held = Stand("p0.0", 90.0, rides.NO_ROOM, "b_0", queue="a")
    behind = Stand("p0.1", 80.0, "behind: behind p0.0", "c_0")
    own = ride(long_on=("a_1",))
    assert verdict(ride(stands=(behind, held)), own).holds
    assert not verdict(ride(stands=(behind, held)), ride()).holds
    assert not verdict(ride(stands=(held._replace(queue="d"),)), own).holds
    first = Stand("p0.2", 100.0, "behind: behind p0.1", "d_0")  # a queue that has come to the next junction
    assert verdict(ride(stands=(behind, held, first, held._replace(vehicle="p1.0", lane="e_0", queue="d"))), own).holds


def test_a_member_may_wait_beside_a_queue_for_about_as_long_as_sumos_own_cars_stand_in_it():
    waits = Stand("p0.0", 90.0, rides.LANE_CHANGE, "a_0", onto="a_1")
    queue = Stand("p0.1", 80.0, "behind: behind x", "a_1")
    own = ride(stands=(queue, queue._replace(lasts=20.0)))
    assert verdict(ride(stands=(waits,)), own).holds
    assert not verdict(ride(stands=(waits._replace(lasts=170.0),)), own).holds  # it was not let in at the next green
    assert not verdict(ride(stands=(waits._replace(onto="a_2"),)), own).holds
    first = Stand("p0.2", 80.0, rides.RIGHT_OF_WAY, "a_1", unregulated=True)
    assert verdict(ride(stands=(waits, first))).holds
    assert not verdict(ride(stands=(waits, first._replace(lasts=65.0)))).holds


def test_a_wait_for_a_gap_is_no_fault_where_sumos_cars_drive_through_each_other():
    waits = Stand("p0.0", 90.0, rides.RIGHT_OF_WAY, "a_0", unregulated=True)
    assert verdict(ride(stands=(waits, Stand("p0.1", 80.0, "behind: behind p0.0", "a_0")))).holds
    assert not verdict(ride(stands=(waits._replace(unregulated=False),))).holds
    assert not verdict(ride(stands=(waits._replace(lasts=181.0),))).holds


def test_who_waits_beside_another_one_that_waits_beside_a_queue_is_compared_with_the_queue():
    queue = Stand("p0.0", 80.0, "behind: behind x", "a_2")
    first = Stand("p0.1", 99.0, rides.LANE_CHANGE, "a_1", onto="a_2")
    second = Stand("p0.2", 120.0, rides.LANE_CHANGE, "a_0", onto="a_1")
    own = ride(stands=(queue,))
    assert verdict(ride(stands=(first,)), own).holds
    assert not verdict(ride(stands=(first, second)), own).holds


def test_a_standstill_at_a_line_tells_what_lies_beyond():
    cross = Line(50.0, "M", "", 0, "a_1", "b_0", (":j_0_0", ":j_4_0"), 8.0)
    change = Line(10.0, "change", "", 0, "a_0", "a_1", (), 20.0)
    trip = TRIP._replace(lines=(change, cross))
    why = {"room": "no room behind the junction", "gap": "right of way", "change": "lane change"}
    found = events(
        *(
            (30.0, "standstill", name, "", "", "held", f"since 20.000 s, held by {one}", np.nan)
            for name, one in why.items()
        )
    ).assign(x_m=0.0, y_m=0.0)

    class On(Lanes):
        def lanes_at(self, x, y):
            return [self.lane]

    for lane, unregulated in (("a_0", True), (":j_4_0", False), ("z_0", True)):
        network = On()
        network.lane, network.unregulated = lane, frozenset([":j_0_0"] if unregulated else [])
        stands = {s.vehicle: s for s in _stands(found, 99.0, pd.Series(dtype=float), network, dict.fromkeys(why, trip))}
        ahead = lane != "z_0"
        assert [stands[name].queue for name in why] == ["b" if ahead else "", "", ""]
        assert [stands[name].onto for name in why] == ["", "", "a_1" if lane == "a_0" else ""]
        assert [stands[name].unregulated for name in why] == [False, ahead and unregulated, False]


@pytest.mark.parametrize(("lane", "queue"), [(":j_0_0", "b"), (":j_4_0", "b"), ("a_1", ""), ("b_0", "")])
def test_a_queue_inside_a_junction_reaches_back_from_the_edge_beyond(lane, queue):
    cross = Line(50.0, "M", "", 0, "a_1", "b_0", (":j_0_0", ":j_4_0"), 8.0)
    found = events((30.0, "standstill", "p0.0", "", "", "behind", "since 20.000 s, behind x", np.nan))

    class On(Lanes):
        def lanes_at(self, x, y):
            return [lane]

    none = pd.Series(dtype=float)
    (stand,) = _stands(found.assign(x_m=0.0, y_m=0.0), 99.0, none, On(), {"p0.0": TRIP._replace(lines=(cross,))})
    assert stand.queue == queue
    other = Stand("p1.0", 55.0, "held: held by light", "c_0", begins=20.0)  # the vehicle ahead may wait for this one
    assert verdict(ride(stands=(stand, other)), ride(long_on=("b_0",))).holds == (queue == "b" or lane == "b_0")


@pytest.mark.parametrize(
    ("lane", "onto"),
    [
        ("z_0", "a_1"),
        (":k_0_0", "a_1"),
        ("a_0", "a_1"),
        ("a_1", ""),
        ("a_2", "a_1"),  # beside the lanes of the trip
        (":k_0_1", "a_0"),  # as in `fokr_bs_demo`, beside the red light of the lane of the trip
        ("x_0", ""),
    ],
)
def test_who_waits_for_a_lane_change_may_be_with_its_body_on_the_lane_before(lane, onto):
    """The place of a standstill is that of the middle of the body; its front stands at the begin of the change."""
    enter, cross = (
        Line(at, "M", "", 0, before, beyond, (via,), 8.0)
        for at, before, beyond, via in ((2.0, "z_0", "a_0", ":k_0_0"), (50.0, "a_1", "b_0", ":j_0_0"))
    )
    change = Line(10.0, "change", "", 0, "a_0", "a_1", (), 20.0)
    farther = (
        cross._replace(station=70.0, lane="b_0", onto="c_0"),
        change._replace(station=90.0, lane="c_0", onto="c_1"),
    )
    trip = TRIP._replace(lines=(enter, change, cross, *farther))
    row = (30.0, "standstill", "p", "", "", "held", "since 20.000 s, held by lane change", np.nan)
    network = SimpleNamespace(lanes_at=lambda x, y: [lane], unregulated=frozenset(), longest_closed={})
    (stand,) = _stands(events(row).assign(x_m=0.0, y_m=0.0), 99.0, pd.Series(dtype=float), network, {"p": trip})
    assert stand.onto == onto


def test_contacts_where_lanes_overlap_are_no_fault_but_printed(capsys):
    found = verdict(ride(contacts=2, by_road=2))
    assert found.holds
    assert found.by_road == 2
    _print_verdict(found, Road("kinked", CORRIDOR, {"net": "corridor"}, has_traffic=False))
    assert "0 contacts caused (and 2 where lanes of two directions overlap)" in " ".join(
        capsys.readouterr().out.split()
    )


def test_a_run_that_failed_is_a_fault():
    assert verdict(None, error="SUMO failed").faults == ("SUMO failed",)


def test_arrivals_are_compared_where_sumos_own_arrive_and_apart_where_they_overlap():
    assert verdict(ride()).ratio == 1.0
    assert math.isnan(verdict(ride(), ride(arrivals=(100.0,))).ratio)
    overlapping = verdict(ride(arrivals=(100.0, 165.0)), ride(contacts=1))
    assert math.isnan(overlapping.ratio)
    assert overlapping.ratio_overlapping == 1.5


def test_where_sumos_own_do_not_all_arrive_times_are_not_compared_but_numbers_are():
    assert not verdict(ride()).not_compared
    one = ride(arrivals=(100.0,))
    assert verdict(one, one).holds
    assert verdict(one, one).not_compared == "SUMO's own cars do not all arrive"
    fault = "seed 1: 0 members arrive within 300 s, 1 of SUMO's own within 240 s"
    assert verdict(ride(arrivals=()), one).faults == (fault,)


def test_a_road_on_which_no_vehicle_arrives_does_not_hold():
    """A run of 5 s was said to hold."""
    nobody = ride(arrivals=())
    assert verdict(nobody, nobody).faults == (
        "no member and none of SUMO's own cars arrives; a longer --duration may tell",
    )


def test_a_member_that_may_still_arrive_in_time_is_not_late():
    """SUMO's own arrive at 110 s: by 130 s a member is not yet late, at 138 s it is. Without a median nothing holds."""
    one, all_ = ride(arrivals=(100.0,)), ride()
    made = [Pair(i, 2, (), platoons, ride(), 130.0, 0) for i, platoons in enumerate((one, all_, all_))]
    assert Verdict.of(made).holds
    assert verdict(one, lasts=130.0).faults == (
        "most runs end before all members arrive; a longer --duration may tell",
    )
    assert verdict(one, lasts=138.0).faults == ("seed 1: 1 members arrive within 138 s, 2 of SUMO's own within 110 s",)


def test_medians_are_over_the_seeds():
    arrivals = [(100.0, 110.0), (100.0, 121.0), (100.0, 220.0)]
    made = [Pair(i, 2, (), ride(arrivals=one), ride(), 300.0, 0) for i, one in enumerate(arrivals)]
    assert Verdict.of(made).ratio == pytest.approx(1.1)
    assert Verdict.of(made).hours == pytest.approx(0.3)


def test_a_seed_in_which_only_sumos_own_arrive_is_a_fault_whatever_the_median_is():
    made = [
        Pair(i, 2, (), ride(arrivals=one), ride(), 300.0, 0) for i, one in enumerate([(100.0, 110.0)] * 2 + [(100.0,)])
    ]
    assert Verdict.of(made).ratio == 1.0
    assert Verdict.of(made).faults == ("seed 2: 1 members arrive within 300 s, 2 of SUMO's own within 240 s",)


@pytest.mark.sumo
@pytest.mark.slow
@pytest.mark.parametrize("net", ["corridor", "plain"])
def test_the_command_runs_both_and_keeps_them(net, tmp_path, generated_nets):
    name = net if net in shipped.networks() else str(generated(generated_nets))
    folder = tmp_path / "kept"
    given = ["prove", name, "--traffic", "--seeds", "1", "--warm-up", "30", "--duration", "60", "--json"]
    done = CliRunner().invoke(app, [*given, "--results", str(folder)])
    assert done.exit_code in (0, 1), done.output
    (pair,) = json.loads(done.stdout)["pairs"]
    assert pair["error"] == ""
    assert pair["platoons"]["vehicles"] == pair["sumo"]["vehicles"] == 10
    assert len(list(folder.glob("seed-1/*/*/DONE"))) == 2
    assert (folder / "seed-1" / "demand.rou.xml").is_file() == (net == "plain")


@pytest.mark.parametrize(("name", "reaches"), [("highway", 150.0), ("grid", None)])
def test_lasers_reach_as_far_as_the_network_is_fast(name, reaches):
    """With 60 m a leader would drive no faster than 26.6 m/s on a road for 33.3 m/s."""
    drivers = plans._drivers(Network.read(networks()[name]))
    lidars = [driver["lidar"] for driver in drivers[plans.LASER].values()]
    if reaches is None:
        assert lidars == ["car-leader", "car-tracker"]
    else:
        assert [lidar["range_max_m"] for lidar in lidars] == [reaches, reaches]
    assert drivers[plans.SUMO] == plans.DRIVERS[plans.SUMO]
