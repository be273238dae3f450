"""The members ahead of a member: where they are and how they move, without errors."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from platoontraffic.controllers.law import Known, Neighbour

Fleet = Any  # that of `fleet`, which imports this file


class State(NamedTuple):
    """What a member can say of itself, arrays (n,)."""

    x: np.ndarray  # middle of its rear bumper [m]
    y: np.ndarray
    heading: np.ndarray  # [rad]
    speed: np.ndarray  # [m/s]
    acceleration: np.ndarray  # [m/s2]
    demand: np.ndarray  # the acceleration that it last commanded [m/s2]; its acceleration, where it commands a speed

    @classmethod
    def of(cls, fleet: Fleet) -> State:
        motion, back = fleet.motion, fleet.model.length / 2
        x, y = motion.x - back * np.cos(motion.heading), motion.y - back * np.sin(motion.heading)
        demand = fleet.command.drive.acceleration
        demand = np.where(np.isnan(demand), motion.acceleration, demand)
        return cls(x, y, motion.heading, motion.speed, motion.acceleration, demand)


def seen_by(fleet: Fleet, rows: np.ndarray, state: State, age: np.ndarray, lost: np.ndarray) -> Neighbour:
    """Other vehicles as members know them by states of some age; a vehicle is taken to have kept its speed since.

    rows  : of the members, (m,)
    state : of the vehicle that each of them knows, (m,)
    age   : of that [s], (m,)
    lost  : the member knows no vehicle, bool (m,)
    """
    x, y, heading, speed = (getattr(fleet.motion, name)[rows] for name in ("x", "y", "heading", "speed"))
    front, driven = fleet.model.length[rows] / 2, state.speed * age
    cos, sin = np.cos(heading), np.sin(heading)
    dx = state.x + driven * np.cos(state.heading) - (x + front * cos)
    dy = state.y + driven * np.sin(state.heading) - (y + front * sin)
    gap = np.copysign(np.hypot(dx, dy), dx * cos + dy * sin)
    values = gap, state.speed - speed, state.speed, state.acceleration, state.demand, age
    return Neighbour(*(np.where(lost, np.nan, value) for value in values), lost)


def known_by(fleet: Fleet, rows: np.ndarray, leader: bool) -> Known:
    """The predecessors of some members, and the leaders if wanted, without errors."""
    state, now = State.of(fleet), np.zeros(len(rows))

    def known(other: np.ndarray) -> Neighbour:
        return seen_by(fleet, rows, State(*(values[other] for values in state)), now, other < 0)

    heads, places = chains(fleet)
    leaders = np.where(places > 0, heads, -1)[rows]
    return Known(known(fleet.predecessor[rows]), known(leaders) if leader else None, places[rows])


def chains(fleet: Fleet) -> tuple[np.ndarray, np.ndarray]:
    """Row of the first vehicle in each member's chain of predecessors, and the number of vehicles to it, (n,)."""
    head, places = np.arange(len(fleet)), np.zeros(len(fleet), int)
    for _ in range(len(fleet)):
        ahead = fleet.predecessor[head]
        if (ahead < 0).all():
            break
        places += ahead >= 0
        head = np.where(ahead < 0, head, ahead)
    return head, places


def nothing_known(n: int, leader: bool) -> Known:
    """n vehicles that know no other."""
    nothing = Neighbour(*np.full((6, n), np.nan), np.ones(n, bool))
    return Known(nothing, nothing if leader else None, np.zeros(n, int))
