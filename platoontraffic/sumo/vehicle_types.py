"""The vehicle types of members and obstacles in SUMO: what its drivers take them for, and how it drives them.

Of SUMO's classes they are all passenger cars, which may drive on every road that routes are checked for.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from xml.sax.saxutils import quoteattr

from platoontraffic.sumo.client import Client
from platoontraffic.vehicles.catalogue import VehicleModel

ANY_SPEED = 10.0  # speed factor: SUMO clips the speed that it believes to this times the lane's limit
TOP_SPEED_MARGIN = 1.5  # and to the maximum of the type: this times the vehicle's top speed
LARGEST_MIN_GAP = 2.5  # minGap of a type is half its length, at most this [m]

# What a driver uses of a vehicle. They give the catalogue's car SUMO's values for a passenger car, 2.6 and 4.5 m/s2,
# and its truck SUMO's acceleration for a truck, 1.3 m/s2; SUMO's truck brakes with 4.0, this one with 3.5 m/s2.
OF_ACCELERATION = 0.65
OF_BRAKING = 0.5
SLOWEST = 0.1  # acceleration that SUMO is given at least, near the top speed [m/s2]

# Speed mode of a moved vehicle: SUMO believes the speed that follows from its displacement (32), and that it stops
# before red lights (16). Otherwise drivers inside a junction wait for one that stands at red, as if it were to come.
MOVED = 32 + 16
ALL_CHECKS_ON = 31  # speed mode of a vehicle that SUMO drives, its default
NO_LANE_CHANGE = 0  # lane change mode
USUAL_LANE_CHANGES = 1621  # the default
AS_THE_ROUTE_DOES = 0b1000000001  # strategic changes, with regard to the gaps of others

# Parameters that are set by vehicle, not by type.
BY_VEHICLE = frozenset({"ccaht"})


def driver_type(attributes: Mapping[str, str]) -> str:
    """The vehicle type that a driver's types are copies of; attributes: of SUMO's vehicle type."""
    if not attributes:
        return "DEFAULT_VEHTYPE"
    text = json.dumps(dict(attributes), sort_keys=True)
    return f"platoontraffic.driver.{hashlib.sha256(text.encode()).hexdigest()[:10]}"


def driver_types(drivers: Iterable[Mapping[str, str]]) -> str:
    """The types of drivers as elements of an additional file: SUMO chooses a car-following model when it reads them."""
    elements = {}
    for attributes in filter(None, drivers):
        given = {name: value for name, value in attributes.items() if name not in BY_VEHICLE}
        text = " ".join(f"{name}={quoteattr(value)}" for name, value in given.items())
        elements[driver_type(attributes)] = f"<vType id={quoteattr(driver_type(attributes))} {text}/>"
    return "".join(element for _, element in sorted(elements.items()))


def kind_of(name: str) -> str:
    """The vehicle type of a member or an obstacle; each has its own."""
    return f"platoontraffic.{name}"


def make_type(
    sumo: Client, kind: str, length: float, width: float, attributes: Mapping[str, str] = MappingProxyType({})
) -> None:
    """A vehicle type `kind` of this size [m], otherwise SUMO's default passenger car with these attributes."""
    types = sumo.vehicletype
    types.copy(driver_type(attributes), kind)
    types.setVehicleClass(kind, "passenger")  # a scenario may have changed the default
    types.setLength(kind, length)
    types.setWidth(kind, width)
    if "minGap" not in attributes:
        types.setMinGap(kind, min(LARGEST_MIN_GAP, length / 2))
    types.setSpeedDeviation(kind, 0)


def make_type_of(
    sumo: Client, kind: str, model: VehicleModel, attributes: Mapping[str, str] = MappingProxyType({})
) -> None:
    """A vehicle type `kind` with the size and the brakes of a vehicle, which may be moved at any speed.

    attributes: of SUMO's vehicle type; they replace what would follow from the vehicle
    """
    make_type(sumo, kind, model.length, model.width, attributes)
    _drive_as(sumo, kind, model, attributes)


def make_type_from(sumo: Client, kind: str, original: str, model: VehicleModel, native: bool) -> None:
    """A vehicle type `kind` that is another one but for what moving the vehicle needs.

    native: SUMO goes on driving it
    """
    sumo.vehicletype.copy(original, kind)
    if not native:
        _drive_as(sumo, kind, model, {})


def _drive_as(sumo: Client, kind: str, model: VehicleModel, attributes: Mapping[str, str]) -> None:
    """Give a type the brakes of a vehicle, and any speed."""
    types, hardest = sumo.vehicletype, float(model.hardest_braking)
    if math.isfinite(hardest):
        braking = float(attributes.get("decel", OF_BRAKING * hardest))
        values = {"emergencyDecel": max(hardest, braking), "decel": braking, "apparentDecel": braking}
        for name, value in values.items():
            set_value = getattr(types, f"set{name[0].upper()}{name[1:]}")
            set_value(kind, float(attributes.get(name, value)))
    types.setSpeedFactor(kind, ANY_SPEED)
    types.setMaxSpeed(kind, TOP_SPEED_MARGIN * model.top_speed)


def limit_acceleration(sumo: Client, kind: str, strongest: float) -> None:
    """What SUMO's driver may use of the strongest acceleration of the vehicle at its present speed [m/s2]; inf: any."""
    if math.isfinite(strongest):
        sumo.vehicletype.setAccel(kind, max(OF_ACCELERATION * strongest, SLOWEST))


def release(sumo: Client, name: str) -> None:
    """Take a vehicle from SUMO's driver: it moves only as it is moved."""
    sumo.vehicle.setSpeedMode(name, MOVED)
    sumo.vehicle.setLaneChangeMode(name, NO_LANE_CHANGE)
