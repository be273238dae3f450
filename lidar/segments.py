"""Groups of neighbouring returns in a scan, each with the line and the right angle that fit it best."""

import math
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np

from .laserscan import ScanBatch
from .model import LidarModel


@dataclass(frozen=True, eq=False)
class Segments:
    """All g groups of a batch of n scans, by row, then by first beam. Sensor frame, x forward, y left [m, rad].

    Arrays are (g,), points and leg_lengths (g, 2), offset (n + 1,); headings and bearings in (−π, π]. Beams turn
    counter-clockwise: seen from the sensor, a group starts on its right.

    row                            : of the sensor
    first, last                    : beams of the first and last return; first > last across the seam of a full turn
    count                          : returns
    start, stop                    : first and last return
    width                          : distance between them
    nearest_range, nearest_bearing : nearest return

    Line of least squares (across itself); NaN if count < 2.
    line_heading                   : from start to stop
    line_distance                  : of the infinite line from the sensor
    line_rms                       : distance of the returns from the line, root mean square

    Right angle of least squares; NaN, −1 and False if count < 4.
    corner                         : where the legs meet
    split                          : beam of the first return on the second leg
    leg_heading                    : of the first leg, from start to corner; of the second one, from corner to stop, it
                                     is π/2 less if convex, else π/2 more
    leg_lengths                    : from start to corner and from corner to stop, along the legs
    corner_rms                     : distance of the returns from the legs, root mean square
    convex                         : the corner points to the sensor, as that of a box seen from outside

    offset                         : groups of row i are offset[i] to offset[i + 1] − 1
    """

    row: np.ndarray
    first: np.ndarray
    last: np.ndarray
    count: np.ndarray
    start: np.ndarray
    stop: np.ndarray
    width: np.ndarray
    nearest_range: np.ndarray
    nearest_bearing: np.ndarray
    line_heading: np.ndarray
    line_distance: np.ndarray
    line_rms: np.ndarray
    corner: np.ndarray
    split: np.ndarray
    leg_heading: np.ndarray
    leg_lengths: np.ndarray
    corner_rms: np.ndarray
    convex: np.ndarray
    offset: np.ndarray

    def __len__(self) -> int:
        return len(self.row)

    def of(self, row: int) -> slice:
        """The place of a row's groups in the arrays: `segments.width[segments.of(3)]`."""
        row = range(len(self.offset) - 1)[row]
        return slice(int(self.offset[row]), int(self.offset[row + 1]))


# A grazing angle of 10° is the paper's. A jump of 0.1 m is for errors up to 5 cm, either way: the custom of 1 cm
# standard deviation, and what a UTM-30LX promises at 30 m. One return of a hundred may be lost: three beside each other
# are lost once in a million. Two returns are the fewest that have a width.
def find_segments(
    batch: ScanBatch,
    *,
    jump: float = 0.1,
    grazing: float = math.radians(10),
    min_beams: int = 2,
    bridge: int = 2,
) -> Segments:
    """Split each scan where neighbouring returns are too far apart to be of one surface, and measure the parts.

    Two returns with an angle φ between them, the nearer one at r, belong together up to a distance of

        r sin φ / sin(grazing − φ) + jump.

    The first term is how far apart they are on a surface that the nearer beam meets at the angle `grazing`; flatter
    ones fall apart (Borges & Aldon, "Line extraction in 2D range images for mobile robotics", J. Intelligent and
    Robotic Systems 40, 2004; they take r of the earlier beam, so that the mirror image may differ).

    In a full turn the last beam has the first as its neighbour, or is the same direction once more; then both count. A
    ring of returns, all joined, starts at the first.

    jump      : noise of the difference of two ranges, three standard deviations or more [m]
    grazing   : [rad]
    min_beams : groups of fewer returns are left out
    bridge    : number of successive beams without a return (NaN, +inf or −inf: real scanners lose returns either way)
                that do not end a group; φ is then wider

    Right angle: of returns 1..j on a line of normal n and the others on one of normal Jn (J turns by π/2), both lines
    through the means of their returns, the squared distances sum up to n'(S1 + J'S2 J)n, S1 and S2 the scatter matrices
    about these means. Its least value over n is the smaller eigenvalue; the best j is taken, of all that leave two
    returns or more on each leg. A straight group has one too, with a short leg: compare corner_rms with line_rms.
    """
    model = batch.model
    if batch.ranges.shape != (len(batch), model.samples):
        raise ValueError(f"ranges are {batch.ranges.shape}; must be {(len(batch), model.samples)}")
    spread, reach = _rule(model, jump, grazing, min_beams, bridge)

    kernel = _kernel()
    ranges = np.ascontiguousarray(batch.ranges).view()
    ranges.setflags(write=False)  # else numba compiles once more for arrays that may be written to
    groups, offset = kernel.find(ranges, spread, reach, float(jump), int(min_beams))
    g = groups.shape[1]
    pairs, ones, split = np.empty((4, g, 2)), np.empty((8, g)), np.empty(g, np.intp)  # rows are columns of the result
    pairs.fill(np.nan)
    ones.fill(np.nan)
    split.fill(-1)
    ends, nearest, line = (pairs[0], pairs[1], ones[0]), (ones[1], ones[2]), (ones[3], ones[4], ones[5])
    corner = pairs[2], split, ones[6], pairs[3], ones[7], np.zeros(g, dtype=bool)
    kernel.describe(ranges, model.directions, model.angles, groups, ends, nearest, line, corner)
    columns = *groups, *ends, *nearest, *line, *corner, offset
    segments = object.__new__(Segments)  # as by __init__, in a third of its time
    segments.__dict__.update(zip(Segments.__dataclass_fields__, columns, strict=True))
    return segments


@cache
def _kernel():
    """Imported when it is first used, because numba takes a second to import."""
    from . import segments_kernel

    return segments_kernel


@lru_cache
def _rule(model: LidarModel, jump, grazing, min_beams, bridge):
    """Constants of the distance rule for 0 to `bridge` beams without a return, in the fan and across its seam.

    Returns at a and b with the angle φ between them are (b − a)² + spread a b apart, squared.

    returns: spread, 4 sin²(φ/2), and reach, sin φ / sin(grazing − φ), (2, bridge + 1); NaN where the fan has no seam
    """
    if not 0 <= jump < math.inf:
        raise ValueError(f"jump = {jump}; must be finite and not negative")
    if not 0 < grazing <= math.pi / 2:
        raise ValueError(f"grazing = {grazing} rad; must be above 0, up to pi/2")
    if min_beams != int(min_beams) or min_beams < 1:
        raise ValueError(f"min_beams = {min_beams}; must be a whole number, 1 or more")
    if bridge != int(bridge) or bridge < 0:
        raise ValueError(f"bridge = {bridge}; must be a whole number, 0 or more")
    step = model.angle_increment
    widest = (bridge + 1) * step
    if widest >= grazing:
        angles = f"grazing = {math.degrees(grazing):.3g} deg; must be above {math.degrees(widest):.3g} deg"
        raise ValueError(f"{angles}, the angle over {bridge} bridged beams; fewer may be bridged")
    seam = 2 * math.pi - (model.angle_max - model.angle_min)
    seam = min(seam, step) if seam < step * (1 + 1e-6) else math.nan
    angle = np.array([[step], [seam]]) + step * np.arange(bridge + 1)
    return 4 * np.sin(angle / 2) ** 2, np.sin(angle) / np.sin(grazing - angle)
