"""The networks that tests generate are what they are said to be."""

from __future__ import annotations

import numpy as np
import pytest

from platoontraffic.cli.net_content import read
from platoontraffic.road.network import Network
from tests.support.generated import JUNCTIONS, LAYOUTS, generated, kinked, roundabouts


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layouts_have_roads_for_cars_and_lanes_as_asked_for(layout, generated_nets):
    network = Network.read(generated(generated_nets, layout, lanes=2))
    assert all(len(lengths) == 2 for lengths in network.edges.values())
    assert len(network.lanes_for_cars()) == 2 * len(network.edges) > 60


@pytest.mark.parametrize("junction", JUNCTIONS)
def test_junctions_are_of_the_type_asked_for(junction, generated_nets):
    text = generated(generated_nets, "grid", junction, 2).read_text()
    assert text.count(f'type="{junction}"') >= 4


def test_left_hand_networks_say_so(generated_nets):
    assert Network.read(generated(generated_nets, "grid", "priority", 1, "--lefthand")).left_hand


def test_the_same_arguments_give_the_same_bytes(generated_nets, tmp_path):
    for made in (lambda to: generated(to, "random", seed=3), lambda to: kinked(generated(to), 2.0, 5)):
        assert made(generated_nets).read_bytes() == made(tmp_path).read_bytes()


def test_roundabouts_are_known_to_sumo_and_can_be_driven_through(generated_nets):
    file = roundabouts(generated_nets, lanes=2)
    assert file.read_text().count("<roundabout ") == 3
    assert len(Network.read(file).fastest_route("i0.2", "o2.0")) >= 8


def test_kinks_leave_the_ends_of_lanes_and_shift_no_point_farther_than_asked_for(generated_nets):
    plain = generated(generated_nets, "random")
    shifted, plain = read(kinked(plain, 3.0, 1)).roads(), read(plain).roads()
    turned = []
    for name, edge in shifted.items():
        for lane, before in zip(edge.lanes, plain[name].lanes, strict=True):
            points, straight = np.array(lane.shape), np.array(before.shape)
            assert np.allclose(points[[0, -1]], straight[[0, -1]], atol=0.011)
            along = np.linspace(straight[:-1], straight[1:], 400).reshape(-1, 2)
            away = np.abs(points[:, None] - along).max(axis=2).min(axis=1)
            assert away.max() <= 3.0 + np.hypot(*np.diff(straight, axis=0).T).max() / 399 + 0.011
            assert lane.length == pytest.approx(np.hypot(*np.diff(points, axis=0).T).sum(), abs=0.03)
            headings = np.unwrap(np.arctan2(*np.diff(points, axis=0).T[::-1]))
            turned.append(np.abs(np.diff(headings)).max(initial=0.0))
    assert np.degrees(max(turned)) > 45
