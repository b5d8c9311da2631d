"""What bundles of sight rays cannot tell, tested on the rays themselves.

A target whose motion is a polynomial of order K has a distance nobody can know if another polynomial of that order,
u(t) = sum over k of a_k t^k, lies along every one of its rays: X + lambda u fits as well as X for every lambda. So

    minimise over a:  sum over i of |(I - d_i d_i') u(t_i)|^2 / (sigma_i |u(t_i)|)^2

and where that is no more than chance, the motion is not determined (paper section 2.2). Rays that are parallel (u is
constant), rays through one point P (u = X - P; a camera that stands still among them) and a camera that itself moves
as a polynomial of order K or less (u = X - C) are the ways in which this happens. A hypothesis test on measured rays,
not a small eigenvalue: noise alone makes every eigenvalue look healthy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.solver.offset_search.views import Track, View, thinned

MOST = 400
"""Rays of one camera that are looked at."""
ROUNDS = 8
"""Weightings by the polynomial's own length that are tried."""
SLACK = 1e-6
"""Share of a lower bound that rounding may take."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Bundle:
    """Rays of one target from one or more cameras: common time (m,), centres and unit rays (m, 3), sigmas (m,).

    sigma_rad  of the direction, what changes from frame to frame
    bias_rad, position_bias_m  of what stays: attitude, and the camera's place
    camera     (m,) place in the list of cameras
    """

    time_s: Floats
    centre_m: Floats
    ray: Floats
    sigma_rad: Floats
    bias_rad: float
    position_bias_m: float
    camera: Floats

    @property
    def cameras(self) -> int:
        """How many cameras it comes from."""
        return len(np.unique(self.camera))


def bundle_of(views: Sequence[View], clocks: Sequence[tuple[float, float]], target: str) -> Bundle:
    """The rays of `target` from all `views` that see it, at common times by clocks of offset and clock_scale."""
    parts = [
        (i, v, _at_most(v.tracks[target]), *clock)
        for i, (v, clock) in enumerate(zip(views, clocks, strict=True))
        if target in v.tracks
    ]
    return Bundle(
        time_s=np.concatenate([clock_scale * t.time_s + offset for _, _, t, offset, clock_scale in parts]),
        centre_m=np.concatenate([t.centre_m for _, _, t, _, _ in parts]),
        ray=np.concatenate([t.ray for _, _, t, _, _ in parts]),
        sigma_rad=np.concatenate([_sigma(v, t) for _, v, t, _, _ in parts]),
        bias_rad=max(v.attitude_bias_rad for _, v, _, _, _ in parts),
        position_bias_m=max(float(np.hypot(v.position_bias_m, v.position_noise_m)) for _, v, _, _, _ in parts),
        camera=np.concatenate([np.full(len(t), float(i)) for i, _, t, _, _ in parts]),
    )


def _at_most(track: Track) -> Track:
    return track if len(track) <= MOST else thinned(track, 0.0, MOST)


def _sigma(view: View, track: Track) -> Floats:
    """What instruments and labels claim, or what neighbouring rays show where that is more."""
    claimed = np.hypot(track.pixel_rad, view.attitude_noise_rad)
    if len(track) < 12:
        return np.asarray(claimed)
    second = track.ray[2:] - 2 * track.ray[1:-1] + track.ray[:-2]
    shown = 1.4826 * float(np.median(np.abs(second))) / np.sqrt(6)
    return np.asarray(np.maximum(claimed, min(shown, 10 * float(np.median(claimed)))))


def by_chance(chi_square: float, degrees: int) -> bool:
    """Whether residuals are no larger than noise and small biases make them."""
    return bool(chi_square <= 1.5 * degrees + 4 * np.sqrt(2 * degrees))


def slides_along_rays(bundle: Bundle, order: int) -> bool:
    """Whether some polynomial of `order` lies along every ray: then the distance is anybody's guess.

    The first eigenvalue bounds the sum from below: |u(t_i)|^2 is nowhere more than the greatest leverage times the sum
    of all. Where that bound already is more than chance, no weighting needs to be tried.
    """
    count = len(bundle.time_s)
    unknown = 3 * (order + 1)
    degrees = max(2 * count - unknown + 1, 1)
    if 2 * count < unknown:
        return True
    middle, half = 0.5 * (bundle.time_s.min() + bundle.time_s.max()), max(0.5 * float(np.ptp(bundle.time_s)), 1e-9)
    powers = np.polynomial.legendre.legvander((bundle.time_s - middle) / half, order)
    across = np.eye(3) - bundle.ray[:, :, None] * bundle.ray[:, None, :]
    design = (powers[:, None, :, None] * across[:, :, None, :]).reshape(count, 3, unknown)
    least, a = _least_across(design / bundle.sigma_rad[:, None, None], powers)
    leverage = float((np.linalg.qr(powers)[0] ** 2).sum(axis=1).max())
    if not by_chance(least / leverage * (1 - SLACK), degrees):
        return False
    best = np.inf
    for _ in range(ROUNDS):
        u = powers @ a.reshape(order + 1, 3)
        length = np.maximum(np.linalg.norm(u, axis=1), 0.02 * np.sqrt((u**2).sum(1).mean()))
        off = design @ a
        best = min(best, float(((off**2).sum(1) / (bundle.sigma_rad * length) ** 2).sum()))
        if by_chance(best, degrees):
            return True
        _, a = _least_across(design / (bundle.sigma_rad * length)[:, None, None], powers / length[:, None])
    return False


def _least_across(design: Floats, powers: Floats) -> tuple[float, Floats]:
    """Least sum of squares of `design` (m, 3, 3 (K + 1)) @ a over that of the polynomial u itself, and that a."""
    unknown = design.shape[2]
    flat = design.reshape(-1, unknown)
    size = np.kron(powers.T @ powers, np.eye(3))
    root = np.linalg.cholesky(size + 1e-12 * np.trace(size) * np.eye(unknown))
    inner = np.linalg.solve(root, np.linalg.solve(root, flat.T @ flat).T)
    value, vector = np.linalg.eigh(0.5 * (inner + inner.T))
    return float(value[0]), np.linalg.solve(root.T, vector[:, 0])


def are_parallel(bundle: Bundle) -> bool:
    """Whether all rays point the same way."""
    return slides_along_rays(bundle, 0)


def stands_still(bundle: Bundle) -> bool:
    """Whether one camera alone sees the target, and from one place as far as its instruments can tell."""
    spread = np.linalg.norm(bundle.centre_m - bundle.centre_m.mean(axis=0), axis=1)
    return bool(bundle.cameras == 1 and np.sqrt((spread**2).mean()) < 3 * bundle.position_bias_m + 1e-6)


def moves_simply(bundle: Bundle, order: int) -> bool:
    """Whether one camera alone sees the target and itself moves as a polynomial of `order`, as far as one can tell."""
    if bundle.cameras > 1:
        return False
    middle, half = 0.5 * (bundle.time_s.min() + bundle.time_s.max()), max(0.5 * float(np.ptp(bundle.time_s)), 1e-9)
    powers = np.polynomial.legendre.legvander((bundle.time_s - middle) / half, order)
    off = bundle.centre_m - powers @ np.linalg.lstsq(powers, bundle.centre_m, rcond=None)[0]
    return bool(np.sqrt((off**2).sum(axis=1).mean()) < 3 * bundle.position_bias_m + 1e-6)


def meet_in_one_point(bundle: Bundle) -> bool:
    """Whether one point lies on every ray: the camera itself where it stands still, or a point that all rays pass."""
    if stands_still(bundle):
        return True
    across = np.eye(3) - bundle.ray[:, :, None] * bundle.ray[:, None, :]
    weight = np.ones(len(bundle.centre_m))
    for _ in range(5):
        normal = np.einsum("m,mij->ij", weight, across)
        right = np.einsum("m,mij,mj->i", weight, across, bundle.centre_m)
        point = np.linalg.lstsq(normal, right, rcond=1e-10)[0]
        away = point - bundle.centre_m
        variance = bundle.sigma_rad**2 * (away**2).sum(1) + bundle.position_bias_m**2
        weight = 1 / variance
    off = (across @ away[:, :, None])[:, :, 0]
    return by_chance(float(((off**2).sum(1) * weight).sum()), max(2 * len(weight) - 3, 1))


def lie_in_one_plane(bundle: Bundle) -> bool:
    """Whether all rays and all camera centres of at least two cameras lie in one plane (paper section 2.3)."""
    if bundle.cameras < 2:
        return False
    normal = np.linalg.eigh(np.einsum("mi,mj->ij", bundle.ray, bundle.ray))[1][:, 0]
    sigma = np.hypot(bundle.sigma_rad, bundle.bias_rad)
    out = float((((bundle.ray @ normal) / sigma) ** 2).mean())
    centres = bundle.centre_m - bundle.centre_m.mean(axis=0)
    reach = float(np.sqrt((centres**2).sum(1).mean()))
    height = float(np.sqrt(((centres @ normal) ** 2).mean()))
    return out <= 2.0 and height <= 2 * np.hypot(bundle.position_bias_m, reach * float(np.median(sigma)))


def stand_on_one_line(views: Sequence[View]) -> bool:
    """Whether all camera centres, of at least two cameras, lie on one straight line."""
    centres = np.concatenate([t.centre_m for v in views for t in v.tracks.values()])
    shift = max(float(np.hypot(v.position_bias_m, v.position_noise_m)) for v in views)
    away = centres - centres.mean(axis=0)
    square = np.linalg.eigvalsh(away.T @ away / len(away))
    if square[2] < (3 * shift) ** 2 and len(views) < 2:
        return False
    return bool(np.sqrt(max(square[1], 0.0)) <= 3 * shift + 1e-9)
