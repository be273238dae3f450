"""Warnings of what a scenario asks for beyond what holds."""

from __future__ import annotations

import pytest

from platoontraffic import scenario, simulation
from platoontraffic.observation.tested import warnings
from tests.support import ODD_NETS

pytestmark = pytest.mark.sumo


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("platoon.0.follower.lidar.rate_hz=2.5", "a laser of 2.5 Hz"),
        ('platoon.0.follower.lidar={preset="car-tracker", noise={dropout=0.45}}', "45% of the returns lost"),
        ("platoon.0.follower.odometry.yaw_rate_bias_degps=2.0", "a yaw rate with a bias of 2 deg/s"),
        ("platoon.0.follower.lidar.delay_s=0.4", "a delay of 0.4 s: `tracking` was tested up to 0.3 s"),
        ("platoon.0.follower.odometry.delay_s=0.35", "a delay of 0.35 s: `tracking` was tested up to 0.3 s"),
        (
            'platoon.0.follower={law="tracking", time_headway_s=0.7, lidar={delay_s=0.3}}',
            "strings amplify with time_headway_s below 0.83; it is 0.7",
        ),
        ('platoon.0.leader={law="path", profile="sinusoid", amplitude_mps=1.0}', "its upper half is cut off"),
        (
            'platoon.0.leader={law="path", speed_mps=10.0, profile="sinusoid", amplitude_mps=2.0, frequency_hz=0.5}',
            "needs 6.3 m/s2, and the vehicle has 4 m/s2 at 10 m/s",
        ),
        (
            'platoon.0.leader={law="path", speed_mps=1.0, profile="sinusoid", amplitude_mps=2.0, frequency_hz=0.02}',
            "the vehicle drives from 0 to 55.6 m/s",
        ),
    ],
)
def test_what_does_not_hold_is_said_once(change, said):
    texts = warnings(simulation.prepare(scenario.load("corridor_tracking", [change])))
    assert len(texts) == 1
    assert said in texts[0]


def test_a_network_without_lanes_inside_junctions_is_said():
    """There members give way to nobody; only `nets check` said so."""
    where = (
        f"sumo.net={ODD_NETS / 'bare.net.xml'}",
        'platoon.0.start={edge="wm", lane=1, position_m=60.0}',
        "platoon.0.to=me",
    )
    (text,) = warnings(simulation.prepare(scenario.load("corridor_tracking", where)))
    assert text.endswith(
        "no lanes inside junctions: members give way to nobody there; build it without no-internal-links"
    )


SIGN = '<variableSpeedSign id="s" lanes="west_light_0"><step time="0" speed="5"/></variableSpeedSign>'
CLOSED = '<rerouter id="r" edges="west_light"><interval begin="0" end="9"><{} id="{}"/></interval></rerouter>'


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (SIGN + SIGN, ["<variableSpeedSign>: members drive by the speed limits of the network"]),
        (CLOSED.format("closingReroute", "light_prio"), ["<closingReroute>: members keep the route"]),
        (CLOSED.format("parkingAreaReroute", "lot"), []),
    ],
)
def test_what_members_do_not_heed_is_said_once(tmp_path, content, said):
    (tmp_path / "more.add.xml").write_text(f"<additional>{content}</additional>")
    file = tmp_path / "signs.toml"
    file.write_text('[sumo]\nnet = "corridor"\nadditional = ["more.add.xml"]\n[[equip]]\nshare = 0.5\n')
    texts = warnings(simulation.prepare(scenario.load(file, ["run.duration_s=9"])))
    assert len(texts) == len(said)
    assert all(part in text for part, text in zip(said, texts, strict=True))


def test_a_configuration_without_lanes_inside_junctions_is_named_by_its_path(tmp_path):
    file = tmp_path / "bare.sumocfg"
    net = ODD_NETS / "bare.net.xml"
    file.write_text(f"<configuration><input><net-file value='{net}'/></input></configuration>")
    (text,) = warnings(simulation.prepare(scenario.load(file, ["equip.share=0.5", "run.duration_s=9"])))
    assert text.startswith(f"{file}: no lanes inside junctions")


def test_shipped_scenarios_ask_for_nothing_that_does_not_hold():
    for name in ("corridor_tracking", "highway_tracking"):
        assert not warnings(simulation.prepare(scenario.load(name)))
