"""Platoons of a demand: which vehicles depart together, how long each waits, and none is in two."""

from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from platoontraffic import shipped
from platoontraffic.road.demand import Selection, Vehicle, chosen, common_beginning, read_demand
from platoontraffic.road.network import Network
from platoontraffic.road.platooning import UNCHECKED, plan, platoons

ROUTES = ("a", "a b", "a b c", "a b d", "a e", "b", "b c")


def vehicle(name: str, depart: float, route: str = "a b", **more) -> Vehicle:
    plain = Vehicle(
        name, "car", depart, tuple(route.split()), False, False, False, False, "", "", "", Path("d.rou.xml")
    )
    return plain._replace(**more)


@st.composite
def demands(draw):
    departs = draw(st.lists(st.integers(0, 120_000), max_size=40))
    return [
        vehicle(
            f"v{k}", depart / 1000, draw(st.sampled_from(ROUTES)), drawn=draw(st.booleans()),
            lane=draw(st.sampled_from(["", "free", "0", "1"])), flow=draw(st.sampled_from(["", "", "f", "g"])),
        )
        for k, depart in enumerate(departs)
    ]  # fmt: skip


@settings(deadline=None)
@given(demands(), st.integers(1, 5), st.floats(0, 60))
def test_nobody_is_lost_and_nobody_waits_too_long(vehicles, size, window):
    found, alone = platoons(vehicles, size, window)
    by_id = {v.id: v for v in vehicles}
    assert sorted([*alone, *(name for p in found for name in p.ids)]) == sorted(by_id)
    for p in found:
        members = [by_id[name] for name in p.ids]
        assert 2 <= len(members) <= size
        assert all(0 <= wait <= round(window, 3) for wait in p.waits)
        assert all(one.depart <= other.depart for one, other in pairwise(members))
        assert len({(m.edges[0], m.lane if m.lane in "01" else "") for m in members}) == 1
        assert all(common_beginning(p.edges, m.edges) == p.edges for m in members)
        assert len(p.edges) > 1 or all(m.edges == p.edges and not m.drawn for m in members)
        together = [m.depart + wait for m, wait in zip(members, p.waits, strict=True)]
        assert together[0] == pytest.approx(p.depart)
        assert all(-1e-9 <= after - before <= 0.001 + 1e-9 for before, after in pairwise(together))


@settings(deadline=None)
@given(demands(), st.integers(1, 5), st.floats(0, 60), st.integers(0, 86400))
def test_platoons_are_the_same_at_any_time_of_the_day(vehicles, size, window, shift):
    now, _ = platoons(vehicles, size, window)
    later, _ = platoons([v._replace(depart=v.depart + shift) for v in vehicles], size, window)
    assert tuple(p._replace(depart=round(p.depart + shift, 3)) for p in now) == later


def test_five_cars_every_four_seconds_become_a_platoon_of_four_and_one_alone():
    found, alone = platoons([vehicle(f"v{k}", 4.0 * k) for k in range(5)], 4, 30.0)
    assert [(p.ids, p.depart, p.waits) for p in found] == [(("v0", "v1", "v2", "v3"), 12.0, (12.0, 8.0, 4.0, 0.0))]
    assert alone == ["v4"]


def test_the_window_counts_from_the_first_of_a_platoon():
    found, _ = platoons([vehicle(f"v{k}", 10.0 * k) for k in range(5)], 9, 20.0)
    assert [p.ids for p in found] == [("v0", "v1", "v2"), ("v3", "v4")]


def test_a_vehicle_joins_those_with_which_it_shares_most():
    vehicles = [
        vehicle("x", 0, "a e f"),
        vehicle("y", 1, "a b c d"),
        vehicle("z", 2, "a b c g"),
        vehicle("w", 3, "a e"),
    ]
    found, _ = platoons(vehicles, 4, 30.0)
    assert [(p.ids, p.edges) for p in found] == [(("y", "z"), ("a", "b", "c")), (("x", "w"), ("a", "e"))]


def test_one_edge_is_enough_only_where_it_is_the_whole_route_of_all():
    one, two, other = vehicle("1", 0, "a"), vehicle("2", 1, "a"), vehicle("3", 2, "a b")
    assert [p.ids for p in platoons([one, two, other], 4, 30.0)[0]] == [("1", "2")]
    assert not platoons([one, two._replace(drawn=True)], 4, 30.0)[0]


def test_those_that_sumo_loads_in_another_order_depart_a_millisecond_apart():
    early, late = vehicle("bus", 0, file=Path("second.rou.xml")), vehicle("car", 5.0, file=Path("first.rou.xml"))
    (platoon,), _ = platoons([late, early], 4, 30.0)
    assert platoon.ids == ("bus", "car")
    assert platoon.waits == (5.0, 0.001)
    assert not platoons([late, early], 4, 5.0)[0]  # the follower would depart 5.001 s after the leader
    (platoon,), _ = platoons([late, early._replace(file=late.file, depart=5.0)], 4, 30.0)
    assert platoon.waits == (0.0, 0.0)


# ---- a share of a demand


def demand_of(tmp_path, content):
    file = tmp_path / "d.rou.xml"
    file.write_text(f"<routes>{content}</routes>")
    return read_demand([file])


@pytest.fixture(scope="module")
def highway():
    return Network.read(shipped.networks()["highway"])


def test_every_vehicle_of_the_share_is_in_one_platoon_or_single(tmp_path, highway):
    flows = '<flow id="f" from="e0_e1" to="e4_e5" begin="0" end="600" period="3"/>'
    off = '<flow id="g" from="e0_e1" to="e2_e_exit" begin="0" end="600" period="5"/>'
    demand, before = demand_of(tmp_path, flows + off), set()
    for share in (0.1, 0.3, 1.0):
        made = plan(demand, Selection(5, share), 4, 30.0, highway)
        names = [name for platoon in made.platoons for name in platoon.ids] + list(made.single)
        assert sorted(names) == sorted(v.id for v in demand.vehicles if chosen(5, v.id, share))
        assert before <= set(names)
        before = set(names)
    assert len(before) == 200 + 120


def test_trips_are_joined_by_their_fastest_routes(tmp_path, highway):
    through, off = 'from="e0_e1" to="e4_e5"', 'from="e0_e1" to="e2_e_exit"'
    demand = demand_of(tmp_path, f'<trip id="a" depart="0" {through}/><trip id="b" depart="1" {off}/>')
    (platoon,) = plan(demand, Selection(1, 1.0), 4, 30.0, highway).platoons
    assert platoon.edges == ("e0_e1", "e1_e2")


def test_what_cannot_be_in_a_platoon_says_why(tmp_path, highway):
    route = '<route edges="e0_e1 e1_e2"/>'
    demand = demand_of(
        tmp_path,
        f"""<vTypeDistribution id="mixed"><vType id="car"/><vType id="truck" vClass="truck"/></vTypeDistribution>
        <vehicle id="one" depart="0">{route}</vehicle>
        <vehicle id="bus" depart="0">{route}<stop lane="e0_e1_0" duration="5"/></vehicle>
        <vehicle id="random" depart="0" departPos="random">{route}</vehicle>
        <vehicle id="event" depart="triggered">{route}</vehicle>
        <vehicle id="any" depart="0" type="mixed">{route}</vehicle>
        <vehicle id="never" depart="0" type="truck">{route}</vehicle>
        <trip id="taz" depart="0" fromTaz="1" toTaz="2"/>
        <flow id="draws" begin="0" end="100" probability="0.5" from="e0_e1" to="e1_e2"/>""",
    )
    made = plan(demand, Selection(1, 1.0, classes=frozenset(["passenger"])), 4, 30.0, highway)
    assert made.platoons == ()
    assert made.single == {
        "one": "no other with their start and route departs soon enough",
        "bus": "they stop on their route",
        "random": "they depart at a random position",
        "event": "their departure is triggered",
        "any": "SUMO draws their type at departure",
        "taz": "their route is known at departure only",
    }
    lines = made.summary(scale=1.5)
    assert lines[0] == "no two vehicles can form a platoon within 30 s"
    assert lines[1].startswith("6 vehicles left over, each a platoon of one (1: ")
    assert lines[2].startswith("1 flow with random departures (some 50 vehicles before the share is taken)")
    assert lines[3].startswith("the demand is scaled by 1.5")
    assert lines[4].startswith("this includes vehicles on routes that members cannot drive")


def test_the_summary_counts_platoons_and_waits(tmp_path, highway):
    flow = '<flow id="f" from="e0_e1" to="e4_e5" begin="0" number="5" period="4"/>'
    made = plan(demand_of(tmp_path, flow), Selection(1, 1.0), 3, 30.0, highway)
    assert made.waits == {"f.0": 8.0, "f.1": 4.0, "f.3": 4.0}
    assert made.summary() == [
        "2 platoons found, of 5 vehicles: 1 of 2, 1 of 3; a vehicle waits 3.2 s on average, 8.0 s at most",
        UNCHECKED,
    ]
    assert [p.depart for p in made.platoons] == [8.0, 16.0]
    assert made.summary(end=16.0)[1:-1] == ["1 platoon of these would depart after the end of the run"]
