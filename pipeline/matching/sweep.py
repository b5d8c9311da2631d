"""Every offset between two cameras, judged roughly: how well do the best pairs of tracks agree at it?

Constant errors of the instruments are allowed for, not found; the ground's height is the one of the best few pairs
that serves the others best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from calibration.foundation.arrays import Bools, Floats, Ints
from pipeline.matching.evidence import Polynomials, different_m, log_ratio, polynomials
from pipeline.matching.meeting import Meeting, meet
from pipeline.matching.sampling import Sampled
from pipeline.matching.settings import MatchSettings
from pipeline.records import InstrumentSigma

GROUNDS = 6
"""Heights of the ground that are tried at each offset: those of so many best pairs."""
FINE = 16
"""Offsets, of every second step, whose neighbours are looked at too; elsewhere these are taken as in between."""
NEVER = -1e3
"""Of pairs that cannot be: behind a camera, or with nothing in common."""
ROUGH_ORDERS, ROUGH_SAMPLES = 4, 24


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """What offsets between two cameras are worth: b's samples moved by `shift` (k,) steps; `score`, `ground_m` (k,)."""

    shift: Ints
    score: Floats
    ground_m: Floats


def sweep(a: Sampled, b: Sampled, low_s: float, high_s: float, settings: MatchSettings) -> Curve:
    """Scores at every step of the offset of b's video time on a's, low_s to high_s."""
    shift = np.arange(int(np.floor(low_s / a.step_s)), int(np.ceil(high_s / a.step_s)) + 1)
    found = np.full((len(shift), 2), np.nan)
    found[::2] = [_score(a, b, int(k), settings) for k in shift[::2]]
    score = np.where(np.isnan(found[:, 0]), -np.inf, found[:, 0])
    near = np.zeros(len(shift), bool)
    near[np.argsort(-score)[:FINE]] = True
    for row in np.flatnonzero(np.isnan(found[:, 0])):
        beside = [k for k in (row - 1, row + 1) if 0 <= k < len(shift)]
        if near[beside].any():
            found[row] = _score(a, b, int(shift[row]), settings)
        else:
            found[row] = found[beside].mean(axis=0)
    return Curve(shift=shift, score=found[:, 0], ground_m=found[:, 1])


def _score(a: Sampled, b: Sampled, shift: int, settings: MatchSettings) -> tuple[float, float]:
    begin = max(a.first, b.first + shift)
    end = min(a.first + len(a.centre_m), b.first + shift + len(b.centre_m))
    if (end - begin) * a.step_s < settings.least_s:
        return 0.0, np.nan
    rows = np.arange(begin, end, max(1, (end - begin) // ROUGH_SAMPLES))
    own, other = rows - a.first, rows - shift - b.first
    met = meet(
        a.centre_m[own], a.ray[:, None, own], b.centre_m[other], b.ray[None, :, other],
        _turn(a)[:, None, None], _turn(b)[None, :, None], _moving(a.sigma, b.sigma),
    )  # fmt: skip
    miss, height, level_m, level_var = _coefficients(met, rows.astype(float) * a.step_s, a, b, settings)
    fixed = miss - np.log(max(len(a.names), len(b.names)))
    best = np.argsort(-(fixed + height).ravel())[:GROUNDS]
    score, ground = _assigned(fixed + np.log1p(-settings.on_ground)), np.nan
    for k in best:
        if fixed.ravel()[k] + height.ravel()[k] < 0:
            break
        here = level_m.ravel()[k]
        same = level_var + settings.relief_m**2
        on_it = log_ratio(level_m - here, np.zeros(()), same, np.asarray(settings.apart_m**2)) + height
        told = fixed + np.logaddexp(on_it + np.log(settings.on_ground), np.log1p(-settings.on_ground))
        worth = _assigned(told)
        if worth > score:
            score, ground = worth, float(here)
    return score, ground


def _turn(camera: Sampled) -> Floats:
    return np.hypot(camera.pixel_rad, camera.sigma.attitude_rad)


def _moving(a: InstrumentSigma, b: InstrumentSigma) -> float:
    return float(np.hypot(a.position_m, b.position_m))


def _assigned(worth: Floats) -> float:
    """Sum over the best pairs, none where none is worth it."""
    gain = np.maximum(worth, 0.0)
    if not gain.any():
        return 0.0
    rows, columns = linear_sum_assignment(-gain)
    return float(gain[rows, columns].sum())


def _coefficients(
    met: Meeting, time_s: Floats, a: Sampled, b: Sampled, settings: MatchSettings
) -> tuple[Floats, Floats, Floats, Floats]:
    """Of every pair (ma, mb): log ratio of the miss, of the height's changes, the mean height and its variance."""
    valid = np.isfinite(met.miss_m)
    standing = a.still[:, None] & b.still
    weight = np.where(valid, 1 / np.where(valid, met.miss_sigma_m, 1.0), 0.0)
    fit = polynomials(time_s, weight, ROUGH_ORDERS)
    bias_m = constant_m(met, a.sigma, b.sigma, valid)
    allowed = np.stack([bias_m**2 * share**2 for share in (1.0, 0.4, 0.2, 0.1)], axis=-1) + settings.place_m**2
    noise = np.diagonal(fit.inverse, axis1=-2, axis2=-1)
    miss = mixed(fit.of(np.where(valid, met.miss_m, 0), weight), noise, allowed, fit, met, standing, settings)
    steep = np.where(valid, met.height_sigma_m / met.miss_sigma_m, 0.0).sum(-1) / np.maximum(valid.sum(-1), 1)
    up_weight = np.where(valid, 1 / np.where(valid, met.height_sigma_m, 1.0), 0.0)
    up = polynomials(time_s, up_weight, ROUGH_ORDERS)
    c = up.of(np.where(valid, met.height_m, 0), up_weight)
    up_noise = np.diagonal(up.inverse, axis1=-2, axis2=-1)
    up_allowed = allowed * np.maximum(steep, 1.0)[..., None] ** 2
    height = np.full(c.shape[:-1], np.inf)
    for kind, share in (("free", settings.free), ("wild", settings.wild)):
        apart = different_m(up.half_s, settings, kind)[..., :ROUGH_ORDERS] ** 2
        height = np.minimum(height, log_ratio(c, up_noise, up_allowed, apart)[..., 1:].sum(-1) - np.log(share))
    return miss, height, c[..., 0], up_noise[..., 0] + up_allowed[..., 0]


def constant_m(met: Meeting, a: InstrumentSigma, b: InstrumentSigma, valid: Bools) -> Floats:
    """What constant errors of both cameras do to a miss, one sigma (...), metres."""
    count = np.maximum(valid.sum(-1), 1)
    far_a, far_b = (
        np.where(valid, np.clip(np.abs(np.nan_to_num(s)), 2.0, 2e4), 0).sum(-1) / count
        for s in (met.depth_a_m, met.depth_b_m)
    )
    turned = (far_a * a.attitude_bias_rad) ** 2 + (far_b * b.attitude_bias_rad) ** 2
    return np.asarray(np.sqrt(turned + a.position_bias_m**2 + b.position_bias_m**2))


def mixed(
    coefficient: Floats, noise: Floats, allowed: Floats, fit: Polynomials, met: Meeting, standing: Bools,
    settings: MatchSettings,
) -> Floats:  # fmt: skip
    """Log ratio (...) of one target against the likeliest way in which two could look so; NEVER where it cannot be."""
    orders = coefficient.shape[-1]
    found = np.full(coefficient.shape[:-1], np.inf)
    valid = np.isfinite(met.miss_m)
    for kind, share in kinds(settings, standing):
        apart = different_m(fit.half_s, settings, kind)[..., :orders] ** 2
        found = np.minimum(found, log_ratio(coefficient, noise, allowed, apart).sum(-1) - np.log(share))
    few = valid.sum(-1) < 3
    behind = np.where(valid, met.behind, False).sum(-1) > settings.behind * valid.sum(-1)
    return np.where(few | behind, NEVER, found)


def kinds(settings: MatchSettings, standing: Bools) -> tuple[tuple[str, Floats], ...]:
    """The ways in which two different targets look, each with its share (...); `standing`: both may stand still."""
    apart = np.where(standing, 0.5 * settings.still, settings.twin)
    near = np.where(standing, 0.5 * settings.still, settings.twin * settings.near)
    others = ("free", settings.free), ("alike", settings.alike), ("wild", settings.wild)
    return (*((kind, np.full(standing.shape, share)) for kind, share in others), ("still", apart), ("near", near))
