"""Motion of a differential drive against its closed forms."""

from dataclasses import fields, replace

import numpy as np
import pytest

from platoontraffic.lidar.pose import wrap
from platoontraffic.vehicles.differential import DifferentialDrive
from platoontraffic.vehicles.motion import Command, Drive, Motion, Twist
from platoontraffic.vehicles.records import stack
from tests.support.differential_by_arrays import moved

ROBOT = DifferentialDrive()
CENTRED = replace(ROBOT, axle=0.0)
START = (0.3, -0.2, 0.7)


def driven(model, twist, seconds, steps, start=START):
    motion = Motion.at_rest(*start)
    for _ in range(steps):
        motion = model.moved(motion, Twist(*twist), seconds / steps)
    return motion


def state(motion):
    return np.array([motion.x, motion.y, motion.turned, motion.speed, motion.yaw_rate])


def fastest_wheel(model, twist):
    swing = abs(twist.yaw_rate) * model.wheel_separation / 2
    return (abs(twist.speed) + swing) / model.wheel_radius


@pytest.mark.parametrize("dt", [0.001, 0.025, 0.4, 3.0])
@pytest.mark.parametrize("twist", [(0.4, 0.5), (0.4, -0.5), (0.05, 2.0), (-0.3, 0.3)])
def test_constant_twist_draws_a_circle_of_radius_v_over_w(twist, dt):
    speed, yaw_rate = twist
    x, y, heading = START
    x += ROBOT.axle * np.cos(heading)
    y += ROBOT.axle * np.sin(heading)
    radius = speed / yaw_rate
    middle = np.array([x - radius * np.sin(heading), y + radius * np.cos(heading)])
    motion = Motion.at_rest(*START)
    for _ in range(5):
        motion = ROBOT.moved(motion, Twist(*twist), dt)
        away = np.hypot(*(ROBOT.axle_position(motion) - middle))
        assert away == pytest.approx(abs(radius), abs=1e-11)  # the arc is exact, no lag is 1 ps of lag
    assert motion.turned == pytest.approx(5 * dt * yaw_rate, abs=1e-11)


@pytest.mark.parametrize("lag", [0.0, 0.3])
def test_one_big_step_is_many_small_ones(lag):
    model = replace(ROBOT, lag=lag)
    big, small = (driven(model, (0.4, 0.9), 2.0, steps) for steps in (1, 800))
    np.testing.assert_allclose(state(big), state(small), atol=1e-12)


def test_centre_draws_a_wider_circle_than_the_axle():
    """The centre stands |axle| before the axle: radius sqrt((v/w)^2 + axle^2)."""
    speed, yaw_rate = 0.2, 1.0
    half_turn = driven(ROBOT, (speed, yaw_rate), np.pi / yaw_rate, 7)
    across = np.hypot(half_turn.x - START[0], half_turn.y - START[1])
    assert across / 2 == pytest.approx(np.hypot(speed / yaw_rate, ROBOT.axle), rel=1e-12)


def test_straight_is_speed_times_time():
    motion = driven(ROBOT, (0.37, 0.0), 4.0, 3)
    x, y, heading = START
    gone = 0.37 * 4.0
    np.testing.assert_allclose(
        [motion.x, motion.y], [x + gone * np.cos(heading), y + gone * np.sin(heading)], rtol=1e-12
    )
    assert motion.turned == 0


def test_turn_on_the_spot_leaves_the_axle_where_it_is():
    before = ROBOT.axle_position(Motion.at_rest(*START))
    after = driven(ROBOT, (0.0, 1.3), 1.0, 9)
    np.testing.assert_allclose(ROBOT.axle_position(after), before, atol=1e-15)
    assert after.turned == pytest.approx(1.3)
    assert after.x != START[0]


@pytest.mark.parametrize("twist", [(5.0, 1.0), (-5.0, 1.0), (0.0, 90.0), (1.0, -40.0), (1.3, 0.0)])
def test_saturation_keeps_the_curvature_and_turns_one_wheel_at_its_limit(twist):
    wanted = Twist(*twist)
    kept = ROBOT.saturated(wanted)
    assert fastest_wheel(ROBOT, kept) == pytest.approx(ROBOT.max_wheel_speed, rel=1e-12)
    assert kept.speed * wanted.yaw_rate == pytest.approx(kept.yaw_rate * wanted.speed, rel=1e-12)
    assert kept.speed * wanted.speed + kept.yaw_rate * wanted.yaw_rate > 0


def test_a_command_within_the_limits_of_both_wheels_is_not_changed():
    for twist in (Twist(0.0, 0.0), Twist(1.19, 0.0), Twist(0.5, -8.0)):
        assert fastest_wheel(ROBOT, twist) < ROBOT.max_wheel_speed
        assert ROBOT.saturated(twist) == twist


@pytest.mark.parametrize("steps", [1, 4, 100])
def test_lagged_speed_approaches_as_one_minus_exp(steps):
    """v(t) = V (1 - exp(-t/tau)), distance V (t - tau (1 - exp(-t/tau))), whatever the step."""
    tau, wanted, time = 0.8, 0.5, 1.7
    motion = driven(replace(ROBOT, lag=tau), (wanted, 0.0), time, steps, (0.0, 0.0, 0.0))
    share = 1 - np.exp(-time / tau)
    assert motion.speed == pytest.approx(wanted * share, rel=1e-12)
    assert motion.x == pytest.approx(wanted * (time - tau * share), rel=1e-12)
    assert motion.acceleration == pytest.approx(wanted * share / time) or steps > 1


@pytest.mark.parametrize("lag", [0.0, 0.2, 1.0])
@pytest.mark.parametrize("steps", [20, 200])
def test_a_drive_is_obeyed_whatever_the_lag_and_the_step(lag, steps):
    """With a lag of 0.2 s a robot reached 0.09 m/s in place of 0.8, and 0.04 with a shorter step."""
    drive = Drive(np.float64(0.2), np.float64(0.0))
    motion = Motion.at_rest(0.0, 0.0, 0.0)
    for _ in range(steps):
        motion = replace(ROBOT, lag=lag).moved(motion, drive, 2.0 / steps)
    assert motion.speed == pytest.approx(0.4)
    assert motion.acceleration == pytest.approx(0.2)


@pytest.mark.parametrize("lag", [0.0, 0.1, 0.3])
def test_a_robot_that_brakes_turns_to_the_side_that_it_is_told(lag):
    """From 0.5 m/s by 1.2 m/s2: with a lag of 0.3 s the speed that is set is below 0; it turned to the other side."""
    robot, motion = replace(ROBOT, lag=lag), replace(Motion.at_rest(0.0, 0.0, 0.0), speed=0.5)
    headings = [0.0]
    for _ in range(16):
        motion = robot.moved(motion, Drive(np.float64(-1.2), np.float64(1.0)), 0.025)
        headings.append(float(motion.heading))
    assert np.diff(headings).min() >= 0
    assert headings[-1] > 0.02


@pytest.mark.parametrize("lag", [0.0, 0.3])
def test_a_robot_that_brakes_stays_on_its_arc(lag):
    robot = replace(CENTRED, lag=lag)
    motion = replace(Motion.at_rest(0.0, 0.0, 0.0), speed=0.5, yaw_rate=0.5)
    for _ in range(20):
        motion = robot.moved(motion, Drive(np.float64(-0.9), np.float64(1.0)), 0.025)
    assert motion.speed == pytest.approx(0.05)
    assert np.hypot(motion.x, motion.y - 1.0) == pytest.approx(1.0, abs=2e-4)
    assert motion.yaw_rate == pytest.approx(motion.speed)


def test_lag_from_rest_stays_on_the_circle():
    motion = driven(replace(CENTRED, lag=0.6), (0.5, 0.5), 2.5, 11, (0.0, 0.0, 0.0))
    assert np.hypot(motion.x, motion.y - 1.0) == pytest.approx(1.0, abs=1e-12)


def test_without_lag_a_command_holds_at_once():
    motion = driven(ROBOT, (0.3, -0.4), 0.025, 1)
    assert (motion.speed, motion.yaw_rate) == (0.3, -0.4)
    assert motion.acceleration == pytest.approx(0.3 / 0.025)


def test_stacked_robots_move_as_each_alone():
    rng = np.random.default_rng(1)
    models = [DifferentialDrive(*values) for values in rng.uniform(0.1, 1.0, (20, len(fields(DifferentialDrive))))]
    start, twist = rng.uniform(-3, 3, (3, 20)), rng.uniform(-2, 2, (2, 20))
    together = driven(stack(models), twist, 0.5, 3, start)
    for i, model in enumerate(models):
        np.testing.assert_array_equal(state(together)[:, i], state(driven(model, twist[:, i], 0.5, 3, start[:, i])))


def test_wrap_keeps_the_direction_in_minus_pi_to_pi():
    angles = np.concatenate([np.random.default_rng(2).uniform(-50, 50, 1000), np.pi * np.arange(-9, 10)])
    wrapped = wrap(angles)
    assert ((wrapped > -np.pi) & (wrapped <= np.pi)).all()
    np.testing.assert_allclose(np.exp(1j * wrapped), np.exp(1j * angles), atol=1e-13)
    np.testing.assert_allclose(wrap(wrapped), wrapped, atol=1e-15)


def test_mirrored_command_draws_the_mirrored_path():
    left, right = (driven(replace(ROBOT, lag=0.2), (0.4, w), 3.0, 40, (0.0, 0.0, 0.0)) for w in (0.8, -0.8))
    np.testing.assert_allclose(state(left) * (1, -1, -1, 1, -1), state(right), rtol=1e-14)


def test_the_reverse_command_drives_back():
    there = driven(ROBOT, (0.4, 0.8), 3.0, 40)
    back = driven(ROBOT, (-0.4, -0.8), 3.0, 17, (there.x, there.y, there.heading))
    np.testing.assert_allclose([back.x, back.y, back.heading], START, atol=1e-12)


@pytest.mark.parametrize("lag", [0.0, 0.2])
def test_motion_is_that_of_whole_arrays_bit_for_bit(lag):
    """Robots of many sizes that obey twists and drives at random, beyond what their wheels can turn too."""
    rng, n = np.random.default_rng(3), 40
    sizes = rng.uniform(0.5, 2.0, (n, 4)) * (-0.06, 0.13, 0.03, 40.0)
    names = "axle", "wheel_separation", "wheel_radius", "max_wheel_speed"
    robots = stack([replace(ROBOT, lag=lag, **dict(zip(names, size.tolist(), strict=True))) for size in sizes])
    motion = Motion.at_rest(*rng.uniform(-3, 3, (3, n)))
    for _ in range(200):
        drives = np.where(rng.random(n) < 0.5, np.nan, rng.normal(0, (2.0, 0.5), (n, 2)).T)
        command = Command(Twist(*rng.choice([-1.0, 0.0, 0.4, 2.0], (2, n))), Drive(*drives))
        motion, expected = robots.moved(motion, command, 0.025), moved(robots, motion, command, 0.025)
        for field in fields(Motion):
            np.testing.assert_array_equal(getattr(motion, field.name), getattr(expected, field.name), strict=True)
