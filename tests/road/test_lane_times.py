"""Time lost on the lanes of a route, compared with what an enumeration of all sequences of lanes finds."""

from __future__ import annotations

import itertools
import math
import random
from types import SimpleNamespace

import pytest

from platoontraffic.road.lane_times import (
    CHANGE_COSTS,
    LITTLE_ROOM_COSTS,
    NO_CHANGE,
    QUEUE,
    LaneTimes,
    Queue,
    change_time,
)


class Edge(SimpleNamespace):
    __hash__ = object.__hash__


def edge(name: str, length: float, lanes: int, closed: int = -1) -> Edge:
    """closed: the lane that is not for cars"""
    made = [SimpleNamespace(getIndex=lambda k=k: k, allows=lambda _, k=k: k != closed) for k in range(lanes)]
    return Edge(getLength=lambda: length, getID=lambda: name, getLanes=lambda: made)


def link(lane: SimpleNamespace, onto: SimpleNamespace) -> SimpleNamespace:
    return SimpleNamespace(getFromLane=lambda: lane, getToLane=lambda: onto)


def road(edges: list[Edge], links: list[list[tuple[int, int]]]) -> list[Edge]:
    """The edges, with links from lane to lane between each and the next one."""
    for (here, there), pairs in zip(itertools.pairwise(edges), links, strict=True):
        made = [link(here.getLanes()[k], there.getLanes()[m]) for k, m in pairs]
        here.getAllowedOutgoing = lambda _, there=there, made=made: {there: made}
    return edges


def two_lanes(*lengths: float) -> list[Edge]:
    """Each lane leads to the same lane of the next edge; of the last but one, the right lane only."""
    edges = [edge("abcdef"[i], length, 2) for i, length in enumerate(lengths)]
    return road(edges, [[(0, 0), (1, 1)]] * (len(edges) - 2) + [[(0, 0)]])


def queues(times: dict[str, float], lengths: dict[str, float] | None = None):
    """Queues by lane, of times [s] and lengths [m]."""
    return lambda lane: Queue(times.get(lane, 0.0), (lengths or {}).get(lane, 0.0))


def test_without_queues_a_lane_costs_the_changes_that_it_needs():
    times = LaneTimes(two_lanes(200.0, 200.0, 200.0))
    assert times.leaving(0, queues({}), 0.0) == {0: 0.0, 1: CHANGE_COSTS}
    assert times.leaving(1, queues({}), 0.0) == {0: 0.0}


def test_a_queue_counts_where_it_is_within_reach():
    times, queued = LaneTimes(two_lanes(200.0, 200.0, 200.0, 200.0)), queues({"b_0": 30.0, "b_1": 3.0})
    # On b it takes the lane with the shorter queue, and changes lanes beyond; from the right lane it must cross twice.
    assert times.leaving(0, queued, 100.0) == {0: 3.0 + 2 * CHANGE_COSTS, 1: 3.0 + CHANGE_COSTS}
    assert times.leaving(0, queued, 0.0) == {0: 0.0, 1: CHANGE_COSTS}


def test_nobody_counts_on_a_change_to_a_lane_on_which_a_queue_stands():
    """One that passed the queue of its lane on the lane beside stood at its end for good, beside the next queue."""
    times = LaneTimes(two_lanes(200.0, 200.0, 200.0))
    assert times.leaving(0, queues({"a_0": 8.0, "b_0": QUEUE}), 100.0) == {0: 8.0 + QUEUE, 1: math.inf}


@pytest.mark.parametrize(
    ("length", "time"),
    [
        (0.0, CHANGE_COSTS),
        (160.0, CHANGE_COSTS + LITTLE_ROOM_COSTS / 2),
        (190.0, 16.0),  # it comes to the end of the queue at once, and waits in it
    ],
)
def test_there_is_room_to_leave_a_lane_before_its_queue_only(length, time):
    """A member counted on a change beside a queue that began at the begin of the edge, and stood before it for 66 s."""
    edges = [edge(name, 200.0, 2) for name in "abc"]
    times = LaneTimes(road(edges, [[(0, 0), (1, 1)]] * 2))
    assert times.leaving(0, queues({"b_1": 16.0}, {"b_1": length}), 100.0)[1] == pytest.approx(time)
    assert times.leaving(0, queues({"b_1": 0.9 * QUEUE}, {"b_1": length}), 100.0)[1] == pytest.approx(0.9 * QUEUE)


@pytest.mark.parametrize(
    ("lanes", "room", "time"),
    [
        (0, 0.0, 0.0),
        (1, 0.99 * NO_CHANGE, math.inf),
        (1, 1000.0, CHANGE_COSTS),
        (1, 40.0, CHANGE_COSTS + LITTLE_ROOM_COSTS / 2),
        (2, 80.0, 2 * (CHANGE_COSTS + LITTLE_ROOM_COSTS / 2)),
        (2, 1.99 * NO_CHANGE, math.inf),
    ],
)
def test_a_change_costs_more_where_there_is_little_room(lanes, room, time):
    assert change_time(lanes, room) == pytest.approx(time)


@pytest.mark.parametrize("seed", range(20))
def test_it_is_the_least_over_all_sequences_of_lanes(seed):
    rng = random.Random(seed)
    counts = [rng.randint(1, 3) for _ in range(5)]
    lengths = [rng.choice([15.0, 30.0, 60.0, 200.0]) for _ in counts]
    edges = [edge("abcde"[i], length, n) for i, (length, n) in enumerate(zip(lengths, counts, strict=True))]
    links = []
    for here, there in itertools.pairwise(counts):
        every = list(itertools.product(range(here), range(there)))
        links.append(rng.sample(every, rng.randint(1, len(every))))
    queue = {
        f"{one.getID()}_{k}": rng.choice([0.0, 2.0, rng.uniform(4, 20)])
        for one, n in zip(edges, counts, strict=True)
        for k in range(n)
    }
    taken_up = {name: rng.uniform(5.0, 190.0) for name in queue}
    reach = 1e3  # all queues count, but on the last edge, on which nobody queues for a next one

    expected = {k: math.inf for k, _ in links[0]}
    for taken in itertools.product(*links):
        time = sum(queue[f"{edges[i].getID()}_{k}"] for i, (k, _) in enumerate(taken))
        for i, ((_, onto), (leaves, _)) in enumerate(itertools.pairwise(taken)):
            entered = f"{edges[i + 1].getID()}_{onto}"
            room = lengths[i + 1] - (taken_up[entered] if queue[entered] >= QUEUE else 0.0)
            time += change_time(abs(onto - leaves), room)
            if onto != leaves and queue[f"{edges[i + 1].getID()}_{leaves}"] >= QUEUE:
                time = math.inf
        expected[taken[0][0]] = min(expected[taken[0][0]], time)

    assert LaneTimes(road(edges, links)).leaving(0, queues(queue, taken_up), reach) == pytest.approx(expected)
