"""SUMO in other processes: several worlds at once, each with the results that it has alone."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from platoontraffic import shipped
from platoontraffic.controllers.reactive import ReactiveLeader
from platoontraffic.errors import InputError, RunError
from platoontraffic.lidar import PRESETS
from platoontraffic.road.network import Network
from platoontraffic.sumo.remote import RemoteSumo
from platoontraffic.sumo.world import World
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.traffic import TrafficSnapshot

pytestmark = pytest.mark.sumo

STEP, STEPS = 0.1, 60
SPEED = 5.0  # of members, straight on [m/s]


@pytest.fixture
def remote():
    pytest.importorskip("sumo", reason="the program sumo comes with eclipse-sumo: pip install platoontraffic[gui]")
    return RemoteSumo


class Scene:
    """A car among the traffic of a shipped network, straight on from a position on an edge."""

    def __init__(self, net: str, edge: str, position: float, seed: int, folder: Path, client=None) -> None:
        file = shipped.networks()[net]
        network = Network.read(file)
        options = {"route-files": str(file.parent / f"{net}.rou.xml")}
        if (more := file.parent / f"{net}.add.xml").exists():
            options["additional-files"] = str(more)
        log = folder / f"{net}.{seed}.{client is None}.log"
        self.world = World(network, STEP, seed, log, options, warm_up=60.0, client=client)
        x, y, heading = network.lane_pose(edge, 0, position)
        car = VEHICLES["car"]
        pose = (x - car.length / 2 * np.cos(heading), y - car.length / 2 * np.sin(heading), heading)
        self._member = Member("m.0", "m", 0, car, PRESETS["car-leader"], ReactiveLeader(), edge, 0, position, pose)
        self.seen: list[TrafficSnapshot] = []

    def deploy(self) -> None:
        self._fleet = self.world.deploy(Fleet.deployed([self._member], STEP))

    def step(self) -> None:
        motion = self._fleet.motion
        motion.x[:] += SPEED * STEP * np.cos(motion.heading)
        motion.y[:] += SPEED * STEP * np.sin(motion.heading)
        self.world.place(self._fleet)
        self._fleet = self.world.advance(self._fleet)
        self.seen.append(self.world.snapshot(self._fleet))


RING = ("ring", "east_north", 60.0, 1)
CORRIDOR = ("corridor", "west_light", 60.0, 2)


def played(*scenes: Scene) -> list[list[TrafficSnapshot]]:
    """Snapshots of worlds that are stepped in turn."""
    with ExitStack() as worlds:
        for scene in scenes:
            worlds.enter_context(scene.world)
            scene.deploy()
        for _ in range(STEPS):
            for scene in scenes:
                scene.step()
    return [scene.seen for scene in scenes]


def same(one: list[TrafficSnapshot], other: list[TrafficSnapshot]) -> bool:
    return all(
        a.ids == b.ids and all(np.array_equal(getattr(a, name), getattr(b, name)) for name in ("x", "y", "speed"))
        for a, b in zip(one, other, strict=True)
    )


def test_two_remote_worlds_are_each_as_alone_in_libsumo(remote, tmp_path):
    together = played(Scene(*RING, tmp_path, remote()), Scene(*CORRIDOR, tmp_path, remote()))
    alone = [played(Scene(*which, tmp_path))[0] for which in (RING, CORRIDOR)]
    for one, other in zip(together, alone, strict=True):
        assert len(one[-1].ids) > 5
        assert same(one, other)


def test_two_remote_worlds_of_one_network_differ_by_their_seeds(remote, tmp_path):
    net, edge, position, seed = RING
    one, other = played(Scene(*RING, tmp_path, remote()), Scene(net, edge, position, seed + 1, tmp_path, remote()))
    assert not same(one, other)


def test_a_remote_world_runs_beside_one_in_libsumo(remote, tmp_path):
    both = played(Scene(*RING, tmp_path), Scene(*RING, tmp_path, remote()))
    assert same(*both)


def test_a_refused_network_is_reported_in_sumos_words(remote, tmp_path):
    broken = tmp_path / "broken.net.xml"
    text = shipped.networks()["lab_loop"].read_text().replace('type="priority"', 'type="no_such_type"')
    broken.write_text(text)
    with pytest.raises(InputError, match="SUMO refuses it: Attribute 'type' in definition of junction"):
        World(Network.read(broken), STEP, 1, tmp_path / "words.log", client=remote()).__enter__()


def test_refused_routes_are_reported_in_sumos_words(remote, tmp_path):
    routes = tmp_path / "x.rou.xml"
    routes.write_text('<routes><vehicle id="a" depart="0"><route edges="nope"/></vehicle></routes>')
    network, options = Network.read(shipped.networks()["ring"]), {"route-files": str(routes)}
    with pytest.raises(InputError, match="edge 'nope'"):
        World(network, STEP, 1, tmp_path / "words.log", options, client=remote()).__enter__()


def test_a_remote_sumo_that_dies_is_an_error(remote, tmp_path):
    client = remote()
    scene = Scene(*RING, tmp_path, client)

    def dies() -> None:
        with scene.world:
            scene.deploy()
            client._process.kill()
            scene.step()

    with pytest.raises(RunError, match="SUMO failed at its end"):
        dies()
