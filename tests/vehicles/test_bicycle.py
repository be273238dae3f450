"""Motion of a car against its closed forms."""

from dataclasses import fields, replace

import numpy as np
import pytest

from platoontraffic.lidar.pose import wrap
from platoontraffic.vehicles.bicycle import CARS, SUBSTEP, Car, lateral_acceleration, steering_at_lock
from platoontraffic.vehicles.bicycle_formulas import CRAWL
from platoontraffic.vehicles.motion import Drive, Motion, Twist
from platoontraffic.vehicles.records import stack

CAR = CARS["car"]
QUICK = replace(CAR, max_jerk=1e9, max_steering_rate=1e9, steering_lag=0.0)  # lag of drive and brakes alone
DIRECT = replace(QUICK, lag=0.0, brake_lag=0.0)
START = (0.3, -0.2, 0.7)


def rolling(speed=0.0, steering=0.0, start=START, model=CAR):
    """At a steady speed and steering angle."""
    motion = Motion.at_rest(*start)
    speed, steering = motion.x * 0 + speed, motion.x * 0 + steering
    return replace(motion, speed=speed, steering=steering, yaw_rate=speed * np.tan(steering) / model.wheelbase)


def driven(model, motion, command, seconds, steps=1):
    for _ in range(steps):
        motion = model.moved(motion, command, seconds / steps)
    return motion


def state(motion):
    return np.array([getattr(motion, f.name) for f in fields(Motion)])


@pytest.mark.parametrize("kind", CARS)
@pytest.mark.parametrize("braking", [1.0, 4.0, 8.0])
def test_a_car_stops_within_the_distance_of_its_braking_delay(kind, braking):
    """And not much sooner: v T is too long by the speed that is lost meanwhile, b T^2 / 2 at most."""
    car, speed, braking = CARS[kind], 20.0, min(braking, CARS[kind].max_braking)
    motion, delay = rolling(speed, start=(0.0, 0.0, 0.0), model=car), car.braking_delay(0.0, braking)
    for _ in range(3000):
        motion = car.moved(motion, Drive(np.float64(-braking), np.float64(0.0)), 0.01)
    assert motion.speed == 0
    longest = speed * delay + speed**2 / (2 * braking)
    assert longest - braking * delay**2 / 2 - 1e-3 <= motion.x <= longest + 1e-3


@pytest.mark.parametrize("dt", [0.003, 0.025, 0.1, 1.0])
@pytest.mark.parametrize("steering", [0.3, -0.5])
def test_constant_steering_draws_a_circle_of_radius_wheelbase_over_tan_whatever_the_speed_does(steering, dt):
    radius = CAR.wheelbase / np.tan(steering)
    motion = rolling(4.0, steering)  # slow enough for its tyres
    x, y = CAR.axle_position(motion)
    middle = np.array([x - radius * np.sin(motion.heading), y + radius * np.cos(motion.heading)])
    for acceleration in (2.0, -6.0, -9.0, 1.0):
        motion = CAR.moved(motion, Drive(acceleration, 1 / radius), dt)
        assert np.hypot(*(CAR.axle_position(motion) - middle)) == pytest.approx(abs(radius), abs=1e-10)
    assert motion.turned * steering > 0
    assert motion.heading == pytest.approx(wrap(START[2] + motion.turned), abs=1e-12)


def test_steady_yaw_rate_is_speed_by_radius_and_the_lateral_acceleration_speed_squared_by_radius():
    motion = driven(CAR, rolling(12.0), Drive(0.0, 1 / 60), 3.0, 30)
    assert motion.speed == 12.0
    assert motion.yaw_rate == pytest.approx(12 / 60, rel=1e-9)
    assert lateral_acceleration(motion) == pytest.approx(144 / 60, rel=1e-9)


def test_yaw_rate_is_that_of_the_speed_and_the_steering_at_the_same_instant():
    motion = driven(CAR, rolling(5.0, 0.1), Drive(4.0, 0.1), 0.5)
    assert motion.yaw_rate == pytest.approx(motion.speed * np.tan(motion.steering) / CAR.wheelbase, rel=1e-12)


def test_centre_draws_a_wider_circle_than_the_axle():
    radius = 8.0
    before = rolling(3.0, np.arctan(CAR.wheelbase / radius))
    half_turn = driven(CAR, before, Drive(0.0, 1 / radius), np.pi * radius / 3.0, 20)
    across = np.hypot(half_turn.x - before.x, half_turn.y - before.y)
    assert across / 2 == pytest.approx(np.hypot(radius, CAR.axle), rel=1e-9)


@pytest.mark.parametrize(
    ("lag", "jerk", "lost_speed", "moment"),  # while the brake builds up, by deceleration b
    [
        (0.2, 1e9, lambda b: b * 0.2, lambda b: b * 0.2**2),
        (0.0, 20.0, lambda b: b**2 / 40, lambda b: b**3 / (6 * 20**2)),
    ],
)
@pytest.mark.parametrize(("speed", "braking"), [(25.0, 9.0), (14.0, 3.0)])
def test_the_braking_distance_is_the_closed_form_with_lag_or_jerk(speed, braking, lag, jerk, lost_speed, moment):
    """s = (v + D)^2 / 2b - M, with D = int (b - |a|) dt and M = int t (b - |a|) dt.

    For a lag T: D = b T, M = b T^2, so s = v^2 / 2b + v T - b T^2 / 2.
    For a ramp of jerk j: D = b^2 / 2j, M = b^3 / 6j^2.
    """
    model = replace(CAR, brake_lag=lag, max_jerk=jerk)
    motion = driven(model, rolling(speed, start=(0.0, 0.0, 0.0)), Drive(-braking, 0.0), 10.0, 100)
    expected = (speed + lost_speed(braking)) ** 2 / (2 * braking) - moment(braking)
    assert motion.speed == 0
    assert motion.x == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("dt", [0.017, 0.1, 1.0])
def test_without_any_lag_the_braking_distance_is_speed_squared_by_twice_the_braking(dt):
    motion = driven(DIRECT, rolling(7.0, start=(0.0, 0.0, 0.0)), Drive(-6.0, 0.0), 200 * dt, 200)
    assert motion.x == pytest.approx(49 / 12, rel=1e-7)  # a jerk of 1e9 takes its time


@pytest.mark.parametrize(("demand", "lag"), [(1.5, CAR.lag), (-4.0, CAR.brake_lag)])
@pytest.mark.parametrize("steps", [1, 7])
def test_acceleration_follows_its_demand_as_one_minus_exp(demand, lag, steps):
    time = 0.7
    motion = driven(QUICK, rolling(20.0), Drive(demand, 0.0), time, steps)
    share = 1 - np.exp(-time / lag)
    assert motion.acceleration == pytest.approx(demand * share, rel=1e-6)
    assert motion.speed == pytest.approx(20 + demand * (time - lag * share), rel=1e-8)


def test_jerk_is_bounded_first_and_the_lag_takes_over_where_the_gap_is_lag_times_jerk():
    model = replace(CAR, max_jerk=10.0)
    ramp = (8.0 - 10 * model.brake_lag) / 10
    motion = driven(model, rolling(30.0), Drive(-8.0, 0.0), 0.4, 4)
    assert motion.acceleration == pytest.approx(-10 * 0.4, rel=1e-9)
    assert motion.speed == pytest.approx(30 - 10 * 0.4**2 / 2, rel=1e-9)
    motion = driven(model, rolling(30.0), Drive(-8.0, 0.0), ramp + 0.3, 9)
    left = 10 * model.brake_lag * np.exp(-0.3 / model.brake_lag)
    assert motion.acceleration == pytest.approx(-8 + left, rel=1e-9)


def test_the_wheel_turns_at_its_greatest_rate_and_no_further_than_to_its_lock():
    model = replace(CAR, steering_lag=0.0)
    half_way = driven(model, rolling(), Drive(0.0, 10.0), 0.5, 5)
    assert half_way.steering == pytest.approx(0.5 * CAR.max_steering_rate, rel=1e-9)
    assert driven(CAR, rolling(), Drive(0.0, 10.0), 4.0, 9).steering == pytest.approx(CAR.max_steering, rel=1e-9)
    assert driven(CAR, rolling(), Drive(0.0, -10.0), 4.0, 9).steering == pytest.approx(-CAR.max_steering, rel=1e-9)


def test_steering_follows_a_small_demand_as_one_minus_exp():
    motion = driven(CAR, rolling(5.0), Drive(0.0, 0.01), 0.15, 3)
    wanted = np.arctan(0.01 * CAR.wheelbase)
    assert motion.steering == pytest.approx(wanted * (1 - np.exp(-0.15 / CAR.steering_lag)), rel=1e-9)


@pytest.mark.parametrize("dt", [0.001, 0.025, 0.7])
def test_a_car_that_has_braked_to_0_stands_and_then_pulls_away(dt):
    motion = driven(CAR, rolling(2.0, 0.2), Drive(-5.0, 0.0), 1.4, round(1.4 / dt))
    assert (motion.speed, motion.acceleration, motion.yaw_rate) == (0, 0, 0)
    for demand in (-9.0, 0.0):
        later = driven(CAR, motion, Drive(demand, 0.1), 2.1, round(2.1 / dt))
        place = ["x", "y", "heading", "turned", "speed", "acceleration", "yaw_rate"]
        assert [getattr(later, name) for name in place] == [getattr(motion, name) for name in place]
    assert driven(CAR, later, Drive(1.0, 0.0), 0.7, 1).speed > 0


def test_no_command_makes_a_car_reverse():
    rng = np.random.default_rng(3)
    start = rng.uniform(-3, 3, (3, 500))
    motion = rolling(rng.uniform(0, 3, 500), start=start)
    for _ in range(40):
        before = motion
        motion = CAR.moved(motion, Drive(rng.uniform(-9, 5, 500), rng.uniform(-0.3, 0.3, 500)), 0.07)
        x, y = np.subtract(CAR.axle_position(motion), CAR.axle_position(before))
        along = before.heading + (motion.turned - before.turned) / 2
        forward = x * np.cos(along) + y * np.sin(along)
        assert (motion.speed >= 0).all()
        assert (forward > -1e-12).all()
    assert (motion.speed == 0).any()


def test_full_throttle_gains_energy_at_the_rate_of_power_less_drag():
    """v v' = p (1 - (v / v_top)^3), so (v / v_top)^3 tends to 1 as exp(-3 p x / v_top^3) over the distance x."""
    motion = driven(DIRECT, rolling(20.0, start=(0.0, 0.0, 0.0)), Drive(99.0, 0.0), 12.0, 120)
    top = CAR.max_speed
    away = (1 - (20 / top) ** 3) * np.exp(-3 * CAR.power * motion.x / top**3)
    assert motion.speed == pytest.approx(top * (1 - away) ** (1 / 3), rel=1e-6)
    assert motion.x > 200


def test_speed_tends_to_the_top_speed_and_not_beyond():
    motion = rolling(CAR.max_speed - 5)
    for _ in range(15):
        motion = CAR.moved(motion, Drive(4.0, 0.0), 5.0)
        assert motion.speed <= CAR.max_speed + 1e-9
    assert motion.speed == pytest.approx(CAR.max_speed, rel=2e-3)


@pytest.mark.parametrize("kind", CARS)
def test_saturated_is_the_nearest_that_engine_brakes_and_lock_can_do(kind):
    car = CARS[kind]
    tightest = np.tan(car.max_steering) / car.wheelbase
    fast = 0.6 * car.max_speed
    available = car.power / fast * (1 - 0.6**3)
    assert available < car.max_acceleration
    assert car.saturated(Drive(99.0, 9.0), rolling(fast)) == pytest.approx((available, tightest))
    assert car.saturated(Drive(99.0, -9.0), rolling(0.1)) == pytest.approx((car.max_acceleration, -tightest))
    assert car.saturated(Drive(-99.0, 0.0), rolling(fast)) == (-car.max_braking, 0)
    possible = Drive(0.9 * available, 0.9 * tightest)
    assert car.saturated(possible, rolling(fast)) == possible


def test_speed_of_a_twist_is_reached_as_through_two_lags_in_series():
    lag, response, time = CAR.lag, CAR.response, 1.3
    motion = driven(CAR, rolling(20.0), Twist(21.0, 0.0), time, 13)
    left = (response * np.exp(-time / response) - lag * np.exp(-time / lag)) / (response - lag)
    assert motion.speed == pytest.approx(21 - left, abs=1e-4)


@pytest.mark.parametrize("kind", CARS)
@pytest.mark.parametrize(("before", "wanted"), [(0.0, 13.0), (13.0, 5.0), (20.0, 0.0), (8.0, -3.0)])
def test_speed_of_a_twist_is_reached_without_passing_it(kind, before, wanted):
    motion, speeds = rolling(before), []
    for _ in range(400):
        motion = CARS[kind].moved(motion, Twist(wanted, 0.0), 0.1)
        speeds.append(motion.speed)
    wanted = max(wanted, 0.0)
    assert speeds[-1] == pytest.approx(wanted, abs=1e-3)
    beyond = (np.array(speeds) - wanted) * np.sign(wanted - before)
    assert beyond.max() < 0.02 * abs(wanted - before)


def test_a_twist_backwards_is_a_wish_to_stand():
    assert CAR.drive_for(Twist(-3.0, 0.2), rolling(5.0)) == CAR.drive_for(Twist(0.0, 0.2), rolling(5.0))


@pytest.mark.parametrize(("speed", "yaw_rate"), [(8.0, 0.5), (8.0, -0.5), (20.0, 0.1), (1.0, 0.1), (CRAWL, -0.1)])
def test_a_twist_ends_on_its_circle(speed, yaw_rate):
    motion = driven(CAR, rolling(0.0), Twist(speed, yaw_rate), 40.0, 400)
    assert (motion.speed, motion.yaw_rate) == pytest.approx((speed, yaw_rate), rel=1e-4)


@pytest.mark.parametrize("speed", [0.0, 0.2, 3.0, 15.0])
@pytest.mark.parametrize("wanted", [-1.0, 0.0, 0.2, 3.0, 15.0])
def test_a_twist_never_asks_for_more_than_its_yaw_rate_nor_more_than_its_curvature(speed, wanted):
    yaw_rate = 0.2
    curvature = CAR.drive_for(Twist(wanted, yaw_rate), rolling(speed)).curvature
    assert curvature * speed <= yaw_rate * (1 + 1e-12)
    assert curvature * max(wanted, 0) <= yaw_rate * (1 + 1e-12)
    assert 0 < curvature <= yaw_rate / CRAWL


def test_mirrored_command_draws_the_mirrored_path():
    commands = [Drive(2.0, 0.05), Drive(-1.0, -0.1), Twist(9.0, 0.4), Twist(3.0, -0.2)]
    left = right = rolling(7.0, start=(0.0, 0.0, 0.0))
    for command in commands:
        left = CAR.moved(left, command, 0.6)
        right = CAR.moved(right, type(command)(command[0], -command[1]), 0.6)
    mirror = np.array([1, -1, -1, -1, 1, -1, 1, -1, 1])  # in the order of the fields
    np.testing.assert_allclose(state(left) * mirror, state(right), rtol=1e-13)
    assert abs(left.y) > 1


def test_error_falls_with_the_square_of_the_step():
    def end(steps):
        motion = driven(CAR, rolling(8.0), Twist(11.0, 0.6), 0.8, steps)
        motion = driven(CAR, motion, Twist(4.0, -0.5), 1.6, 2 * steps)
        return np.array([motion.x, motion.y, motion.turned, motion.speed])

    exact = end(32 * 32)
    errors = [abs(end(steps) - exact).max() for steps in (32, 64, 128)]
    assert 32 * SUBSTEP == 0.8  # so every step is one sub-step
    assert errors[0] < 1e-3
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.2)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.2)


@pytest.mark.parametrize("command", [Drive(1.5, 0.04), Drive(-7.0, -0.1), Twist(12.0, 0.5), Twist(0.0, 0.5)])
def test_one_big_step_is_many_small_ones(command):
    big, small = (driven(CAR, rolling(8.0), command, 1.0, steps) for steps in (1, 40))
    np.testing.assert_allclose(state(big), state(small), atol=1e-12)


@pytest.mark.parametrize("kind", [Drive, Twist])
def test_stacked_cars_move_as_each_alone(kind):
    rng = np.random.default_rng(4)
    n = 21
    models = [Car(*values) for values in rng.uniform(0.1, 1.0, (n, len(fields(Car))))]
    start, speed, steering = rng.uniform(-3, 3, (3, n)), rng.uniform(0, 2, n), rng.uniform(-1, 1, n)
    commands = rng.uniform(-2, 2, (2, n))
    together = driven(stack(models), rolling(speed, steering, start), kind(*commands), 5.0, 3)
    assert 0 < (together.speed == 0).sum() < n
    for i, model in enumerate(models):
        alone = driven(model, rolling(speed[i], steering[i], start[:, i]), kind(*commands[:, i]), 5.0, 3)
        one_row = driven(
            stack([model]), rolling(speed[[i]], steering[[i]], start[:, [i]]), kind(*commands[:, [i]]), 5.0, 3
        )
        np.testing.assert_array_equal(state(together)[:, i], state(alone))
        np.testing.assert_array_equal(state(together)[:, i], state(one_row)[:, 0])


def test_the_order_of_cars_changes_nothing():
    """A fleet in another order gives the same bytes in that order."""
    rng = np.random.default_rng(2)
    order = rng.permutation(40)
    start, speed, commands = rng.uniform(-3, 3, (3, 40)), rng.uniform(0, 30, 40), rng.uniform(-1, 1, (2, 40))
    straight = driven(CAR, rolling(speed, start=start), Drive(*commands), 0.5, 5)
    shuffled = driven(CAR, rolling(speed[order], start=start[:, order]), Drive(*commands[:, order]), 0.5, 5)
    np.testing.assert_array_equal(state(straight)[:, order], state(shuffled))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("kind", [Drive, Twist])
def test_a_command_that_is_not_finite_is_refused(kind, bad):
    for command in (kind(np.array([0.0, bad]), 0.0), kind(0.0, bad)):
        with pytest.raises(ValueError, match="must be finite"):
            CAR.moved(rolling(), command, 0.1)


def test_inner_radius_of_the_design_car_on_its_smallest_circle_is_the_published_one():
    """11.7 m from kerb to kerb, and 3.5 m inside."""
    rear_radius = CAR.wheelbase / np.tan(steering_at_lock(11.7, CAR.wheelbase, CAR.width))
    assert rear_radius - CAR.width / 2 == pytest.approx(3.5, abs=0.1)
    assert 2 * np.hypot(rear_radius + CAR.width / 2, CAR.wheelbase) == pytest.approx(11.7)


@pytest.mark.parametrize(("kind", "kmh", "allowed"), [("car", 100, 0.1 * 100 + 0.006 * 100**2), ("truck", 60, 36.7)])
def test_a_vehicle_stops_within_the_distance_of_its_type_approval(kind, kmh, allowed):
    """UN R13-H, 0.1 v + 0.0060 v^2; UN R13, 0.15 v + v^2 / 130; v in km/h."""
    start = rolling(kmh / 3.6, start=(0.0, 0.0, 0.0))
    gone = driven(CARS[kind], start, Drive(-99.0, 0.0), 12.0, 120)
    assert gone.speed == 0
    assert 0.5 * allowed < gone.x < allowed


@pytest.mark.parametrize("kind", CARS)
def test_rear_axle_and_front_axle_lie_within_the_footprint(kind):
    car = CARS[kind]
    assert -car.length / 2 < car.axle < car.axle + car.wheelbase < car.length / 2


def test_car_reaches_100_kmh_in_the_time_of_an_average_car():
    motion = driven(CAR, rolling(), Drive(99.0, 0.0), 9.5, 95)
    assert 26.0 < motion.speed < 29.5


# ---- grip


@pytest.mark.parametrize("speed", [12.0, 25.0])
def test_beyond_the_grip_a_car_drives_the_circle_that_its_tyres_hold(speed):
    motion = driven(CAR, rolling(speed), Drive(0.0, 0.2), 3.0, 30)
    assert lateral_acceleration(motion) == pytest.approx(CAR.grip, rel=1e-9)
    loose = driven(replace(CAR, grip=np.inf), rolling(speed), Drive(0.0, 0.2), 3.0, 30)
    assert lateral_acceleration(loose) == pytest.approx(speed**2 * 0.2, rel=1e-6)


def test_braking_takes_what_a_bend_leaves_of_the_friction_circle():
    model = replace(DIRECT, max_braking=9.0, grip=9.0)
    motion = rolling(20.0, np.arctan(model.wheelbase * 0.015))  # 6 m/s2 to the left
    after = model.moved(motion, Drive(-20.0, 0.015), 0.01)
    assert (motion.speed - after.speed) / 0.01 == pytest.approx(np.sqrt(81 - 36), rel=0.01)


@pytest.mark.parametrize("kind", CARS)
def test_no_command_leaves_the_friction_circle(kind):
    rng, model, motion = np.random.default_rng(3), CARS[kind], rolling(20.0)
    for _ in range(400):
        before, motion = motion, CARS[kind].moved(motion, Drive(rng.uniform(-12, 6), rng.uniform(-0.3, 0.3)), 0.1)
        assert abs(lateral_acceleration(motion)) <= model.grip * (1 + 1e-9)
        # The brakes lag behind the bend, so for a moment the sum is above the circle.
        assert np.hypot(before.acceleration, lateral_acceleration(before)) < 1.42 * model.grip
