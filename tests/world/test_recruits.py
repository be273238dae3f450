"""Which vehicles of the traffic become members, and as what."""

from __future__ import annotations

import pytest

from platoontraffic import scenario
from platoontraffic.road.network import Network
from platoontraffic.world.recruits import (
    HAS_STOPS,
    NO_ROUTE,
    OTHER_SIZE,
    Newcomer,
    Recruits,
)

TABLE = """
[sumo]
net = "corridor"
[run]
duration_s = 20
[[equip]]
share = {share}
"""


def recruits(folder, *changes, share=1.0, more=""):
    file = folder / "equip.toml"
    file.write_text(TABLE.format(share=share) + more)
    loaded = scenario.load(file, changes)
    return Recruits(loaded, Network.read(loaded.net))


def newcomer(**values):
    like = Newcomer("car.1", "passenger", ("west_light",), 0, 4.7, (2.4, -1.6, 0.0), 13.0, 4.6, 1.8, 1.1, 50.0,
                    stops=False)  # fmt: skip
    return like._replace(**values)


def chosen(of, ids, kind="car", vehicle_class="passenger", edge="west_light", time=1.0):
    return {name for name in ids if of.chosen(name, kind, vehicle_class, edge, time) is not None}


def test_a_larger_share_contains_a_smaller_one(tmp_path):
    ids = [f"flow.{i}" for i in range(2000)]
    smaller, larger = (chosen(recruits(tmp_path, share=share), ids) for share in (0.2, 0.3))
    assert smaller < larger
    assert len(smaller) / 2000 == pytest.approx(0.2, abs=0.03)
    assert chosen(recruits(tmp_path, share=0.0), ids) == set()
    assert chosen(recruits(tmp_path, share=1.0), ids) == set(ids)


def test_buses_and_bicycles_are_of_no_share(tmp_path):
    whole = recruits(tmp_path)
    assert not any(chosen(whole, ["a"], vehicle_class=name) for name in ("bus", "bicycle", "motorcycle", "emergency"))


def test_shares_of_several_tables_add_up(tmp_path):
    ids = [f"flow.{i}" for i in range(2000)]
    both = recruits(tmp_path, share=0.3, more='[[equip]]\nid = "two"\nshare = 0.4\n')
    tables = [both.chosen(name, "car", "passenger", "e", 1.0) for name in ids]
    assert tables.count(0) / 2000 == pytest.approx(0.3, abs=0.04)
    assert tables.count(1) / 2000 == pytest.approx(0.4, abs=0.04)


@pytest.mark.parametrize(
    ("key", "fits", "does_not"),
    [
        ('types = ["van"]', {"kind": "van"}, {"kind": "car"}),
        ('classes = ["delivery"]', {"vehicle_class": "delivery"}, {"vehicle_class": "passenger"}),
        ('edges = ["west_light"]', {"edge": "west_light"}, {"edge": "light_west"}),
        ("begin_s = 5.0", {"time": 5.0}, {"time": 4.9}),
        ("end_s = 5.0", {"time": 4.9}, {"time": 5.0}),
    ],
)
def test_a_share_is_of_the_vehicles_that_its_table_names(tmp_path, key, fits, does_not):
    of = recruits(tmp_path, more=key)
    assert chosen(of, ["a"], **fits)
    assert not chosen(of, ["a"], **does_not)


def test_a_member_keeps_what_the_vehicle_was(tmp_path):
    member = recruits(tmp_path).member(0, newcomer(length=4.9, width=1.9), 3.2)
    assert (member.id, member.departs, member.speed, member.pose) == ("car.1", 3.2, 13.0, (2.4, -1.6, 0.0))
    assert (member.model.length, member.model.width) == (4.9, 1.9)
    assert (member.route.edges, member.route.speed_factor, member.route.top_speed) == (("west_light",), 1.1, 50.0)
    assert not member.leads
    assert member.lidar.mount.x == pytest.approx(4.9 / 2 - 0.03)


def test_the_size_scales_the_vehicle_and_not_its_power(tmp_path):
    long, short = (recruits(tmp_path).member(0, newcomer(length=n), 0.0).model for n in (5.0, 4.0))
    assert long.wheelbase / short.wheelbase == pytest.approx(5 / 4)
    assert long.axle / short.axle == pytest.approx(5 / 4)
    assert long.power == short.power


@pytest.mark.parametrize(
    ("what", "why"),
    [
        ({"length": 1.5}, OTHER_SIZE),
        ({"stops": True}, HAS_STOPS),
        ({"edges": ("west_light", "west_light")}, NO_ROUTE),
    ],
)
def test_what_cannot_become_a_member_stays(tmp_path, what, why):
    of = recruits(tmp_path)
    assert of.member(0, newcomer(**what), 0.0) is None
    assert of.left == {why: 1}


def test_routes_that_members_cannot_drive_have_a_fault_and_an_example(tmp_path):
    of = recruits(tmp_path)
    for name, edges in (("a", ("west_light", "none")), *((n, ("west_light", "west_light")) for n in ("b", "c"))):
        of.member(0, newcomer(id=name, edges=edges), 0.0)
    of.member(0, newcomer(id="d", edges=("west_light", "none"), stops=True), 0.0)  # stays SUMO's for its stops
    (twice, such_as, loop), (once, other, unknown) = of.undrivable
    assert (twice, such_as, once, other) == (2, "b", 1, "a")
    assert loop.startswith("no connection from edge 'west_light' to 'west_light'; it leads to: ")
    assert unknown.startswith("no edge 'none' in corridor.net.xml")
    of.begin()
    assert of.undrivable == []
    assert not of.left


def test_one_turn_is_one_fault_for_vehicles_of_any_size(tmp_path):
    of = recruits(tmp_path, 'sumo.net="lab_world"')
    for name, length in (("a", 4.6), ("b", 4.2)):
        of.member(0, newcomer(id=name, edges=("s_end", "end_s"), position=0.5, length=length), 0.0)
    (fault,) = of.undrivable
    assert fault.vehicles == 2
    assert fault.why.startswith("turns back from 's_end' to 'end_s' on a radius of 0.5 m; the vehicle needs ")


def test_vehicles_on_one_route_share_its_line(tmp_path):
    of = recruits(tmp_path)
    one, other = (of.member(0, newcomer(id=str(i), speed_factor=1 + i / 10), 0.0).route for i in range(2))
    assert one.line is other.line
    assert one.curvature(4.6)[0] is other.curvature(4.6)[0]  # 0.2 MB for each member that ever was
    assert (one.speed_factor, other.speed_factor) == (1.0, 1.1)
