"""Theory of strings: closed forms of the papers, and the sampled response against a simulated vehicle."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from platoontraffic.controllers.acc import ConstantTimeHeadway
from platoontraffic.controllers.acc_commercial import CommercialAcc
from platoontraffic.controllers.cacc_ploeg import PloegFollower
from platoontraffic.controllers.constant_spacing import ConstantSpacing
from platoontraffic.controllers.idm_follower import IntelligentDriver
from platoontraffic.controllers.law import Linear
from platoontraffic.controllers.printed import SPEED_GAIN
from platoontraffic.controllers.repaired import RepairedFollower
from platoontraffic.string_stability import theory
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.vehicles.motion import Drive, Motion, Twist

DT = 0.001  # so short that sampling hardly shows
CAR, ROBOT = VEHICLES["car"], VEHICLES["paper-robot"]
FREQUENCIES = np.geomspace(0.01, 1.0, 13)


def lagged(lag: float):
    return replace(CAR, lag=lag, brake_lag=lag)


def turn(peak, low: float, high: float) -> float:
    """Where a greatest gain falls to 1, between a value where it is above and one where it is not."""
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (middle, high) if peak(middle) > 1 + 1e-6 else (low, middle)
    return high


def test_acc_is_that_of_the_continuous_law():
    h, gain, lag = 1.2, 0.3, 0.4
    found = theory.gains(
        ConstantTimeHeadway(time_headway=h, distance_gain=gain), [lagged(lag)] * 2, 20, FREQUENCIES, DT
    )
    s = 2j * np.pi * FREQUENCIES
    closed = (s + gain) / (h * lag * s**3 + h * s**2 + (1 + gain * h) * s + gain)
    assert found[:, 0] == pytest.approx(closed, rel=5e-3)


def test_each_place_has_the_theory_of_its_own_vehicle():
    """The swing of a predecessor's position beside that of its speed is nearly the same for every car."""
    light, heavy = lagged(0.3), lagged(1.2)
    mixed, alone = (
        theory.gains(ConstantTimeHeadway(), vehicles, 20, FREQUENCIES, DT)
        for vehicles in ([light, light, heavy, light], [heavy, heavy])
    )
    assert mixed[:, 1] == pytest.approx(alone[:, 0], rel=1e-3)
    assert mixed[:, 2] == pytest.approx(mixed[:, 0], rel=1e-3)
    assert np.abs(mixed[:, 0] / alone[:, 0] - 1).max() > 0.3


@pytest.mark.parametrize("lag", [0.2, 0.5])
@pytest.mark.parametrize("gain", [0.1, 0.5])
def test_acc_turns_at_twice_the_lag(lag, gain):
    def peak(h: float) -> float:
        return theory.greatest(ConstantTimeHeadway(time_headway=h, distance_gain=gain), lagged(lag), 20, DT)

    assert turn(peak, 0.2 * lag, 5 * lag) == pytest.approx(2 * lag, rel=0.01)


def test_commercial_acc_amplifies_at_every_setting_and_turns_at_its_closed_form():
    def peak(h: float, lag: float = 0.0) -> float:
        return theory.greatest(CommercialAcc(time_headway=h), lagged(lag), 20, DT)

    assert turn(peak, 1.0, 5.0) == pytest.approx((-0.07 + (0.07**2 + 2 * 0.23) ** 0.5) / 0.23, rel=0.01)
    assert min(peak(h, lag) for h in (1.1, 1.6, 2.2) for lag in (0.0, 0.5)) > 1.02


def ploeg(h: float, delay: float, forward: bool = True) -> float:
    """The greatest |G| with the paper's lag of 0.1 s, gap and speed by radar, and a delay of the messages [s]."""
    law, dt = PloegFollower(time_headway=h, feed="radar", feed_forward=forward), 0.005
    return theory.greatest(law, lagged(0.1), 20, dt, delay=round(delay / dt))


def test_ploeg_turns_at_the_published_time_gaps():
    """0.67 s with messages 0.15 s late, and 3.16 s = sqrt(2 / kp) without the desired acceleration."""
    assert turn(lambda h: ploeg(h, 0.15), 0.2, 2.0) == pytest.approx(0.67, abs=0.02)
    assert turn(lambda h: ploeg(h, 0.0, forward=False), 1.0, 5.0) == pytest.approx(10**0.5, rel=0.01)
    assert ploeg(0.2, 0.0) <= 1 + 1e-3  # without delay no time gap is too short


def test_ploeg_without_delay_follows_by_its_time_gap_alone_whatever_the_lag():
    s = 2j * np.pi * FREQUENCIES
    for lag in (0.1, 0.5):
        found = theory.gains(PloegFollower(time_headway=0.7), [lagged(lag)] * 2, 20, FREQUENCIES, DT)[:, 0]
        assert found == pytest.approx(1 / (1 + 0.7 * s), rel=0.01)


def test_constant_spacing_has_the_published_peak():
    found = theory.gains(ConstantSpacing(), [lagged(0.1)] * 2, 20, f := np.geomspace(0.01, 2, 4000), DT)[:, 0]
    assert np.abs(found).max() == pytest.approx(1.21, abs=0.005)
    assert 2 * np.pi * f[np.abs(found).argmax()] == pytest.approx(0.93, abs=0.01)


@pytest.mark.parametrize("gain", [0.3, 1.0])
@pytest.mark.parametrize("speed_gain", [1.5, 3.0])
def test_constant_spacing_keeps_the_sensitivity_integral(gain, speed_gain):
    """Seiler, Pant, Hedrick: with two integrators in the loop the integral of log|T| / w^2 is 0."""
    law = ConstantSpacing(distance_gain=gain, speed_gain=speed_gain)
    w = np.geomspace(1e-3, 3e4, 200_000)
    found = np.abs(theory.gains(law, [lagged(0.1)] * 2, 20, w / (2 * np.pi), 1e-4)[:, 0])
    whole = np.trapezoid(np.log(found) / w**2, w)
    assert found.max() > 1
    assert abs(whole) < 0.02 * np.trapezoid(np.abs(np.log(found)) / w**2, w)


def test_idm_amplifies_slow_waves_exactly_where_its_criterion_says():
    for speed in (5.0, 15.0, 25.0):
        for acceleration in (0.3, 0.73, 1.5, 3.0):
            law = IntelligentDriver(acceleration=acceleration)
            one = law.linear(speed, 1)
            by_speed = one.speed + one.ahead_speed  # at a constant rate of the gap
            unstable = one.gap > by_speed**2 / 2 - by_speed * one.ahead_speed
            slow = np.abs(theory.gains(law, [lagged(0.0)] * 2, speed, np.geomspace(0.001, 0.5, 500), DT))
            assert (slow.max() > 1 + 1e-5) == unstable, (speed, acceleration)


def test_the_papers_law_turns_at_half_for_a_lag_on_speed():
    def peak(lag: float) -> float:
        return theory.greatest(RepairedFollower(), replace(ROBOT, lag=lag), 0.4, DT)

    assert peak(0.449) <= 1 + 1e-6 < peak(0.46)


def test_the_papers_law_on_a_car_turns_at_its_own_value():
    """G = k / (s (r s + 1) (T s + 1) + k), with the lag T and the time constant r with which a car takes up a speed."""
    response, lag = 0.2, 0.1

    def peak(k: float) -> float:
        law = SimpleNamespace(linear=lambda speed, place: Linear(gap=k, commands="speed"))
        return theory.greatest(law, replace(lagged(lag), response=response), 20.0, DT)

    w = np.geomspace(1e-3, 100, 100_000)
    s = 1j * w

    def closed(k: float) -> float:
        return np.abs(k / (s * (response * s + 1) * (lag * s + 1) + k)).max()

    assert turn(peak, 4.0, 0.1) == pytest.approx(turn(closed, 4.0, 0.1), rel=0.01)
    assert turn(closed, 4.0, 0.1) > SPEED_GAIN


@pytest.mark.parametrize(
    ("vehicle", "commands"),
    [(lagged(0.5), "acceleration"), (lagged(0.5), "speed"), (ROBOT, "acceleration"), (replace(ROBOT, lag=0.2), "speed"),
     (replace(ROBOT, lag=0.2), "acceleration"), (CAR, "acceleration")],
)  # fmt: skip
def test_the_sampled_response_is_that_of_the_vehicle(vehicle, commands):
    dt, frequency, base = 0.1, 0.2, 10.0 if vehicle.length > 1 else 0.5
    size = 0.2 if vehicle.length > 1 else 0.02
    motion, rows = replace(Motion.at_rest([0.0], [0.0], [0.0]), speed=np.array([base])), []
    for k in range(600):
        u = size * np.sin(2 * np.pi * frequency * k * dt)
        rows.append((u, motion.x[0] - base * k * dt, motion.speed[0] - base, motion.acceleration[0]))
        zero = np.zeros(1)
        command = Drive(zero + u, zero) if commands == "acceleration" else Twist(zero + base + u, zero)
        motion = vehicle.moved(motion, command, dt)
    rows = np.array(rows)[300:]
    t = np.arange(300, 600) * dt
    basis = np.column_stack([np.exp(2j * np.pi * frequency * t), np.exp(-2j * np.pi * frequency * t), t**0, t])
    u, p, v, a = np.linalg.lstsq(basis, rows, rcond=None)[0][0]
    z = np.exp(2j * np.pi * np.array([frequency]) * dt)
    found = theory.response(vehicle, commands, z, dt)
    assert (p / u, v / u, a / u) == pytest.approx(tuple(complex(one[0]) for one in found), rel=2e-3)
