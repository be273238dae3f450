"""Covariance of a pose that follows from a vehicle's own speed and yaw rate, by the errors that its odometry has."""

from __future__ import annotations

import math
import tomllib

import numpy as np
import pandas as pd

from platoontraffic.analysis.reading import ResultsError, inside
from platoontraffic.analysis.results import Results
from platoontraffic.scenario.vehicle_tables import OdometryTable
from platoontraffic.vehicles.odometry import OdometryErrors


def errors_of(results: Results) -> tuple[dict[tuple[str, bool], OdometryErrors], float]:
    """Errors by platoon and whether the member leads it, and the length of a step [s], by config.toml.

    raises: ResultsError
    """
    file = inside(results.folder, "config.toml")
    if not file.is_file():
        return {}, 0.0
    try:
        config = tomllib.loads(file.read_text(encoding="utf-8"))
        found = {
            (group["id"], role == "leader"): OdometryTable.model_validate(group[role].get("odometry", {})).model()
            for group in (*config.get("platoon", []), *config.get("equip", []))
            for role in ("leader", "follower")
            if isinstance(group.get(role), dict)
        }
        for table in config.get("equip", []):
            if table["mode"] == "single":  # all its members are followers, at place 0
                found[table["id"], True] = found[table["id"], False]
        return found, float(config["run"]["step_s"])
    except (ValueError, KeyError, TypeError) as error:
        raise ResultsError(f"{file}: is not the scenario of a run: {error}") from error


def covariances(rows: pd.DataFrame, errors: OdometryErrors, dt: float) -> np.ndarray:
    """Covariance of x [m], y [m] and heading [rad] in the frame of the first row's pose, (k, 3, 3), of the driven axle.

    Errors are propagated to first order along the true path. The scale of the speed and the bias of the yaw rate are
    constant; noise is independent from reading to reading.

    rows : a member's of trajectories.csv
    dt   : time between two readings [s]
    """
    time, speed = rows.time_s.to_numpy(), rows.speed_mps.to_numpy()
    heading = rows.heading_rad.to_numpy() - rows.heading_rad.iloc[0]
    constant = np.diag([errors.speed_scale**2, errors.yaw_rate_bias**2])
    sensitivity, noise = np.zeros((3, 2)), np.zeros((3, 3))
    found = np.zeros((len(rows), 3, 3))
    for k in range(1, len(rows)):
        middle = heading[k - 1] + math.remainder(heading[k] - heading[k - 1], math.tau) / 2  # of the span
        span, v, c, s = time[k] - time[k - 1], speed[k - 1], math.cos(middle), math.sin(middle)
        moved = np.array([[1.0, 0.0, -v * s * span], [0.0, 1.0, v * c * span], [0.0, 0.0, 1.0]])
        reads = float(v != 0)  # a standing vehicle measures 0
        # In the middle of the span the errors of the yaw rate have turned the heading by half of what they do.
        by_errors = np.array([[c * v, -s * v * span / 2], [s * v, c * v * span / 2], [0.0, reads]]) * span
        by_noise = np.array([[c, -s * v * span / 2], [s, c * v * span / 2], [0.0, 1.0]]) * reads
        of_noise = np.diag([errors.speed_noise**2, errors.yaw_rate_noise**2]) * dt * span
        sensitivity = moved @ sensitivity + by_errors
        noise = moved @ noise @ moved.T + by_noise @ of_noise @ by_noise.T
        found[k] = sensitivity @ constant @ sensitivity.T + noise
    return found
