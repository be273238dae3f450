"""The law "policy": its file, its inputs, and its network against a plain one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from platoontraffic.controllers.external import External
from platoontraffic.controllers.law import Sensed
from platoontraffic.controllers.policy import LearnedFollower, Network, inputs_of
from platoontraffic.controllers.repaired import RepairedFollower
from platoontraffic.lidar import PRESETS, ScanBatch

LASER = PRESETS["paper-follower"]


def network(inputs="group", k=10, m=2, h=5, seed=1, command="twist"):
    random = np.random.default_rng(seed)
    layers = (
        (random.normal(size=(h, k + m)), random.normal(size=h)),
        (random.normal(size=(2 + m, h)), np.zeros(2 + m)),
    )
    return Network(
        inputs, np.zeros(k), np.ones(k), layers, command, np.array([0.0, -1.0]), np.array([0.5, 1.0]),
        np.array([0.5, 2.0][:m]), np.array([0.4, 0.5]), "paper-follower",
    )  # fmt: skip


def scans(*ranges):
    rows = np.array(ranges, dtype=np.float32)
    rows.setflags(write=False)  # as the laser's, or numba compiles once more
    return ScanBatch(LASER, 0.0, tuple(f"v{i}" for i in range(len(rows))), rows, None, np.zeros(len(rows), bool))


def rear(x, y, heading, width=0.15):
    """Ranges of a rear with its middle at (x, y), by the line that it is."""
    direction = np.array([-np.sin(heading), np.cos(heading)])
    normal = np.array([np.cos(heading), np.sin(heading)])
    beams = LASER.directions
    r = (normal @ [x, y]) / (normal @ beams)
    along = direction @ (r * beams - np.array([[x], [y]]))
    return np.where((abs(along) <= width / 2) & (r < LASER.range_max), r, np.inf)


def sensed(batch):
    n = len(batch)
    return Sensed(batch, np.linspace(0.1, 0.2, n), np.zeros(n))


def test_inputs_of_a_group_are_where_the_rear_is_and_how_it_is_turned():
    batch = scans(rear(0.5, 0.01, 0.2), rear(0.5, -0.01, -0.2), np.full(720, np.inf))
    shift = np.full(10, 0.3)
    values = inputs_of("group", shift, sensed(batch)).values
    assert values[0, 1] * np.cos(values[0, 2]) == pytest.approx(0.5, abs=2e-3)
    assert values[0, 5] == pytest.approx(0.2, abs=1e-3)
    mirrored = [0, 1, 6, 7]
    assert values[0, mirrored] == pytest.approx(values[1, mirrored], abs=1e-6)
    assert values[0, [2, 5]] == pytest.approx(-values[1, [2, 5]], abs=1e-6)
    assert values[0, [3, 4]] == pytest.approx(-values[1, [4, 3]], abs=1e-6)
    assert list(values[2]) == [0.0, *shift[1:8], 0.2, 0.0]


def test_a_rear_beyond_the_view_touches_its_border():
    values = inputs_of("group", np.zeros(10), sensed(scans(rear(0.5, 0.1, 0.0)))).values[0]
    assert (values[6], values[7]) == (0.0, 1.0)
    assert values[4] == pytest.approx(LASER.angle_max)


def test_inputs_of_sectors_are_their_least_ranges_from_right_to_left():
    ranges = np.full(720, np.inf)
    ranges[100], ranges[700] = 0.6, -np.inf
    values = inputs_of("scan", np.zeros(10), sensed(scans(ranges))).values[0]
    expected = np.full(8, LASER.range_max)
    expected[1], expected[7] = 0.6, LASER.range_min
    assert values[:8] == pytest.approx(expected)


def test_rows_do_not_depend_on_each_other_and_equal_a_plain_network(tmp_path):
    file = tmp_path / "one.npz"
    network().write(file)
    law = LearnedFollower(file)
    batch = scans(rear(0.5, 0.02, 0.1), rear(0.45, -0.02, 0.0), np.full(720, np.inf))
    both, memory = None, None
    for _ in range(3):
        both = law(sensed(batch), memory, 0.025)
        memory = both.memory
    own = None
    one = replace(sensed(batch), scan=batch.rows([1]), speed=np.array([0.15]), yaw_rate=np.zeros(1))
    for _ in range(3):
        alone = law(one, own, 0.025)
        own = alone.memory
    assert np.array(alone.command)[:, 0] == pytest.approx(np.array(both.command)[:, 1])

    net, remembered = network(), np.zeros(2)
    for _ in range(3):  # written out, number by number
        (w0, b0), (w1, b1) = net.layers
        x = [*inputs_of("group", net.shift, one).values[0], *remembered]
        hidden = [np.tanh(sum(w * v for w, v in zip(row, x, strict=True)) + b) for row, b in zip(w0, b0, strict=True)]
        out = [np.tanh(sum(w * v for w, v in zip(row, hidden, strict=True)) + b) for row, b in zip(w1, b1, strict=True)]
        left = np.exp(-0.025 / net.memory_time)
        remembered = np.array(out[2:]) * (1 - left) + remembered * left
    assert alone.command.speed[0] == pytest.approx(0.5 * (1 + out[0]) / 2)
    assert alone.command.yaw_rate[0] == pytest.approx(out[1])
    assert alone.memory[0] == pytest.approx(remembered)


def test_its_target_is_that_of_repaired_and_its_distance_that_of_the_file(tmp_path):
    network().write(tmp_path / "one.npz")
    law, batch = LearnedFollower(tmp_path / "one.npz"), scans(rear(0.5, 0.02, 0.1), np.full(720, np.inf))
    target = law(sensed(batch), None, 0.025).target
    other = RepairedFollower()(sensed(batch), None, 0.025).target
    assert np.array_equal(target, other, equal_nan=True)
    assert law.desired_distance(0.2) == pytest.approx(0.5)
    assert law.lidar == "paper-follower"


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"inputs": "scans"}, "must be 'group' or 'scan'"),
        ({"command": "speed"}, "must be 'twist' or 'drive'"),
        ({"lidar": "laser"}, "must be one of: paper-leader"),
        ({"shift": np.zeros(9)}, "shift has 9 values; must have 10"),
        ({"low": np.array([1.0, -1.0])}, "low < high"),
        ({"scale": np.full(10, np.nan)}, "must be finite numbers"),
        ({"memory_time": np.ones(3)}, r"w0, b0 are .*; must be \(5, 13\)"),
    ],
)
def test_a_file_that_does_not_fit_is_said_to_be_wrong(change, what, tmp_path):
    replace(network(), **change).write(tmp_path / "one.npz")
    with pytest.raises(ValueError, match=what):
        LearnedFollower(tmp_path / "one.npz")


def test_what_is_no_network_is_said_to_be_none(tmp_path):
    (tmp_path / "text.npz").write_text("no")
    np.savez(tmp_path / "other.npz", a=1)
    with pytest.raises(ValueError, match=r"is no \.npz file"):
        Network.read(Path(tmp_path / "text.npz"))
    with pytest.raises(ValueError, match="has no array 'inputs'"):
        Network.read(Path(tmp_path / "other.npz"))


def test_the_seat_stands_and_takes_what_is_ahead_for_its_target():
    wide = PRESETS["utm30lx"]
    ranges = np.full((1, wide.samples), np.inf, dtype=np.float32)
    ahead, aside = np.argmin(abs(wide.angles)), np.argmin(abs(wide.angles - 1.0))
    ranges[0, ahead - 3 : ahead + 4], ranges[0, aside] = 2.0, 1.0
    batch = ScanBatch(wide, 0.0, ("a",), ranges, None, np.zeros(1, bool))
    decision = External()(Sensed(batch, np.ones(1), np.zeros(1)), None, 0.1)
    assert [one.item() for one in decision.command] == [0.0, 0.0]
    assert decision.target.distance[0] == pytest.approx(2.0, abs=1e-3)
    assert np.isnan(External().desired_distance(np.ones(1))).all()
    assert External(stand_off=1.0, headway=0.5).desired_distance(2.0) == 2.0


def test_the_learned_follower_of_the_examples_speeds_up_for_a_distant_rear_and_turns_to_where_it_is():
    file = Path(__file__).parents[2] / "docs" / "examples" / "learned_follower" / "follower.npz"
    assert file.stat().st_size < 100_000
    law = LearnedFollower(file)
    batch = scans(rear(0.4, 0.0, 0.0), rear(0.7, 0.0, 0.0), rear(0.5, 0.04, 0.0), rear(0.5, -0.04, 0.0))
    still = Sensed(batch, np.full(4, 0.1), np.zeros(4))
    memory = None
    for _ in range(40):  # 1 s: it turns by what it remembers, too
        command, memory, _ = law(still, memory, 0.025)
    assert command.speed[1] > command.speed[0] + 0.1
    assert command.yaw_rate[2] > command.yaw_rate[3] + 0.2  # it is not quite symmetric
