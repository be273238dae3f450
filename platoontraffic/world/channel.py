"""Messages between members: rate, delay, loss, range and blackouts of the table `[channel]` of a scenario.

Each member sends its state at the channel's rate to the members that have a law which needs it: its direct follower;
all behind it, if it leads; any of its platoon, where the law needs all members. A message is lost if any of these says
so: an independent draw; a burst, by the two-state chain of E. N. Gilbert (Bell Syst. Tech. J. 39 (1960) 1253) that
loses every message in its bad state; the distance; a building between the two; a blackout. Draws depend on seed,
sender, receiver and number of the message only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely

from platoontraffic.controllers.law import Known, Neighbour
from platoontraffic.lidar.noise import GOLDEN, mixed, scan_keys, sensor_keys, uniform
from platoontraffic.scenario import Channel
from platoontraffic.vehicles.records import changed
from platoontraffic.world.events import Noted
from platoontraffic.world.fleet import Fleet, Member, Radio
from platoontraffic.world.neighbours import State, chains, others_of, seen_by

PREDECESSOR, LEADER, MEMBERS = range(3)  # columns of links: the two, and from MEMBERS on all members by number
LOST, NEVER = np.iinfo(int).max, -1


class Batch(NamedTuple):
    """The messages sent at one instant, by number of the receiver, on k links each: arrays (N, k)."""

    time: float  # [s]
    sender: np.ndarray  # number; NEVER: none
    arrives: np.ndarray  # step; LOST: never
    state: np.ndarray  # fields of `State`, (6, N, k)


class Messages:
    """All messages of a run. Arrays (N, k): of all members by number, on links from predecessor and leader, and from
    all N members once a law needs them."""

    def __init__(
        self, channel: Channel | None, members: Sequence[Member], dt: float, seed: int, solids: shapely.Geometry | None
    ) -> None:
        shape = len(members), MEMBERS
        self._channel, self._ids, self._dt, self._seed = channel, [m.id for m in members], dt, seed
        self._solids = solids if channel and channel.blocked_by_buildings else None
        self._flying: list[Batch] = []
        self._sender = np.full(shape, NEVER)
        self._sent = np.full(shape, np.nan)  # time of the newest message that has arrived [s]
        self._since = np.zeros(shape)  # time since which this sender is heard [s]
        self._state = np.full((len(State._fields), *shape), np.nan)  # in that message
        self._bad, self._down = np.zeros((2, *shape), bool)

    def extend(self, newcomers: Sequence[Member]) -> None:
        """Further members of the run, with the numbers that come next."""
        self._ids += [m.id for m in newcomers]
        self._grow(all_members=self._sender.shape[1] > MEMBERS)

    def _grow(self, all_members: bool) -> None:
        """Room for all ids, and for links from all of them."""
        shape = len(self._ids), MEMBERS + (len(self._ids) if all_members else 0)
        self._sender, self._sent = _padded(self._sender, shape, NEVER), _padded(self._sent, shape, np.nan)
        self._since, self._state = _padded(self._since, shape, 0.0), _padded(self._state, shape, np.nan)
        self._bad, self._down = _padded(self._bad, shape, False), _padded(self._down, shape, False)
        self._flying = [
            Batch(time, _padded(sender, shape, NEVER), _padded(arrives, shape, LOST), _padded(state, shape, np.nan))
            for time, sender, arrives, state in self._flying
        ]

    def received(self, fleet: Fleet, step: int, time: float) -> tuple[Known | None, Fleet, list[Noted]]:
        """What all members have received by now, the fleet with ages and losses of messages, and what has happened.

        time: of this step [s]
        """
        channel = self._channel
        if channel is None:
            return None, fleet, []
        number, (heads, places) = fleet.number, chains(fleet)
        if self._sender.shape[1] == MEMBERS and any("members" in group.law.needs for group in fleet.groups):
            self._grow(all_members=True)
        senders = self._links(fleet, heads, places)
        self._begin(number, np.where(senders < 0, NEVER, number[senders]), time)
        lost = np.full(len(fleet), np.nan)
        every = round(1 / (channel.rate_hz * self._dt))
        if step % every == 0:
            lost = self._send(fleet, senders, step, step // every, time)
        self._deliver(step)
        age = time - self._sent[number]
        silent = np.where(np.isnan(age), time - self._since[number], age) > channel.silence_s + 1e-9
        heard = senders >= 0
        noted = self._noted(fleet, senders, silent & heard, time)
        unknown = ~heard | silent | np.isnan(age)
        rows, state = np.arange(len(fleet)), self._state[:, number]

        def known(rows: np.ndarray, links: int | np.ndarray) -> Neighbour:
            return seen_by(fleet, rows, State(*state[:, :, links]), age[:, links], unknown[:, links])

        found = Known(known(rows, PREDECESSOR), known(rows, LEADER), places)
        if age.shape[1] > MEMBERS:
            others, ahead = known(rows[:, None], MEMBERS + number), others_of(heads, places)[1]
            found = found._replace(members=others, ahead=ahead)
        fleet = changed(fleet, radio=Radio(np.where(heard[:, 0], age[:, 0], np.nan), lost))
        return found, fleet, noted

    def _links(self, fleet: Fleet, heads: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Rows of the members that each receives from, -1: none, (n, k)."""
        needs = [m.law.needs if "messages" in m.law.needs else frozenset() for m in fleet.members]
        senders = np.full((len(fleet), self._sender.shape[1]), -1)
        predecessor, leader, members = (
            np.array([name in some for some in needs], dtype=bool) for name in ("messages", "leader", "members")
        )
        senders[:, PREDECESSOR] = np.where(predecessor, fleet.predecessor, -1)
        senders[:, LEADER] = np.where((places > 0) & leader, heads, -1)
        if senders.shape[1] > MEMBERS:
            senders[:, MEMBERS + fleet.number] = np.where(members[:, None], others_of(heads, places)[0], -1)
        return senders

    def _begin(self, number: np.ndarray, sender: np.ndarray, time: float) -> None:
        """Links to other senders than before begin anew."""
        rows, kinds = np.nonzero(self._sender[number] != sender)
        at = number[rows], kinds
        self._sender[at], self._sent[at], self._since[at], self._down[at] = sender[rows, kinds], np.nan, time, False
        self._state[:, at[0], at[1]] = np.nan
        if len(rows):
            self._bad[at] = self._draws(self._sender[at], at[0], 0, 2) < self._channel.burst_loss

    def _send(self, fleet: Fleet, senders: np.ndarray, step: int, message: int, time: float) -> np.ndarray:
        """Send a message on each link; 1 where that of the predecessor is lost, else 0, NaN: there is none, (n,)."""
        channel, (rows, kinds) = self._channel, np.nonzero(senders >= 0)
        sent = Batch(time, np.full_like(self._sender, NEVER), np.full_like(self._sender, LOST), self._state.copy())
        sender, at = senders[rows, kinds], (fleet.number[rows], kinds)
        draw, later, chain = (self._draws(fleet.number[sender], at[0], message + 1, k) for k in range(3))
        begins, ends = channel.burst_begins, 1 / channel.burst_length
        bad = self._bad[at] = np.where(self._bad[at], chain >= ends, chain < begins)
        lost = bad | (draw < channel.loss) | self._blocked(fleet, rows, sender, time)
        delay = channel.latency_s + channel.jitter_s * later
        sent.sender[at] = fleet.number[sender]
        sent.arrives[at] = np.where(lost, LOST, step + np.ceil(delay / self._dt - 1e-6).astype(int))
        sent.state[:, at[0], at[1]] = np.array(State.of(fleet))[:, sender]
        self._flying.append(sent)
        found = np.full(len(fleet), np.nan)
        found[rows[kinds == PREDECESSOR]] = lost[kinds == PREDECESSOR]
        return found

    def _blocked(self, fleet: Fleet, rows: np.ndarray, sender: np.ndarray, time: float) -> np.ndarray:
        """Messages to members (m,) from others (m,) that distance, buildings or blackouts stop, bool (m,)."""
        at = np.stack([fleet.motion.x, fleet.motion.y], axis=1)
        lost = np.linalg.norm(at[rows] - at[sender], axis=1) > (self._channel.range_m or math.inf)
        if self._solids is not None:
            lost |= shapely.intersects(shapely.linestrings(np.stack([at[rows], at[sender]], axis=1)), self._solids)
        for one in self._channel.blackout:
            if one.time_s - 1e-9 <= time < one.time_s + one.lasts_s - 1e-9:
                of = [one.sender in (None, fleet.ids[i]) and one.receiver in (None, fleet.ids[k])
                      for i, k in zip(sender, rows, strict=True)]  # fmt: skip
                lost |= np.array(of, dtype=bool)
        return lost

    def _draws(self, sender: np.ndarray, receiver: np.ndarray, message: int, kind: int) -> np.ndarray:
        """Uniform numbers of links, given by numbers of members (m,), (m,)."""
        links = tuple(f"{self._ids[i]} {self._ids[k]}" if i >= 0 else "" for i, k in zip(sender, receiver, strict=True))
        keys = scan_keys(sensor_keys(self._seed, links, "messages"), message)
        return uniform(mixed(keys + np.uint64(kind * int(GOLDEN) % 2**64)))

    def _deliver(self, step: int) -> None:
        for batch in self._flying:
            newer = ~(batch.time <= self._sent)
            at = np.nonzero((batch.arrives == step) & (batch.sender == self._sender) & newer)
            self._sent[at], self._state[:, at[0], at[1]] = batch.time, batch.state[:, at[0], at[1]]
        self._flying = [b for b in self._flying if ((b.arrives > step) & (b.arrives < LOST)).any()]

    def _noted(self, fleet: Fleet, senders: np.ndarray, silent: np.ndarray, time: float) -> list[Noted]:
        """Links of predecessors and leaders that have fallen silent, and those on which messages arrive again."""
        noted, number, silent = [], fleet.number, silent[:, :MEMBERS]
        before = self._down[number, :MEMBERS]
        for row, kind in zip(*np.nonzero(silent != before), strict=True):
            other, link = senders[row, kind], (number[row], kind)
            if silent[row, kind]:
                last = self._since[link] if np.isnan(self._sent[link]) else self._sent[link]
                self._since[link] = last
            if kind == LEADER and other == senders[row, PREDECESSOR]:
                continue
            name = fleet.ids[other] if other >= 0 else ""
            if silent[row, kind]:
                noted.append(Noted(row, "radio_lost", f"no message of {name} for {time - last:.2f} s", other=name))
            else:
                lasted = time - self._since[link]
                noted.append(Noted(row, "radio_back", f"after {lasted:.2f} s", lasted, other=name))
        self._down[number, :MEMBERS] = silent
        return noted


def _padded(array: np.ndarray, shape: tuple[int, int], value: float) -> np.ndarray:
    """A copy whose last two axes are as long as `shape`, with a value in what is new."""
    larger = np.full((*array.shape[:-2], *shape), value, array.dtype)
    larger[..., : array.shape[-2], : array.shape[-1]] = array
    return larger
