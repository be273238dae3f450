"""The paper's follower as printed: consequences of its formulas, measured in simulations."""

from dataclasses import replace

import numpy as np
import pytest

from platoontraffic.controllers.printed import SPEED_GAIN, PrintedFollower, edges
from platoontraffic.lidar import PRESETS, Mount
from platoontraffic.vehicles.motion import Twist
from tests.support.bench import (
    DT,
    FOLLOWER_EYE,
    NO_WALLS,
    POINT,
    ROBOT,
    WIDE_EYE,
    Prescribed,
    amplitude,
    asked,
    batch_of,
    constant,
    drive,
    platoon,
    rear_at,
)

EYE = PRESETS["paper-follower"]
PRINTED = PrintedFollower()
FAR_SIGHTED = PrintedFollower(no_return="infinity")
K = (np.pi / 2) / (2 * np.sin(np.pi / 4))  # 1.1107 1/s: from a distance to a speed
STEP = EYE.angle_increment


def command(law, ranges, memory=None):
    decision = asked(law, [ranges], memory=memory)
    return float(decision.command.speed[0]), float(decision.command.yaw_rate[0])


def test_straight_ahead_speed_is_1_1107_of_the_distance():
    assert pytest.approx(1.1107, abs=5e-5) == K == SPEED_GAIN
    for distance in (0.38, 0.42, 0.48):
        speed, yaw_rate = command(PRINTED, rear_at(distance, 0.15))
        assert speed == pytest.approx(K * distance, rel=1e-6)
        assert yaw_rate == pytest.approx(0, abs=1e-9)
        assert PRINTED.desired_distance(speed) == pytest.approx(distance, rel=1e-6)


def test_speed_is_the_arc_through_the_middle_as_printed():
    """r = D / (2 sin(theta / 2)), v = r theta, w = theta - 90, with straight ahead at 90 degrees."""
    bearing = 0.06
    decision = asked(FAR_SIGHTED, [rear_at(0.6, 0.1, bearing)])
    distance, theta = decision.target.distance[0], decision.target.bearing[0] + np.pi / 2
    assert theta == pytest.approx(np.pi / 2 + bearing, abs=STEP)
    assert decision.command.speed[0] == pytest.approx(theta * distance / (2 * np.sin(theta / 2)), rel=1e-12)
    assert decision.command.yaw_rate[0] == pytest.approx(theta - np.pi / 2, rel=1e-12)


def test_two_edges_are_found_exactly_as_printed():
    """Edge i lies between beam i and i + 1; the middle is the mean of point first + 1 and point second."""
    ranges = np.full(720, 0.95)
    ranges[100:201] = 0.40
    ranges[300:401] = 0.30  # a third and a fourth edge, which are ignored
    ranges[500] = 0.46  # a step of 0.49 m is no edge
    scan = batch_of([np.full(720, 0.95), ranges])
    np.testing.assert_array_equal(edges(EYE, scan.filled()), [[1, 1, 1, 1], [99, 200, 299, 400]])
    middle = 0.40 * np.exp(1j * EYE.angles[[100, 200]]).mean()
    (nothing, distance), (_, theta) = PRINTED.find(scan)
    assert np.isnan(nothing)
    assert distance == pytest.approx(abs(middle), rel=1e-12)
    assert theta == pytest.approx(np.pi / 2 + np.angle(middle), rel=1e-12)


def three_bodies() -> np.ndarray:
    """Two bodies in the view, and the background: four edges, at 99, 200, 299 and 400."""
    ranges = np.full(720, 0.95)
    ranges[100:201] = 0.40
    ranges[300:401] = 0.30
    return ranges


@pytest.mark.parametrize(
    ("between", "ranges", "beams"),
    [
        ("first_two", (0.40, 0.40), (100, 200)),
        ("last_edge", (0.30, 0.95), (400, 401)),
        ("offsets", (0.40, 0.30), (200, 300)),
    ],
)
def test_readings_of_lines_13_to_18_take_the_points_that_they_name(between, ranges, beams):
    """`offsets`: the first point of the second edge, and the second point of the third."""
    distance, theta = replace(PRINTED, between=between).find(batch_of([three_bodies()]))
    middle = (np.array(ranges) * np.exp(1j * EYE.angles[list(beams)])).mean()
    assert distance[0] == pytest.approx(abs(middle), rel=1e-12)
    assert theta[0] == pytest.approx(np.pi / 2 + np.angle(middle), rel=1e-12)


@pytest.mark.parametrize(("between", "edges_needed"), [("first_two", 2), ("last_edge", 1), ("offsets", 3)])
def test_each_reading_needs_its_number_of_edges(between, edges_needed):
    ranges = np.full(720, 0.95)
    law = replace(PRINTED, between=between)
    for i in range(4):
        assert np.isnan(law.find(batch_of([ranges])).distance[0]) == (i < edges_needed)
        ranges[100 * (i + 1) :] = 0.35 if i % 2 == 0 else 0.95


def test_with_theta_from_the_lasers_own_frame_it_turns_right_of_what_is_straight_ahead():
    """theta = 0 straight ahead: v = D, and theta - 90 is a quarter turn a second to the right."""
    law = replace(PRINTED, frame="x_forward")
    speed, yaw_rate = command(law, rear_at(0.42, 0.15))
    assert speed == pytest.approx(0.42, rel=1e-6)
    assert yaw_rate == pytest.approx(-np.pi / 2)
    assert law.desired_distance(0.3) == 0.3
    bearing = 0.04
    decision = asked(law, [rear_at(0.42, 0.12, bearing)])
    assert decision.target.bearing[0] == pytest.approx(bearing, abs=STEP)
    assert decision.command.yaw_rate[0] == pytest.approx(decision.target.bearing[0] - np.pi / 2, rel=1e-12)


def test_signed_step_finds_only_one_of_the_two_edges():
    law = replace(PRINTED, edge="signed")
    ranges = rear_at(0.42, 0.15)
    rear = np.flatnonzero(np.isfinite(ranges))
    np.testing.assert_array_equal(edges(EYE, batch_of([ranges]).filled(), "signed"), [[0], rear[-1:]])
    assert command(law, ranges) == (0, 0)


def test_no_return_as_range_max_hides_what_is_farther_than_half_a_metre():
    scan = batch_of([rear_at(0.49, 0.15), rear_at(0.51, 0.15)])
    assert PRINTED.find(scan).distance == pytest.approx([0.49, np.nan], abs=1e-6, nan_ok=True)
    assert FAR_SIGHTED.find(scan).distance == pytest.approx([0.49, 0.51], abs=1e-6)


def test_degrees_taken_as_radians_turn_57_times_as_fast():
    ranges = rear_at(0.42, 0.12, 0.04)
    _, radians = command(PRINTED, ranges)
    _, degrees = command(replace(PRINTED, yaw_unit="deg"), ranges)
    assert degrees == pytest.approx(radians * 180 / np.pi, rel=1e-12)


@pytest.mark.parametrize("bearing", [0.0, 0.04])
def test_bearing_in_the_arc_gives_speed_1_0_of_the_distance(bearing):
    """theta / (2 sin(theta / 2)) = 1 + theta^2 / 24 + ..."""
    law = replace(PRINTED, angle_in_speed="bearing")
    decision = asked(law, [rear_at(0.42, 0.12, bearing)])
    assert decision.command.speed[0] / decision.target.distance[0] == pytest.approx(1 + bearing**2 / 24, abs=2e-6)
    assert law.desired_distance(0.3) == 0.3


def test_without_a_target_it_stops_or_holds_its_last_command():
    seen, nothing = rear_at(0.42, 0.12, 0.04), np.full(720, np.inf)
    for law, on_loss in ((PRINTED, "stop"), (replace(PRINTED, on_loss="hold"), "hold")):
        first = asked(law, [seen])
        later = asked(law, [nothing], memory=first.memory)
        kept = np.array(first.command) if on_loss == "hold" else np.zeros((2, 1))
        np.testing.assert_array_equal(later.command, kept)
        assert np.isnan(later.target.distance[0])
        assert command(law, nothing) == (0, 0)


def test_each_vehicle_decides_by_its_own_scan_and_holds_its_own_command():
    law = replace(PRINTED, on_loss="hold")
    rears = np.random.default_rng(11).uniform((0.31, 0.05, -0.3), (0.6, 0.2, 0.3), (2, 200, 3))
    first, then = ([rear_at(*rear) for rear in step] for step in rears)
    together = asked(law, first)
    later = asked(law, then, memory=together.memory)
    for i, (seen, seen_then) in enumerate(zip(first, then, strict=True)):
        alone = asked(law, [seen])
        np.testing.assert_array_equal(alone.target, np.array(together.target)[:, [i]])
        later_alone = asked(law, [seen_then], memory=alone.memory)
        np.testing.assert_array_equal(later_alone.command, np.array(later.command)[:, [i]])
    held = np.isnan(later.target.distance) & ~np.isnan(together.target.distance)
    assert 10 < held.sum() < 190
    np.testing.assert_array_equal(np.array(later.command)[:, held], np.array(together.command)[:, held])


def test_a_target_at_the_laser_itself_is_not_driven_to():
    """The sensor is inside a solid and has no blind zone, so that the distance is 0 and the angle any."""
    ranges = np.full(720, 0.9)
    ranges[300:400] = -np.inf
    decision = asked(PRINTED, [ranges], replace(EYE, range_min=0.0))
    assert decision.target.distance == 0
    assert not np.any(decision.command)


def test_nearer_than_the_sufficient_distance_it_stands():
    ranges = rear_at(0.42, 0.15)
    assert command(replace(PRINTED, sufficient_distance=0.43), ranges) == (0, 0)
    assert command(replace(PRINTED, sufficient_distance=0.41), ranges)[0] > 0


def test_both_edges_are_in_view_from_w_over_2_tan_11_5_deg():
    """The limit is set by the outermost beams but one: the last beam on each side must pass the rear."""
    width = 0.15
    distances = np.arange(0.35, 0.39, 1e-5)
    found = PRINTED.find(batch_of([rear_at(d, width) for d in distances]))
    seen = distances[np.isfinite(found.distance)]
    nearest = width / (2 * np.tan(EYE.angle_max))
    assert nearest == pytest.approx(2.46 * width, rel=1e-3)
    assert nearest - 1e-5 <= min(seen) <= width / (2 * np.tan(EYE.angle_max - STEP)) + 1e-5


def behind(speed, law, seconds=6.0):
    start = np.clip(law.desired_distance(speed) + 0.01, 0.37, 0.98 if law.no_return == "infinity" else 0.49)
    return drive(platoon(constant(speed), law, 1, distance=start), NO_WALLS, seconds)


@pytest.mark.parametrize(
    ("law", "speed"),
    [(PRINTED, 0.43), (PRINTED, 0.48), (PRINTED, 0.54), (FAR_SIGHTED, 0.6), (FAR_SIGHTED, 0.85), (FAR_SIGHTED, 1.05)],
)
def test_the_follower_keeps_a_headway_of_0_900_s(law, speed):
    """Steady distance v / 1.1107; 6 s leave exp(-6.7) of the centimetre it starts with."""
    log = behind(speed, law)
    assert log.locked().all()
    assert log.distance[-1, 1] == pytest.approx(speed / K, rel=1e-3)
    bumper_to_bumper = log.x[-1, 0] - log.x[-1, 1] - ROBOT.length
    assert bumper_to_bumper == pytest.approx(speed / K - 0.03, rel=1e-3)  # the laser is 0.03 m behind the bumper
    assert log.wanted_speed[-1, 1] == pytest.approx(speed, rel=1e-3)


def test_below_its_range_of_speeds_the_follower_stops_and_goes_at_the_near_limit_of_sight():
    """At 0.35 m/s the desired distance is 0.315 m, but both edges are in view only from 0.369 m on."""
    log = behind(0.35, PRINTED)
    late = log.time > 1.0
    assert 0.5 < log.locked()[late].mean() < 0.95
    assert set(np.round(log.wanted_speed[late, 1], 1)) == {0.0, 0.4}
    assert np.nanmin(log.distance[late, 1]) > 0.15 / (2 * np.tan(EYE.angle_max))
    laser_to_rear = log.x[late, 0] - log.x[late, 1] - ROBOT.length / 2 - FOLLOWER_EYE.mount.x
    assert 0.36 < laser_to_rear.min() < laser_to_rear.max() < 0.38


@pytest.mark.parametrize(("law", "speed"), [(PRINTED, 0.60), (FAR_SIGHTED, 1.14)])
def test_above_its_range_of_speeds_the_follower_loses_its_predecessor_for_good(law, speed):
    """The desired distance is beyond 0.50 m, or, with misses at infinity, beyond 1.0 m."""
    log = behind(speed, law)
    assert log.locked()[0].all()
    assert not log.locked()[-1].any()
    assert log.speed[-1, 1] == 0


def on_a_circle(speed, radius, gain, seconds, model=POINT, eye=WIDE_EYE):
    """Leader and follower on a circle to the left, from near the steady state."""
    yaw_rate = speed / radius
    back = -yaw_rate / K  # the arc between them
    own = radius * (1 + yaw_rate**2 * (1 / (K * gain) - 1 / (2 * K**2)))
    law = replace(FAR_SIGHTED, heading_gain=gain)
    leader, follower = platoon(constant(speed, yaw_rate), law, 1, model=model, eye=eye)
    follower = replace(follower, pose=(own * np.sin(back), radius - own * np.cos(back), back))
    return drive([leader, follower], NO_WALLS, seconds)


@pytest.mark.parametrize("speed", [0.2, 0.47])
@pytest.mark.parametrize("gain", [1.0, 2 * K])
def test_on_a_circle_the_bearing_is_v_over_K_R_and_the_radius_follows(gain, speed):
    """The follower turns as fast as the leader: beta = w/K. Then, with v = f D and f = v/D at that bearing,
    R_follower/R = 1 / sqrt(1 - 2 (w/f) sin(beta) + (w/f)^2). A beam is 1.1 mrad.
    """
    radius = 1.0
    log = on_a_circle(speed, radius, gain, 10.0)
    tail = slice(-200, None)
    bearing = speed / (gain * radius)
    assert log.bearing[tail, 1].mean() == pytest.approx(bearing, rel=2e-3)
    theta = np.pi / 2 + bearing
    reach = speed / radius / (theta / (2 * np.sin(theta / 2)))
    ratio = 1 / np.sqrt(1 - 2 * reach * np.sin(bearing) + reach**2)
    own = np.hypot(log.x[tail, 1], log.y[tail, 1] - radius).mean()
    assert own / radius == pytest.approx(ratio, abs=2e-3)
    if gain == 2 * K:
        assert own / radius == pytest.approx(1, abs=2.5e-3)  # it keeps the leader's circle
    elif speed == 0.47:
        assert own / radius == pytest.approx(1.12, abs=5e-3)


def test_bearing_on_a_circle_does_not_depend_on_the_robots_shape():
    wide = replace(WIDE_EYE, mount=FOLLOWER_EYE.mount)
    log = on_a_circle(0.4, 1.2, 1.0, 10.0, model=ROBOT, eye=wide)
    assert log.bearing[-200:, 1].mean() == pytest.approx(0.4 / 1.2, rel=0.01)


@pytest.mark.parametrize(("speed", "gain"), [(0.6, 1.0), (0.8, 1.0), (0.8, 2 * K)])
def test_sight_is_lost_where_bearing_and_half_width_fill_the_view(speed, gain):
    """v/(K R) + w/(2 D) = 11.5 deg, to first order: held 5 % above that radius, lost 5 % below."""
    width = 0.15
    flat = replace(POINT, width=width)
    eye = replace(FOLLOWER_EYE, mount=Mount())
    radius = speed / gain / (EYE.angle_max - width * K / (2 * speed))
    wider, narrower = (on_a_circle(speed, f * radius, gain, 5.0, flat, eye) for f in (1.05, 0.95))
    assert wider.locked().all()
    assert not narrower.locked().all()


def string(omega, lag, settling):
    """Amplitudes of the speeds of a leader and two followers over one period; the leader's oscillates at omega."""
    leader = Prescribed(lambda time: Twist(0.5 + 0.05 * np.sin(omega * time), 0.0))
    members = platoon(leader, FAR_SIGHTED, 2, model=replace(POINT, lag=lag), eye=WIDE_EYE, distance=0.5 / K)
    log = drive(members, NO_WALLS, settling + 2 * np.pi / omega)
    late = log.time >= settling
    return amplitude(log.time[late], log.speed[late], omega)


@pytest.mark.parametrize("omega", [0.5, 1.0, 3.0])
def test_a_string_of_followers_damps_as_a_first_order_low_pass(omega):
    """G = k / (jw + k); sampled, k dt / (z - 1 + k dt) at z = exp(jw dt)."""
    leader, first, second = string(omega, 0.0, 8.0)
    sampled = abs(K * DT / (np.exp(1j * omega * DT) - 1 + K * DT))
    assert sampled == pytest.approx(1 / np.hypot(1, omega / K), rel=0.015)
    assert first / leader == pytest.approx(sampled, rel=1e-3)
    assert second / first == pytest.approx(sampled, rel=1e-3)


def test_a_string_with_a_lag_of_0_8_s_swings_up():
    """|G| = 1 / sqrt((1 - tau w^2/k)^2 + w^2/k^2), above 1 as k tau > 1/2; largest at w^2 = k/tau - 1/(2 tau^2).

    The command waits half a step on average: jw tau + 1 becomes that times jw/k, plus exp(-jw dt/2).
    """
    tau = 0.8
    omega = np.sqrt(K / tau - 1 / (2 * tau**2))
    leader, first, second = string(omega, tau, 14.0)
    continuous = 1 / np.hypot(1 - tau * omega**2 / K, omega / K)
    sampled = 1 / abs(1j * omega * (1 + 1j * omega * tau) / K + np.exp(-1j * omega * DT / 2))
    assert min(first / leader, second / first) > 1.1
    assert [first / leader, second / first] == pytest.approx([sampled] * 2, rel=2e-3)
    assert sampled == pytest.approx(continuous, rel=0.01)
