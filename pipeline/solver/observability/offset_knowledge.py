"""Which knowledge the offsets rest on: the information of the sightings alone, with each prior weakened in turn.

    N = J'J (sightings, motions eliminated),   P = priors of frame rates, offsets, attitudes and positions

After `map` the covariance C = (N + P)^-1 is there already, and a prior P_k of kind k made ten times wider changes it by

    (N + P - w P_k)^-1 = C + C_k (P_k^-1 / w - C_kk)^-1 C_k',   w = 1 - 1/100

with C_k the columns of that kind: exact, whatever the motions are. Before a covariance is known, N is taken from the
rays at the clocks in question. An offset whose sigma grows more than threefold when one kind of prior is made ten times
wider is carried by that prior and not by the sightings; one that stays unknown with all priors is carried by nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.records import CameraInput, Finding, SolverSettings
from pipeline.solver.offset_search.crossing import crossing_information
from pipeline.solver.offset_search.polynomial_polish import polynomial_information
from pipeline.solver.offset_search.views import View

CARRIED = 3.0
"""Growth of a sigma, of ten at most, from which on a prior carries an offset."""
NOTICED_S = 0.005
"""Offsets known better than this are nobody's worry."""

WORDS = {
    "position": (
        "offset-and-position",
        "at nearly constant velocity a later clock looks like a camera further along the motion: the offset of "
        "{camera} (sigma {sigma:.2g} s) is only as good as its position",
        "sigma.position_bias_m",
    ),
    "attitude": (
        "offset-and-attitude",
        "a later clock looks like a turned camera: the offset of {camera} (sigma {sigma:.2g} s) is only as good as "
        "its attitude",
        "sigma.attitude_bias_deg",
    ),
    "rate": (
        "offset-and-frame-rate",
        "the offset of {camera} (sigma {sigma:.2g} s) is only as good as what is known of the frame rates",
        "sigma.frame_rate",
    ),
    "offset": (
        "offset-from-prior",
        "the sightings say next to nothing of the offset of {camera}: it keeps the value it was given "
        "(sigma {sigma:.2g} s)",
        "sigma.offset_s",
    ),
}
"""Kind, words and the key that carries, for each kind of prior."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OffsetKnowledge:
    """Sigma of the common time at the middle of one camera's track, and its growth when a prior is ten times wider."""

    camera: str
    sigma_s: float
    growth: Mapping[str, float]


def offset_knowledge(
    cameras: Sequence[CameraInput],
    views: Sequence[View],
    clocks: Sequence[tuple[float, float]],
    orders: Mapping[str, int] | None,
    settings: SolverSettings,
    reference: str,
) -> tuple[OffsetKnowledge, ...]:
    """What carries each offset. `orders` of polynomial motions; None: motions free, only crossing rays count."""
    if orders is None:
        information = crossing_information(views, clocks)
    else:
        information = polynomial_information(views, clocks, orders)
    parts = _priors(cameras, views, settings)
    free = _free(cameras, settings, reference)
    full = _sigmas(information + sum(parts.values()), free)
    weaker = {
        kind: _sigmas(information + sum(p if k != kind else p / 100 for k, p in parts.items()), free) for kind in parts
    }
    return tuple(
        OffsetKnowledge(
            camera=camera.camera,
            sigma_s=float(full[8 * i]),
            growth={kind: float(s[8 * i] / max(full[8 * i], 1e-12)) for kind, s in weaker.items()},
        )
        for i, camera in enumerate(cameras)
        if free[8 * i]
    )


def solved_offset_knowledge(
    cameras: Sequence[CameraInput],
    views: Sequence[View],
    clocks: Sequence[tuple[float, float]],
    names: Sequence[str],
    covariance: Floats,
) -> tuple[OffsetKnowledge, ...]:
    """What carries each offset that `map` has freed, from the covariance (s, s) of its shared parameters `names`.

    `clocks` are offset and clock_scale of each camera.
    """
    place = {name: i for i, name in enumerate(names)}
    parts = _prior_places(cameras, [clock_scale for _, clock_scale in clocks], place)
    out = []
    for camera, view, (_, clock_scale) in zip(cameras, views, clocks, strict=True):
        if f"{camera.camera}.offset_s" not in place:
            continue
        row = np.zeros(len(names))
        row[place[f"{camera.camera}.offset_s"]] = 1.0
        if f"{camera.camera}.frame_rate" in place:  # t = clock_scale tau + offset, clock_scale = nominal / rate
            row[place[f"{camera.camera}.frame_rate"]] = -0.5 * sum(view.span_s) * clock_scale**2 / camera.frame_rate
        full = float(np.sqrt(row @ covariance @ row))
        growth = {kind: _widened(covariance, row, at, sigma) / max(full, 1e-12) for kind, (at, sigma) in parts.items()}
        out.append(OffsetKnowledge(camera=camera.camera, sigma_s=full, growth=growth))
    return tuple(out)


def _prior_places(
    cameras: Sequence[CameraInput], clock_scales: Sequence[float], place: Mapping[str, int]
) -> dict[str, tuple[Ints, Floats]]:
    """Places among the shared parameters, and prior sigmas there in their units, of each kind of prior."""
    found: dict[str, list[tuple[int, float]]] = {kind: [] for kind in WORDS}
    for camera, clock_scale in zip(cameras, clock_scales, strict=True):
        sigma, name = camera.sigma, camera.camera
        told: dict[str, tuple[tuple[str, ...], float]] = {
            "rate": (("frame_rate",), sigma.frame_rate * camera.frame_rate / clock_scale**2),
            "attitude": (tuple(f"rotation_bias_{a}_rad" for a in "xyz"), sigma.attitude_bias_rad),
            "position": (tuple(f"position_bias_{a}_m" for a in ("east", "north", "up")), sigma.position_bias_m),
        }
        if camera.offset_s is not None and sigma.offset_s is not None:
            told["offset"] = (("offset_s",), sigma.offset_s)
        for kind, (keys, value) in told.items():
            found[kind] += [(place[f"{name}.{key}"], value) for key in keys if f"{name}.{key}" in place]
    return {
        kind: (np.array([at for at, _ in rows], dtype=np.int64), np.array([value for _, value in rows]))
        for kind, rows in found.items()
    }


def _widened(covariance: Floats, row: Floats, at: Ints, sigma: Floats) -> float:
    """Sigma of `row` @ parameters where the priors at places `at`, of these sigmas, are ten times wider."""
    scaled = (row @ covariance)[at] / sigma
    room = np.eye(len(at)) / 0.99 - covariance[np.ix_(at, at)] / np.outer(sigma, sigma)
    value, vector = np.linalg.eigh(room)
    more = ((vector.T @ scaled) ** 2 / np.maximum(value, 1 / 0.99 - 1)).sum()
    return float(np.sqrt(row @ covariance @ row + more))


def carried(known: OffsetKnowledge) -> tuple[Finding, ...]:
    """The prior that carries an offset most, in words; nothing where the sightings do."""
    kind = max(known.growth, key=lambda k: known.growth[k])
    if known.sigma_s < NOTICED_S or known.growth[kind] < CARRIED:
        return ()
    name, words, key = WORDS[kind]
    return (
        Finding(
            kind=name,
            subject=known.camera,
            words=words.format(camera=known.camera, sigma=known.sigma_s),
            carried_by=f"cameras.{known.camera}.{key}",
        ),
    )


def _priors(cameras: Sequence[CameraInput], views: Sequence[View], settings: SolverSettings) -> dict[str, Floats]:
    """Precision matrices (8 c, 8 c), one for each kind of prior; only `map` has them."""
    size = 8 * len(cameras)
    parts = {kind: np.zeros((size, size)) for kind in WORDS}
    if settings.method != "map":
        return parts
    for i, (camera, view) in enumerate(zip(cameras, views, strict=True)):
        sigma, at = camera.sigma, 8 * i
        middle = 0.5 * sum(view.span_s)
        parts["rate"][at + 1, at + 1] = 1 / max(sigma.frame_rate, 1e-9) ** 2
        if camera.offset_s is not None and sigma.offset_s is not None:
            row = np.zeros(size)
            row[at : at + 2] = np.array([1.0, -middle]) / max(sigma.offset_s, 1e-9)
            parts["offset"] += np.outer(row, row)
        for k in range(3):
            parts["attitude"][at + 2 + k, at + 2 + k] = view.attitude_bias_rad**-2
            parts["position"][at + 5 + k, at + 5 + k] = view.position_bias_m**-2
    return parts


def _free(cameras: Sequence[CameraInput], settings: SolverSettings, reference: str) -> Floats:
    """(8 c,) which unknowns move at all in the method in force."""
    statistical = settings.method == "map"
    free = np.zeros((len(cameras), 8), dtype=bool)
    for i, camera in enumerate(cameras):
        sigma = camera.sigma
        if camera.camera != reference:
            free[i, 0] = sigma.offset_s is None or sigma.offset_s > 0
            free[i, 1] = settings.refine_frame_rate and sigma.frame_rate > 0 and settings.method != "li"
        free[i, 2:5] = statistical and sigma.attitude_bias_rad > 0
        free[i, 5:8] = statistical and sigma.position_bias_m > 0
    return free.ravel()


def _sigmas(normal: Floats, free: Floats) -> Floats:
    """One sigma of each unknown; infinite where nothing determines it, zero where it is held."""
    out = np.zeros(len(free))
    part = normal[np.ix_(free, free)]
    scale = 1 / np.sqrt(np.maximum(np.diagonal(part), 1e-30))
    value, vector = np.linalg.eigh(part * scale[:, None] * scale)
    square = (vector**2 / np.maximum(value, 1e-13)).sum(1)
    out[free] = scale * np.sqrt(square)
    return out
