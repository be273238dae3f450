"""Speeds over time by their definitions, and that what is named their rate is it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from platoontraffic.controllers.path import PathLeader
from platoontraffic.controllers.profiles import Trace, braking, chirp, sinusoid, step

amounts = st.floats(0.1, 10)
frequencies = st.floats(0.01, 1)
instants = st.floats(0.01, 200)


def rate_of(profile, t: float, h: float = 1e-5) -> float:
    before, after = profile(np.array([t - h, t + h]))[0]
    return (after - before) / (2 * h)


@given(instants, amounts, frequencies)
def test_the_rate_of_a_sinusoid_is_its_derivative(t, amplitude, frequency):
    value, rate = sinusoid(np.array([t]), amplitude, frequency)
    assert value[0] == pytest.approx(amplitude * np.sin(2 * np.pi * frequency * t), abs=1e-9)
    assert rate[0] == pytest.approx(rate_of(lambda t: sinusoid(t, amplitude, frequency), t), abs=1e-4 * amplitude)


@given(st.floats(0.1, 59.9), amounts, frequencies, frequencies)
def test_the_rate_of_a_chirp_is_its_derivative_and_its_frequency_grows_linearly(t, amplitude, first, last):
    value, rate = chirp(np.array([t]), amplitude, first, last, 60.0)
    turns = first * t + (last - first) * t**2 / 120
    assert value[0] == pytest.approx(amplitude * np.sin(2 * np.pi * turns), abs=1e-9)
    assert rate[0] == pytest.approx(rate_of(lambda t: chirp(t, amplitude, first, last, 60.0), t), abs=1e-4 * amplitude)


def test_a_chirp_of_one_frequency_is_a_sinusoid_until_it_ends():
    t = np.linspace(0, 90, 500)
    for one, other in zip(chirp(t, 2.0, 0.1, 0.1, 60.0), sinusoid(t, 2.0, 0.1), strict=True):
        np.testing.assert_allclose(one, np.where(t <= 60, other, 0.0), atol=1e-9)


@given(st.floats(0, 200), st.floats(-30, 30), amounts)
def test_braking_runs_at_its_rate_and_ends_at_its_height(t, height, rate):
    (value,), (change,) = braking(np.array([t]), np.array([height]), rate)
    assert abs(value) == pytest.approx(min(rate * t, abs(height)))
    assert value * height >= 0
    assert abs(change) in (0.0, rate)
    if t > abs(height) / rate + 1e-9:
        assert (value, change) == (pytest.approx(height), 0.0)


def test_a_step_is_there_at_once_and_names_no_rate():
    value, rate = step(np.array([0.0, 5.0]), np.array([-3.0, -3.0]))
    np.testing.assert_array_equal(value, [-3, -3])
    np.testing.assert_array_equal(rate, 0)


# ---- traces


def test_a_trace_is_linear_between_its_times_and_kept_outside():
    trace = Trace(np.array([10.0, 20.0, 30.0]), np.array([5.0, 15.0, 15.0]))
    speed, change = trace.at(np.array([0.0, 10.0, 12.5, 20.0, 29.0, 30.0, 99.0]))
    np.testing.assert_allclose(speed, [5, 5, 7.5, 15, 15, 15, 15])
    np.testing.assert_allclose(change, [0, 1, 1, 0, 0, 0, 0])


@given(st.lists(st.tuples(st.floats(0.1, 20), st.floats(0, 40)), min_size=1, max_size=20), st.floats(-5, 400))
def test_the_change_of_a_trace_is_that_of_its_speed(rows, t):
    steps, speed = np.array(rows).T
    trace = Trace(np.cumsum(steps), speed)
    here, soon = (trace.at(np.array([t + dt])) for dt in (0.0, 1e-6))
    if np.searchsorted(trace.time, t, "right") == np.searchsorted(trace.time, t + 1e-6, "right"):
        assert soon[0] - here[0] == pytest.approx(1e-6 * here[1], abs=1e-9)


def test_a_trace_of_one_row_is_a_constant_speed():
    speed, change = Trace(np.array([3.0]), np.array([7.0])).at(np.array([0.0, 3.0, 50.0]))
    np.testing.assert_array_equal(speed, 7)
    np.testing.assert_array_equal(change, 0)


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
def test_what_is_wrong_with_a_trace_is_one_line_with_its_file(tmp_path, content, said):
    file = tmp_path / "cycle.csv"
    file.write_bytes(content)
    with pytest.raises(ValueError, match=said) as error:
        Trace.read(file)
    assert str(file) in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_a_trace_that_is_not_there_or_is_a_folder_cannot_be_read(tmp_path):
    for file in (tmp_path / "none.csv", tmp_path):
        with pytest.raises(ValueError, match="cannot be read"):
            Trace.read(file)


# ---- what a leader makes of them


@pytest.mark.parametrize("profile", ["sinusoid", "chirp", "step", "brake"])
def test_until_it_begins_a_profile_changes_nothing(profile):
    law = PathLeader(speed=10.0, profile=profile, begins=5.0, amplitude=2.0, last_speed=3.0)
    speed, change = law._profile(np.array([0.0, 4.999, 5.0, 9.0]), np.full(4, 30.0))
    np.testing.assert_array_equal(speed[:2], 10.0)
    np.testing.assert_array_equal(change[:2], 0.0)
    assert speed[3] != 10.0


def test_each_row_has_its_own_time_and_limit():
    law = PathLeader(speed="road", speed_factor=0.5, profile="brake", last_speed=0.0, rate=2.0)
    speed, _ = law._profile(np.array([0.0, 1.0, 100.0]), np.array([10.0, 20.0, 30.0]))
    np.testing.assert_allclose(speed, [5.0, 8.0, 0.0])
