"""A share of the traffic becomes members: no vehicle is lost, and trips are measured as SUMO measures them."""

from __future__ import annotations

import filecmp
import json

import numpy as np
import pandas as pd
import pytest

from platoontraffic import shipped
from platoontraffic.cli.printing import not_equipped, print_run
from platoontraffic.road.network import Network
from platoontraffic.scenario.equip_tables import VEHICLE_OF
from platoontraffic.simulation import Simulation
from platoontraffic.sumo.client import libsumo
from tests.support.generated import lane_that_ends
from tests.support.runs import run

pytestmark = pytest.mark.sumo

SCENARIO = """
[sumo]
net = "corridor"
warm_up_s = 40
[run]
duration_s = 60
[[equip]]
share = 1.0
"""
ROUTES = """<routes>
    <vType id="private" vClass="private" length="4.4" speedFactor="1.05" sigma="0"/>
    <vType id="city_bus" vClass="bus"/>
    <vehicle id="first" type="private" depart="1" departSpeed="10"><route edges="west_light light_light_n"/></vehicle>
    <trip id="second" type="private" depart="2" from="west_light" to="light_prio" departSpeed="10"/>
    <vehicle id="bus" type="city_bus" depart="3"><route edges="light_n_light light_light_s"/></vehicle>
    <vehicle id="parks" type="private" depart="3"><route edges="west_light light_prio"/>
        <stop lane="light_prio_0" endPos="100" duration="5" parking="true"/></vehicle>
    <flow id="flow" type="private" begin="4" end="20" number="2" from="west_light" to="light_light_s"/>
</routes>
"""


@pytest.fixture
def file(tmp_path):
    written = tmp_path / "equip.toml"
    written.write_text(SCENARIO)
    return written


def test_a_member_that_departs_where_its_edge_begins_heads_along_its_lane(tmp_path):
    """SUMO draws its rear on a lane that leads there, across the bend of the junction."""
    (tmp_path / "all.rou.xml").write_text(
        '<routes><vType id="private" vClass="private" length="4.4" sigma="0"/>'
        '<vehicle id="v" type="private" depart="1" departPos="0" departSpeed="10"><route edges="A1_B1"/></vehicle>'
        "</routes>"
    )
    file = tmp_path / "equip.toml"
    file.write_text('[sumo]\nnet = "grid"\nroutes = ["all.rou.xml"]\n[run]\nduration_s = 8\n[[equip]]\nshare = 1.0\n')
    *_, lane = Network.read(shipped.networks()["grid"]).lane_pose("A1_B1")
    heading = []
    with Simulation.load(file) as simulation:
        for now in simulation:
            if "v" in now.fleet.ids:
                heading.append(now.traffic.heading[now.traffic.ids.index("v")])
    assert len(heading) > 20
    assert np.abs(np.array(heading[:20]) - lane).max() < np.radians(1.0)


def departures(file, *changes):
    """Route and class of every vehicle that departs, by id; the members; and how many stay SUMO's, by the reason."""
    found = {}
    with Simulation.load(file, *changes) as simulation:
        for _ in simulation:
            for name in libsumo.simulation.getDepartedIDList():
                found[name] = tuple(libsumo.vehicle.getRoute(name)), libsumo.vehicle.getVehicleClass(name)
        return found, {m.id for m in simulation.members}, simulation.setting.recruits.left


def test_the_demand_is_conserved(file):
    """Later departures may wait for room behind others; the first half minute is the same whoever drives."""
    short = "run.duration_s=30"
    none, nobody, _ = departures(file, "equip.share=0.0", short)
    half, some, _ = departures(file, "equip.share=0.5", short)
    whole, everybody, left = departures(file, short)
    assert not nobody
    assert some < everybody
    assert 0 < len(some) < len(everybody)
    assert none == half == whole
    of_class = [name for name, (_, vehicle_class) in none.items() if vehicle_class in VEHICLE_OF]
    assert everybody <= set(of_class)
    assert len(of_class) == len(everybody) + sum(left.values())


def test_a_vehicle_that_a_calibrator_removes_as_it_departs_is_no_member(demand):
    none = '<calibrator id="none" edge="west_light" pos="0"><flow begin="0" end="99" vehsPerHour="0" speed="9"/>'
    (demand.parent / "none.add.xml").write_text(f"<additional>{none}</calibrator></additional>")
    more = '<additional-files value="none.add.xml"/></input>'
    demand.write_text(demand.read_text().replace("</input>", more))
    found, members, _ = departures(demand, "equip.share=1.0", "run.duration_s=20")
    assert {"first", "second", "flow.0"} <= set(found)
    assert not members


@pytest.mark.parametrize("mode", ["single", "platoons"])
@pytest.mark.parametrize(("steps", "more"), [("200", set()), ("0", {"early.0", "early.1"})])
def test_what_sumo_ignores_for_its_order_is_no_demand(demand, mode, steps, more):
    """By its option `route-steps` 0, which shares of the traffic need, SUMO loads that too."""
    early = '<flow id="early" type="private" begin="1" end="20" number="2" from="west_light" to="light_light_n"/>'
    routes = demand.parent / "demand.rou.xml"
    routes.write_text(routes.read_text().replace("</routes>", f"{early}</routes>"))
    option = f'<processing><route-steps value="{steps}"/></processing></configuration>'
    demand.write_text(demand.read_text().replace("</configuration>", option))
    found, *_ = departures(demand, "equip.share=0.0", f"equip.mode={mode}", "run.duration_s=20")
    assert set(found) == {"first", "second", "flow.0", "flow.1", "bus", "parks"} | more


def test_two_runs_of_a_seed_are_the_same_bytes(file, tmp_path):
    first, second = (run(tmp_path / name, file, "equip.share=0.5", "run.duration_s=30") for name in ("a", "b"))
    for table in ("trajectories", "events", "trips", "metrics", "statistics"):
        assert filecmp.cmp(first / f"{table}.csv", second / f"{table}.csv", shallow=False), table


def test_trips_of_vehicles_that_sumo_drives_are_measured_as_by_sumo(file, tmp_path):
    """Through the turns of junctions, where a vehicle that leaves its lane's line would be measured wrong."""
    folder = run(tmp_path / "run", file, "equip.follower.law=sumo", "run.duration_s=150")
    own, sumo = (pd.read_csv(folder / f"{name}.csv", index_col="vehicle_id") for name in ("trips", "sumo_trips"))
    own = own[(own.member == 1) & (own.status == "arrived")]
    assert len(own) > 10
    sumo = sumo.loc[own.index]
    for column in ("depart_s", "arrival_s"):
        assert own[column].to_numpy() == pytest.approx(sumo[column].to_numpy(), abs=1e-6), column
    for column in ("co2_kg", "fuel_kg", "route_length_m"):
        assert own[column].sum() == pytest.approx(sumo[column].sum(), rel=0.005), column
    assert own.time_loss_s.sum() == pytest.approx(sumo.time_loss_s.sum(), rel=0.005, abs=0.5)
    assert own.waiting_s.to_numpy() == pytest.approx(sumo.waiting_s.to_numpy(), abs=0.15)
    assert (own.type == "car").any()


@pytest.fixture
def demand(tmp_path):
    """A demand of vehicles, trips, flows and a bus, in a configuration without an end."""
    (tmp_path / "demand.rou.xml").write_text(ROUTES)
    net = shipped.networks()["corridor"]
    file = tmp_path / "town.sumocfg"
    file.write_text(f"""<configuration><input><net-file value="{net}"/><route-files value="demand.rou.xml"/></input>
</configuration>""")
    return file


def test_a_configuration_without_an_end_runs_until_its_demand_has_arrived(demand, tmp_path):
    folder = run(tmp_path / "run", demand, "equip.share=1.0")
    trips = pd.read_csv(folder / "trips.csv", index_col="vehicle_id")
    assert set(trips.index) == {"first", "second", "flow.0", "flow.1", "bus", "parks"}
    assert (trips.status == "arrived").all()
    assert trips.member.to_dict() == {"first": 1, "second": 1, "flow.0": 1, "flow.1": 1, "bus": 0, "parks": 0}
    assert set(trips.type[trips.member == 1]) == {"private"}
    events = pd.read_csv(folder / "events.csv")
    assert events.loc[events.kind == "end", "what"].item() == "arrived"
    metrics = pd.read_csv(folder / "metrics.csv").set_index(["scope", "metric"]).value
    assert metrics["everybody", "trips_finished"] == 6
    assert metrics["equipped", "trips_finished"] == 4
    assert json.loads((folder / "provenance.json").read_text())["not_equipped"] == {"has stops": 1}
    assert metrics["equipped", "delay_mean_finished"] == pytest.approx(trips.time_loss_s[trips.member == 1].mean())


def test_vehicles_that_are_on_the_road_at_the_end_of_the_warm_up_stay_sumos(demand, tmp_path):
    folder = run(tmp_path / "run", demand, "equip.share=1.0", "sumo.warm_up_s=2", "run.duration_s=20")
    trips = pd.read_csv(folder / "trips.csv", index_col="vehicle_id")
    assert trips.member.to_dict() == {"first": 0, "second": 0, "flow.0": 1, "flow.1": 1, "bus": 0, "parks": 0}


@pytest.mark.slow
@pytest.mark.parametrize("remedy", ["remove", "sumo_drives"])
def test_a_member_that_is_stuck_is_removed_or_driven_by_sumo(file, tmp_path, remedy):
    """At a light that is red for longer. Whatever is done, none is lost without a word."""
    folder = run(
        tmp_path / "run", file, "sumo.warm_up_s=30", "run.duration_s=120", "equip.stuck_after_s=10",
        f"equip.stuck={remedy}", "record.traffic_every_s=5",
    )  # fmt: skip
    events = pd.read_csv(folder / "events.csv")
    given_up, stuck = (events[events.kind == kind] for kind in ("given_up", "stuck"))
    assert len(stuck) == len(given_up) > 0
    assert set(given_up.what) == {remedy}
    assert (given_up.time_s.to_numpy() - stuck.time_s.to_numpy()) == pytest.approx(0.1)
    trips = pd.read_csv(folder / "trips.csv", index_col="vehicle_id")
    sumo = pd.read_csv(folder / "sumo_trips.csv", index_col="vehicle_id").loc[given_up.vehicle_id]
    assert set(sumo.status) <= ({"removed"} if remedy == "remove" else {"arrived", "running"})
    own = trips.loc[given_up.vehicle_id]
    assert (own.member == 1).all()
    assert own.status.tolist() == sumo.status.tolist()
    if remedy == "sumo_drives":  # its way and its waits go on
        assert own.route_length_m.to_numpy() == pytest.approx(sumo.route_length_m.to_numpy(), rel=0.02)
        assert own.waiting_s.to_numpy() == pytest.approx(sumo.waiting_s.to_numpy(), abs=1.0)
        assert own.arrival_s.to_numpy() == pytest.approx(sumo.arrival_s.to_numpy(), abs=1e-6, nan_ok=True)
    assert pd.read_csv(folder / "vehicles.csv").vehicle_id.is_unique
    metrics = pd.read_csv(folder / "metrics.csv").query("scope == 'equipped'").set_index("metric").value
    assert metrics.trips_removed == (len(given_up) if remedy == "remove" else 0)
    assert metrics[["trips_finished", "trips_running", "trips_removed"]].sum() == trips.member.sum()
    assert np.isfinite(sumo.depart_s).all()


QUEUE = """<routes>
    <vType id="car" lcStrategic="100"/><vType id="private" vClass="private"/>
    {}
    <vehicle id="m" type="private" depart="48" departLane="0" departPos="150"><route edges="B C"/></vehicle>
</routes>
"""
BESIDE_A_QUEUE = """
[sumo]
net = "{}"
routes = ["queue.rou.xml"]
[run]
duration_s = 95
[[equip]]
share = 1.0
types = ["private"]
stuck = "remove"
stuck_after_s = 12
"""


@pytest.mark.parametrize("step", [0.05, 0.1])
def test_a_member_that_waits_for_room_can_be_removed(tmp_path, step):
    """Beside a queue, where another one lets it in. The run ended with an error of SUMO's, which knew it no longer."""
    net, waits = lane_that_ends(tmp_path, 250.0), False
    car = '<vehicle id="q{}" type="car" depart="{}" departLane="1"><route edges="B C"/>{}</vehicle>'
    stop = '<stop lane="B_1" startPos="240" endPos="245" duration="1000"/>'
    cars = [car.format(k, 1 + 2.2 * k, "" if k else stop) for k in range(20)]
    (tmp_path / "queue.rou.xml").write_text(QUEUE.format("".join(cars)))
    (tmp_path / "queue.toml").write_text(BESIDE_A_QUEUE.format(net.name))
    with Simulation.load(tmp_path / "queue.toml", f"run.step_s={step}") as simulation:
        removed = -1
        for now in simulation:
            waits |= "m" in simulation.world._letting_in.waiting
            if any(event.kind == "given_up" for event in now.events):
                removed = now.step
        assert 0 < removed < now.step - 20
        assert "m" not in simulation.world._placement.where
    assert waits


PLATOONS = """<routes>
    <vType id="private" length="4.4" speedFactor="1" sigma="0"/>
    <vehicle id="a" type="private" depart="1"><route edges="west_light light_prio prio_rw"/></vehicle>
    <vehicle id="b" type="private" depart="6"><route edges="west_light light_prio prio_rw"/></vehicle>
    <vehicle id="c" type="private" depart="7"><route edges="west_light light_prio prio_prio_s"/></vehicle>
    <vehicle id="late" type="private" depart="90"><route edges="west_light light_prio prio_rw"/></vehicle>
</routes>
"""


def test_vehicles_wait_for_each_other_and_are_a_platoon_until_their_routes_part(demand, tmp_path, capsys):
    (demand.parent / "demand.rou.xml").write_text(PLATOONS)
    more = "equip.share=1.0", "equip.mode=platoons", "equip.window_s=10"
    folder = run(tmp_path / "run", demand, *more, "run.duration_s=150")
    vehicles, trips = (pd.read_csv(folder / f"{name}.csv", index_col="vehicle_id") for name in ("vehicles", "trips"))
    members = list(vehicles[["platoon_id", "place"]].itertuples(name=None))
    assert sorted(members) == [("a", "equip.0", 0), ("b", "equip.0", 1), ("c", "equip.0", 2), ("late", "equip", 0)]
    assert trips.depart_delay_s["a"] >= 6 - 0.2  # it waits for the last of them, which departs 6 s later
    assert trips.depart_delay_s["b"] >= 1 - 0.2
    assert (trips.depart_delay_s < 10).all()
    assert trips.depart_s[["a", "b", "c"]].is_monotonic_increasing
    events = pd.read_csv(folder / "events.csv")
    assert set(events.vehicle_id[events.kind == "locked"]) == {"b", "c"}
    assert events.vehicle_id[events.kind == "parted"].tolist() == ["c"]
    assert not set(events.kind) & {"collision", "red_light", "failed_to_yield", "given_up"}
    metrics = pd.read_csv(folder / "metrics.csv").query("scope == 'vehicle'").set_index(["vehicle_id", "metric"]).value
    assert metrics["b", "in_platoon_share"] > 0.8
    assert ("late", "in_platoon_share") not in metrics.index
    print_run(folder)
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    (members,) = (row for row in rows if row[:1] == ["members"])
    arrived = trips[(trips.member == 1) & (trips.status == "arrived")]
    assert float(members[-1]) == pytest.approx(arrived.depart_delay_s.mean(), abs=0.051)


def test_a_run_says_why_members_cannot_drive_a_route(tmp_path, capsys):
    (tmp_path / "turn.rou.xml").write_text(
        '<routes><vType id="private" vClass="private" length="4.4"/>'
        '<vehicle id="back" type="private" depart="1"><route edges="s_end end_s"/></vehicle></routes>'
    )
    file = tmp_path / "turn.toml"
    file.write_text(
        '[sumo]\nnet = "lab_world"\nroutes = ["turn.rou.xml"]\n[run]\nduration_s = 2\n[[equip]]\nshare = 1.0\n'
    )
    print_run(run(tmp_path / "run", file))
    said = capsys.readouterr().out
    assert (
        "1 of the share stay SUMO's: a route that members cannot drive\n  vehicle back: turns back from 's_end'" in said
    )
    assert "0 of 1 vehicles are members, 0.0%" in said
    assert "Gaps and cross-track" not in said  # no member is in a platoon, so the table has neither


def test_faults_of_many_routes_are_printed_in_few_lines():
    faults = [{"vehicles": 5 - i, "such_as": f"v.{i}", "why": f"fault {i}"} for i in range(5)]
    lines = list(not_equipped({"not_equipped": {"no route": 15}, "undrivable_routes": faults}))
    assert lines[:2] == ["15 of the share stay SUMO's: no route", "  5 vehicles, such as v.0: fault 0"]
    assert lines[-1] == "  3 for 2 other faults: see undrivable_routes in provenance.json"
    assert len(lines) == 5
    lines = list(not_equipped({"undrivable_routes": faults[:4]}))
    assert lines[-1] == "  2 for 1 other fault: see undrivable_routes in provenance.json"
    assert list(not_equipped({"not_equipped": {"has stops": 1}})) == ["1 of the share stay SUMO's: has stops"]  # before


def test_an_obstacle_does_not_keep_a_run_going(demand, tmp_path):
    """To SUMO it is a vehicle that never arrives."""
    box = "kind = 'box'\nx_m = 150.0\ny_m = 1.6\nheading_deg = 180.0\nlength_m = 4.0\nwidth_m = 1.8\n"
    tables = "[run]\nstep_s = 0.1\nduration_s = 200\n[[equip]]\nshare = 1.0\n[[obstacle]]\n"
    file = tmp_path / "held.toml"
    file.write_text(f"[sumo]\nconfig = '{demand}'\n{tables}{box}")
    folder = run(tmp_path / "run", file)
    events = pd.read_csv(folder / "events.csv")
    assert events.loc[events.kind == "end", "what"].item() == "arrived"


def test_members_of_the_share_that_depart_while_platoons_are_placed_are_counted(demand, tmp_path):
    """They stay SUMO's, and nothing said so."""
    text = (tmp_path / "demand.rou.xml").read_text()
    assert text.count('depart="1"') == 1
    (tmp_path / "demand.rou.xml").write_text(text.replace('depart="1"', 'depart="0.1"'))
    folder = run(tmp_path / "run", demand, "equip.share=1.0", "run.duration_s=5")
    left = json.loads((folder / "provenance.json").read_text())["not_equipped"]
    assert left["departed in the first two steps, in which the members are placed"] == 1
