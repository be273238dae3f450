"""How long a light is closed, by the programs of a network file."""

from __future__ import annotations

from pathlib import Path

from platoontraffic import shipped
from platoontraffic.road.light_programs import longest_closed
from platoontraffic.road.network import Network

NET = """<net version="1.20">
    <tlLogic id="a" type="static" programID="0" offset="0">
        <phase duration="0:00:10" state="rGrg"/><phase duration="3" maxDur="50" state="ryry"/>
        <phase duration="20" state="Grrg"/><phase duration="4" state="yrrg"/><phase duration="5" state="rrrg"/>
    </tlLogic>
    <tlLogic id="b" type="actuated" programID="0" offset="0">
        <phase duration="10" minDur="5" maxDur="50" state="G"/><phase duration="3" state="y"/>
        <phase duration="30" minDur="5" maxDur="60" state="r"/>
    </tlLogic>
    <tlLogic id="b" type="static" programID="night" offset="0"><phase duration="9" state="G"/></tlLogic>
</net>"""


def test_the_longest_time_without_green_goes_round_the_end_of_the_cycle(tmp_path: Path):
    net = tmp_path / "a.net.xml"
    net.write_text(NET)
    closed = longest_closed(net)
    assert closed == {
        ("a", 0): 4 + 5 + 10 + 3,
        ("a", 1): 3 + 20 + 4 + 5,
        ("a", 2): 0.0,  # it never opens
        ("a", 3): 3.0,
        ("b", 0): 3 + 60,
    }


def test_every_link_at_a_light_of_a_network_is_known():
    network = Network.read(shipped.networks()["corridor"])
    links = {(light, index) for _, light, index in network.signal_lines()}
    assert links
    assert links <= network.longest_closed.keys()
    assert all(5.0 < network.longest_closed[link] < 120.0 for link in links)
