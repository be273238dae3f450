"""Vehicles that SUMO drives by its car-following models: the human-led platoon, and SUMO's models as followers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, PlainValidator

from platoontraffic.controllers.gains import Keys
from platoontraffic.controllers.law import Law
from platoontraffic.errors import did_you_mean
from platoontraffic.vehicles.motion import Positive

# Parameters of each model by SUMO's names, as of its vehicle types; CC's `ccaht` is the headway of its ACC [s].
_OF_ALL = ("accel", "decel", "emergencyDecel", "apparentDecel", "minGap", "tau", "collisionMinGapFactor")
_OF_ACC = (
    "gapClosingControlGainSpeed", "gapClosingControlGainSpace", "gapControlGainSpeed", "gapControlGainSpace",
    "collisionAvoidanceGainSpeed", "collisionAvoidanceGainSpace",
)  # fmt: skip
PARAMETERS: dict[str, tuple[str, ...]] = {
    "Krauss": _OF_ALL,
    "IDM": (*_OF_ALL, "delta", "stepping"),
    "EIDM": (
        *_OF_ALL, "delta", "stepping", "tPersDrive", "tpreview", "treaction", "tPersEstimate", "ccoolness",
        "sigmaleader", "sigmagap", "sigmaerror", "jerkmax", "epsilonacc", "taccmax", "Mflatness", "Mbegin",
        "vehdynamics", "maxvehpreview",
    ),
    "ACC": (*_OF_ALL, "speedControlGain", *_OF_ACC),
    "CACC": (
        *_OF_ALL, "speedControlGainCACC", *_OF_ACC, "gapClosingControlGainGap", "gapClosingControlGainGapDot",
        "gapControlGainGap", "gapControlGainGapDot", "collisionAvoidanceGainGap", "collisionAvoidanceGainGapDot",
        "tauCACCToACC",
    ),
    "CC": (
        *_OF_ALL, "ccaht", "ccAccel", "ccDecel", "constSpacing", "kp", "lambda", "c1", "xi", "omegaN", "tauEngine",
        "ploegH", "ploegKp", "ploegKd", "flatbedKa", "flatbedKv", "flatbedKp", "flatbedD", "flatbedH",
    ),
}  # fmt: skip


MOST_IN_CONSENSUS = 8  # members, of the model CC


def _keys(value: Any) -> Keys:
    if not isinstance(value, dict | Keys):
        raise ValueError("must be a table of numbers")
    return Keys(sorted(dict(value).items()))


@dataclass(frozen=True)
class SumoDriver(Law):
    """SUMO's own driver: follows cars, changes lanes, obeys lights and right of way. Its motion is read, not set.

    It accelerates with 0.65 of what the vehicle can at its speed, and brakes with half of what it can, in emergencies
    with all of it: as a car it is SUMO's passenger car, with 2.6, 4.5 and 9 m/s2. It has no laser and decides nothing
    in this package. With followers behind it, it stays on the lane on which it overtook: changing back would put its
    followers beside a vehicle that they have not yet passed. On roads with such a driver, a lane change takes 3 s
    (`sumo.lane_change_s`).

    model        SUMO's car-following model.
    parameters   of the model, by SUMO's names and in SUMO's units: accel, decel, tau, minGap and those of the model.
                 Where they are not given, they are as above, and else SUMO's.
    overtakes    Without it, it changes lanes only where its route does.
    controller   of the model "CC", the controllers of Plexe (M. Segata et al., "Plexe: a platooning extension for
                 Veins", IEEE VNC 2014). CACC, PLOEG and FLATBED know speed, acceleration and command of predecessor
                 and leader, CONSENSUS those of all members, as they were at the last step. CONSENSUS works on roads
                 to the east, for up to 8 members. A leader has the cruise control of ACC. They ignore lights and right
                 of way (speed mode 0, as in Plexe), and `minGap` is 0.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"route"})
    native: ClassVar[bool] = True

    max_speed: Annotated[Positive, Field(alias="max_speed_mps")] = 50.0  # of the vehicle
    speed_factor: Positive = 1.0  # its speed by the limit, on a free road
    imperfection: Annotated[float, Field(ge=0, le=1)] = 0.5  # SUMO's sigma: random braking, 0: none
    model: Literal["Krauss", "IDM", "EIDM", "ACC", "CACC", "CC"] = "Krauss"
    parameters: Annotated[Keys, PlainValidator(_keys)] = Keys()  # noqa: RUF009  (immutable)
    overtakes: bool = True
    controller: Literal["ACC", "CACC", "PLOEG", "CONSENSUS", "FLATBED"] | None = None

    def __post_init__(self) -> None:
        if (self.model == "CC") != (self.controller is not None):
            kinds = "ACC, CACC, PLOEG, CONSENSUS or FLATBED"
            raise ValueError(f'model = "CC" and `controller` ({kinds}) go together; must have both or neither')
        for name, value in self.parameters:
            known = PARAMETERS[self.model]
            if name not in known:
                what = f"no such parameter of {self.model}{did_you_mean(name, known)}; there is: {', '.join(known)}"
                raise ValueError(f"parameters.{name}: {what}")
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                raise ValueError(f"parameters.{name}: {value!r}; must be a number")

    @property
    def vehicle_type(self) -> Mapping[str, str]:
        given = {name: f"{value:g}" for name, value in self.parameters}
        if self.model == "CC":
            return {"carFollowModel": "CC", "lanesCount": "1", "minGap": "0", **given}  # it changes no lanes by itself
        return {"carFollowModel": self.model, **given} if given or self.model != "Krauss" else {}
