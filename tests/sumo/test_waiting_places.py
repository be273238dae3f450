"""Vehicles that are kept from driving on inside a junction."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from platoontraffic.sumo.letting_in import OWN_DRIVER, speed_to_stop
from platoontraffic.sumo.waiting_places import WaitingPlaces
from platoontraffic.sumo.world import World

STEP = 0.1


@pytest.mark.parametrize(("speed", "room"), [(8.0, 8.0), (8.0, 20.0), (3.0, 1.0), (0.0, 0.0)])
def test_a_vehicle_stops_within_its_room_as_gently_as_it_may(speed, room):
    place, hardest = 0.0, 0.0
    for _ in range(300):
        told = speed_to_stop(speed, room - place, 4.5, STEP)
        new = min(speed + 2.6 * STEP, 8.0) if told == OWN_DRIVER else told
        hardest = max(hardest, (speed - new) / STEP)
        speed, place = new, place + new * STEP
    assert place == pytest.approx(room, abs=0.05)
    assert hardest <= 4.5 + 1e-9


def test_they_drive_on_when_nobody_comes_any_more():
    speeds, told = {"a": 5.0, "b": 5.0, "gone": 5.0}, []

    class Gone(Exception):
        pass

    def set_speed(name: str, speed: float) -> None:
        if name not in speeds:
            raise Gone
        told.append((name, speed))

    vehicle = SimpleNamespace(getSpeed=speeds.__getitem__, setSpeed=set_speed)
    places = WaitingPlaces(SimpleNamespace(vehicle=vehicle, TraCIException=Gone), STEP)
    places.observe({"a": 2.0, "b": 1e3, "gone": 2.0})
    assert [(name, speed == OWN_DRIVER) for name, speed in told] == [("a", False), ("b", True), ("gone", False)]
    del speeds["gone"], told[:]
    places.observe({"b": 2.0})
    assert [(name, speed == OWN_DRIVER) for name, speed in told] == [("a", True), ("b", False)]
    del told[:]
    places.observe({})
    places.observe({})
    assert told == [("b", OWN_DRIVER)]


def test_who_stands_while_a_member_drives_round_it_stays():
    speeds, told = {"stands": 0.0, "drives": 2.0}, {}

    class Unknown(Exception):
        pass

    def speed_of(name: str) -> float:
        if name not in speeds:
            raise Unknown
        return speeds[name]

    vehicle = SimpleNamespace(getSpeed=speed_of, setSpeed=told.__setitem__)
    places = WaitingPlaces(SimpleNamespace(vehicle=vehicle, TraCIException=Unknown), STEP)
    places.observe({}, {"stands", "drives", "wall"})
    assert told == {"stands": 0.0}
    places.observe({})
    assert told == {"stands": OWN_DRIVER}


def test_the_world_asks_that_of_all_but_members():
    """And those that are told to stop, and obstacles, let nobody in; for obstacles nobody waits, and they stay."""
    asked, let_in, apart = [], [], []
    world = World.__new__(World)
    world._letting_go = SimpleNamespace(observe=lambda *_: None)
    world._obstacles = SimpleNamespace(in_sumo={"cone"})
    world._first_on_lanes = SimpleNamespace(room_wanted=lambda *_: {"bus": "room", "cone": "room"})
    world._letting_in = SimpleNamespace(observe=lambda *given: let_in.append(given))
    world._lines = SimpleNamespace(waiting_places={"c": 3.0}, room_wanted={}, over_line={}, heedless={"native"})
    world._placement = SimpleNamespace(where={"m.0": ("road", "road_0")}, place=lambda *_: None)
    world._waiting_places = SimpleNamespace(observe=lambda *given: asked.append(given) or {"c"})
    world._lane_swaps = SimpleNamespace(observe=lambda *given: apart.append(given[-1]))
    world._clock = 0.0
    world.place(SimpleNamespace(ids=("m.0",), places={"m.1": ("m", 1)}), None, {"bus", "m.0"})
    assert asked == [({"c": 3.0}, {"bus"})]
    assert let_in == [({"bus": "room"}, {"m.0": ("road", "road_0")}, {"cone", "c", "native"}, {"m.1": ("m", 1)})]
    assert apart == [{"cone"}]
