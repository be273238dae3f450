"""Events of a run, the rows of events.csv: their record, their kinds, and the thresholds of events and metrics.

Each threshold is one constant, from which the text of the data dictionary is formatted. A new kind of event is a row of
`EVENT_KINDS` and the place that emits it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from platoontraffic.controllers.creeping import AFTER as CREEPS_AFTER
from platoontraffic.vehicles.motion import CAR_LENGTH, FULL_SIZE

WALL = "wall"  # `Event.other` where that is no vehicle

SPLIT_AFTER = 2.0  # time out of its platoon after which a follower counts as split off [s]
SPLIT_GAP_FACTOR, SPLIT_GAP_MARGIN = 2.0, 15.0  # a gap above both is too long: times the wanted gap [1], above it [m]
HELD_DISTANCE, HELD_SPEED = 8.0, 1.0  # a closed stop line holds a member this near [m] and slower than this [m/s]
STANDSTILL_AFTER = 10.0  # shortest standstill that is an event [s]
NEAR_MISS_GAP = 0.5  # gap below which there is a near miss [m]
NEAR_MISS_SPEED = 1.0  # least relative speed of a near miss with another body than the predecessor [m/s]
CLEARANCE_REACH = 30.0  # distance up to which the closest body is looked for [m]
CONTACT_HORIZON = 5.0  # time up to which contacts with any body are foreseen [s]
ENCROACHED = 5.0  # post-encroachment time below which there is an encroachment [s]
SHORT_ENCROACHMENT = 2.0  # ... and below which it is a short one, as by SUMO's SSM device [s]
EMERGENCY_BRAKING = 4.5  # braking above which it is an emergency brake [m/s2]
OFF_ROAD_DISTANCE = 0.3  # distance outside the drivable area from which a member is off the road [m]
LANE_CHANGE_BLAME = 2.0  # a collision this soon after one vehicle came into the other's lane is put down to it [s]
APPEARANCE_BLAME = 1.0  # a collision this soon after the other vehicle was inserted is put down to that [s]
STOOD_BLAME = 2.0  # one that has stood so long is not the cause where one from another direction strikes it [s]
LANE_CHANGE_TIME = 3.0  # time before that from which on the moves of both across the road are compared [s]
EXPOSED = 3.0  # a shorter time to collision counts as exposure [s]
ENOUGH_BEAMS = 5  # least number of beams on a predecessor for a law to recognise it
ENCOUNTER_TIME = 10.0  # time for which the consequences of a cut-in or crossing are measured [s]


GONE = ("arrived", "stranded", "given_up")  # kinds of events by which a member leaves the road


class Event(NamedTuple):
    """One row of events.csv."""

    time: float  # since the platoons were placed [s]
    kind: str  # a name in EVENT_KINDS
    vehicle: str  # id; "" for the run
    other: str  # id of another vehicle, WALL, or ""
    x: float  # of the vehicle's centre, east [m]; NaN: it is not on the road
    y: float  # of it, north [m]
    edge: str  # on which it is, as SUMO has it; "": it is not on the road
    duration: float  # of what this event ends [s]; NaN: it ends nothing
    detail: str  # for people to read; nothing computes with it
    what: str = ""  # one of the kind's words, or ""
    done: int | None = None  # 1: the order was carried out, 0: it was rejected; None: the event is no order


class Noted(NamedTuple):
    """An event that is found where it happens, and not by observing the fleet; the observer makes an `Event` of it."""

    row: int  # of the member in the fleet; -1: it is not on the road
    kind: str
    detail: str
    duration: float = np.nan
    other: str = ""
    vehicle: str = ""  # id of the member, where row is -1
    what: str = ""
    done: int | None = None


class Kind(NamedTuple):
    name: str
    meaning: str  # with the vehicle of the event as its subject
    words: tuple[str, ...] = ()  # that `Event.what` may be; "" always may
    cause: bool = False  # sorted before the other events of its instant, which may follow from it


_SCALED = f"times length / {CAR_LENGTH:g} m if it is shorter than {FULL_SIZE:g} m"

EVENT_KINDS = {
    kind.name: kind
    for kind in (
        Kind("departed", "enters the road", cause=True),
        Kind(
            "arrived",
            "leaves the road, at the end of its own route or together with its leader; the position is its last one",
            ("own_route", "with_leader"),
        ),
        Kind(
            "stranded",
            "is taken off the road, because its leader (other_id) has arrived and its law knows no route, while it or "
            "a member between them is split off and its gap is longer than that of a platoon (see split); the "
            "position is its last one",
        ),
        Kind(
            "locked", "its law takes its true predecessor (other_id) as target for the first time since it has this one"
        ),
        Kind(
            "lock_lost",
            "its law no longer takes the true predecessor as target: it takes something else (other_id), does not "
            "recognise the predecessor though beams hit it, has no beam on it, or its laser is broken",
            ("taken", "not_recognised", "out_of_sight", "broken"),
        ),
        Kind("lock_regained", "its law takes the true predecessor as target again, after duration_s"),
        Kind(
            "wrong_target",
            "its law's target changes to something other than the predecessor; not noted while it is split off, when "
            "it may follow any vehicle",
        ),
        Kind(
            "split",
            f"is split off from its platoon: for {SPLIT_AFTER:g} s its law has not taken the predecessor (other_id) as "
            f"target, or its gap has been more than {SPLIT_GAP_FACTOR:g} times the gap that the law wants and also "
            f"more than {SPLIT_GAP_MARGIN:g} m ({_SCALED}) longer than that. Causes: a closed stop line held it, "
            "another body in its way blocked it, it had no room beside it to go over to the lane of its predecessor, "
            "vehicles came between, it fell behind, or a cause of lock_lost",
            (
                "held",
                "blocked",
                "beside",
                "between",
                "fell_behind",
                "taken",
                "not_recognised",
                "out_of_sight",
                "broken",
            ),
        ),
        Kind("parted", "has no predecessor from now on: the route of the one that it had (other_id) leaves its own"),
        Kind(
            "rejoined",
            f"is in its platoon again, duration_s after the split began: {SPLIT_AFTER:g} s before its event, or at the "
            "order",
        ),
        Kind(
            "told",
            "receives the order to split off, to join behind other_id, or to leave; done says whether it was carried "
            "out. After an order to join it counts as split off until it has rejoined",
            ("split", "join", "leave"),
            cause=True,
        ),
        Kind(
            "held",
            f"is slower than {HELD_SPEED:g} m/s and less than {HELD_DISTANCE:g} m (both {_SCALED}) before a stop line "
            "that is closed to it: by a light, by right of way, by vehicles beside it before a lane change, for want "
            "of room behind the junction, by a stop sign, by people on the crossing, or since it lets another vehicle "
            "in. Noted only for laws that are given stop lines",
            ("light", "right_of_way", "lane_change", "no_room", "stop_sign", "people", "letting_in"),
        ),
        Kind("released", "the stop line that held it is open again, or behind it, after duration_s"),
        Kind("red_light", "enters a junction from a lane (detail) with a red light; not noted if SUMO drives it"),
        Kind(
            "failed_to_yield",
            "enters a junction from a lane (detail) although it must give way to a vehicle that arrives before it is "
            "across, and does not stop within 1 m behind the line; not noted if SUMO drives it",
        ),
        Kind(
            "breaks_down",
            "its drive or its laser fails: it rolls to a stand, or it sees nothing",
            ("drive", "laser"),
            cause=True,
        ),
        Kind("repaired", "its drive or its laser works again, after duration_s", ("drive", "laser"), cause=True),
        Kind(
            "standstill",
            f"has stood still for more than {STANDSTILL_AFTER:g} s, no faster than 0.01 of its lengths and 0.01 rad a "
            "second: held at a stop line, behind another vehicle, blocked by a body across its path, without its "
            "predecessor, or broken down; empty where no reason is known, as of a leader that stops by its profile",
            ("held", "behind", "blocked", "lost", "broken"),
        ),
        Kind("standstill_end", "moves again, after duration_s"),
        Kind(
            "stuck",
            "a member from the traffic has stood still for stuck_after_s of its table equip; the word is the remedy",
            ("wait", "remove", "sumo_drives"),
        ),
        Kind(
            "given_up",
            "is a member no more, because it was stuck: it is removed, or SUMO drives it from now on",
            ("remove", "sumo_drives"),
        ),
        Kind(
            "creeps",
            f"begins to creep past other_id: both have stood for {CREEPS_AFTER:g} s. It drives at walking pace, and "
            "keeps free what its body sweeps and some centimetres, until it is past",
        ),
        Kind(
            "goes_round",
            "steers past other_id, which stands and covers a part of its path: from now on until it is past, it drives "
            "its route shifted to the side by what detail says, slowly, and follows no vehicle",
        ),
        Kind(
            "collision",
            "touches a vehicle or a wall (other_id); once per episode. If the two came in line less than "
            f"{LANE_CHANGE_BLAME:g} s before, the one of them that moved towards the other across the road had changed "
            f"lanes: of the moves since {LANE_CHANGE_TIME:g} s before that, the larger one counts. Else it was struck "
            "from behind, struck the other from behind, or they met side by side or head on. Or one of them has swung "
            "its rear out, as SUMO's vehicles do at kinks: they would not have touched had its rear axle followed its "
            "front, and the other was on its own side of the road; inside a junction and on a one-way road, on a lane. "
            f"Or it had stood for {STOOD_BLAME:g} s, on the lanes of its own edge, when one from another direction "
            "struck it, or anywhere when a pedestrian did. Or each was in the middle of its lane, and lanes of two "
            "directions overlap there. Or the other was beyond the middle of the road, and all of it was on its own "
            f"side. Or the other was not there {APPEARANCE_BLAME:g} s before, or it was not there itself one step "
            "before: SUMO has inserted it. Empty for a wall",
            (
                "struck_from_behind",
                "struck_other_from_behind",
                "changed_lanes",
                "other_changed_lanes",
                "beside",
                "swung_out",
                "other_swung_out",
                "stood",
                "lanes_overlap",
                "other_crossed_middle",
                "other_appeared",
                "appeared",
            ),
        ),
        Kind(
            "near_miss",
            f"its gap to the predecessor (other_id) falls below {NEAR_MISS_GAP:g} m ({_SCALED}), without contact at "
            "that instant, and it is not beside the predecessor's path; once per episode, also where contact follows",
        ),
        Kind(
            "near_miss_other",
            f"its outline comes within {NEAR_MISS_GAP:g} m ({_SCALED}) of that of other_id, which is neither its "
            f"predecessor nor its follower, while their velocities differ by more than {NEAR_MISS_SPEED:g} m/s, "
            "without contact at that instant; once per episode and pair, also where contact follows",
        ),
        Kind(
            "encroachment",
            f"it and other_id, which is not of its platoon, use the same place less than {ENCROACHED:g} s after each "
            "other, without contact; duration_s is the post-encroachment time (Allen, Shin, Cooper 1978): from when "
            "the first leaves that place to when the second enters it, the least over the places where both bodies "
            "come. Where paths merge, places count until the second has driven by its own width into the path of the "
            "first; one that comes from behind follows, and does not encroach. Noted when the second is across, or has "
            "driven that far; what: whether it was the first or the second (of two members, it is the first)",
            ("first", "second"),
        ),
        Kind(
            "emergency_brake",
            f"brakes harder than {EMERGENCY_BRAKING:g} m/s2; once per episode; not noted for vehicles shorter than "
            f"{FULL_SIZE:g} m",
        ),
        Kind(
            "off_road",
            f"its driven axle is more than {OFF_ROAD_DISTANCE:g} m ({_SCALED}) outside the drivable area; detail: how "
            "far",
        ),
        Kind("on_road", "is no longer off the road, after duration_s"),
        Kind(
            "obstacle",
            "an obstacle enters the road; detail: its size and speed",
            ("car", "cut_in", "pedestrian", "box", "robot"),
            cause=True,
        ),
        Kind("obstacle_gone", "an obstacle leaves the road"),
        Kind(
            "cut_in",
            "other_id has cut in between it and its predecessor; what: whether it can avoid contact",
            ("avoidable", "unavoidable"),
        ),
        Kind("no_cut_in", "other_id was to cut in, and did not; detail says why"),
        Kind(
            "steps_out",
            "pedestrian other_id has stepped into its path; what: whether it can avoid contact",
            ("avoidable", "unavoidable"),
        ),
        Kind(
            "radio_lost",
            "no message of other_id, its predecessor or its leader, has arrived for the channel's lost_after_s",
        ),
        Kind("radio_back", "a message of other_id arrives again, duration_s after the last one"),
        Kind("never_departed", "its platoon was due to depart, and waited for room until the run ended"),
        Kind(
            "end",
            "the run ended: every member had left the road, had driven its laps, the run's duration was over, "
            "a member had touched something (`run.ends_at_contact`), or with members from the traffic nobody on the "
            "road had moved for 600 s",
            ("arrived", "laps", "contact", "duration", "gridlock"),
        ),
    )
}

KINDS = {  # for the data dictionary
    kind.name: kind.meaning + (f" (what: {', '.join(kind.words)})" if kind.words else "")
    for kind in EVENT_KINDS.values()
}
CAUSES = frozenset(kind.name for kind in EVENT_KINDS.values() if kind.cause)
