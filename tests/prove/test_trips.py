"""Random trips for cars."""

import numpy as np
import pytest

from platoontraffic import shipped
from platoontraffic.errors import InputError
from platoontraffic.prove.trips import LONGEST, SHORTEST, Trip, _turns_back, draw
from platoontraffic.road.network import Line, Network
from platoontraffic.vehicles.catalogue import VEHICLES
from tests.support import ODD_NETS
from tests.support.generated import generated

CAR = VEHICLES["car"]


@pytest.fixture(scope="module")
def corridor() -> Network:
    return Network.read(shipped.networks()["corridor"])


def drawn(network: Network, count: int, seed: int = 1, room: float = CAR.length) -> list[Trip]:
    return draw(network, count, np.random.default_rng(seed), room=room, radius=CAR.turning_radius)


def test_trips_are_different_roads_of_the_wanted_length(corridor):
    trips = drawn(corridor, 12)
    assert len(trips) == len({(trip.edges, trip.lane) for trip in trips}) == 12
    for trip in trips:
        assert SHORTEST <= trip.length <= LONGEST + 50  # and what lies inside junctions
        assert CAR.length <= trip.position <= corridor.edges[trip.edges[0]][trip.lane]


def test_trips_follow_their_seed(corridor):
    one, again, other = ([trip.edges for trip in drawn(corridor, 6, seed)] for seed in (3, 3, 4))
    assert one == again != other


def test_where_all_routes_are_short_the_longest_are_taken():
    cross = Network.read(ODD_NETS / "cross.net.xml")
    trips = drawn(cross, 50)
    lengths = [trip.length for trip in trips if trip.length < SHORTEST]
    assert trips
    assert len(trips) < 50
    assert lengths == sorted(lengths, reverse=True)


def test_there_is_no_trip_without_a_lane_that_is_long_enough(corridor):
    with pytest.raises(InputError, match=r"no lane for cars is 5000\.0 m long"):
        drawn(corridor, 3, room=5000.0)


def test_trips_in_traffic_do_not_turn_back_round_blocks_that_are_too_small(generated_nets):
    network = Network.read(generated(generated_nets, "short", "priority", 1))
    given = {"room": CAR.length, "radius": CAR.turning_radius}
    every, fewer = (draw(network, 24, np.random.default_rng(1), **given, round_blocks=may) for may in (True, False))
    turn_back = [_turns_back(one.line, CAR.turning_radius) for one in every]
    assert any(turn_back)
    assert fewer
    assert not any(_turns_back(one.line, CAR.turning_radius) for one in fewer)


def triangle(side: float) -> np.ndarray:
    """From the west round a triangle to the left, and back west."""
    away = side / 2 * np.sqrt(3.0)
    return np.array([(-50.0, 0.0), (0.0, 0.0), (side, 0.0), (side / 2, away), (0.0, 0.0), (-50.0, 1.0)])


def test_no_trip_turns_back_round_a_block_that_is_too_small_for_a_car():
    assert _turns_back(triangle(7.0), CAR.turning_radius)
    assert not _turns_back(triangle(60.0), CAR.turning_radius)
    assert not _turns_back(triangle(7.0), 0.0)  # SUMO's own cars turn on the spot
    sharp = np.array([(0.0, 0.0), (50.0, 0.0), (20.0, 40.0)])
    assert not _turns_back(sharp, CAR.turning_radius)


def trip(*lines: Line) -> Trip:
    points, limit = np.array([(0.0, 0.0), (50.0, 0.0), (50.0, 60.0)]), np.array([10.0, 5.0, 5.0])
    return Trip(("a", "b"), 0, 20.0, points, limit, lines)


def test_the_time_of_a_trip_is_that_at_the_speed_limits():
    assert trip().length == 90.0
    assert trip().free_time(99.0) == 30 / 10 + 60 / 5
    assert trip().free_time(2.0) == 90 / 2


def test_the_lane_at_a_station_is_the_one_of_the_stop_lines():
    change = Line(20.0, "change", "", 0, "a_0", "a_1", (), 10.0)
    stop = Line(50.0, "M", "", 0, "a_1", "b_0", (":j_0_0",), 8.0)
    lanes = [trip(change, stop).lane_at(station) for station in (5.0, 30.0, 55.0, 58.5)]
    assert lanes == ["a_0", "a_1", ":j_0_0", "b_0"]
