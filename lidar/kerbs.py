"""Kerbs: the drivable area of lanes and junctions, and its borders. World frame, metres."""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import ArrayLike

CLOSING = 0.05  # half the width below which a slit between neighbouring lanes is closed [m]
VERSION = 1  # of the construction of the area; a new one ignores files of earlier ones


def drivable(
    lanes: Sequence[ArrayLike],
    widths: Sequence[float],
    junctions: Iterable[shapely.Geometry] = (),
    cache: str | Path | None = None,
) -> shapely.Geometry:
    """The area of all lanes and junctions: a polygon, or several where the network has parts.

    lanes     : centre lines, (k, 2) each
    widths    : of each lane
    junctions : their polygons
    cache     : folder where the area is kept under a hash of its input; a faulty folder or file does no harm

    raises: ValueError (there are no lanes)
    """
    if not len(lanes):
        raise ValueError("there are no lanes; must be one or more")
    centres = [shapely.LineString(lane) for lane in lanes]
    widths = np.array(widths, dtype=float)
    closing = min(CLOSING, widths.min() / 20)  # narrow lanes have narrow slits
    junctions = list(junctions)

    def build():
        strips = shapely.buffer(centres, widths / 2, cap_style="flat", join_style="mitre")
        parts = [part for part in (*strips, *junctions) if not part.is_empty]
        # In floating point GEOS may lose a whole lane (libgeos/geos issues 965, 1344); on a grid it takes longer.
        for grid in (None, 1e-6):
            wide = shapely.union_all(parts, grid_size=grid).buffer(closing, join_style="mitre")
            shapely.prepare(wide)
            if shapely.covers(wide, parts).all():
                break
        area = wide.buffer(-closing, join_style="mitre")
        return shapely.set_precision(area, 1e-6).normalize().simplify(1e-6)

    if cache is None:
        return build()
    made_by = f"{VERSION} {shapely.geos_version} {closing!r} {len(centres)}"
    inputs = [made_by.encode(), widths.tobytes(), *shapely.to_wkb(centres), *shapely.to_wkb(junctions)]
    return _kept(Path(cache, f"{_digest(*inputs).hex()}.wkb"), build)


def borders(area: shapely.Geometry, tolerance: float = 0.0) -> list[shapely.LinearRing]:
    """The borders of an area as rings; a hole is one as well.

    tolerance : largest distance from the exact borders, for fewer vertices [m]
    """
    if tolerance:
        area = shapely.simplify(area, tolerance)  # keeps the topology: no ring crosses another, none vanishes
    return [ring for part in shapely.get_parts(area) for ring in (part.exterior, *part.interiors)]


def _kept(file: Path, build: Callable[[], shapely.Geometry]) -> shapely.Geometry:
    """The geometry in a file, or a new one, which is then kept there; a checksum follows the WKB."""
    with contextlib.suppress(OSError):
        content = file.read_bytes()
        size = len(_digest())
        if content[-size:] == _digest(content[:-size]):
            return shapely.from_wkb(content[:-size])
    geometry = build()
    wkb = shapely.to_wkb(geometry)
    with contextlib.suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=file.parent) as own:  # a reader meanwhile finds the whole file or none
            whole = Path(own, file.name)
            whole.write_bytes(wkb + _digest(wkb))
            os.replace(whole, file)
    return geometry


def _digest(*parts: bytes) -> bytes:
    return hashlib.blake2b(b"".join(parts), digest_size=16).digest()
