"""Reading a demand: the vehicles that SUMO loads, their departures, routes and types; the choice of a share."""

import gzip
import random
from itertools import pairwise
from pathlib import Path

import libsumo
import pytest

from platoontraffic.errors import InputError
from platoontraffic.road.demand import Kind, Selection, chosen, read_demand
from platoontraffic.road.network import Network
from tests.support import ROOT
from tests.support.demands import loaded

HIGHWAY = ROOT / "sumo_nets" / "highway" / "highway.net.xml"
EAST = ("e0_e1", "e1_e2", "e2_e3", "e3_e4", "e4_e5")
ROUTE = f'<route id="r" edges="{" ".join(EAST)}"/>'
FLOWS = f"""<routes>{ROUTE}
    <vehicle id="v" depart="0" route="r"/>
    <flow id="counted" route="r" begin="0" end="20" number="7"/>
    <flow id="hourly" from="w0_w1" to="w4_w5" begin="0.3" end="20" vehsPerHour="1300"/>
    <vehicle id="clock" depart="0:0:1.5" route="r"/>
    <flow id="late" route="r" begin="0" end="20" period="5"/>
    <trip id="early" depart="1" from="e0_e1" to="e4_e5"/>
    <flow id="period" route="r" begin="5" number="4" period="3.3335"/>
    <flow id="at_once" route="r" begin="5" end="5" number="4"/>
    <flow id="fine" route="r" begin="5.0005" end="16" perHour="700"/>
    <flow id="random" route="r" begin="6" end="30" probability="0.2"/>
    <flow id="poisson" route="r" begin="6" end="30" period="exp(0.2)"/>
    <trip id="line" depart="20" from="e0_e1" to="e4_e5" line="7"/>
    <person id="p" depart="8"><walk edges="e0_e1"/></person>
    <interval begin="10" end="15"><flow id="inside" route="r" number="2"/></interval>
    <flow id="to_the_end" route="r" begin="12" number="5"/>
    <flow id="triggered" route="r" begin="triggered" number="2"/>
</routes>"""


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def read(tmp_path: Path, content: str, **more):
    return read_demand([written(tmp_path / "d.rou.xml", f"<routes>{content}</routes>")], **more)


def departures(demand):
    return {v.id: v.depart for v in demand.vehicles if v.depart is not None}


# ---- departures


@pytest.mark.sumo
@pytest.mark.parametrize("begin", [0, 10, 19])
def test_departures_are_those_that_sumo_loads(tmp_path, begin):
    text = FLOWS.replace('<person id="p" depart="8"><walk edges="e0_e1"/></person>', "")  # nobody may walk here
    routes = written(tmp_path / "flows.rou.xml", text)
    demand = read_demand([routes], begin=begin, end=40)
    sumo = loaded(tmp_path, HIGHWAY, [routes], begin=begin, end=40)
    expected = {name: v.depart for name, v in sumo.items() if name.split(".")[0] not in ("random", "poisson")}
    triggered = {name for name in expected if name.startswith("triggered")}
    assert departures(demand) == {name: depart for name, depart in expected.items() if name not in triggered}


@pytest.mark.sumo
@pytest.mark.parametrize("begin", [0, 37])
def test_departures_of_random_flows_are_those_of_sumo(tmp_path, begin):
    draw = random.Random(1)
    starts = sorted(draw.uniform(0, 80) for _ in range(60))
    flows = []
    for k, start in enumerate(starts):
        end, number = start + draw.uniform(0, 60), draw.randint(1, 30)
        rate = draw.choice([
            f'end="{end:.4f}" number="{number}"',
            f'end="{end:.4f}" period="{draw.uniform(0.01, 9):.5f}"',
            f'end="{end:.4f}" vehsPerHour="{draw.uniform(100, 9000):.3f}"',
            f'number="{number}" period="{draw.uniform(0, 9):.5f}"',
        ])  # fmt: skip
        flows.append(f'<flow id="f{k}" route="r" begin="{start:.4f}" {rate}/>')
    routes = written(tmp_path / "flows.rou.xml", f"<routes>{ROUTE}{''.join(flows)}</routes>")
    sumo = loaded(tmp_path, HIGHWAY, [routes], begin=begin, end=400)
    assert departures(read_demand([routes], begin=begin)) == {name: v.depart for name, v in sumo.items()}


@pytest.mark.sumo
def test_additional_files_may_be_in_any_order(tmp_path):
    text = "".join(f'<vehicle id="v{t}" depart="{t}" route="r"/>' for t in (5, 30, 20))
    text = f'<additional>{ROUTE}{text}<flow id="f" begin="0" end="60" period="10" route="r"/></additional>'
    additional = written(tmp_path / "d.add.xml", text)
    demand = read_demand([], [additional], begin=12)
    sumo = loaded(tmp_path, HIGHWAY, [], [additional], begin=12)
    assert departures(demand) == {name: v.depart for name, v in sumo.items()}
    assert {"v20", "v30", "f.0"} <= departures(demand).keys()


@pytest.mark.sumo
def test_departures_of_the_ring(tmp_path):
    ring = ROOT / "sumo_nets" / "ring"
    demand = read_demand([ring / "ring.rou.xml"])
    sumo = loaded(tmp_path, ring / "ring.net.xml", [ring / "ring.rou.xml"], end=130)
    assert departures(demand) == {name: v.depart for name, v in sumo.items()}


def test_what_cannot_be_planned_is_counted(tmp_path):
    demand = read_demand([written(tmp_path / "flows.rou.xml", FLOWS)])
    assert demand.random_flows == {"random": pytest.approx(0.2 * 24), "poisson": pytest.approx(0.2 * 24)}
    assert demand.dropped == {("flow", "late"), ("trip", "early")}
    assert demand.persons == 1
    assert [v.id for v in demand.vehicles if v.depart is None] == ["triggered.0", "triggered.1"]


def test_a_flow_without_an_end_lasts_as_long_as_the_simulation_or_a_day(tmp_path):
    flow = f'{ROUTE}<flow id="f" route="r" begin="100" period="60"/>'
    assert len(read(tmp_path, flow, end=700.0).vehicles) == 10
    assert len(read(tmp_path, flow).vehicles) == 24 * 60


# ---- routes and types


def test_a_route_is_that_of_the_vehicle_or_one_by_reference(tmp_path):
    own = '<vehicle id="own" depart="0"><route edges="a b"/></vehicle>'
    later = '<vehicle id="later" depart="1" route="x"/><route id="x" edges="c d" repeat="1"/>'
    flow = '<flow id="f" begin="2" end="3" number="1" route="x"/>'
    vehicles = {v.id: v for v in read(tmp_path, own + later + flow).vehicles}
    assert vehicles["own"].edges == ("a", "b")
    assert vehicles["later"].edges == vehicles["f.0"].edges == ("c", "d", "c", "d")
    assert not any(v.routed for v in vehicles.values())


def test_a_trip_has_the_edges_that_it_names(tmp_path):
    trips = """<trip id="a" depart="0" from="a" via="b c" to="d"/><trip id="b" depart="0" fromTaz="1" toTaz="2"/>
               <trip id="c" depart="0" from="a" toTaz="2"/>"""
    one, other, third = read(tmp_path, trips).vehicles
    assert (one.edges, one.routed, one.taz) == (("a", "b", "c", "d"), True, False)
    assert (other.edges, other.taz) == ((), True)
    assert (third.edges, third.taz) == (("a",), True)


def test_of_a_distribution_of_routes_the_common_beginning_is_known(tmp_path):
    routes = (
        '<routeDistribution id="d"><route id="x" edges="a b c"/><route id="y" edges="a b d e"/></routeDistribution>'
    )
    again = '<routeDistribution id="e" routes="x y"/>'
    named = '<vehicle id="v" depart="0" route="d"/><vehicle id="w" depart="0" route="e"/>'
    own = '<flow id="f" begin="0" end="1" number="1"><routeDistribution><route refId="x"/></routeDistribution></flow>'
    v, w, f = read(tmp_path, routes + again + named + own).vehicles
    assert (v.edges, v.drawn) == (w.edges, w.drawn) == (("a", "b"), True)
    assert (f.edges, f.drawn) == (("a", "b", "c"), False)


def test_stops_of_the_vehicle_or_of_its_route(tmp_path):
    own = '<vehicle id="own" depart="0" route="r"><stop lane="e1_e2_0" duration="9"/></vehicle>'
    route = '<route id="s" edges="a b"><stop lane="a_0" duration="9"/></route><vehicle id="bus" depart="0" route="s"/>'
    vehicles = read(tmp_path, f'{ROUTE}{own}{route}<vehicle id="none" depart="0" route="r"/>').vehicles
    assert [v.stops for v in vehicles] == [True, True, False]


def test_types_and_classes(tmp_path):
    mixed = '<vTypeDistribution id="m" vTypes="lorry"><vType id="car"/></vTypeDistribution>'
    types = f'<vType id="lorry" vClass="truck"/>{mixed}'
    vehicles = "".join(
        f'<vehicle id="{t}" type="{t}" depart="0" route="r"/>' for t in ("lorry", "m", "DEFAULT_BIKETYPE")
    )
    demand = read(tmp_path, f'{types}{ROUTE}{vehicles}<vehicle id="plain" depart="0" route="r"/>')
    kinds = {v.id: demand.kinds(v) for v in demand.vehicles}
    assert kinds["lorry"] == (Kind("lorry", "truck"),)
    assert kinds["m"] == (Kind("lorry", "truck"), Kind("car", "passenger"))
    assert kinds["DEFAULT_BIKETYPE"][0].vclass == "bicycle"
    assert kinds["plain"] == (Kind("DEFAULT_VEHTYPE", "passenger"),)


def test_included_and_compressed_files_are_read_in_place(tmp_path):
    (tmp_path / "sub").mkdir()
    written(tmp_path / "sub" / "inner.xml", '<routes><vehicle id="b" depart="5" route="r"/></routes>')
    around = (
        '<vehicle id="a" depart="1" route="r"/><include href="sub/inner.xml"/><vehicle id="c" depart="4" route="r"/>'
    )
    file = tmp_path / "d.rou.xml.gz"
    file.write_bytes(gzip.compress(f"<routes>{ROUTE}{around}</routes>".encode()))
    demand = read_demand([file])
    assert departures(demand) == {"a": 1, "b": 5}  # c is not in order
    assert {v.file for v in demand.vehicles} == {file}


def test_flows_of_calibrators_are_no_demand(tmp_path):
    calibrator = (
        '<calibrator id="c" edge="e0_e1" pos="0"><flow begin="0" end="9" vehsPerHour="900" route="r"/></calibrator>'
    )
    assert read(tmp_path, ROUTE + calibrator).vehicles == []


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ('<vehicle id="v" depart="soon" route="r"/>', "d.rou.xml:1: vehicle 'v': depart = \"soon\"; must be a time"),
        ('<flow id="f" period="0.001" route="r"/>', "flow 'f': makes 86,400,000 vehicles; must be 1,000,000 at most"),
        ('<include href="d.rou.xml"/>', "leads back to it"),
        ('<include href="none.xml"/>', "no such file"),
        ("<vehicle", "not whole XML"),
    ],
)
def test_a_fault_is_one_line(tmp_path, content, words):
    with pytest.raises(InputError) as raised:
        read(tmp_path, content)
    assert words in str(raised.value)
    assert len(raised.value.faults) == 1


# ---- fastest routes


@pytest.mark.sumo
@pytest.mark.parametrize(("name", "share"), [("corridor", 1.0), ("grid", 0.98)])  # some of the grid take equally long
def test_fastest_routes_are_those_that_sumo_finds(name, share):
    net = ROOT / "sumo_nets" / name / f"{name}.net.xml"
    network, draw = Network.read(net), random.Random(2)
    routes, edges, wanted = network.fastest_routes(), sorted(network.edges), {}
    for _ in range(200):
        ends = tuple(draw.sample(edges, draw.choice([2, 2, 3])))
        if route := routes.through(ends):
            wanted[ends] = route
    assert len(wanted) > 40
    libsumo.start(["sumo", "-n", str(net), "--no-step-log", "true"])
    try:
        found = {}
        for ends in wanted:
            parts = [libsumo.simulation.findRoute(a, b).edges for a, b in pairwise(ends)]
            found[ends] = parts[0] + tuple(edge for part in parts[1:] for edge in part[1:])
    finally:
        libsumo.close()
    assert sum(found[ends] == wanted[ends] for ends in wanted) >= share * len(wanted)


def test_there_may_be_no_route():
    routes = Network.read(HIGHWAY).fastest_routes()
    assert routes.through(("e4_e5", "e0_e1")) == ()
    assert routes.through(("e0_e1", "nowhere")) == ()
    assert routes.through(("e0_e1", "e0_e1")) == ("e0_e1",)


# ---- choice

IDS = [f"flow.{k}" for k in range(20_000)]


def test_a_share_is_part_of_every_larger_share():
    shares = [{name for name in IDS if chosen(7, name, share)} for share in (0, 0.05, 0.2, 0.5, 1)]
    assert all(smaller < larger for smaller, larger in pairwise(shares))
    assert len(shares[-1]) == len(IDS)


def test_vehicles_are_chosen_evenly_and_seeds_are_independent():
    tenths = [next(k for k in range(1, 11) if chosen(3, name, k / 10)) for name in IDS]
    expected = len(IDS) / 10
    chi2 = sum((tenths.count(k) - expected) ** 2 / expected for k in range(1, 11))
    assert chi2 < 33.7  # 9 degrees of freedom: exceeded once in 10,000 seeds
    both = [(chosen(3, name, 0.5), chosen(4, name, 0.5)) for name in IDS]
    chi2 = sum((both.count((a, b)) - len(IDS) / 4) ** 2 / (len(IDS) / 4) for a in (True, False) for b in (True, False))
    assert chi2 < 21.1  # 3 degrees of freedom


def test_the_choice_is_the_same_in_every_process_and_version():
    assert [k for k in range(40) if chosen(1, f"v{k}", 0.2)] == [5, 12, 16, 17, 27, 32]


def test_a_selection_has_types_classes_edges_and_a_time():
    car = Kind("car", "passenger")
    everything = Selection(1, 1.0)
    assert everything.takes("v", car, "a", 5.0)
    assert not Selection(1, 0.0).takes("v", car, "a", 5.0)
    for more in ({"types": {"bus"}}, {"classes": {"truck"}}, {"edges": {"b"}}, {"begin": 5.1}, {"end": 5.0}):
        assert not everything._replace(**more).takes("v", car, "a", 5.0)
    for more in ({"types": {"car"}}, {"classes": {"passenger"}}, {"edges": {"a"}}, {"begin": 5.0}, {"end": 5.1}):
        assert everything._replace(**more).takes("v", car, "a", 5.0)
