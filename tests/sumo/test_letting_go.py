"""A vehicle of SUMO's that waits inside a junction for a member that stands goes, where it passes the member."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from platoontraffic.controllers import BRAKES_FOR
from platoontraffic.road.network import Network
from platoontraffic.sumo.client import libsumo as sumo
from platoontraffic.sumo.frame import centre_of
from platoontraffic.sumo.letting_go import AFTER, IGNORED, LettingGo
from tests.support.generated import crossroads

pytestmark = pytest.mark.sumo

STEP, LENGTH, WIDTH = 0.1, 5.0, 1.8
STANDS_AT = 20.0  # time from which the member stands before a body [s]


def fleet(x: float, y: float, reason: str = "obstacle") -> SimpleNamespace:
    """A member that stands with its front bumper at a place, and heads east."""
    limit = SimpleNamespace(reason=np.array([BRAKES_FOR.index(reason)]), creeps=np.zeros(1, bool))
    law = SimpleNamespace(braking_for=lambda memory: limit)
    centre = centre_of(x, y, 0.0, LENGTH)
    motion = SimpleNamespace(x=np.array([centre[0]]), y=np.array([centre[1]]), heading=np.zeros(1), speed=np.zeros(1))
    model = SimpleNamespace(length=np.array([LENGTH]), width=np.array([WIDTH]))
    group = SimpleNamespace(law=law, memory=0, rows=np.array([0]))
    return SimpleNamespace(ids=("member",), motion=motion, model=model, groups=(group,))


@pytest.fixture
def waiting(tmp_path):
    """The time at which a left-turner is through, where a member stands so far behind its stop line [m]."""
    net = crossroads(tmp_path)
    network = Network.read(net)

    def run(beyond: float, reason: str = "obstacle", seconds: float = 60.0, at_wait=None) -> float:
        sumo.start(["sumo", "-n", str(net), "--step-length", str(STEP), "--no-step-log", "--no-warnings",
                    "--time-to-teleport", "-1"])  # fmt: skip
        try:
            sumo.route.add("on", ["wc", "ce"])
            sumo.route.add("left", ["ec", "cs"])
            sumo.vehicle.add("member", "on", departLane="1", departPos="150")
            sumo.vehicle.add("turns", "left", departLane="1", departPos="120", departSpeed="10")
            sumo.trafficlight.setPhase("c", 2)
            sumo.simulationStep()
            sumo.vehicle.setSpeedMode("member", 48)
            y, letting_go = sumo.vehicle.getPosition("member")[1], LettingGo(sumo, network)
            x = sumo.lane.getLength("wc_1") + beyond
            for k in range(round(seconds / STEP)):
                where = {"member": (sumo.vehicle.getRoadID("member"), sumo.vehicle.getLaneID("member"))}
                letting_go.observe(
                    fleet(x, y, reason if k * STEP > STANDS_AT else ""), where, sumo.simulation.getTime()
                )
                sumo.vehicle.moveToXY("member", "", -1, x, y, 90, 2, 5)
                sumo.simulationStep()
                sumo.vehicle.setPreviousSpeed("member", 0.0)
                if at_wait and k * STEP > STANDS_AT:
                    return at_wait(letting_go)
                if sumo.vehicle.getRoadID("turns") == "cs":
                    letting_go.observe(fleet(x, y), where, sumo.simulation.getTime())
                    assert sumo.vehicle.getParameter("turns", IGNORED) == ""
                    return k * STEP
            return np.inf
        finally:
            sumo.close()

    return run


@pytest.mark.parametrize("beyond", [-1.0, 2.0, 5.0])
def test_it_goes_past_a_member_that_stands_before_a_body(waiting, beyond):
    assert STANDS_AT + AFTER < waiting(beyond) < STANDS_AT + AFTER + 8.0


def test_it_waits_for_a_member_that_stands_in_its_path(waiting):
    assert waiting(14.0) == np.inf


def test_it_waits_for_a_member_that_stands_for_another_reason(waiting):
    assert waiting(2.0, reason="line") == np.inf


@pytest.mark.parametrize(("gap", "passes"), [(0.5, True), (0.1, True), (-0.1, False)])
def test_it_passes_what_is_close_beside_its_tail(waiting, gap, passes):
    """To the right of it, away from which it turns."""

    def passing(letting_go: LettingGo) -> bool:
        (x, y), heading = sumo.vehicle.getPosition("turns"), np.radians(90 - sumo.vehicle.getAngle("turns"))
        ahead, left = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
        inner = sumo.vehicle.getWidth("turns") / 2 + gap
        corners = [(-LENGTH, inner), (-LENGTH + 1.0, inner), (-LENGTH + 1.0, inner + 1.0), (-LENGTH, inner + 1.0)]
        return letting_go._passes("turns", shapely.Polygon([(x, y) + s * ahead - d * left for s, d in corners]))

    assert waiting(2.0, at_wait=passing) == passes
