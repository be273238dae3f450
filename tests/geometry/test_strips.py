"""An area in strips, against the whole."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from platoontraffic.geometry.strips import CORNERS, Strips


def town(streets: int) -> shapely.Geometry:
    """Streets 6 m wide, 40 m apart, each way; one round place, and one road apart from all."""
    span = 40.0 * streets
    lines = [shapely.LineString([(k * 40.0, 0.0), (k * 40.0 + 7.0, span)]) for k in range(streets)]
    lines += [shapely.LineString([(0.0, k * 40.0), (span, k * 40.0 + 3.0)]) for k in range(streets)]
    lines.append(shapely.LineString([(-300.0, 0.0), (-250.0, 20.0)]))
    return shapely.union_all([*shapely.buffer(lines, 3.0), shapely.Point(100, 100).buffer(30, quad_segs=30)])


@pytest.mark.parametrize("streets", [1, 5, 30])
def test_places_are_inside_where_the_whole_has_them(streets):
    area, rng = town(streets), np.random.default_rng(streets)
    west, south, east, north = area.bounds
    x, y = rng.uniform(west - 50, east + 50, 20_000), rng.uniform(south - 50, north + 50, 20_000)
    corners = shapely.get_coordinates(area)[:: max(shapely.get_num_coordinates(area) // 1000, 1)]
    borders = np.linspace(west, east, 65)  # of strips, where there are many
    x = np.concatenate([x, corners[:, 0], borders, [np.nan, np.inf, -np.inf, 0.0]])
    y = np.concatenate([y, corners[:, 1], np.full(65, 1.0), [0.0, 0.0, 0.0, np.nan]])
    strips = Strips(area)
    assert strips.contain(x, y).tolist() == shapely.contains_xy(area, x, y).tolist()
    assert (shapely.get_num_coordinates(area) > 2 * CORNERS) == (streets == 30)


def test_an_area_that_no_strip_of_is_sound_stays_whole(monkeypatch):
    area = town(30)
    monkeypatch.setattr(shapely, "clip_by_rect", lambda *_: shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)]))
    assert Strips(area).contain(np.array([0.0, 20.0]), np.array([100.0, 20.0])).tolist() == [True, False]
