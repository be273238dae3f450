"""Calls of laws, in which the faults of a plug-in are reported with its file and line."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from platoontraffic.controllers.law import NO_TARGET, Decision, Law, Sensed, Target
from platoontraffic.errors import InputError
from platoontraffic.plug_ins import end_copy, is_shipped, place_of
from platoontraffic.vehicles.motion import Drive, Twist
from platoontraffic.vehicles.records import take

NO_ROWS = np.empty((2, 0))


class Occasion(NamedTuple):
    """When a group of vehicles decides."""

    stamp: float  # [s]
    ids: tuple[str, ...]  # (n,)


def decide(law: Law, sensed: Sensed, memory: Any, dt: float, at: Occasion) -> Decision:
    """The decision of a law, its command and target as arrays (n,); NO_TARGET stays as it is.

    at    : instant and vehicles, for errors
    raises: InputError if a plug-in fails, or decides nothing that fits n vehicles; or if a command is not finite
    """
    decision = law(sensed, memory, dt) if is_shipped(type(law)) else _call(law, at, law, sensed, memory, dt)
    n = sensed.speed.size
    if _is_sound(decision, n):
        _check_finite(law, decision, at)
        return decision
    try:
        kind = Drive if isinstance(decision.command, Drive) else Twist
        command = kind(*[_row_each(values, n) for values in decision.command])
        distance, bearing = [_row_each(values, n) for values in decision.target]
        decision = Decision(command, decision.memory, Target(distance, bearing))
    except (AttributeError, TypeError, ValueError) as error:
        if is_shipped(type(law)):
            raise
        what = f"gave {decision!r:.200}; must be a Decision of a Twist, or a Drive, and a Target with numbers, {n} rows"
        raise _fault(law, what) from error
    _check_finite(law, decision, at)
    return decision


def desired_distance(law: Law, speed: float) -> float:
    """Distance from laser to rear that a law keeps at one steady speed [m]; NaN: none."""
    return float(_call(law, f"in desired_distance({speed:g})", lambda: float(law.desired_distance(speed))))


def ask(law: Law, method: Callable, *arguments: Any) -> Any:
    """What another method of a law returns.

    raises: InputError if a plug-in fails
    """
    if is_shipped(type(law)):
        return method(*arguments)
    return _call(law, f"in {method.__name__}", method, *arguments)


def memory_of(law: Law, memory: Any, rows: np.ndarray) -> Any:
    """The rows of a law's memory for some of its vehicles.

    raises: InputError if no rows can be taken out of it
    """
    try:
        return take(memory, rows)
    except TypeError as error:
        raise _fault(law, f"remembers {error}") from error


def _call(law: Law, when: Occasion | str, function: Callable, *arguments: Any) -> Any:
    """function(*arguments); an error of a plug-in becomes an InputError that says when and where it failed."""
    if is_shipped(type(law)):
        return function(*arguments)
    process = os.getpid()
    try:
        return function(*arguments)
    except (Exception, SystemExit) as error:  # whatever a user's code may raise
        words = when if isinstance(when, str) else f"at {when.stamp:.3f} s"
        raise _fault(law, f"failed {words}: {type(error).__name__}: {error}", error) from error
    finally:
        end_copy(process)


def _is_sound(decision: Any, n: int) -> bool:
    """It is a decision with arrays (n,) of floats, as those of most laws."""
    if type(decision) is not Decision or type(decision.target) is not Target:
        return False
    if type(decision.command) is not Drive and type(decision.command) is not Twist:
        return False
    target = () if decision.target is NO_TARGET else decision.target
    for values in (*decision.command, *target):  # without a call for each: it is asked in every step
        if type(values) is not np.ndarray or values.dtype != float or values.shape != (n,):
            return False
    return True


def _check_finite(law: Law, decision: Decision, at: Occasion) -> None:
    command, target = decision.command, decision.target
    (one, other), (distance, bearing) = command, target
    if _kernel().all_finite(one, other, *(NO_ROWS if target is NO_TARGET else target)):
        return
    sound = np.isfinite(one) & np.isfinite(other) & ~np.isinf(distance) & ~np.isinf(bearing)
    row = int(np.argmin(sound))
    given = ", ".join(f"{name.replace('_', ' ')} {values[row]}" for name, values in command._asdict().items())
    distance, bearing = (np.broadcast_to(values, sound.shape)[row] for values in target)
    given += f", target {distance}, {bearing}"
    vehicle = f"{at.ids[row]} at {at.stamp:.3f} s"
    raise _fault(law, f"gave {given} for {vehicle}; must be finite, a target may be NaN")


@cache
def _kernel():
    """Imported when it is first used: importing numba takes half a second."""
    from platoontraffic.controllers import calls_kernel

    return calls_kernel


def _row_each(values: Any, n: int) -> np.ndarray:
    """Numbers as an array (n,)."""
    if type(values) is np.ndarray and values.dtype == float and values.shape == (n,):
        return values
    values = np.asarray(values)
    if values.dtype.kind not in "iuf":
        raise TypeError(f"{values.dtype} is no number")
    return np.full(n, float(values)) if values.ndim == 0 else np.broadcast_to(values.astype(float), (n,))


def _fault(law: Law, what: str, error: BaseException | None = None) -> InputError:
    return InputError(f"{place_of(law, error)}: law {type(law).__qualname__} {what}")
