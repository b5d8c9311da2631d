"""timing.csv, clock.csv, trajectory.csv and sightings.csv: the answer as tables.

Rounded well below what any of it is worth: times to 1 ns (clocks) or 1 us, metres to 1 um, degrees to 1e-10 (10 um),
pixels to 1e-5, sigmas and covariances to 9 significant digits.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.export.text.cells import Cell, rounded, significant, table, utc_texts
from pipeline.export.text.places import geodetic_degrees
from pipeline.records import Clock, Results, Solution, Trajectory

TIMING_COLUMNS = ("camera", "offset_s", "offset_sigma_s", "frame_rate", "frame_rate_sigma")
CLOCK_COLUMNS = ("camera", "frame", "deviation_s", "deviation_sigma_s")
TRAJECTORY_COLUMNS = (
    *("target", "time_s", "utc", "east_m", "north_m", "up_m", "latitude_deg", "longitude_deg", "height_m"),
    *("ve_mps", "vn_mps", "vu_mps", "cov_ee", "cov_en", "cov_eu", "cov_nn", "cov_nu", "cov_uu"),
)
SIGHTING_COLUMNS = (
    *("camera", "target", "frame", "time_s", "residual_x_px", "residual_y_px", "residual_sigma", "weight"),
    *("east_m", "north_m", "up_m"),
)
_UPPER = np.triu_indices(3)


def timing_csv(results: Results) -> str:
    """The clock of every camera: common time = f / frame_rate + offset_s (paper eq. 2); sigma 0 where it was held.

    Sigmas are the larger of the plain and the cluster-robust one: a tracker's fixes do not err independently.
    """
    clocks = results.solution.clocks
    offset_sigma, rate_sigma = _clock_sigmas(results.solution)
    return table(
        TIMING_COLUMNS,
        [
            [c.camera for c in clocks],
            rounded(np.array([c.offset_s for c in clocks]), 9),
            significant(offset_sigma, 9),
            rounded(np.array([c.frame_rate for c in clocks]), 9),
            significant(rate_sigma, 9),
        ],
    )


def _clock_sigmas(solution: Solution) -> tuple[Floats, Floats]:
    """Of every camera's offset (C,) seconds and frame rate (C,) Hz: the larger of plain and robust, where there are
    both."""
    robust = solution.shared_covariance_robust
    sigma = [] if robust is None else np.sqrt(np.diagonal(robust)).tolist()
    known = dict(zip(solution.shared_names, sigma, strict=False))
    plain = ([c.offset_sigma_s for c in solution.clocks], [c.frame_rate_sigma for c in solution.clocks])
    also = ([known.get(f"{c.camera}.{what}", 0.0) for c in solution.clocks] for what in ("offset_s", "frame_rate"))
    offset, rate = (np.fmax(p, a) for p, a in zip(plain, also, strict=True))
    return offset, rate


def clock_csv(results: Results) -> str | None:
    """What is added to f / frame_rate + offset_s where a clock drifts, linear between rows; None where none does."""
    columns: list[list[Any]] = [[] for _ in CLOCK_COLUMNS]
    for clock in results.solution.clocks:
        for column, part in zip(columns, _drift(clock), strict=True):
            column.extend(part)
    return table(CLOCK_COLUMNS, columns) if columns[0] else None


def trajectory_csv(results: Results) -> str:
    """Position, velocity and the position's covariance (m^2) of every target, evenly sampled in common time.

    latitude, longitude and height (above the ellipsoid) are empty without an origin, utc where no log knows it.
    """
    columns: list[list[Any]] = [[] for _ in TRAJECTORY_COLUMNS]
    for trajectory in results.trajectories:
        for column, part in zip(columns, _trajectory_columns(trajectory, results), strict=True):
            column.extend(part)
    return table(TRAJECTORY_COLUMNS, columns)


def sightings_csv(results: Results) -> str:
    """Every observation after the adjustment: residual (observed minus predicted), weight, estimated position."""
    s = results.solution.sightings
    return table(
        SIGHTING_COLUMNS,
        [
            s.camera,
            s.target,
            s.frame.tolist(),
            rounded(s.time_s, 6),
            *(rounded(column, 5) for column in s.residual_px.T),
            rounded(s.residual_sigma, 5),
            rounded(s.weight, 6),
            *(rounded(column, 6) for column in s.position_enu_m.T),
        ],
    )


def _drift(clock: Clock) -> list[list[Any]]:
    if clock.deviation_frame is None or clock.deviation_s is None:
        return [[] for _ in CLOCK_COLUMNS]
    n = len(clock.deviation_frame)
    frame = [int(f) if float(f).is_integer() else f for f in rounded(clock.deviation_frame, 6)]
    sigma: list[Cell] = [""] * n if clock.deviation_sigma_s is None else significant(clock.deviation_sigma_s, 9)
    return [[clock.camera] * n, frame, rounded(clock.deviation_s, 9), sigma]


def _trajectory_columns(trajectory: Trajectory, results: Results) -> list[list[Any]]:
    n = len(trajectory.time_s)
    utc = [""] * n if results.utc_s is None else utc_texts(results.utc_s, trajectory.time_s)
    place: Floats = np.full((n, 3), np.nan)
    if results.origin is not None:
        place = geodetic_degrees(trajectory.position_enu_m, results.origin)[:, [1, 0, 2]]
    return [
        [trajectory.target] * n,
        rounded(trajectory.time_s, 6),
        utc,
        *(rounded(column, 6) for column in trajectory.position_enu_m.T),
        rounded(place[:, 0], 10),
        rounded(place[:, 1], 10),
        rounded(place[:, 2], 6),
        *(rounded(column, 6) for column in trajectory.velocity_mps.T),
        *(significant(column, 9) for column in trajectory.covariance[:, *_UPPER].T),
    ]
