"""Messages: delay, loss and its statistics, blackouts, and what laws do without them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import shapely

from platoontraffic import scenario
from platoontraffic.controllers.acc import ConstantTimeHeadway
from platoontraffic.controllers.cacc_ploeg import PloegFollower
from platoontraffic.controllers.consensus import ConsensusFollower
from platoontraffic.errors import InputError
from platoontraffic.scenario.overrides import Change, branch_of
from platoontraffic.scenario.tables import Blackout, Channel
from platoontraffic.simulation import Setting, Simulation
from platoontraffic.vehicles.motion import Drive
from platoontraffic.world.channel import Messages
from platoontraffic.world.fleet import Fleet
from platoontraffic.world.neighbours import known_by
from tests.controllers.test_field_laws import CAR, EYE
from tests.support.bench import BLIND, NO_WALLS, Prescribed, platoon
from tests.support.runs import run

DT = 0.1
LAW = PloegFollower()


def members(law=LAW, count: int = 3, at=lambda time: (0.0, 0.0)):
    distance = float(law.desired_distance(20.0)) + 0.03
    leader, eye = Prescribed(lambda time: Drive(*at(time))), replace(BLIND, rate=10.0)
    return platoon(leader, law, count, distance=distance, model=CAR, leader_eye=eye, eye=EYE, speed=20.0)


def deaf(channel: Channel, steps: int, some=None, seed: int = 1, solids=None) -> np.ndarray:
    """Which messages of predecessors are lost, of cars that stand, (steps, followers) bool."""
    some = some or members()
    fleet = Fleet.deployed(some, DT)
    messages = Messages(channel, some, DT, seed, solids)
    lost = []
    for step in range(steps):
        _, fleet, _ = messages.received(fleet, step, step * DT)
        lost.append(fleet.radio.lost)
    return np.array(lost)[:, [i for i, m in enumerate(some) if m.place]] == 1.0


def test_independent_loss_is_binomial():
    p, n = 0.3, 8_000
    lost = deaf(Channel(loss=p), n)
    assert lost.mean(axis=0) == pytest.approx(p, abs=4 * math.sqrt(p * (1 - p) / n))
    both = lost[1:] & lost[:-1]  # and one loss says nothing of the next, or of another link
    assert both.mean() == pytest.approx(p * p, abs=4 * p / math.sqrt(n))
    assert (lost[:, 0] & lost[:, 1]).mean() == pytest.approx(p * p, abs=4 * p / math.sqrt(n))


@pytest.mark.slow
def test_bursts_have_the_stationary_loss_and_the_length_of_the_chain():
    share, mean, n = 0.2, 4.0, 60_000
    lost = deaf(Channel(burst_loss=share, burst_length=mean), n, members(count=1))[:, 0]
    edges = np.flatnonzero(np.diff(lost.astype(int)))
    lengths = np.diff(edges)[0 if lost[edges[0] + 1] else 1 :: 2]  # of the bursts
    spread = math.sqrt((1 - share) * share / n * (2 * mean - 1))  # the chain's memory lengthens the error of the mean
    assert lost.mean() == pytest.approx(share, abs=4 * spread)
    # chi-squared of lengths 1 to 11 and longer against the geometric distribution: 11 degrees of freedom, 0.1 %
    expected = np.append((1 / mean) * (1 - 1 / mean) ** np.arange(11), (1 - 1 / mean) ** 11) * len(lengths)
    found = np.bincount(np.minimum(lengths, 12), minlength=13)[1:]
    assert ((found - expected) ** 2 / expected).sum() < 31.3
    assert lengths.mean() == pytest.approx(mean, abs=4 * math.sqrt(mean * (mean - 1) / len(lengths)))


def test_equal_seeds_give_equal_losses_whatever_the_order_of_members():
    channel, some = Channel(loss=0.2, burst_loss=0.2), members()
    one, reverse = deaf(channel, 300, some), deaf(channel, 300, some[::-1])
    assert (one == reverse[:, ::-1]).all()
    assert (one != deaf(channel, 300, some, seed=2)).any()
    assert (one[:, 0] == deaf(channel, 300, members(count=1))[:, 0]).all()  # nor does another link matter


def heard(channel: Channel, steps: int = 40, law=LAW, at=lambda time: (1.0, 0.0)):
    """Simulated instants with what was received, after each step."""
    some, found = members(law, 2, at), []
    with Simulation(Setting(some, NO_WALLS, DT, steps=steps, channel=channel)) as simulation:
        for now in simulation:
            found.append(now)
    return found


@pytest.mark.parametrize(("latency", "steps"), [(0.0, 0), (0.05, 1), (0.1, 1), (0.25, 3)])
def test_a_message_is_used_in_the_first_step_after_its_latency(latency, steps):
    ages = np.array([now.fleet.radio.age for now in heard(Channel(latency_s=latency))])
    assert np.isnan(ages[:steps, 1:]).all()
    assert ages[steps:, 1:] == pytest.approx(steps * DT)
    assert np.isnan(ages[:, 0]).all()


def test_ages_of_slower_messages_are_a_saw_tooth():
    ages = np.array([now.fleet.radio.age[1] for now in heard(Channel(rate_hz=2.0, latency_s=0.2))])
    assert ages[2:12] == pytest.approx([0.2, 0.3, 0.4, 0.5, 0.6] * 2)


def test_jitter_makes_later_messages_overtake_and_ages_never_come_down_to_older_ones():
    nows = heard(Channel(jitter_s=0.55), 200)
    sent = np.array([now.traffic.time - now.fleet.radio.age[1] for now in nows])
    known = ~np.isnan(sent)
    assert (np.diff(sent[known]) > -1e-9).all()
    assert 0.0 <= (np.arange(len(sent)) * DT - sent)[known].min() < 0.15
    assert 0.2 < (np.arange(len(sent)) * DT - sent)[known].max() <= 0.6 + 1e-9


def test_a_member_that_comes_later_hears_its_predecessor_while_messages_are_under_way():
    three = members(count=2)
    messages = Messages(Channel(latency_s=0.3), three[:2], DT, 1, None)
    two, all_three = Fleet.deployed(three[:2], DT), Fleet.deployed(three, DT)
    for step in range(5):
        messages.received(two, step, step * DT)
    messages.extend(three[2:])
    ages = [messages.received(all_three, step, step * DT)[1].radio.age for step in range(5, 10)]
    assert [age[1] for age in ages] == pytest.approx([0.3] * 5)
    assert np.isnan([age[2] for age in ages[:3]]).all()
    assert [age[2] for age in ages[3:]] == pytest.approx([0.3] * 2)


def test_a_law_that_needs_all_members_hears_those_ahead_and_behind_alone_or_with_newcomers():
    law, channel = ConsensusFollower(hears="all"), Channel(latency_s=0.3)
    four = members(law, count=3)
    messages, truth = Messages(channel, four[:3], DT, 1, None), law.needs | {"truth"}
    fleets = [Fleet.deployed(four[:3], DT), Fleet.deployed(four, DT)]
    for step in range(5):
        messages.received(fleets[0], step, step * DT)
    messages.extend(four[3:])
    for step in range(5, 10):
        known, _, _ = messages.received(fleets[1], step, step * DT)
    exact = known_by(fleets[1], np.arange(4), truth)
    assert known.ahead[1:].tolist() == exact.ahead[1:].tolist() == [[1, 0, -1, -2], [2, 1, 0, -1], [3, 2, 1, 0]]
    assert (known.members.lost[1:] == np.eye(4, dtype=bool)[1:]).all()
    assert known.members.lost[0].all()  # the leader's law needs no messages
    others = ~known.members.lost
    assert known.members.age[others] == pytest.approx(0.3)
    carried = 20.0 * 0.3  # by the speed sent, of cars that stay here
    assert known.members.gap[others] == pytest.approx(exact.members.gap[others] + carried)


@pytest.mark.parametrize("law", [LAW, ConsensusFollower(hears="all")])
def test_the_last_member_may_leave_the_road(law):
    some, none = members(law, count=1), np.zeros(0, int)
    fleet, messages = Fleet.deployed(some, DT), Messages(Channel(latency_s=0.3), some, DT, 1, None)
    messages.received(fleet, 0, 0.0)
    known, _, noted = messages.received(fleet.without({m.id for m in some}), 1, DT)
    assert (known.place.tolist(), known.predecessor.gap.tolist(), noted) == (none.tolist(), [], [])


def test_links_to_all_members_lose_messages_apart_and_whatever_the_order():
    law, channel = ConsensusFollower(hears="all"), Channel(loss=0.5)

    def losses(some) -> np.ndarray:
        fleet, messages, found = Fleet.deployed(some, DT), Messages(channel, some, DT, 1, None), []
        order = np.argsort([m.id for m in some])
        for step in range(400):
            known, fleet, _ = messages.received(fleet, step, step * DT)
            found.append((known.members.age == 0)[order][:, order])
        return np.array(found)

    some = members(law, count=3)
    one = losses(some)
    assert (one == losses(some[::-1])).all()
    followers = [i for i, m in enumerate(sorted(some, key=lambda m: m.id)) if m.place]
    links = np.array([one[:, i, k] for i in followers for k in range(4) if i != k])
    assert links.mean(axis=1) == pytest.approx(0.5, abs=4 * 0.5 / math.sqrt(400))
    assert np.abs(np.corrcoef(links) - np.eye(len(links))).max() < 4.5 / math.sqrt(400)


def test_a_known_position_is_carried_on_at_the_speed_sent():
    some = members(count=1, at=lambda time: (0.0, 0.0))
    fleet, messages = Fleet.deployed(some, DT), Messages(Channel(latency_s=0.3), some, DT, 1, None)
    for step in range(8):
        known, fleet, _ = messages.received(fleet, step, step * DT)
        before, fleet = fleet, fleet.moved(DT)
    gap = before.motion.x[0] - before.motion.x[1] - CAR.length
    assert known.predecessor.gap[1] == pytest.approx(gap)
    assert known.predecessor.age[1] == pytest.approx(0.3)


def test_range_buildings_and_blackouts_stop_messages():
    assert deaf(Channel(range_m=20.0), 3).all()
    assert not deaf(Channel(range_m=25.0), 3).any()
    wall = shapely.box(-15, -1, -14, 1)
    lost = deaf(Channel(blocked_by_buildings=True), 3, solids=wall)
    assert lost[:, 0].all()
    assert not lost[:, 1:].any()
    assert not deaf(Channel(), 3, solids=wall).any()
    black = Channel(blackout=[Blackout(time_s=0.5, lasts_s=0.3, receiver="robot.2")])
    lost = deaf(black, 12)
    assert np.flatnonzero(lost[:, 1]).tolist() == [5, 6, 7]
    assert not lost[:, [0, 2]].any()


def test_a_blackout_is_two_events_within_an_interval_after_the_message_that_is_missing():
    channel = Channel(latency_s=0.1, blackout=[Blackout(time_s=1.0, lasts_s=1.0, receiver="robot.1")])
    some, noted = members(count=2), []
    fleet, messages = Fleet.deployed(some, DT), Messages(channel, some, DT, 1, None)
    for step in range(40):
        _known, fleet, new = messages.received(fleet, step, step * DT)
        noted += [(one.kind, fleet.ids[one.row], one.other, round(step * DT, 3), one.duration) for one in new]
    # the last message is of 0.9 s; the next but one of 1.1 s was due at 1.2 s
    assert noted[0][:4] == ("radio_lost", "robot.1", "robot.0", 1.3)
    assert noted[1][:4] == ("radio_back", "robot.1", "robot.0", 2.1)
    assert noted[1][4] == pytest.approx(1.2)
    assert len(noted) == 2


@pytest.mark.parametrize("instead", ["laser", "headway", "hold"])
def test_a_law_without_messages_does_what_its_key_says(instead):
    """The leader brakes while nobody receives a message."""

    def brakes(time: float) -> tuple[float, float]:
        return (-2.0 if 2.0 <= time < 4.0 else 0.0), 0.0

    law = PloegFollower(on_radio_loss=instead)
    dark = Channel(blackout=[Blackout(time_s=1.5, lasts_s=9.0)])
    demands = np.array([now.fleet.command.drive.acceleration[1] for now in heard(dark, 40, law, brakes)])
    assert demands[:17] == pytest.approx(0.0, abs=1e-6)  # steady, up to the age of 0.2 s that is allowed
    if instead == "hold":
        assert demands == pytest.approx(0.0, abs=1e-6)
    else:
        assert demands[20:40].min() < -1.0
    other = {"laser": PloegFollower(feed="scan"), "headway": ConstantTimeHeadway()}.get(instead)
    if instead == "laser":
        by_scan = np.array([now.fleet.command.drive.acceleration[1] for now in heard(None, 40, other, brakes)])
        assert demands[25:] == pytest.approx(by_scan[25:], abs=0.05)


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ((), "'cacc_ploeg' needs messages; the scenario must have a [channel]: channel.latency_s=0.1 makes one"),
        (("platoon.follower.law=tracking", "channel.loss=0.1"), "no law needs messages, so nobody receives them"),
        (("channel.loss=1.2",), "channel.loss: 1.2: should be less than or equal to 1"),
        (("channel.burst_loss=0.9", "channel.burst_length=2"), "must be at least 9"),
        (("channel.rate_hz=7",), "the interval must be a multiple of run.step_s"),
        (("channel.lost_after_s=0.05",), "must be at least 0.1"),
        (("channel.loss=0.1", "platoon.follower.on_radio_loss=stop"), "on_radio_loss"),
    ],
)
def test_bad_input_is_one_line(changes, fault):
    law = () if "platoon.follower.law=tracking" in changes else ("platoon.follower.law=cacc_ploeg",)
    with pytest.raises(InputError) as caught:
        scenario.load("highway_tracking", [*law, *changes])
    (line,) = caught.value.faults
    assert fault in line


def test_a_channel_that_a_change_of_the_law_leaves_without_receivers_is_left_out():
    assert scenario.load("yardsticks").spec.channel is not None
    for change in ("platoon.follower.law=tracking", "platoon.follower.feed=truth", "platoon.follower.feed=scan"):
        assert scenario.load("yardsticks", [change]).spec.channel is None
    with pytest.raises(InputError, match="nobody receives them"):
        scenario.load("yardsticks", ["platoon.follower.law=tracking", "channel.loss=0.1"])


BRANCHED = """
[sumo]
net = "highway"
traffic = false
[scene]
walls = "none"
[run]
duration_s = 20
[channel]
latency_s = 0.1
[[platoon]]
size = 3
vehicle = "car"
start = { edge = "e0_e1", position_m = 400.0, speed_mps = 20.0 }
to = "e4_e5"
leader = { law = "path", speed_mps = 20.0 }
follower = "acc"
[branch]
at_s = 10
then = { platoon.follower.law = "THEN" }
"""


def test_a_channel_may_have_receivers_only_after_a_branch(tmp_path):
    file = tmp_path / "branched.toml"
    file.write_text(BRANCHED.replace('law = "THEN"', 'feed = "messages"'))
    found = scenario.load(file)
    assert found.spec.channel is not None
    assert "messages" not in found.laws[0, "follower"].needs
    assert "messages" in found.then.laws[0, "follower"].needs
    file.write_text(BRANCHED.replace("THEN", "idm"))
    with pytest.raises(InputError, match="before the branch or after it"):
        scenario.load(file)


def test_a_channel_may_have_receivers_only_in_branches_of_a_command(tmp_path):
    file = tmp_path / "to_branch.toml"
    file.write_text(BRANCHED[: BRANCHED.index("[branch]")])
    with pytest.raises(InputError, match="nobody receives them"):
        scenario.load(file)
    found = scenario.load(file, to_branch=True)
    assert found.spec.channel is None

    def branched(change: str) -> scenario.Scenario:
        return found.branched(branch_of(10.0, [Change.parse(change, 1)]))

    assert branched("platoon.follower.feed=messages").spec.channel.latency_s == 0.1
    with pytest.raises(InputError, match="nobody receives them"):
        branched("platoon.follower.time_headway_s=2")


@pytest.mark.sumo
@pytest.mark.slow
@pytest.mark.parametrize("instead", ["laser", "headway"])
def test_nobody_touches_in_a_blackout_while_the_leader_brakes(instead, tmp_path):
    change = f"platoon.follower.on_radio_loss={instead}"
    found = pd.read_csv(run(tmp_path, "blackout", change) / "metrics.csv")
    of_run = found[found.scope == "run"].set_index("metric").value
    assert of_run.collisions == 0
    assert of_run.radio_losses == 5
    assert of_run.message_age_max == pytest.approx(10.2, abs=0.11)
