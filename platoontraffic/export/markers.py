"""What a viewer of ROS messages draws: road, walls and buildings, vehicles, targets, and a map of what is occupied."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import shapely

from platoontraffic.analysis.results import Results

COLOURS = ("#000000", "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#F0E442")  # by place
GREY, ORANGE, RIGHT, WRONG = "#8B929D", "#FF7A1A", "#00A070", "#C8210A"
STYLES = {  # kind of the scene: colour, width of its lines in a town [m]
    "road": ("#9AA0A8", 0.2),
    "lanes": ("#C9CCD1", 0.1),
    "middle": ("#C9CCD1", 0.1),
    "walls": ("#4B4F57", 0.3),
    "buildings": ("#B8A890", 0.3),
}
TOWN = 100.0  # a larger road is for cars [m]
CELLS = 4_000_000  # most cells of a map
FREE, OCCUPIED, UNKNOWN = 0, 100, -1  # of OccupancyGrid
HEIGHT = 1.5  # of a car's marker [m]
LINE_LIST, CUBE, SPHERE, DELETE_ALL = 5, 1, 2, 3  # of visualization_msgs/msg/Marker


class Markers:
    """Markers by the constructors of a ROS 2 type store."""

    def __init__(self, types: dict[str, Any]) -> None:
        self._types = types

    def new(self, kind: str, **values: Any) -> Any:
        return self._types[kind](**values)

    def array(self, markers: Iterable[Any]) -> Any:
        return self.new("visualization_msgs/msg/MarkerArray", markers=list(markers))

    def scene(self, results: Results) -> Any:
        """Lines of the road and of what stands beside it, in the frame map."""
        town = max(_size(results)) > TOWN
        return self.array(
            self.marker(
                "map", 0, kind, i, LINE_LIST, colour=colour, scale=(width if town else width / 10, 0.0, 0.0),
                points=_pairs(results.scene.get(kind, [])),
            )
            for i, (kind, (colour, width)) in enumerate(STYLES.items())
        )  # fmt: skip

    def box(self, time: int, ns: str, number: int, pose: Sequence[float], size: Sequence[float], colour: str) -> Any:
        """A vehicle: pose x, y, heading in the frame map; size length, width."""
        x, y, heading = pose
        height = HEIGHT * min(1.0, size[0] / 4.0)
        return self.marker("map", time, ns, number, CUBE, (x, y, height / 2), heading, (*size, height), colour)

    def cleared(self, time: int, ns: str) -> Any:
        """Takes away all markers of a namespace that are there."""
        return self.marker("map", time, ns, 0, CUBE, action=DELETE_ALL)

    def marker(
        self,
        frame: str,
        time: int,
        ns: str,
        number: int,
        kind: int,
        place: Sequence[float] = (0.0, 0.0, 0.0),
        heading: float = 0.0,
        scale: Sequence[float] = (1.0, 1.0, 1.0),
        colour: str = GREY,
        points: np.ndarray | None = None,
        action: int = 0,
    ) -> Any:
        new = self.new
        seconds, nanoseconds = divmod(time, 10**9)
        stamp = new("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
        turned = new(
            "geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=float(np.sin(heading / 2)), w=float(np.cos(heading / 2))
        )
        at = new("geometry_msgs/msg/Point", **dict(zip("xyz", map(float, place), strict=True)))
        rgb = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
        plain = np.empty(0, dtype=np.uint8)
        image = new(
            "sensor_msgs/msg/CompressedImage",
            header=new("std_msgs/msg/Header", stamp=stamp, frame_id=""), format="", data=plain,
        )  # fmt: skip
        return new(
            "visualization_msgs/msg/Marker",
            header=new("std_msgs/msg/Header", stamp=stamp, frame_id=frame),
            ns=ns,
            id=number,
            type=kind,
            action=action,
            pose=new("geometry_msgs/msg/Pose", position=at, orientation=turned),
            scale=new("geometry_msgs/msg/Vector3", **dict(zip("xyz", map(float, scale), strict=True))),
            color=new("std_msgs/msg/ColorRGBA", r=rgb[0], g=rgb[1], b=rgb[2], a=1.0),
            lifetime=new("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
            frame_locked=False,
            points=[
                new("geometry_msgs/msg/Point", x=float(x), y=float(y), z=0.0)
                for x, y in (points if points is not None else ())
            ],
            colors=[],
            texture_resource="",
            texture=image,
            uv_coordinates=[],
            text="",
            mesh_resource="",
            mesh_file=new("visualization_msgs/msg/MeshFile", filename="", data=plain),
            mesh_use_embedded_materials=False,
        )


def occupancy(results: Results) -> tuple[np.ndarray, float, tuple[float, float]] | None:
    """Cells (rows from south to north), their size [m], and the lower left corner [m]; None if there are no walls.

    A cell is occupied if a wall goes through it or a building covers its centre, free if its centre is on the road
    """
    scene = results.scene
    walls, buildings = scene.get("walls", []), scene.get("buildings", [])
    if not walls and not buildings:
        return None
    points = np.concatenate([np.asarray(line, dtype=float)[:, :2] for lines in scene.values() for line in lines])
    low, high = points.min(axis=0) - 0.5, points.max(axis=0) + 0.5
    size = 0.5 if max(high - low) > TOWN else 0.02
    size = max(size, float(np.sqrt(np.prod(high - low) / CELLS)))
    columns, rows = (int(np.ceil(n)) for n in (high - low) / size)
    x, y = low[0] + (np.arange(columns) + 0.5) * size, low[1] + (np.arange(rows) + 0.5) * size
    grid = np.full((rows, columns), UNKNOWN, dtype=np.int8)
    across, up = np.meshgrid(x, y)
    grid[_covered(scene.get("road", []), across, up)] = FREE
    grid[_covered(buildings, across, up)] = OCCUPIED
    for line in (*walls, *buildings):
        dense = shapely.get_coordinates(shapely.segmentize(shapely.LineString(line), size / 2))
        column, row = ((dense - low) / size).astype(int).T
        grid[row, column] = OCCUPIED
    return grid, size, (float(low[0]), float(low[1]))


def _covered(rings: Sequence[Sequence], x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Which points lie in an area of rings, holes left out."""
    area = shapely.Polygon()
    for ring in rings:
        area = shapely.symmetric_difference(area, shapely.make_valid(shapely.Polygon(ring)))
    shapely.prepare(area)
    return shapely.contains_xy(area, x, y)


def _pairs(lines: Sequence[Sequence]) -> np.ndarray:
    """Begin and end of every segment of some lines, one after the other, (k, 2) [m]."""
    parts = [np.asarray(line, dtype=float)[:, :2] for line in lines if len(line) > 1]
    return np.concatenate([np.repeat(part, 2, axis=0)[1:-1] for part in parts]) if parts else np.empty((0, 2))


def _size(results: Results) -> tuple[float, float]:
    points = np.concatenate([np.asarray(line)[:, :2] for lines in results.scene.values() for line in lines])
    width, height = np.ptp(points, axis=0)
    return float(width), float(height)
