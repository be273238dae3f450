"""Looking beside and behind before a follower leaves its lane after its predecessor, by its own laser.

A follower drives in the trail of its predecessor. The lane that it drives in is the parabola through the last piece of
its path. Where the trail goes aside from that, it is a bend or a lane change; a bend cannot be told at once. So the
follower goes along until it has moved BUDGET aside. If the trail is straight by then, or what is abreast does not go
aside as well, and there is no room on that side, it stays: its trail is laid on along its lane, and beside that of the
predecessor once that drives parallel again. It follows the predecessor from there, more slowly if it must open a gap,
and goes over, by a cosine, when there is room. If the predecessor's path goes on turning, it was a bend, and the trail
is laid anew from where the follower is.

Room is judged by the first return ahead and behind in the strip that it would go over to, and by the rates at which
they come nearer, known from the second scan on (`lane_room`). What a body hides and what is out of range is not seen. A
laser that looks to the front alone sees nobody behind. Below SLOWEST, and where the path driven last is no parabola, a
follower repeats what its predecessor does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from platoontraffic.controllers.closing import closing_speed
from platoontraffic.controllers.lane_room import room_needed
from platoontraffic.controllers.law import Body
from platoontraffic.controllers.tracker.records import HEADING, SPEED
from platoontraffic.controllers.tracker.track import Odometry, Track
from platoontraffic.controllers.tracker.trail import POINTS, Trail
from platoontraffic.lidar import ScanBatch

STEADY, GOING, HELD = range(3)  # in a lane; the predecessor goes aside, and it too; it stays while that goes aside

DRIVEN = 30.0  # length of path by which the own lane is known: BEHIND of `trail_kernel` [m]
ASIDE = 0.4  # offset of the predecessor from the own lane beyond which it goes aside [m]
BUDGET = 0.45  # own offset up to which a follower goes along before it can tell a lane change from a bend [m]
COMMITTED = 1.0  # own offset from which it goes over in any case [m]
ARRIVED = 0.3  # lateral distance from the predecessor's path within which a lane change is over [m]
WIDEST = 5.5  # offset beyond which the predecessor is in a bend, if it does not yet drive parallel [m]
PARALLEL = 0.45  # share of its steepest slope below which a predecessor drives parallel again
STEEPEST = 0.3  # slope of a lane change [1]
FLATTEST = 0.9  # least mean slope of a lane change from the follower on, over that at its end; in a bend it is less
LONGEST_MOVE = 3.5  # time for which a predecessor changes lanes [s]
SETTLED = 60.0  # time in a lane after which it has certainly driven DRIVEN [s]
LONGEST = 6.0  # time after which a trail that goes aside is a bend [s]
SLOWEST_ASIDE = 0.7  # lateral speed of a lane change, at its steepest [m/s]
STEEPER = 1.3  # growth of the predecessor's slope by which a bend is told from a lane change while it stays [1]
NEAR = 1.7  # the same distance, from which it is too near in any case [m]
SHARE = 0.5  # of the own offset by which the distance to what is abreast must have shrunk, or it is a bend
LEAST = 1.5  # offset by which a predecessor that drives parallel again has changed lanes [m]
BEND_FILTER = 2.0  # time constant of the filter of the own lane's curvature [s]
SLOWEST = 5.0  # speed below which a follower goes along blindly [m/s]
KEPT = 0.5  # share of its own offset at which it stays, in case that it is in a bend [1]
SURE = 0.3  # time for which there must be room [s]
CROSSING_TIME = 3.0  # of the lane change that is made up for [s]
SHORTEST = 20.0  # of that [m]
MARGIN, CLEAR = 0.4, 0.15  # of the strip that it would go over to, and beside the own body [m]
SAME, FILTER = 1.5, 0.3  # of the closing speed: as in `closing_speed` [m], [s]
STANDS = 2.0  # speed of a return behind up to which it is of something that stands [m/s]
SLOWER, DROPS_BACK, GENTLE = 2.0, 25.0, 1.0  # opens a gap: slower by [m/s], as far as [m], braking by [m/s2]


class Lane(NamedTuple):
    """A parabola in the odometry frame, from a place on, arrays (n,)."""

    x: np.ndarray  # [m]
    y: np.ndarray
    heading: np.ndarray  # [rad]
    curvature: np.ndarray  # to the left [1/m]
    station: np.ndarray  # of the trail there [m]
    known: np.ndarray  # the path driven last is of one lane, bool

    @classmethod
    def of(cls, trail: Trail, odometry: Odometry, weight: np.ndarray, bend: np.ndarray) -> tuple[Lane, np.ndarray]:
        """As the path driven last goes on, and its curvature, filtered with a weight of the new one, (n,)."""
        # Imported here, as below: importing numba takes half a second.
        from platoontraffic.controllers.tracker.lane_kernel import fit_lanes

        n, bend = len(trail.size), bend.copy()
        lane = cls(*np.zeros((5, n)), np.zeros(n, bool))
        fit_lanes(trail, odometry, weight, bend, lane)
        return lane, bend

    def place(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance along the lane and offset to its left [m]; x, y: (n, ...)."""
        column = (slice(None), *[None] * (np.ndim(x) - 1))
        dx, dy = x - self.x[column], y - self.y[column]
        cos, sin = np.cos(self.heading)[column], np.sin(self.heading)[column]
        along = dx * cos + dy * sin
        return along, dy * cos - dx * sin - self.curvature[column] * along**2 / 2


class Beside(NamedTuple):
    """What a follower remembers of its lane and of those beside it, arrays (n,)."""

    mode: np.ndarray
    lane: Lane  # anchored where the predecessor began to go aside
    time: np.ndarray  # since the mode changed [s]
    bend: np.ndarray  # curvature of the own lane, filtered [1/m]; NaN: not known
    shift: np.ndarray  # by which the own trail lies beside that of the predecessor, which is to its left [m]
    crosses: np.ndarray  # station from which it goes over to that; NaN: it does not
    slope: np.ndarray  # of the predecessor's path against the own lane, filtered [1]
    steepest: np.ndarray  # the greatest one, to the side to which it goes
    bent: np.ndarray  # mean slope of the trail over that at its end, filtered
    held_slope: np.ndarray  # that slope, when it began to stay
    held_gap: np.ndarray  # `gap` then [m]
    kept: np.ndarray  # offset from the lane at which it stays [m]
    gap: np.ndarray  # distance from the own centre line to what is abreast [m]; inf: nothing is
    first_gap: np.ndarray  # the same less the own offset to that side, when it was first seen; NaN: not yet
    room_for: np.ndarray  # time for which there has been room [s]
    ahead: np.ndarray  # distance to the first return ahead on the other lane [m]; inf: none
    ahead_closing: np.ndarray  # [m/s]; NaN: not known
    behind: np.ndarray  # the same behind; negative: abreast
    behind_closing: np.ndarray

    @classmethod
    def none(cls, n: int) -> Beside:
        zero, inf, nan = np.zeros(n), np.full(n, np.inf), np.full(n, np.nan)
        lane = Lane(zero, zero, zero, zero, zero, np.zeros(n, bool))
        numbers = zero, nan, zero, nan, zero, zero, zero, zero, inf, zero, inf, nan, zero, inf, nan, inf, nan
        return cls(np.zeros(n, int), lane, *numbers)

    @property
    def held(self) -> np.ndarray:
        """It stays in its lane though the predecessor has left it, bool (n,)."""
        return (self.mode == HELD) | ((self.shift != 0) & np.isnan(self.crosses))

    def nears(self, gone: np.ndarray) -> np.ndarray:
        """What is abreast does not go aside as well, as in a bend, bool (n,). gone: own offset to that side [m]"""
        with np.errstate(invalid="ignore"):
            nearer = np.isfinite(self.gap) & (self.gap <= self.first_gap - SHARE * gone)
            return nearer | (self.gap < NEAR)

    def blocked(self, no_room: np.ndarray, length: np.ndarray) -> np.ndarray:
        """There is certainly no room, bool (n,): what is not near is known by its speed."""
        with np.errstate(invalid="ignore"):
            far = (self.ahead > length) & np.isnan(self.ahead_closing) | np.isinf(self.ahead)
            far &= (self.behind > length) & np.isnan(self.behind_closing) | np.isinf(self.behind)
        return no_room & ~far

    def room_ahead(self, length: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Room before what is ahead on the other lane, bool (n,); length, speed: own [m], [m/s]."""
        with np.errstate(invalid="ignore"):
            return (self.ahead == np.inf) | (self.ahead > room_needed(length, speed, self.ahead_closing))

    def room_behind(self, length: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Room for what is behind on the other lane; nothing need be left to what stands. As `room_ahead`."""
        speed_behind = speed + self.behind_closing
        with np.errstate(invalid="ignore"):
            stands = (self.behind > 0) & (speed_behind < STANDS)
            room = self.behind > room_needed(length, speed_behind, self.behind_closing)
        return (self.behind == np.inf) | room | stands

    def forgotten(self, rows: np.ndarray) -> Beside:
        """Without that of some rows, (n,) bool."""
        return _where(rows, Beside.none(len(rows)), self) if rows.any() else self

    def aside(self, track: Track, trail: Trail, speed: np.ndarray) -> tuple[Beside, Track]:
        """The predecessors as they would be on the own lanes, to which the own trails go on."""
        if not (self.shift != 0).any() and not (self.mode == HELD).any():
            return self, track
        x, y, heading = track.mean[:, 0], track.mean[:, 1], track.mean[:, HEADING]
        known = np.isfinite(x)
        _, offset = self.lane.place(x, y)
        shift = np.where((self.mode == HELD) & known, offset - self.kept, self.shift)
        beside = self._replace(shift=shift)
        end = trail.points[np.arange(len(x)), trail.size - 1, 2]
        length = np.maximum(SHORTEST, CROSSING_TIME * speed)
        share = np.clip(np.nan_to_num((end - self.crosses) / length), 0.0, 1.0)
        left = beside.shift * (1 + np.cos(np.pi * share)) / 2
        mean = track.mean.copy()
        mean[:, 0], mean[:, 1] = x + left * np.sin(heading), y - left * np.cos(heading)
        return beside, track._replace(mean=mean)


def _where(rows: np.ndarray, one: NamedTuple, other: NamedTuple):
    """Records of one or the other by rows (n,) bool."""
    chosen = (
        _where(rows, a, b) if isinstance(a, tuple) else np.where(rows, a, b) for a, b in zip(one, other, strict=True)
    )
    return type(one)(*chosen)


class Scene(NamedTuple):
    """What a follower looks beside with."""

    odometry: Odometry
    track: Track  # of the predecessor, where it is
    aside: Track  # the same as it would be on the own lane
    body: Body
    scan: ScanBatch | None  # of the laser that looks beside; None: not due
    active: np.ndarray  # it follows by the trail of its predecessor, bool (n,)
    dt: float


def look(beside: Beside, trail: Trail, scene: Scene) -> tuple[Beside, Trail]:
    """After a scan: whether each follower goes along with its predecessor, stays, or goes over."""
    odometry, speed = scene.odometry, scene.odometry.speed
    beside = beside.forgotten(~scene.active)
    steady = beside.mode == STEADY
    settled = steady & (beside.time * speed > DRIVEN)  # what is behind it is of one lane
    weight = np.where(settled, -np.expm1(-scene.dt / BEND_FILTER), 0.0)
    lane, bend = Lane.of(trail, odometry, weight, beside.bend)
    x, y = scene.aside.mean[:, 0], scene.aside.mean[:, 1]
    _, offset = lane.place(x, y)
    with np.errstate(invalid="ignore"):
        off = scene.track.mean[:, HEADING] - lane.heading
        begins = settled & scene.active & lane.known & (speed > SLOWEST) & (np.abs(offset) > ASIDE)
        begins &= (np.abs(np.sin(off)) < STEEPEST) & np.isnan(beside.crosses)
    beside = beside._replace(
        mode=np.where(begins, GOING, beside.mode),
        lane=_where(steady, lane, beside.lane),
        time=np.where(begins, 0.0, beside.time + scene.dt),
        bend=bend,
        slope=np.where(begins, 0.0, beside.slope),
        steepest=np.where(begins, 0.0, beside.steepest),
        bent=np.where(begins, 0.0, beside.bent),
        first_gap=np.where(begins, np.nan, beside.first_gap),
    )
    if not ((beside.mode != STEADY).any() or (beside.shift != 0).any()):
        return beside, trail
    return _decide(beside, trail, scene)


def _decide(beside: Beside, trail: Trail, scene: Scene) -> tuple[Beside, Trail]:
    odometry, speed, crosses = scene.odometry, scene.odometry.speed, beside.crosses
    along, own = beside.lane.place(odometry.x, odometry.y)
    far_along, far = beside.lane.place(scene.track.mean[:, 0], scene.track.mean[:, 1])
    _, laid = beside.lane.place(scene.aside.mean[:, 0], scene.aside.mean[:, 1])
    far, laid = np.nan_to_num(far), np.nan_to_num(laid)
    # Beside the predecessor it is judged by where its own trail goes.
    parted = (beside.shift != 0) & np.isnan(crosses) & (beside.mode != HELD)
    goes_to = np.where(parted, laid, far)
    side = np.where(goes_to < 0, -1.0, 1.0)
    slope = scene.track.mean[:, HEADING] - beside.lane.heading - beside.lane.curvature * far_along
    now = side * np.nan_to_num(np.sin(slope))
    slope = beside.slope - np.expm1(-scene.dt / FILTER) * (now - beside.slope)
    mean_slope = side * (goes_to - own) / np.maximum(far_along - along, 1.0)
    bent = np.clip(np.nan_to_num(mean_slope / np.maximum(now, 1e-3)), 0.0, 2.0)
    bent = beside.bent + np.where(beside.bent == 0, 1.0, -np.expm1(-scene.dt / FILTER)) * (bent - beside.bent)
    steepest = np.maximum(beside.steepest, slope)
    parallel = (steepest * speed > SLOWEST_ASIDE) & (slope < PARALLEL * steepest)

    cares = (beside.mode != STEADY) | (beside.shift != 0)
    beside = beside._replace(slope=slope, steepest=steepest, bent=bent)
    beside = _seen(beside, scene, cares, along, own, np.where(parted, own + beside.shift, far))
    room = beside.room_ahead(scene.body.length, speed) & beside.room_behind(scene.body.length, speed)
    room_for = np.where(room, beside.room_for + scene.dt, 0.0)

    going, held = beside.mode == GOING, beside.mode == HELD
    gone = side * own
    returns = (beside.shift != 0) & np.isnan(crosses) & (side * beside.shift < 0)
    straight = np.isinf(beside.gap) & (bent > FLATTEST)
    tells = (mean_slope * speed > SLOWEST_ASIDE) & (gone > BUDGET) & (straight | beside.nears(gone))
    tells |= parallel & (side * goes_to > LEAST)
    stays = (
        going
        & (beside.blocked(~room, scene.body.length) | returns)
        & (gone < COMMITTED)
        & tells
        & (side * goes_to < WIDEST)
    )
    over = (np.abs(laid - own) < ARRIVED) & (gone > ARRIVED) | (np.abs(laid) < ASIDE / 2)
    drifted = going & ~stays & ~over & (beside.time > LONGEST_MOVE)  # by errors of the own odometry, or in a bend
    over = going & ~stays & (over | drifted)
    steeper = slope > STEEPER * beside.held_slope
    turns_away = np.isinf(beside.gap) | (beside.gap > beside.held_gap + BUDGET)
    bend = held & ~parallel & turns_away & ((np.abs(far) > WIDEST) | steeper)
    past = held & ~bend & (parallel | (np.abs(far) < ARRIVED) | (beside.time > LONGEST))

    mode = np.where(stays, HELD, np.where(over | past | bend, STEADY, beside.mode))
    kept = np.where(stays, KEPT * own, beside.kept)
    shift = np.where(stays, far - kept, np.where(held, far - beside.kept, beside.shift))
    shift = np.where(np.isnan(crosses) & (mode == STEADY) & (np.abs(shift) < ARRIVED) | bend, 0.0, shift)
    crosses = np.where(stays, np.nan, crosses)
    end = trail.points[np.arange(len(far)), trail.size - 1, 2]
    length = np.maximum(SHORTEST, CROSSING_TIME * speed)
    done = ~np.isnan(crosses) & (end > crosses + length)
    shift, crosses = np.where(done, 0.0, shift), np.where(done, np.nan, crosses)
    goes = (mode == STEADY) & (shift != 0) & np.isnan(crosses) & (room_for >= SURE - 1e-6)
    here = _here(trail, odometry)
    crosses, mode = np.where(goes, here, crosses), np.where(goes, GOING, mode)
    if (stays | goes | bend).any():
        trail = _laid(trail, scene, beside.lane, shift, stays, goes, bend, here, length, kept)
    return beside._replace(
        mode=mode,
        shift=shift,
        crosses=crosses,
        time=np.where(drifted, SETTLED, np.where(mode != beside.mode, 0.0, beside.time)),
        room_for=room_for,
        held_slope=np.where(stays, slope, beside.held_slope),
        held_gap=np.where(stays, beside.gap, beside.held_gap),
        kept=kept,
    ), trail


def _laid(trail: Trail, scene: Scene, lane: Lane, shift, stays, goes, bend, here, length, kept) -> Trail:
    from platoontraffic.controllers.tracker.lane_kernel import lay_across, lay_anew, lay_on_lane

    capacity = max(trail.points.shape[1], POINTS if bend.any() else 0)
    points = np.zeros((len(trail.size), capacity, 3))
    points[:, : trail.points.shape[1]] = trail.points
    trail = Trail(points, trail.size.copy())
    lay_on_lane(trail, lane, kept, np.flatnonzero(stays))
    lay_across(trail, shift, here, length, np.flatnonzero(goes))
    lay_anew(trail, scene.odometry, scene.track.mean[:, :2], np.flatnonzero(bend))
    return trail


def _here(trail: Trail, odometry: Odometry) -> np.ndarray:
    """Station of the trail beside the own axle [m], (n,)."""
    from platoontraffic.controllers.tracker.lane_kernel import stations

    here = np.empty(len(trail.size))
    stations(trail, odometry, here)
    return here


def _seen(beside: Beside, scene: Scene, cares: np.ndarray, own_along, own, far) -> Beside:
    """With the first returns ahead and behind in the strip that goes to where the predecessor is."""
    scan, body, odometry = scene.scan, scene.body, scene.odometry
    if scan is None:
        return beside
    rows = np.flatnonzero(cares)
    n = len(cares)
    ahead, behind, gap = np.full((3, n), np.inf)
    mount, ranges = scan.model.mount, scan.ranges[rows]
    cos, sin = np.cos(mount.yaw), np.sin(mount.yaw)
    dx, dy = np.array([[cos, -sin], [sin, cos]]) @ scan.model.directions
    met = np.isfinite(ranges) & (ranges > 0)
    ranges = np.where(met, ranges, 0.0)
    forward = (mount.x - body.axle[rows])[:, None] + ranges * dx
    left = mount.y + ranges * dy
    cos, sin = np.cos(odometry.heading[rows])[:, None], np.sin(odometry.heading[rows])[:, None]
    x = odometry.x[rows][:, None] + forward * cos - left * sin
    y = odometry.y[rows][:, None] + forward * sin + left * cos
    u, v = _taken(beside.lane, rows).place(x, y)
    half = (body.width[rows] / 2 + MARGIN)[:, None]
    side = np.where(far[rows] < 0, -1.0, 1.0)[:, None]
    away = side * v
    beyond = (side[:, 0] * own[rows] + body.width[rows] / 2 + CLEAR)[:, None]  # not what is behind in the own lane
    inner = np.maximum(side * far[rows][:, None] - half, beyond)
    with np.errstate(invalid="ignore"):
        met &= (away > inner) & (away < side * far[rows][:, None] + half)
        # Not the predecessor itself, nor what is beyond it.
        target_u, _ = _taken(beside.lane, rows).place(scene.track.mean[rows, 0], scene.track.mean[rows, 1])
        met &= u < target_u[:, None] - 2.5
    front = (own_along + body.length / 2 - body.axle)[rows][:, None]
    rear = (own_along - body.length / 2 - body.axle)[rows][:, None]
    middle = (front + rear) / 2
    with np.errstate(invalid="ignore"):
        ahead[rows] = np.where(met & (u >= middle), u - front, np.inf).min(axis=1)
        behind[rows] = np.where(met & (u < middle), rear - u, np.inf).min(axis=1)
        abreast = met & (u < front) & (u > rear)
        gap[rows] = np.where(abreast, away - (side[:, 0] * own[rows])[:, None], np.inf).min(axis=1)
    speed = odometry.speed
    closings = (
        closing_speed(now, before, closing, speed, scene.dt, same=SAME, time_constant=FILTER)
        for now, before, closing in (
            (ahead, beside.ahead, beside.ahead_closing),
            (behind, beside.behind, beside.behind_closing),
        )
    )
    ahead_closing, behind_closing = closings
    gone = np.where(far < 0, -own, own)
    first = np.where(np.isnan(beside.first_gap) & np.isfinite(gap), gap + SHARE * gone, beside.first_gap)
    return beside._replace(
        gap=gap,
        first_gap=first,
        ahead=ahead,
        ahead_closing=ahead_closing,
        behind=behind,
        behind_closing=behind_closing,
    )


def _taken(lane: Lane, rows: np.ndarray) -> Lane:
    return Lane(*(values[rows] for values in lane))


def slowed(beside: Beside, body: Body, track: Track, speed: np.ndarray, error: np.ndarray, wanted: np.ndarray):
    """The wanted acceleration, less where a gap must be opened to what is abreast or keeps pace [m/s2], (n,).

    What comes from behind is waited for.

    error : distance to the predecessor less the desired one [m], (n,)
    """
    with np.errstate(invalid="ignore"):
        paced = ~beside.room_behind(body.length, speed) & ~(beside.behind_closing > SLOWER)
    opens = beside.held & (paced | ~beside.room_ahead(body.length, speed)) & (error < DROPS_BACK)
    slower = np.maximum(track.mean[:, SPEED] - SLOWER - speed, -GENTLE)
    return np.where(opens, np.minimum(wanted, slower), wanted)
