"""Speed profiles by their definitions, and as a leader drives them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from platoontraffic.controllers.path import PathLeader
from platoontraffic.controllers.profiles import Trace, braking, chirp, sinusoid
from platoontraffic.road.route import Route
from platoontraffic.simulation import Setting, Simulation
from platoontraffic.vehicles.bicycle import CARS
from tests.support.bench import NO_WALLS, ROBOT, drive, platoon

amounts = st.floats(0.1, 10)
frequencies = st.floats(0.01, 1)


@given(st.floats(0, 200), amounts, frequencies)
def test_a_sinusoid_begins_at_nothing_and_returns_after_a_period(t, amplitude, frequency):
    now, later, half = (sinusoid(np.array([t + turns / frequency]), amplitude, frequency) for turns in (0, 1, 0.5))
    assert sinusoid(np.zeros(1), amplitude, frequency) == 0
    assert sinusoid(np.array([0.25 / frequency]), amplitude, frequency) == pytest.approx(amplitude)
    assert later == pytest.approx(now, abs=1e-9 * amplitude * (1 + 1e3 * frequency))
    assert half == pytest.approx(-now, abs=1e-9 * amplitude * (1 + 1e3 * frequency))


@given(st.floats(0, 60), amounts, frequencies, frequencies)
def test_the_frequency_of_a_chirp_grows_linearly(t, amplitude, first, last):
    """The phase is that of the mean of the first and the present frequency."""
    present = first + (last - first) * t / 60
    value = chirp(np.array([t]), amplitude, first, last, 60.0)
    assert value == pytest.approx(amplitude * np.sin(2 * np.pi * (first + present) / 2 * t), abs=1e-9)


def test_a_chirp_of_one_frequency_is_a_sinusoid_until_it_ends():
    t = np.linspace(0, 90, 500)
    expected = np.where(t <= 60, sinusoid(t, 2.0, 0.1), 0.0)
    np.testing.assert_allclose(chirp(t, 2.0, 0.1, 0.1, 60.0), expected, atol=1e-9)


@given(st.floats(0, 200), st.floats(-30, 30), amounts)
def test_braking_runs_at_its_rate_and_ends_at_its_height(t, height, rate):
    (value,) = braking(np.array([t]), np.array([height]), rate)
    assert abs(value) == pytest.approx(min(rate * t, abs(height)))
    assert value * height >= 0


# ---- traces


def test_a_trace_is_linear_between_its_times_and_kept_outside():
    trace = Trace(np.array([10.0, 20.0, 30.0]), np.array([5.0, 15.0, 15.0]))
    speed = trace.at(np.array([0.0, 10.0, 12.5, 20.0, 29.0, 30.0, 99.0]))
    np.testing.assert_allclose(speed, [5, 5, 7.5, 15, 15, 15, 15])


def test_a_trace_of_one_row_is_a_constant_speed():
    speed = Trace(np.array([3.0]), np.array([7.0])).at(np.array([0.0, 3.0, 50.0]))
    np.testing.assert_array_equal(speed, 7)


@pytest.mark.parametrize("start", ["", "\ufeff"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_trace_may_come_from_a_spreadsheet(tmp_path, start, end):
    file = tmp_path / "cycle.csv"
    rows = ["speed_mps,note,time_s", "1.5,a,0", "2.5,b,10"]
    file.write_bytes((start + end.join(rows) + end).encode())
    trace = Trace.read(file)
    np.testing.assert_array_equal(trace.time, [0, 10])
    np.testing.assert_array_equal(trace.speed, [1.5, 2.5])


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "has no column speed_mps and time_s"),
        (b"time_s,speed_mps\n0,1\n1\n", r"cycle.csv:3: time_s '1', speed_mps None; must be numbers"),
        (b"time_s,speed_mps\n0,nan\n", "speeds be 0 or more"),
        (b"time_s,speed_mps\n0,inf\n", "speeds be 0 or more"),
        (b"time_s;speed_mps\n0;1\n", "has no column"),
        ("time_s,speed_mps,Straße\n0,1,x\n".encode("latin-1"), "cannot be read"),
    ],
)
def test_a_fault_of_a_trace_is_one_line_with_its_file(tmp_path, content, said):
    file = tmp_path / "cycle.csv"
    file.write_bytes(content)
    with pytest.raises(ValueError, match=said) as error:
        Trace.read(file)
    assert str(file) in str(error.value)
    assert len(str(error.value).splitlines()) == 1


OPENACC = """\
Date,2019-09-19
Test,1
Vehicle_order,lead,first,second
ACC,1
Distance_setting,min
Time,Speed1,Lat1,Lon1,E1,N1,U1,Speed2,E2,N2,U2,IVS1,Driver1,Driver2
100.0,20.0,0.9,0.1,1.0,2.0,3.0,19.5,1.0,2.0,3.0,30.1,Human,ACC
100.1,20.5,0.9,0.1,1.0,2.0,3.0,19.6,1.0,2.0,3.0,30.2,Human,ACC
100.2,21.0,0.9,0.1,1.0,2.0,3.0,19.8,1.0,2.0,3.0,30.3,Human,ACC
"""


def test_a_file_of_openacc_is_the_trace_of_its_first_car(tmp_path):
    file = tmp_path / "openacc.csv"
    file.write_text(OPENACC)
    trace = Trace.read(file)
    np.testing.assert_allclose(trace.time, [0, 0.1, 0.2], atol=1e-9)
    np.testing.assert_array_equal(trace.speed, [20.0, 20.5, 21.0])
    file.write_text(OPENACC.replace("100.1,20.5", "100.1,"))
    with pytest.raises(ValueError, match=r"openacc.csv:8: Time '100.1', Speed1 ''; must be numbers"):
        Trace.read(file)


def test_a_trace_that_is_not_there_or_is_a_folder_cannot_be_read(tmp_path):
    for file in (tmp_path / "none.csv", tmp_path):
        with pytest.raises(ValueError, match="cannot be read"):
            Trace.read(file)


# ---- as a leader drives them


def car(law: PathLeader, model=CARS["car"]):
    """A leader on a straight road with a speed limit of 50 m/s."""
    (member,) = platoon(law, at=(-model.axle, 0.0, 0.0), model=model)
    straight = np.array([(0.0, 0.0), (1e4, 0.0)])
    return replace(member, route=Route.along(("road",), straight, np.full(2, 50.0)))


@pytest.mark.parametrize("profile", ["sinusoid", "chirp", "step", "brake"])
def test_until_it_begins_a_profile_changes_nothing(profile):
    law = PathLeader(speed=10.0, profile=profile, begins=5.0, amplitude=2.0, last_speed=3.0)
    log = drive([replace(car(law), speed=10.0)], NO_WALLS, 9.0, dt=0.1)
    lags = CARS["car"].lag + CARS["car"].brake_lag  # by which the command leads
    assert log.speed[log.time <= 5.0 - lags] == pytest.approx(10.0)
    assert log.speed[log.time <= 5.0] == pytest.approx(10.0, abs=0.05)
    assert abs(log.speed[-1, 0] - 10.0) > 0.5


def test_the_profile_of_each_vehicle_begins_when_that_vehicle_departs():
    law = PathLeader(speed=10.0, profile="brake", begins=2.0, last_speed=4.0, rate=2.0)
    first = replace(car(law), speed=10.0)
    beside = Route.along(("road",), np.array([(0.0, 50.0), (1e4, 50.0)]), np.full(2, 50.0))
    later = replace(first, id="b.0", platoon="b", pose=(first.pose[0], 50.0, 0.0), route=beside, departs=5.0)
    with Simulation(Setting([first, later], NO_WALLS, 0.1, steps=120)) as simulation:
        speeds = [now.fleet.motion.speed for now in simulation]
    np.testing.assert_allclose([row[1] for row in speeds[50:]], [row[0] for row in speeds[:71]], atol=1e-9)


@pytest.mark.parametrize(("amplitude", "profile"), [(20.0, "sinusoid"), (20.0, "chirp")])
@pytest.mark.parametrize("model", [CARS["car"], ROBOT], ids=["car", "robot"])
def test_no_vehicle_drives_backwards_where_its_profile_is_negative(amplitude, profile, model):
    scale = 0.02 if model is ROBOT else 1.0
    law = PathLeader(speed=5.0 * scale, profile=profile, amplitude=amplitude * scale, frequency=0.1)
    log = drive([car(law, model)], NO_WALLS, 15.0)
    assert log.speed.min() > -1e-9
    assert log.speed.max() > 5.1 * scale


@pytest.mark.parametrize("frequency", [5.0, 10.0, 50.0])
def test_a_profile_faster_than_the_steps_does_not_run_away(frequency):
    """A sinusoid sampled at its steepest phase in every step must not be taken for a lasting acceleration."""
    law = PathLeader(speed=10.0, profile="sinusoid", amplitude=1.0, frequency=frequency)
    log = drive([replace(car(law), speed=10.0)], NO_WALLS, 10.0, dt=0.1)
    assert np.abs(log.speed - 10.0).max() < 1.5


def test_a_robot_has_the_speed_of_its_profile_after_every_step():
    """A robot has no lag."""
    law = PathLeader(speed=0.3, profile="sinusoid", amplitude=0.1, frequency=0.5, acceleration=9.0, braking=9.0)
    log = drive([replace(car(law, ROBOT), speed=0.3)], NO_WALLS, 6.0)
    np.testing.assert_allclose(log.speed[:, 0], 0.3 + 0.1 * np.sin(np.pi * log.time), atol=2e-3)
