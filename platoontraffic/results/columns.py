"""The tables of a run as data: every column's name, type, unit, meaning, format and, where rows are made of an instant
of the simulation, its source. A new column is one row here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from platoontraffic.observation.instant import Instant
from platoontraffic.world.events import CLEARANCE_REACH, CONTACT_HORIZON
from platoontraffic.world.traffic import TrafficSnapshot

Source = Callable[[Instant], Sequence]  # one value a row


class Column(NamedTuple):
    name: str
    type: str  # "number", "integer" or "string"
    unit: str
    meaning: str
    format: str = "%s"
    source: Source | None = None  # None: the rows are given as tuples


def number(name: str, unit: str, meaning: str, source: Source | None = None, *, format: str = "%.6f") -> Column:
    return Column(name, "number", unit, meaning, format, source)


def integer(name: str, meaning: str, source: Source | None = None, *, format: str = "%d") -> Column:
    return Column(name, "integer", "", meaning, format, source)


def text(name: str, meaning: str, source: Source | None = None) -> Column:
    return Column(name, "string", "", meaning, "%s", source)


def time(source: Source | None = None) -> Column:
    return number("time_s", "s", "time since the platoons were placed", source, format="%.3f")


def _members(values: Callable[[TrafficSnapshot], np.ndarray]) -> Source:
    """The members' part of an array of the traffic."""
    return lambda now: values(now.traffic)[: len(now.fleet)]


def _background(values: Callable[[TrafficSnapshot], Sequence]) -> Source:
    """The part of an array of the whole traffic that belongs to other vehicles."""
    return lambda now: values(now.whole)[len(now.fleet) :]


TRAJECTORIES = (
    time(lambda now: np.full(len(now.fleet), now.traffic.time)),
    text("platoon_id", "platoon", lambda now: [m.platoon for m in now.fleet.members]),
    text("vehicle_id", "member of the platoon", lambda now: [m.id for m in now.fleet.members]),
    integer(
        "place",
        "0 for the leader, 1 for the first follower, and so on",
        lambda now: [m.place for m in now.fleet.members],
    ),
    number("x_m", "m", "centre of the footprint, east", _members(lambda traffic: traffic.x)),
    number("y_m", "m", "centre of the footprint, north", _members(lambda traffic: traffic.y)),
    number(
        "heading_rad", "rad", "counter-clockwise from east, in (-pi, pi]", _members(lambda traffic: traffic.heading)
    ),
    number("turned_rad", "rad", "change of heading since the start, not wrapped", lambda now: now.fleet.motion.turned),
    number("speed_mps", "m/s", "forward speed of the midpoint of the driven axle", lambda now: now.fleet.motion.speed),
    number(
        "accel_mps2",
        "m/s2",
        "forward acceleration; robots: mean over the last step, cars: at this instant",
        lambda now: now.fleet.motion.acceleration,
    ),
    number(
        "jerk_mps3",
        "m/s3",
        "change of accel_mps2 over the last step of the simulation, divided by that step; 0 at departure. A car that "
        "comes to rest loses its deceleration in one step",
        lambda now: now.measures.jerk,
    ),
    number("yaw_rate_radps", "rad/s", "yaw rate, positive to the left", lambda now: now.fleet.motion.yaw_rate),
    number(
        "lateral_accel_mps2",
        "m/s2",
        "lateral acceleration of the midpoint of the driven axle, speed times yaw rate, positive to the left",
        lambda now: now.fleet.motion.speed * now.fleet.motion.yaw_rate,
    ),
    number(
        "gap_m",
        "m",
        "distance from the front bumper to the predecessor's rear bumper, along the path that the predecessor's driven "
        "axle drove: length of that path from the foot of the own driven axle to the predecessor's, minus the "
        "distances from own axle to front bumper and from the predecessor's rear bumper to its axle. Before its start "
        "that path is a straight line from the follower's axle (for the last member: one length long). In bends "
        "the bumpers lie beside the path: from bumper to bumper, measured straight, it was up to 0.47 m more or less "
        "in the junctions of corridor_tracking, and up to 0.36 m less, of 0.48 m, at the corners of paper_loop. "
        "A path keeps some 24 points a vehicle length. Empty while a follower passes its predecessor, beside it or "
        "ahead of it; of a follower that SUMO drives, while it is not behind its predecessor on that path",
        lambda now: now.measures.gap,
    ),
    number(
        "gap_error_m",
        "m",
        "gap minus the gap that the law aims for at this speed; empty if the law states none",
        lambda now: now.measures.gap_error,
    ),
    number("time_gap_s", "s", "gap divided by own speed; empty up to 1 mm/s", lambda now: now.measures.time_gap),
    number("closing_mps", "m/s", "own speed minus the predecessor's speed", lambda now: now.measures.closing),
    number(
        "ttc_s",
        "s",
        "time to collision: gap divided by closing speed; empty unless the closing speed is above 1 mm/s, where the "
        "gap is 0 or less, and where cross_track_m is more than the mean width of the two",
        lambda now: now.measures.time_to_collision,
    ),
    number(
        "drac_mps2",
        "m/s2",
        "deceleration rate to avoid a collision: closing^2 / (2 gap); empty where the gap is 0 or less; 0 when not "
        "closing, and where cross_track_m is more than the mean width of the two",
        lambda now: now.measures.needed_braking,
    ),
    integer(
        "beams_on_predecessor",
        "returns that lie on the predecessor in the last scan that the law used",
        lambda now: now.measures.beams,
        format="%.0f",
    ),
    number(
        "occluded_share",
        "",
        "share of the beams that would hit the predecessor in an empty world, but did not; lost returns count",
        lambda now: now.measures.occluded,
    ),
    number(
        "off_road_m",
        "m",
        "distance of the driven axle from the drivable area; 0 on it",
        lambda now: now.measures.off_road,
    ),
    number(
        "seen_gap_m",
        "m",
        "distance of the law's target from the front bumper, as the law sees it",
        lambda now: now.measures.seen_gap,
    ),
    number(
        "seen_bearing_rad",
        "rad",
        "bearing of the law's target from the laser, positive to the left",
        lambda now: now.measures.seen_bearing,
    ),
    text(
        "target_id",
        "the object that the law's target lies on: a vehicle, 'wall', or empty without a target",
        lambda now: now.measures.target,
    ),
    number(
        "cross_track_m",
        "m",
        "lateral offset of the driven axle from the path of the predecessor's driven axle (see gap_m), positive to the "
        "left",
        lambda now: now.measures.cross_track,
    ),
    number(
        "right_of_middle_m",
        "m",
        "offset of the centre from the road's middle line, positive to the right; empty inside junctions",
        lambda now: now.measures.right_of_middle,
    ),
    text("edge_id", "SUMO's edge or junction", lambda now: [edge for edge, _ in now.roads]),
    text("lane_id", "SUMO's lane; empty off the road", lambda now: [lane for _, lane in now.roads]),
    number(
        "clearance_m",
        "m",
        "least distance between its outline and that of another vehicle, person or obstacle, walls not counted; 0 in "
        f"contact, empty beyond {CLEARANCE_REACH:g} m",
        lambda now: now.measures.clearance,
    ),
    text("closest_id", "the body at that distance", lambda now: now.measures.closest),
    number(
        "contact_in_s",
        "s",
        "time to collision with any body, in two dimensions: until the outlines touch if both keep speed and heading; "
        f"empty if none does within {CONTACT_HORIZON:g} s; bodies that overlap and move apart do not count",
        lambda now: now.measures.contact_in,
    ),
)

TRAFFIC = (
    time(lambda now: np.full(len(now.whole.ids) - len(now.fleet), now.whole.time)),
    text("vehicle_id", "a vehicle that belongs to no platoon", _background(lambda traffic: traffic.ids)),
    number("x_m", "m", "centre of the footprint, east", _background(lambda traffic: traffic.x)),
    number("y_m", "m", "centre of the footprint, north", _background(lambda traffic: traffic.y)),
    number(
        "heading_rad", "rad", "counter-clockwise from east, in (-pi, pi]", _background(lambda traffic: traffic.heading)
    ),
    number("speed_mps", "m/s", "forward speed", _background(lambda traffic: traffic.speed)),
)

VEHICLES = (
    text("vehicle_id", "a member or, where there is a traffic.csv, another vehicle"),
    text("platoon_id", "platoon; empty for other vehicles"),
    integer("place", "place in the platoon; empty for other vehicles"),
    number("length_m", "m", "length of the footprint"),
    number("width_m", "m", "width of the footprint"),
    number("laser_x_m", "m", "position of the laser, ahead of the centre; empty for SUMO-driven vehicles"),
    number("laser_y_m", "m", "position of the laser, to the left of the centre"),
    number("laser_yaw_rad", "rad", "forward direction of the laser, from that of the vehicle"),
    number(
        "axle_x_m",
        "m",
        "position of the midpoint of the driven axle, ahead of the centre; negative: behind it. Gap, cross-track and "
        "speed are those of this point; empty for vehicles of no platoon",
    ),
    number("wheelbase_m", "m", "distance of the axles; empty for robots, and for vehicles of no platoon"),
)

EVENTS = (
    time(),
    text("kind", "kind of event; the list of kinds is below"),
    text("vehicle_id", "the vehicle that the event happens to"),
    text("other_id", "the other vehicle involved, or 'wall'"),
    number("x_m", "m", "position of the event: centre of the vehicle, east"),
    number("y_m", "m", "position of the event: centre of the vehicle, north"),
    text("edge_id", "SUMO's edge or junction"),
    number(
        "duration_s",
        "s",
        "duration of the state that this event ends: lock loss, split, standstill, hold, breakdown, time off the road; "
        "of an encroachment, the post-encroachment time",
        format="%.3f",
    ),
    text("detail", "explanation in prose; nothing is computed from it"),
    text("what", "subkind: one of the words listed with the kind; empty for kinds without subkinds"),
    integer("done", "order: 1 carried out, 0 rejected; empty for other kinds"),
)

ENCOUNTERS = (
    number(
        "time_s",
        "s",
        "time at which the obstacle's body first overlaps the strip that the member's body sweeps",
        format="%.3f",
    ),
    text("kind", "kind of the obstacle: cut_in or pedestrian"),
    text("obstacle_id", "the obstacle"),
    text("vehicle_id", "the member that has the obstacle in its path"),
    text("behind_id", "the member that the car cut in behind; empty for a pedestrian"),
    number("gap_m", "m", "distance from the front bumper to the obstacle, along the path; negative: it is beside"),
    number("time_gap_s", "s", "gap divided by the member's speed"),
    number("speed_mps", "m/s", "speed of the member"),
    number("obstacle_speed_mps", "m/s", "speed of the obstacle"),
    number(
        "braking_mps2", "m/s2", "least braking that avoids contact, after the member's reaction; empty if none does"
    ),
    integer("avoidable", "1: the member's hardest braking, after its reaction, avoids contact; 0: it does not"),
    number("gap_min_m", "m", "least distance between the two bodies within the next 10 s"),
    number(
        "ttc_min_s",
        "s",
        "least time to collision within the next 10 s while the obstacle is in the path; empty if never closing",
    ),
    integer("contact", "1: the two bodies touched within the next 10 s"),
)

TRIPS = (
    text("vehicle_id", "vehicle of the traffic"),
    text("type", "vehicle type that it has in the demand"),
    integer(
        "member",
        "1: it was a member, and the row is measured by the tool, also while SUMO drives it on: see stuck; 0: SUMO "
        "drove it, and measured it",
    ),
    text(
        "status",
        "'arrived', at the end 'running' or 'waiting' to depart, or 'removed': members that were stuck, and "
        "vehicles where an obstacle appears",
    ),
    number("depart_s", "s", "departure, since the platoons were placed; negative if before that", format="%.3f"),
    number("arrival_s", "s", "arrival, since the platoons were placed; empty for unfinished trips", format="%.3f"),
    number("duration_s", "s", "time on the road, for unfinished trips until the end", format="%.3f"),
    number("route_length_m", "m", "distance driven", format="%.9g"),
    number("waiting_s", "s", "time slower than 0.1 m/s, without planned stops", format="%.3f"),
    number("time_loss_s", "s", "time lost by driving slower than the driver would on a free road", format="%.3f"),
    number(
        "depart_delay_s",
        "s",
        "delay of departure, for want of room or by waiting for others of its platoon",
        format="%.3f",
    ),
    number("co2_kg", "kg", "CO2 emitted", format="%.9g"),
    number("fuel_kg", "kg", "fuel used", format="%.9g"),
)

PASSAGES = (
    time(),
    text("edge_id", "edge whose end was passed by the front bumper"),
    integer("lane_index", "lane of it, 0 the outermost: the rightmost, on left-hand roads the leftmost"),
    text("vehicle_id", "vehicle"),
    text("type", "vehicle type that it has in the demand"),
    integer("member", "1: a member; 0: a vehicle of the traffic"),
    number("speed_mps", "m/s", "speed"),
)

STATISTICS = (
    text("platoon_id", "platoon"),
    integer("place", "place in the platoon"),
    text("vehicle_id", "member"),
    text("quantity", "what the row is of; the list of quantities is below"),
    number("time_s", "s", "time at which it had a value: number of these steps, times the step", format="%.12g"),
    number("mean", "", "mean over these steps", format="%.12g"),
    number("rms", "", "root mean square", format="%.12g"),
    number("min", "", "least value", format="%.12g"),
    number("max", "", "greatest value", format="%.12g"),
)

METRICS = (
    text(
        "scope",
        "'vehicle' (one member), 'platoon', 'run' (all members), 'traffic' (background traffic), 'everybody' "
        "(members from the traffic too) or 'equipped' (these alone)",
    ),
    text("platoon_id", "platoon; only for vehicles and platoons"),
    text("vehicle_id", "member; empty for the other scopes"),
    text("metric", "name of the metric; the list of metrics is below"),
    number("value", "", "value", format="%.9g"),
    text("unit", "unit of the value; empty for counts and shares"),
)

SCENE = "drivable area, junctions, lane borders, middle lines, walls and buildings [m]"
