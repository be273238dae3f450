"""What a scenario asks for beyond what holds: sensors of `tracking`, profiles of leaders, its network and files."""

from __future__ import annotations

import math
from collections.abc import Iterator

from platoontraffic.controllers.path import SMOOTH, PathLeader
from platoontraffic.controllers.tracking import HEADWAY_PER_DELAY, LEAST_HEADWAY, TrackingFollower
from platoontraffic.road.network import Network
from platoontraffic.road.sumo_files import TRAFFIC, parse
from platoontraffic.vehicles.bicycle import Car
from platoontraffic.world.fleet import Member
from platoontraffic.world.prepared import Prepared

# Sensors with which `tracking` holds: `tests/benchmarks/what_sensors_hold.py`.
SLOWEST = 5.0  # laser [Hz]
MOST_LOST = 0.3  # share of the returns
GREATEST_BIAS = 1.0  # standard deviation of the yaw rate's bias [deg/s]
LONGEST_DELAY = 0.3  # of scans and odometry [s]

# Elements of additional files that members do not heed, and what they do instead.
CLOSED = "members keep the route with which they depart, also on closed roads"
UNHEEDED = {
    "variableSpeedSign": "members drive by the speed limits of the network, and their delays are wrong",
    "calibrator": "members drive by the speed limits of the network, and SUMO may crash where it removes a member",
    **dict.fromkeys(("closingReroute", "closingLaneReroute", "destProbReroute", "routeProbReroute"), CLOSED),
}


def warnings(prepared: Prepared) -> list[str]:
    """One line for every leader whose vehicle cannot drive its profile, and every limit of `tracking` passed.

    And one for a network where members do not know which vehicles they must give way to, and for what they do not heed.
    """
    texts = [*_network(prepared), *_unheeded(prepared)]
    number = {platoon.id: i for i, platoon in enumerate(prepared.scenario.spec.platoon)}
    for member in prepared.members:
        role, beyond = ("leader", _profile) if member.place == 0 else ("follower", _sensors)
        lines = (prepared.scenario.fault(("platoon", number[member.platoon], role), text) for text in beyond(member))
        texts += [line for line in lines if line not in texts]
    return texts


def of_network(name: str, network: Network) -> Iterator[str]:
    """For members that heed stop lines. name: of the network, as the user gave it"""
    if network.has_junctions and not network.entered_from:
        yield f"{name}: no lanes inside junctions: members give way to nobody there; build it without no-internal-links"


def _network(prepared: Prepared) -> Iterator[str]:
    spec = prepared.scenario.spec
    if any(member.law.heeds_lines for member in prepared.members) or spec.equip:
        config = prepared.scenario.configuration
        yield from of_network(spec.sumo.net or str(config.path if config else prepared.network.path), prepared.network)


def _unheeded(prepared: Prepared) -> Iterator[str]:
    if not prepared.scenario.spec.equip and all(member.law.native for member in prepared.members):
        return
    for file in prepared.scenario.additional_of_sumo:
        found: dict[str, str] = {}  # what members do instead -> the first such element
        parse(file, lambda tag, *_, found=found: found.setdefault(UNHEEDED.get(tag, ""), tag), TRAFFIC)
        yield from (f"{file}: <{tag}>: {what}" for what, tag in found.items() if what)


def _sensors(member: Member) -> Iterator[str]:
    if not isinstance(member.law, TrackingFollower):
        return
    lidar, bias = member.lidar, math.degrees(member.odometry.yaw_rate_bias)
    delay, headway = max(member.odometry.delay, *(one.delay for one in member.lidars)), member.law.time_headway
    needed = LEAST_HEADWAY + HEADWAY_PER_DELAY * delay
    if lidar.rate < SLOWEST:
        yield f"a laser of {lidar.rate:g} Hz: `tracking` leaves the path in turns; it holds from {SLOWEST:g} Hz on"
    if lidar.noise.dropout > MOST_LOST:
        lost = f"{lidar.noise.dropout:.0%} of the returns lost"
        yield f"{lost}: beyond {MOST_LOST:.0%} `tracking` may lose its predecessor"
    if bias > GREATEST_BIAS:
        yield f"a yaw rate with a bias of {bias:.3g} deg/s: `tracking` was tested up to {GREATEST_BIAS:g} deg/s"
    if delay > LONGEST_DELAY:
        yield f"a delay of {delay:g} s: `tracking` was tested up to {LONGEST_DELAY:g} s"
    if delay > 0 and headway < needed:
        yield f"a delay of {delay:g} s: strings amplify with time_headway_s below {needed:.2g}; it is {headway:g}"


def _profile(member: Member) -> Iterator[str]:
    law, car = member.law, member.model
    if not isinstance(law, PathLeader) or law.profile not in SMOOTH or not isinstance(car, Car):
        return
    if law.speed == "road":
        yield f"a {law.profile} about the speed limit: its upper half is cut off; speed_mps must be below the limit"
        return
    frequency = max(law.frequency, law.last_frequency) if law.profile == "chirp" else law.frequency
    needed, fastest = 2 * math.pi * frequency * law.amplitude, law.speed + law.amplitude
    can = float(car.strongest_acceleration(law.speed))
    what = f"a {law.profile} of {law.amplitude:g} m/s at {frequency:g} Hz"
    if needed > can:
        yield f"{what} needs {needed:.2g} m/s2, and the vehicle has {can:.2g} m/s2 at {law.speed:g} m/s"
    if law.amplitude > law.speed or fastest > car.max_speed:
        yield f"{what} about {law.speed:g} m/s: the vehicle drives from 0 to {car.max_speed:.3g} m/s"
