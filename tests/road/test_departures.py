"""Files with later departures: SUMO loads the same vehicles, and those that wait later."""

import gzip
from xml.etree import ElementTree

import pytest

from platoontraffic.road.demand import read_demand
from platoontraffic.road.departures import with_departures
from tests.support import ROOT
from tests.support.demands import loaded, trips

HIGHWAY = ROOT / "sumo_nets" / "highway" / "highway.net.xml"
TYPES = '<vType id="car" speedFactor="normc(1,0.2,0.5,1.5)"/>'
MIXED = (
    '<vTypeDistribution id="car"><vType id="fast" speedFactor="norm(1.2,0.1)"/><vType id="van"/></vTypeDistribution>'
)
ROUTE = '<route id="r" edges="e0_e1 e1_e2 e2_e3 e3_e4 e4_e5"/>'
FLOWS = f"""<routes>{TYPES}{ROUTE}
    <flow id="a" type="car" route="r" begin="0" end="100" period="7" departSpeed="max">
        <param key="x" value="&lt;1&quot;"/>
    </flow>
    <flow id="b" type="car" from="w0_w1" to="w4_w5" begin="0" end="100" vehsPerHour="700" departLane="random"/>
    <flow id="c" type="car" begin="0" end="100" number="14"><route edges="e0_e1 e1_e2 e2_e_exit"/></flow>
</routes>"""
VEHICLES = f"""<routes>{MIXED}{ROUTE}
    <vehicle id="a" type="car" depart="0" route="r"/>
    <trip id="b" type="car" depart="1" from="e0_e1" to="e4_e5"/>
    <vehicle id="c" type="car" depart="2"><route edges="e0_e1 e1_e2"/><param key="k" value="v"/></vehicle>
    <vehicle id="dropped" type="car" depart="1.5" route="r"/>
    <vehicle id="d" type="car" depart="3" route="r" line="9"/>
    <vehicle id="e" type="car" depart="4" route="r"/>
</routes>"""


def demand_of(tmp_path, text, name="d.rou.xml"):
    (tmp_path / name).write_text(text)
    return read_demand([tmp_path / name])


@pytest.mark.sumo
@pytest.mark.parametrize("options", [(), ("--device.rerouting.probability", "1")])
def test_expanded_flows_are_the_same_trips(tmp_path, options):
    demand = demand_of(tmp_path, FLOWS)
    routes, _ = with_departures(demand, {}, tmp_path, expand=True)
    assert "flow" not in routes[0].read_text()
    before, after = (
        trips(tmp_path, HIGHWAY, files, 160, ("--step-length", "0.1", *options)) for files in (demand.routes, routes)
    )
    assert len(before) == 15 + 20 + 14
    assert before == after


@pytest.mark.sumo
def test_those_that_wait_depart_later_and_all_keep_type_and_speed_factor(tmp_path):
    demand = demand_of(tmp_path, VEHICLES)
    waits = {"a": 30.0, "b": 2.5, "d": 1.25}
    routes, _ = with_departures(demand, waits, tmp_path)
    before, after = (loaded(tmp_path, HIGHWAY, files) for files in (demand.routes, routes))
    assert set(before) == set("abcde")
    assert after == {name: v._replace(depart=v.depart + waits.get(name, 0)) for name, v in before.items()}


@pytest.mark.sumo
def test_draws_of_several_route_files_stay_the_same_if_each_is_read_at_once(tmp_path):
    files = [tmp_path / "a.rou.xml", tmp_path / "b.rou.xml"]
    for file in files:
        name = file.name[0]
        vehicles = (f'<trip id="{name}{t}" depart="{t}" from="e0_e1" to="e4_e5"/>' for t in range(0, 500, 9))
        file.write_text(f"<routes>{''.join(vehicles)}</routes>")
    demand = read_demand(files)
    waits = {v.id: 30.0 for v in demand.vehicles[::3]}
    routes, _ = with_departures(demand, waits, tmp_path)
    before, after = (
        loaded(tmp_path, HIGHWAY, each, end=600, options=("--route-steps", "0")) for each in (files, routes)
    )
    assert len(before) == 2 * 56
    assert after == {name: v._replace(depart=v.depart + waits.get(name, 0)) for name, v in before.items()}


@pytest.mark.sumo
def test_vehicles_of_flows_wait(tmp_path):
    demand = demand_of(tmp_path, FLOWS)
    routes, _ = with_departures(demand, {"a.3": 20.0, "c.13": 60.0}, tmp_path)
    before, after = (loaded(tmp_path, HIGHWAY, files, end=400) for files in (demand.routes, routes))
    waits = {name: after[name].depart - before[name].depart for name in before}
    assert {name for name, wait in waits.items() if wait} == {"a.3", "c.13"}
    assert (waits["a.3"], waits["c.13"]) == (20.0, 60.0)
    assert all(after[name][1:] == before[name][1:] for name in before)


def test_nothing_else_changes(tmp_path):
    demand = demand_of(tmp_path, VEHICLES)
    routes, _ = with_departures(demand, {"a": 30.0}, tmp_path)
    before, after = (list(ElementTree.parse(files[0]).getroot().iter()) for files in (demand.routes, routes))
    before = [e for e in before if e.get("id") != "dropped"]
    differ = [(e.attrib, f.attrib) for e, f in zip(before, after, strict=True) if e.attrib != f.attrib]
    assert [e.tag for e in before] == [e.tag for e in after]
    assert differ == [(before[5].attrib, {**before[5].attrib, "depart": "30.000", "line": "waits"})]


def test_an_expanded_vehicle_has_all_that_its_flow_has(tmp_path):
    demand = demand_of(tmp_path, FLOWS)
    routes, _ = with_departures(demand, {}, tmp_path, expand=True)
    vehicle = ElementTree.parse(routes[0]).find("vehicle[@id='a.1']")
    assert vehicle.attrib == {"id": "a.1", "depart": "7.000", "type": "car", "route": "r", "departSpeed": "max"}
    assert vehicle.find("param").attrib == {"key": "x", "value": '<1"'}
    assert read_demand(routes).vehicles == [
        v._replace(flow="", file=routes[0], id=v.id)
        for v in sorted(demand.vehicles, key=lambda v: (v.depart, "abc".index(v.flow)))
    ]


def test_files_without_a_change_are_used_as_they_are(tmp_path):
    for name in ("one", "other"):
        text = f'<routes>{ROUTE}<vehicle id="{name}" depart="1" route="r"/></routes>'
        (tmp_path / f"{name}.rou.xml.gz").write_bytes(gzip.compress(text.encode()))
    files = [tmp_path / "one.rou.xml.gz", tmp_path / "other.rou.xml.gz"]
    demand = read_demand(files[:1], files[1:])
    assert with_departures(demand, {}, tmp_path) == (tuple(files[:1]), tuple(files[1:]))
    routes, additional = with_departures(demand, {"other": 1.0}, tmp_path)
    assert routes == tuple(files[:1])
    assert [v.depart for v in read_demand([], additional).vehicles] == [2.0]


def test_flows_that_cannot_be_expanded_stay_in_their_place(tmp_path):
    stops = '<flow id="bus" route="r" begin="5" end="60" period="20"><stop lane="e1_e2_0" until="50"/></flow>'
    loaded_before = '<vehicle id="v" depart="3" route="r"/>'
    draws = '<flow id="draws" route="r" begin="7" end="60" probability="0.1"/>'
    text = f'<routes>{ROUTE}<flow id="f" route="r" begin="0" end="9" period="3"/>{loaded_before}{stops}{draws}</routes>'
    routes, _ = with_departures(demand_of(tmp_path, text), {"f.1": 3.0}, tmp_path)
    tags = [(e.tag, e.get("id")) for e in ElementTree.parse(routes[0]).getroot()]
    assert tags == [
        ("route", "r"), ("vehicle", "f.0"), ("vehicle", "v"), ("vehicle", "f.1"), ("flow", "bus"), ("vehicle", "f.2"),
        ("flow", "draws"),
    ]  # fmt: skip


def test_included_files_are_written_into_the_copy_and_names_of_files_stay_valid(tmp_path):
    (tmp_path / "sub").mkdir()
    reads = '<rerouter id="x" edges="e0_e1" file="closed.xml"/>'
    (tmp_path / "sub" / "inner.xml").write_text(f'<routes><vehicle id="v" depart="5" route="r"/>{reads}</routes>')
    demand = demand_of(tmp_path, f'<routes>{ROUTE}<include href="sub/inner.xml"/></routes>')
    copies = tmp_path / "copies"
    copies.mkdir()
    routes, _ = with_departures(demand, {"v": 1.0}, copies)
    root = ElementTree.parse(routes[0]).getroot()
    assert [e.tag for e in root] == ["route", "vehicle", "rerouter"]
    assert root.find("rerouter").get("file") == str((tmp_path / "sub" / "closed.xml").resolve())


def test_only_known_departures_can_be_changed(tmp_path):
    text = f'<routes>{ROUTE}<vehicle id="v" depart="triggered" route="r"/></routes>'
    for name in ("v", "nobody"):
        with pytest.raises(ValueError, match=f"'{name}' cannot be changed"):
            with_departures(demand_of(tmp_path, text), {name: 1.0}, tmp_path)
