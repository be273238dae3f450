"""Compilation of kernels, shared out between the processes of the tests; numba keeps them on disk for all."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from platoontraffic.controllers.law import Body, Sensed
from platoontraffic.controllers.tracking import TrackingFollower
from platoontraffic.lidar import PRESETS
from tests.support.bench import batch_of
from tests.support.made_runs import made_run


def compile_scanning(folder: Path) -> None:
    made_run(folder / "run", seconds=1.0)


def compile_tracking() -> None:
    """Three decisions about a rear straight ahead, with ranges of the type that the laser returns."""
    model, law, memory = PRESETS["car-tracker"], TrackingFollower(), None
    for distance in (12.0, 12.1, 12.2):
        on_rear = np.abs(distance * np.tan(model.angles)) <= 0.9
        ranges = np.where(on_rear, distance / np.cos(model.angles), np.inf).astype(np.float32)
        body = Body(*(np.array([value]) for value in (4.7, 1.8, -1.2, 4.3, 0.15, 0.2, 0.2, 0.2, 9.0)))
        memory = law(Sensed(batch_of([ranges], model), np.array([5.0]), np.zeros(1), body), memory, 0.1).memory
