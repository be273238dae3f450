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

    rows  : of the members, (m,), or (m, 1) where each knows k vehicles
    state : of the vehicle that each of them knows, (m,), or (m, k)
    age   : of that [s], likewise
    lost  : the member knows no vehicle, bool, likewise
    """
    x, y, heading, speed = (getattr(fleet.motion, name)[rows] for name in ("x", "y", "heading", "speed"))
    front, driven = fleet.model.length[rows] / 2, state.speed * age
    cos, sin = np.cos(heading), np.sin(heading)
    dx = state.x + driven * np.cos(state.heading) - (x + front * cos)
    dy = state.y + driven * np.sin(state.heading) - (y + front * sin)
    gap = np.copysign(np.hypot(dx, dy), dx * cos + dy * sin)
    values = gap, state.speed - speed, state.speed, state.acceleration, state.demand, age
    return Neighbour(*(np.where(lost, np.nan, value) for value in values), lost)


def known_by(fleet: Fleet, rows: np.ndarray, needs: frozenset[str]) -> Known:
    """The predecessors of some members, and the leaders or all members if needed, without errors."""
    state = State.of(fleet)

    def known(rows: np.ndarray, other: np.ndarray) -> Neighbour:
        return seen_by(fleet, rows, State(*(values[other] for values in state)), np.zeros(other.shape), other < 0)

    heads, places = chains(fleet)
    leaders = np.where(places > 0, heads, -1)[rows]
    found = Known(
        known(rows, fleet.predecessor[rows]), known(rows, leaders) if "leader" in needs else None, places[rows]
    )
    if "members" not in needs:
        return found
    others, ahead = others_of(heads, places)
    return found._replace(members=known(rows[:, None], others[rows]), ahead=ahead[rows])


def others_of(heads: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each member and each row: that row if it is another member of its chain, or -1; vehicles to it, (n, n)."""
    rows = np.arange(len(heads))
    same = (heads[:, None] == heads) & (rows[:, None] != rows)
    return np.where(same, rows, -1), np.where(same, places[:, None] - places, 0)


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


def nothing_known(n: int, needs: frozenset[str]) -> Known:
    """n vehicles that know no other."""
    nothing = Neighbour(*np.full((6, n), np.nan), np.ones(n, bool))
    none = Neighbour(*np.full((6, n, 0), np.nan), np.ones((n, 0), bool))
    found = Known(nothing, nothing if "leader" in needs else None, np.zeros(n, int))
    return found._replace(members=none, ahead=np.zeros((n, 0), int)) if "members" in needs else found
