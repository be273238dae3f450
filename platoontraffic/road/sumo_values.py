"""Numbers in SUMO's files that must be sound: SUMO drives on with some that are not, and dies of others."""

from __future__ import annotations

import math
from collections.abc import Mapping

MOST = 1e9  # of lengths, speeds and durations: more overflows in SUMO or here

# By element and attribute: numbers that must be more than 0.
POSITIVE = {
    "lane": ("speed", "length", "width"),
    "edge": ("speed", "length", "width"),
    "phase": ("duration",),
    "vType": ("length", "width", "height", "maxSpeed", "accel", "decel", "emergencyDecel", "tau"),
}
# Numbers in any element; a word in their place is left to SUMO.
FINITE = frozenset(
    {
        *("x", "y", "z", "pos", "startPos", "endPos", "departPos", "departPosLat", "departSpeed", "arrivalPos"),
        *("arrivalSpeed", "depart", "begin", "end", "period", "freq", "vehsPerHour", "probability", "number", "until"),
        *("duration", "minDur", "maxDur", "speed", "length", "width", "height", "angle", "minGap", "accel", "decel"),
        *("emergencyDecel", "apparentDecel", "tau", "sigma", "speedFactor", "speedDev", "maxSpeed", "impatience"),
        *("friction", "offset"),
    }
)


def unsound(tag: str, attributes: Mapping[str, str]) -> str:
    """`name = "value"; must be …` of the first number of an element that is not sound; "" if all are."""
    positive = POSITIVE.get(tag, ())
    for name in FINITE & attributes.keys():
        try:
            value = float(attributes[name])
        except ValueError:  # a word, a time such as 1:30:00, or nothing that SUMO takes
            continue
        if not math.isfinite(value) or (name in positive and not 0 < value <= MOST):
            rule = f"a number more than 0, at most {MOST:g}" if name in positive else "a finite number"
            return f'{name} = "{attributes[name]:.40}"; must be {rule}'
    return ""
