"""Environments for Gymnasium and PettingZoo: their contracts, seeds, rewards, and what goes wrong."""

from __future__ import annotations

import gc
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import weakref
from pathlib import Path

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
pytest.importorskip("pettingzoo")

from gymnasium.utils.env_checker import check_env  # noqa: E402
from pettingzoo.test import parallel_api_test, parallel_seed_test  # noqa: E402

from platoontraffic import shipped  # noqa: E402
from platoontraffic.controllers.printed import SPEED_GAIN  # noqa: E402
from platoontraffic.environments import seats  # noqa: E402
from platoontraffic.environments.follower import Follower  # noqa: E402
from platoontraffic.environments.platoon import Platoon  # noqa: E402
from platoontraffic.episodes.episodes import Frame, Source  # noqa: E402
from platoontraffic.episodes.here import Here, need_sumo  # noqa: E402
from platoontraffic.episodes.parents import Parents  # noqa: E402
from platoontraffic.errors import InputError, RunError  # noqa: E402

pytestmark = [
    pytest.mark.sumo,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork"),
    pytest.mark.filterwarnings("ignore:.*For Box action spaces"),
]

SHORT = ("platoon.size=3", "learn.episode_s=1")
ID = "platoontraffic.environments:platoontraffic/Follower-v0"
AHEAD = np.array([0.1, 0.0], np.float32)


IN_SUMO = "paper_path"  # its leader has a route, so it needs SUMO and processes of their own; `paper_loop` does not


@pytest.fixture(scope="module", params=["paper_loop", IN_SUMO])
def follower(request):
    env = Follower(request.param, SHORT)
    yield env
    env.close()


def test_gymnasium_accepts_it(follower):
    check_env(follower, skip_render_check=True)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "observation"),
    [
        ("paper_loop", "group"), ("paper_path", "scan"), ("highway_tracking", "dict"), ("corridor_tracking", "scan"),
        ("highway_traffic", "group"),
    ],
)  # fmt: skip
def test_gymnasium_accepts_the_shipped_scenarios(scenario, observation):
    changes = ["learn.episode_s=2", "learn.parents=1", f"learn.observation={observation}"]
    env = gymnasium.make(ID, scenario=scenario, changes=changes, render_mode="rgb_array")
    check_env(env.unwrapped)
    env.reset(seed=1)
    picture = env.render()
    assert picture.shape == (480, 640, 3)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 3
    env.close()


# The second platoon departs from 3 s on, and the third from 20 s on, when there is room.
IN_TURN = (
    "platoon.size=2", "platoon.1.start.time_s=3", "platoon.2.start.time_s=20", "sumo.warm_up_s=5", "learn.episode_s=25",
    "learn.parents=1",
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("scenario", "changes"), [("paper_loop", SHORT), ("highway_traffic", IN_TURN)])
def test_pettingzoo_accepts_it(scenario, changes):
    env = Platoon(scenario, changes)
    parallel_api_test(env, num_cycles=250)
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize(("scenario", "changes"), [("paper_loop", SHORT), ("highway_traffic", IN_TURN)])
def test_agents_with_equal_seeds_have_equal_episodes(scenario, changes):
    parallel_seed_test(lambda: Platoon(scenario, changes), num_cycles=60)


@pytest.mark.slow
def test_members_become_agents_when_they_depart_and_a_step_without_agents_goes_on_until_then():
    env = Platoon("highway_traffic", IN_TURN)
    seen, _ = env.reset(seed=1)
    assert env.agents == list(seen) == ["p0.1"]
    assert env.possible_agents[:3] == ["p0.1", "p1.1", "p2.1"]
    keep = np.zeros(2, np.float32)
    while "p1.1" not in env.agents:
        given = env.step(dict.fromkeys(env.agents, keep))
    assert all(list(part) == ["p0.1", "p1.1"] for part in given)
    seen, reward, terminated, truncated, info = (part["p1.1"] for part in given)
    assert env.observation_space("p1.1").contains(seen)
    assert reward == pytest.approx(sum(v for k, v in info.items() if k.startswith("reward_")))
    assert 3 <= info["time_s"] < 5
    assert not terminated
    assert not truncated
    for _ in range(80):  # away from where the next ones are to depart
        env.step(dict.fromkeys(env.agents, keep))
    off_the_road = np.float32([0.0, env.action_space("p0.1").high[1]])
    while env.agents != ["p2.1"]:
        before, given = env.agents, env.step(dict.fromkeys(env.agents, off_the_road))
        assert before  # there is always one to act
    assert given[2] == dict.fromkeys(before, True) | {"p2.1": False}
    assert given[4][before[0]]["time_s"] < 18
    assert given[4]["p2.1"]["time_s"] >= 20
    env.close()


LOADED_IN_A_FORK = """
import os, sys, tempfile
from pathlib import Path
from numba.core.caching import Cache
from platoontraffic.episodes.episodes import Episodes, Source

loads, load = [], Cache.load_overload
Cache.load_overload = lambda self, *given: loads.append(self) or load(self, *given)
parent = Path(tempfile.mkdtemp())
episodes = Episodes(Source(sys.argv[1], ("learn.parents=1", "sumo.warm_up_s=1")), 0, parent)
assert loads
loads.clear()
if not os.fork():
    episodes.forked(1, {}, Path(tempfile.mkdtemp(dir=parent)))
    episodes.begin(None)
    for _ in range(3):
        episodes.step(None, {})
    print([one._cache_file._index_name for one in loads], flush=True)
    os._exit(0)
os.wait()
os._exit(0)
"""


@pytest.mark.slow
@pytest.mark.parametrize("scenario", [IN_SUMO, "corridor_tracking"])
def test_an_episode_loads_no_kernel_that_its_parent_could_have_loaded(scenario):
    given = [sys.executable, "-c", LOADED_IN_A_FORK, scenario]
    assert subprocess.run(given, capture_output=True, text=True, check=True).stdout == "[]\n"


EPISODE = """
import hashlib, sys
import numpy as np
from platoontraffic.environments.follower import Follower
env = Follower("paper_loop", ["platoon.size=2", "platoon.follower.lidar.noise=utm30lx", "learn.episode_s=1",
               "learn.parents=2"])
digest = hashlib.sha256()
for seed in (5, 6):
    seen, _ = env.reset(seed=seed)
    for _ in range(20):
        seen, reward, *_ = env.step(np.float32([0.1, 0.05]))
        digest.update(seen["ranges"].tobytes() + seen["speed"].tobytes() + np.float64(reward).tobytes())
print(digest.hexdigest())
env.close()
"""


def test_a_frame_is_received_as_it_was_sent():
    ranges = np.float32([[1.0, np.inf, np.nan], [0.5, -np.inf, 2.0]])
    rest = [(0.1, 0.0), (0.2, 0.1)], [[0.5], [1.0]], [(1.0,), (2.0,)], [("collision",), ()], {}
    received = Frame.received(pickle.loads(pickle.dumps(Frame(1.5, "", [True, False], ranges, *rest).plain())))
    assert received.ranges.dtype == np.float32
    np.testing.assert_array_equal(received.ranges, ranges)
    assert received._replace(ranges=None) == Frame(1.5, "", [True, False], None, *rest)


@pytest.mark.slow
def test_a_seed_gives_the_same_episode_in_every_process():
    said = {subprocess.run([sys.executable, "-c", EPISODE], capture_output=True, text=True, check=True).stdout
            for _ in range(2)}  # fmt: skip
    assert len(said) == 1


DRAWN = 'learn.draw={"platoon.gap_m" = {from = 0.4, to = 0.6}, "platoon.leader.speed_mps" = [0.1, 0.3]}'
WITHOUT_CHOICE = 'learn.draw={"platoon.gap_m" = [4.0]}'
LEARNS = [
    (),
    (DRAWN, "learn.observation=group", "learn.reward={gap_error_m=-1.0, collision=-10.0, lock_lost=-2.0}"),
    ("platoon.follower.odometry=car", "learn.observation=scan"),
    ('platoon.follower={law="external", needs=["messages"], lidar="paper-follower"}', "channel={latency_s=0.1}"),
]


@pytest.mark.slow
@pytest.mark.parametrize("changes", LEARNS)
def test_an_episode_without_sumo_is_the_same_as_in_sumo(monkeypatch, changes):
    changes = [*changes, "platoon.follower.lidar.noise=utm30lx", "learn.episode_s=4"]
    here = Platoon("paper_loop", changes)
    monkeypatch.setattr(seats, "need_sumo", lambda source: True)
    in_sumo = Platoon("paper_loop", changes)
    assert (type(here._seats._episodes), type(in_sumo._seats._episodes)) == (Here, Parents)
    random, kinds = np.random.default_rng(1), set()
    for seed in (3, None):
        given = [env.reset(seed=seed) for env in (here, in_sumo)]
        while here.agents:
            np.testing.assert_equal(*given)
            actions = {name: random.uniform((0.0, -0.6), (0.3, 0.6)) for name in here.agents}
            given = [env.step(actions) for env in (here, in_sumo)]
            kinds |= {kind for info in given[0][4].values() for kind in info["events"]}
        np.testing.assert_equal(*given)
        assert not in_sumo.agents
    assert "lock_lost" in kinds
    here.close()
    in_sumo.close()


@pytest.mark.parametrize(
    ("scenario", "changes", "needs"),
    [
        ("paper_loop", (), False),
        ("lab_obstacles", (DRAWN,), False),
        ("paper_loop", ("platoon.start.time_s=3",), True),  # it waits for room
        ("paper_loop", ('learn.draw={"platoon.start.time_s" = [0, 3]}',), True),
        ("paper_loop", ('platoon.leader={law="path"}', "platoon.to=se_ne"), True),
        ("highway_tracking", ("sumo.traffic=false",), True),
        ("corridor_tracking", (), True),
    ],
)
def test_what_needs_sumo(scenario, changes, needs):
    assert need_sumo(Source(scenario, changes)) is needs


def first_steps(env, seed, steps):
    """Ranges from a reset on."""
    seen = [env.reset(seed=seed)[0]["ranges"]]
    return np.array(seen + [env.step(AHEAD)[0]["ranges"] for _ in range(steps)])


@pytest.mark.slow
def test_an_episode_that_was_made_while_another_one_went_on_is_the_same_episode():
    draw = 'learn.draw={"platoon.gap_m" = {from = 0.4, to = 0.6}}'
    changes = [*SHORT, draw, "learn.parents=1", "platoon.follower.lidar.noise=utm30lx"]
    env, other = Follower(IN_SUMO, changes), Follower(IN_SUMO, changes)
    first_steps(env, 5, 3)  # at the first step the next one is begun
    other.reset(seed=5)
    assert env._seats._episodes._next
    assert not other._seats._episodes._next
    first, second = first_steps(env, None, 10), first_steps(other, None, 10)
    assert np.array_equal(first, second)
    assert not np.array_equal(first[0], first_steps(env, None, 0)[0])
    assert np.array_equal(first_steps(env, 7, 5), first_steps(other, 7, 5))  # in place of the one that was made
    env.close()
    other.close()


@pytest.mark.slow
def test_an_episode_is_the_same_where_its_parent_has_deployed_the_members():
    """It has where nothing is drawn. The platoon comes to lines before a light and a junction."""
    noise = "platoon.follower.lidar.noise=utm30lx"
    changes = ["learn.parents=1", "platoon.size=2", "platoon.start.position_m=100", noise]
    env, drawing = (Follower("corridor_tracking", [*changes, *draw]) for draw in ((), (WITHOUT_CHOICE,)))
    seen = [env.reset(seed=5), drawing.reset(seed=5)]
    for _ in range(100):
        np.testing.assert_equal(*seen)
        seen = [one.step(np.array([1.0, 0.0])) for one in (env, drawing)]
    env.close()
    drawing.close()


@pytest.mark.slow
def test_an_interrupted_reset_leaves_an_environment_that_works(follower):
    alone = first_steps(follower, 3, 3)
    for delay in (0.0, 0.01, 0.03):
        timer = threading.Timer(delay, signal.pthread_kill, (threading.main_thread().ident, signal.SIGINT))
        with pytest.raises(KeyboardInterrupt):  # noqa: PT012
            timer.start()
            while True:
                follower.reset(seed=1)
                follower.step(AHEAD)
        timer.join()
        assert np.array_equal(first_steps(follower, 3, 3), alone)


@pytest.mark.slow
def test_seeds_differ_by_noise_and_by_what_is_drawn():
    draw = 'learn.draw={"platoon.start.position_m" = {from = 1.5, to = 1.9}, "platoon.gap_m" = [0.4, 0.5]}'
    env = Follower("paper_loop", [*SHORT, draw, "platoon.follower.lidar.noise=none"])
    first = [env.reset(seed=seed)[0]["ranges"].min() for seed in (1, 2, 3, 4, 1)]
    env.close()
    gaps = {round(float(distance), 2) for distance in first}
    assert gaps == {0.43, 0.53}  # the laser stands 0.03 m behind the bumper
    assert first[0] == first[-1]


@pytest.mark.slow
def test_the_reward_is_the_sum_of_its_terms_which_are_integrals_of_quantities():
    reward = "learn.reward={gap_error_m=-2.0, collision=-10.0}"
    straight = 'platoon.start={edge="n_w", position_m=1.5}'
    changes = ["platoon.size=2", "learn.episode_s=20", reward, straight, "platoon.leader.speed_mps=0.02"]
    env = Follower("paper_path", changes)
    env.reset(seed=1)
    ended = False
    while not ended:
        _, gained, terminated, truncated, info = env.step(np.array([0.1, 0.0]))
        assert gained == info["reward_gap_error_m"] + info["reward_collision"]
        if not terminated:
            assert info["reward_gap_error_m"] == pytest.approx(-2.0 * abs(info["gap_error_m"]) * 0.025)
            assert info["gap_error_m"] == pytest.approx(info["gap_m"] + 0.03 - 0.45 - 0.1 / SPEED_GAIN)  # `repaired`
        ended = terminated or truncated
    env.close()
    assert terminated
    assert not truncated
    assert info["reward_collision"] == -10.0
    assert "collision" in info["events"]
    assert info["metrics"]["gap_m_min"] < 0.01


def test_an_episode_is_truncated_at_its_time_and_then_needs_a_reset(follower):
    follower.reset(seed=1)
    ends = [follower.step(np.zeros(2))[2:4] for _ in range(40)]
    assert ends == [(False, False)] * 39 + [(False, True)]
    with pytest.raises(RuntimeError, match="it has ended: reset"):
        follower.step(np.zeros(2))


def test_the_command_moves_the_vehicle_within_its_limits(follower):
    follower.reset(seed=1)
    seen, *_ = follower.step(np.array([0.2, 0.5]))
    assert (seen["speed"][0], seen["yaw_rate"][0]) == pytest.approx((0.2, 0.5))
    seen, *_ = follower.step(np.array([-1.0, 0.0]))
    assert seen["speed"][0] == 0.0  # the nearest within the space


@pytest.mark.parametrize(
    ("action", "what"),
    [([np.nan, 0.0], "must be finite"), ([0.1], "shape"), (None, "two numbers"), (["a", "b"], "two numbers")],
)
def test_a_wrong_action_is_an_error_and_moves_nothing(follower, action, what):
    follower.reset(seed=1)
    with pytest.raises(ValueError, match=what):
        follower.step(np.array(action, dtype=object if action is None else None))
    _, _, _, _, info = follower.step(AHEAD)
    assert info["time_s"] == pytest.approx(0.025)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (("paper_lop",), "did you mean"),
        (("paper_loop", ["learn.reward={gap=1.0}"]), "'gap': no quantity .* or kind of event"),
        (("paper_loop", ["learn.ends=['colision']"]), "did you mean 'collision'"),
        (("paper_loop", [], "robot.7"), "'robot.7': no member"),
        (("paper_loop", ["platoon.size=1"]), "no follower that could learn"),
        (("paper_loop", ["learn.draw={a={from=2,to=1}}"]), "`from` up to `to`"),
        (("paper_loop", ['learn.draw={"platoon.gap" = {from=1,to=2}}']), "learn.draw.platoon.gap: .*did you mean"),
        (
            ("paper_loop", ['learn.draw={"platoon.follower.lidar.range_max_m" = [2,3]}']),
            "range_max_m: 2: changes .* observe",
        ),
        (("paper_loop", ['learn.draw={"platoon.size" = [1,5]}']), "platoon.size: 1: changes which members learn"),
        (("paper_loop", ["learn.vehicle=robot.9"]), "learn.vehicle: 'robot.9': no member"),
        (("paper_loop", ["learn.episode_s=0.01"]), "0.01: must be no less than .* two decisions, 0.025 s"),
    ],
)
def test_faults_of_the_scenario_are_said_before_anything_starts(arguments, what):
    with pytest.raises(InputError, match=what):
        Follower(*arguments)


def test_a_member_learns_once():
    with pytest.raises(InputError, match=r"'robot\.1': is named twice"):
        Platoon("paper_loop", SHORT, vehicles=("robot.1", "robot.2", "robot.1"))


@pytest.mark.parametrize("drawn", ['noise" = ["none","utm30lx"]', 'mount_yaw_deg" = {from=-2.0, to=2.0}'])
def test_errors_of_a_laser_may_be_drawn(drawn):
    Follower("paper_loop", [*SHORT, f'learn.draw={{"platoon.follower.lidar.{drawn}}}']).close()


@pytest.mark.slow
def test_a_fork_of_the_program_that_closes_an_environment_leaves_it_alone():
    """It ended the simulation of its parent."""
    env = Follower(IN_SUMO, SHORT)
    env.reset(seed=1)
    if (pid := os.fork()) == 0:
        env.close()
        os._exit(0)
    os.waitpid(pid, 0)
    env.step(AHEAD)
    env.reset(seed=2)
    env.close()


def test_lists_are_no_texts():
    with pytest.raises(ValueError, match=r"changes = .*; must be a list"):
        Follower("paper_loop", "platoon.size=3")
    with pytest.raises(ValueError, match=r"vehicles = .*; must be a list"):
        Platoon("paper_loop", SHORT, "robot.1")


@pytest.mark.parametrize(
    "changes", [(), ("platoon.start.time_s=1.025",), ("platoon.follower.lidar.delay_s=0.05",)],
    ids=["at once", "out of step with the laser", "a late laser"],
)  # fmt: skip
def test_a_command_holds_from_one_decision_to_the_next(changes):
    """A law's own command, a stand-still, came between where decisions were not those of the laser."""
    env = Follower("paper_loop", ["platoon.size=2", "platoon.follower.lidar.rate_hz=10", *changes])
    env.reset(seed=1)
    speeds = [env.step([0.2, 0.0])[0]["speed"][0] for _ in range(5)]
    env.close()
    assert speeds == pytest.approx([0.2] * 5)


def test_odometry_is_as_late_as_that_of_a_law():
    env = Follower("paper_loop", ["platoon.size=2", "platoon.follower.odometry.delay_s=0.1"])
    env.reset(seed=1)
    speeds = [env.step([0.2, 0.0])[0]["speed"][0] for _ in range(6)]
    env.close()
    assert speeds == pytest.approx([0, 0, 0, 0, 0.2, 0.2])


def test_an_episode_lasts_from_its_first_decision():
    env = Follower("paper_loop", ["platoon.size=2", "platoon.start.time_s=0.5", "learn.episode_s=0.25"])
    _, info = env.reset(seed=1)
    assert "departed" in info["events"]
    steps = 1
    while not env.step([0.1, 0.0])[3]:
        steps += 1
    env.close()
    assert steps == 10


def test_episodes_leave_nothing_behind():
    """Each one of a lab left a megabyte."""
    env, before = Follower("paper_loop", SHORT), None
    for seed in range(4):
        env.reset(seed=seed)
        env.step(AHEAD)
        if before:
            gc.collect()
            assert before() is None
        before = weakref.ref(env._seats._episodes._episodes._simulation)
    assert gc.get_freeze_count() == 0
    env.close()


def test_without_agents_there_is_no_step():
    env = Platoon("paper_loop", SHORT)
    env.reset(seed=1)
    while env.agents:
        env.step(dict.fromkeys(env.agents, AHEAD))
    with pytest.raises(RuntimeError, match="no agent is left"):
        env.step({})
    env.close()


@pytest.mark.slow
def test_a_file_is_found_from_any_folder(tmp_path, monkeypatch):
    (tmp_path / "mine.toml").write_text(shipped.scenarios()["paper_loop"].read_text())
    monkeypatch.chdir(tmp_path)
    env = Follower("mine.toml", [*SHORT, DRAWN])
    monkeypatch.chdir("/")
    env.reset(seed=1)
    assert env.metadata["render_fps"] == 40
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("changes", [(), ("platoon.start.time_s=0.1",)], ids=["here", "in SUMO"])
def test_a_closed_environment_stays_closed(changes):
    env = Follower("paper_loop", [*SHORT, *changes])
    env.close()
    with pytest.raises(RuntimeError, match="is closed; make a new one"):
        env.reset(seed=0)
    env.close()


@pytest.mark.slow
def test_a_drawn_value_that_the_scenario_refuses_is_an_error_and_the_next_reset_works():
    draw = 'learn.draw={"platoon.gap_m" = [-1.0, 0.5]}'
    env = Follower("paper_loop", [*SHORT, draw, "learn.parents=1"])
    ends = set()
    for seed in range(8):
        try:
            env.reset(seed=seed)
            ends.add("fine")
        except InputError as error:
            assert "learn.draw.platoon.gap_m" in str(error)  # noqa: PT017
            ends.add("fault")
    env.close()
    assert ends == {"fine", "fault"}


@pytest.mark.slow
def test_two_environments_in_one_process_do_not_disturb_each_other(follower):
    other = Follower("paper_loop", SHORT)
    follower.reset(seed=3)
    other.reset(seed=3)
    alone = [follower.step(AHEAD)[0]["ranges"] for _ in range(3)]
    follower.reset(seed=3)
    both = []
    for _ in range(3):
        both.append(follower.step(AHEAD)[0]["ranges"])
        other.step(AHEAD)
    other.close()
    assert np.array_equal(alone, both)


@pytest.mark.slow
def test_a_seat_observes_what_its_needs_declare():
    law = 'platoon.follower={law="external", needs=["truth", "leader"], lidar="paper-follower"}'
    straight = 'platoon.start={edge="n_w", position_m=2.5}'
    env = Platoon("paper_path", ["platoon.size=3", law, straight, "learn.episode_s=3", "learn.parents=1"])
    seen, _ = env.reset(seed=1)
    for _ in range(20):
        seen, _, _, _, info = env.step({"robot.1": AHEAD, "robot.2": np.array([0.05, 0.0])})
    assert set(seen["robot.2"]) == {"ranges", "speed", "yaw_rate", "truth", "truth_leader"}
    gap, closing, speed, *_, age, lost = seen["robot.2"]["truth"]
    assert (gap, -closing) == pytest.approx((info["robot.2"]["gap_m"], info["robot.2"]["closing_mps"]), abs=1e-4)
    assert (speed, age, lost) == pytest.approx((0.1, 0.0, 0.0))
    first = seen["robot.1"]["truth"]
    assert first == pytest.approx(seen["robot.1"]["truth_leader"])
    along = gap + 0.2 + first[0]  # [m], a robot is 0.2 m long; gaps are straight, so that the sum is an upper limit
    assert along - 0.005 < seen["robot.2"]["truth_leader"][0] < along + 1e-6
    env.close()


@pytest.mark.slow
def test_a_seat_of_a_law_by_messages_has_them_and_loses_them_in_a_blackout():
    changes = ["run.duration_s=6", "channel.blackout=[{time_s=2, lasts_s=10}]", "learn.parents=1", "platoon.size=2"]
    env = Follower("blackout", changes)
    env.reset(seed=1)
    for step in range(1, 31):
        seen, _, _, _, info = env.step(np.array([0.0, 0.0]))
        assert env.observation_space.contains(seen)
        age, lost = seen["messages"][5:]
        if step < 20:
            assert (age, lost) == pytest.approx((0.1, 0.0))  # latency_s
        if not lost:
            assert age == pytest.approx(info["message_age_s"])
    assert seen["messages"].tolist() == [0, 0, 0, 0, 0, 0, 1]
    env.close()


def descendants(pid: int) -> set[int]:
    found: set[int] = set()
    for task in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = task.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == pid and fields[0] != "Z":
            found |= {int(task.parent.name)} | descendants(int(task.parent.name))
    return found


needs_proc = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks into /proc")


@pytest.mark.slow
@needs_proc
@pytest.mark.parametrize("end", ["pass", "1 / 0", "os.kill(os.getpid(), 2)", "os._exit(1)"])
def test_a_program_that_ends_without_closing_leaves_nothing(end):
    code = (
        "import os, sys\nfrom platoontraffic.environments.follower import Follower\n"
        f"env = Follower({IN_SUMO!r}, {list(SHORT)!r} + ['learn.parents=1'])\nenv.reset(seed=1)\nenv.step([0, 0])\n"
        f"print('ready', flush=True); sys.stdin.readline()\n{end}\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, text=True) as program:  # fmt: skip
        assert program.stdout.readline() == "ready\n"
        until = time.monotonic() + 10
        while len(below := descendants(program.pid)) < 3 and time.monotonic() < until:
            time.sleep(0.05)
        assert len(below) == 3  # a parent, the episode, and the next one
        program.communicate("\n", timeout=60)
    until = time.monotonic() + 10
    while (left := {pid for pid in below if Path(f"/proc/{pid}").exists()}) and time.monotonic() < until:
        time.sleep(0.05)
    assert not left


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["paper_loop", IN_SUMO])
def test_an_interrupted_step_ends_the_episode_and_a_reset_begins_anew(scenario):
    env = Follower(scenario, ["platoon.size=3"])
    main, message = threading.main_thread().ident, ""
    for _ in range(20):  # until the signal comes while a step waits, and not between two steps
        env.reset(seed=1)
        threading.Timer(0.3, signal.pthread_kill, (main, signal.SIGINT)).start()
        with pytest.raises(KeyboardInterrupt):  # noqa: PT012
            while True:
                env.step(np.zeros(2))
        try:
            env.step(np.zeros(2))
        except RuntimeError as error:
            message = str(error)
            break
    assert "no episode" in message
    env.reset(seed=1)
    env.step(np.zeros(2))
    env.close()


def test_an_episode_whose_process_dies_is_an_error_and_a_reset_begins_anew():
    env = Follower(IN_SUMO, SHORT)
    env.reset(seed=1)
    os.kill(env._seats._episodes._episode.pid, signal.SIGKILL)
    with pytest.raises(RunError, match="has died"):
        env.step(AHEAD)
    env.reset(seed=1)
    env.step(AHEAD)
    env.close()


@pytest.mark.slow
@needs_proc
def test_vector_environments_of_gymnasium_work_in_daemons():
    before = descendants(os.getpid())  # of other tests
    envs = gymnasium.make_vec(ID, num_envs=2, vectorization_mode="async", scenario=IN_SUMO, changes=SHORT)
    below = descendants(os.getpid()) - before
    seen, _ = envs.reset(seed=1)
    assert seen["ranges"].shape == (2, 720)
    for _ in range(45):  # over the end of an episode
        envs.step(np.zeros((2, 2), np.float32))
    envs.close()
    until = time.monotonic() + 30
    while below & descendants(os.getpid()) and time.monotonic() < until:
        time.sleep(0.2)
    assert not below & descendants(os.getpid())


@needs_proc
def test_a_lab_needs_no_process():
    before = descendants(os.getpid())  # of other tests
    env = Follower("paper_loop", SHORT)
    env.reset(seed=1)
    env.step(AHEAD)
    assert not descendants(os.getpid()) - before
    env.close()


@pytest.mark.sumo
def test_a_run_refuses_the_seat(tmp_path):
    import platoontraffic

    with pytest.raises(InputError, match=r"platoon\.0\.follower\.law: .* a run needs another law"):
        platoontraffic.run("paper_loop", "platoon.follower.law=external", results=tmp_path)
    assert not list(tmp_path.rglob("*.csv"))
