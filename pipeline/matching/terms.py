"""Pairs of tracks at hypothesised clocks, linear in what is not known exactly.

Unknowns, D = 8 C + 3: of each camera a constant rotation (camera axes, rad), a constant shift (ENU, m), a correction
of its offset (s, at the middle of its video) and of its rate (relative); of the ground its height (m) and slopes.

    coefficients of a pair = c,   expected G b,   covariance S        (miss first, then height above the ground)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints
from pipeline.matching.evidence import Polynomials, different_m, polynomials
from pipeline.matching.meeting import Meeting, meet
from pipeline.matching.sampling import Sampled
from pipeline.matching.settings import MatchSettings
from pipeline.matching.sweep import constant_m, kinds, mixed

OWN = 8
"""Unknowns of a camera: rotation 3, shift 3, offset, rate."""
LEAST_ROUGH, MOST_EACH = -6.0, 6
"""Pairs that are looked at: those not worse than this roughly, the best few of each track."""
LEAST_BOTH = 3
"""Moments in common of which a pair is judged at all."""
NO_PAIRS = np.zeros((0, 2), int)
TURN_RAD, SHIFT_M, TIME_S = 1e-4, 0.05, 0.1
"""Steps of the derivatives."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Terms:
    """S pairs of tracks: `first`, `second` (S,) global numbers of tracks.

    coefficient  (S, 2P)
    covariance   (S, 2P, 2P) if it is one target and all unknowns are exact
    design       (S, 2P, D)
    other        (S, 2) log-likelihood if it is two targets: of the miss alone, of miss and height
    never_both   (K, 2) pairs of tracks that were hardly ever seen at one time: nothing tells of them
    """

    first: Ints
    second: Ints
    coefficient: Floats
    covariance: Floats
    design: Floats
    other: Floats
    never_both: Ints


def terms(
    views: Sequence[Sampled], offset_s: Mapping[str, float | None], ground_m: float, settings: MatchSettings
) -> Terms:
    """The terms of every pair of cameras that are tied."""
    start = np.cumsum([0] + [len(v.names) for v in views])
    parts, silent = [], [NO_PAIRS]
    for a in range(len(views)):
        for b in range(a + 1, len(views)):
            one, other = offset_s[views[a].camera], offset_s[views[b].camera]
            if one is not None and other is not None:
                found = _pair(views, (a, b), (one, other), ground_m, settings)
                apart = _never_both(views[a], views[b], (one, other), settings)
                silent.append(apart + np.array([start[a], start[b]]))
                if found is not None:
                    parts.append(
                        Terms(
                            first=found.first + start[a],
                            second=found.second + start[b],
                            coefficient=found.coefficient,
                            covariance=found.covariance,
                            design=found.design,
                            other=found.other,
                            never_both=NO_PAIRS,
                        )
                    )
    size, wide = 2 * settings.orders, OWN * len(views) + 3
    if not parts:
        none = np.zeros(0, int)
        return Terms(
            first=none, second=none, coefficient=np.zeros((0, size)), covariance=np.zeros((0, size, size)),
            design=np.zeros((0, size, wide)), other=np.zeros((0, 2)), never_both=np.concatenate(silent),
        )  # fmt: skip
    names = ("first", "second", "coefficient", "covariance", "design", "other")
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return Terms(**joined, never_both=np.concatenate(silent))


def _never_both(a: Sampled, b: Sampled, offset: tuple[float, float], settings: MatchSettings) -> Ints:
    """Pairs (K, 2) of tracks of two cameras that have less than `LEAST_BOTH` moments in common."""
    time_s = _times(a, b, *offset, settings)
    seen = [np.isfinite(v.at(time_s - o)[2][..., 0]).astype(int) for v, o in zip((a, b), offset, strict=True)]
    return np.argwhere(seen[0] @ seen[1].T < LEAST_BOTH)


def _times(a: Sampled, b: Sampled, one: float, other: float, settings: MatchSettings) -> Floats:
    begin = max(a.span_s[0] + one, b.span_s[0] + other)
    end = min(a.span_s[1] + one, b.span_s[1] + other)
    if end - begin < settings.least_s:
        return np.zeros(0)
    return np.linspace(begin, end, min(settings.most_samples, int((end - begin) / a.step_s) + 1))


def _pair(
    views: Sequence[Sampled], pair: tuple[int, int], offset: tuple[float, float], ground_m: float,
    settings: MatchSettings,
) -> Terms | None:  # fmt: skip
    a, b = views[pair[0]], views[pair[1]]
    time_s = _times(a, b, *offset, settings)
    if not len(time_s):
        return None
    scene = _Scene(a, b, time_s, offset, settings)
    rough = scene.rough()
    rows, columns = _plausible(rough)
    if not len(rows):
        return None
    met = scene.meeting(rows, columns)
    valid = np.isfinite(met.miss_m)
    weight = np.where(valid, 1 / np.where(valid, met.miss_sigma_m, 1.0), 0.0)
    up_weight = np.where(valid, 1 / np.where(valid, met.height_sigma_m, 1.0), 0.0)
    fits = polynomials(time_s, weight, settings.orders), polynomials(time_s, up_weight, settings.orders)
    level = 0.0 if np.isnan(ground_m) else ground_m

    def coefficients(seen: Meeting) -> Floats:
        gone = ~np.isfinite(seen.miss_m)
        values = _kept(seen.miss_m, met.miss_m, gone), _kept(seen.height_m, met.height_m, gone) - level
        return np.concatenate(
            [fit.of(value, w) for fit, value, w in zip(fits, values, (weight, up_weight), strict=True)], axis=-1
        )

    base = coefficients(met)
    wide = OWN * len(views) + 3
    design = np.zeros((len(rows), base.shape[1], wide))
    for column, moved, step in scene.derivatives(rows, columns):
        change = (coefficients(moved) - base) / step
        side, own = divmod(column, OWN)
        design[:, :, OWN * pair[side] + own] = change
    for side, view in enumerate((a, b)):
        _rate_column(design, pair[side], view, time_s - offset[side], fits, scene, rows, columns, weight, up_weight)
    x = np.where(valid[..., None], met.place_m, 0.0)
    for k, value in enumerate((np.ones(x.shape[:2]), x[..., 0], x[..., 1])):
        design[:, settings.orders :, wide - 3 + k] = fits[1].of(value, up_weight)
    # what is modelled is c = G b + noise: moved by b, the measured coefficient would change by design b
    design[:, :, : wide - 3] *= -1
    noise = _noise(met, valid, fits, scene, settings)
    standing = a.still[rows] & b.still[columns]
    column = OWN * pair[1]
    moved_m = design[:, :, column + 3 : column + 6]  # another target, there, is as a camera shifted
    return Terms(
        first=rows, second=columns, coefficient=base, covariance=noise, design=design,
        other=_different(base, noise, moved_m, fits, standing, settings), never_both=NO_PAIRS,
    )  # fmt: skip


def _kept(value: Floats, before: Floats, gone: Bools) -> Floats:
    """Values; where a step led out of a track, those before it; 0 where there is none."""
    return np.nan_to_num(np.where(gone, before, value))


def _rate_column(
    design: Floats, camera: int, view: Sampled, video_s: Floats, fits: tuple[Polynomials, Polynomials],
    scene: _Scene, rows: Ints, columns: Ints, weight: Floats, up_weight: Floats,
) -> None:  # fmt: skip
    """A relative change of the rate moves each moment by its distance from the video's middle."""
    base, moved = scene.meeting(rows, columns), scene.later(view, rows, columns)
    away = video_s - 0.5 * sum(view.span_s)
    miss = np.nan_to_num((moved.miss_m - base.miss_m) / TIME_S) * away
    up = np.nan_to_num((moved.height_m - base.height_m) / TIME_S) * away  # a step out of the track: no change
    design[:, :, OWN * camera + 7] = np.concatenate([fits[0].of(miss, weight), fits[1].of(up, up_weight)], axis=-1)


class _Scene:
    """Two cameras at common times: rays, and what they become when something is moved a little."""

    def __init__(
        self, a: Sampled, b: Sampled, time_s: Floats, offset: tuple[float, float], settings: MatchSettings
    ) -> None:
        self.a, self.b, self.time_s, self.offset, self.settings = a, b, time_s, offset, settings
        self.seen = a.at(time_s - offset[0]), b.at(time_s - offset[1])
        self.turn = tuple(np.hypot(v.pixel_rad, v.sigma.attitude_rad) for v in (a, b))
        self.shift = float(np.hypot(a.sigma.position_m, b.sigma.position_m))

    def meeting(self, rows: Ints, columns: Ints) -> Meeting:
        """Of pairs (S, n)."""
        return self._meet(
            self.seen[0][0], self.seen[0][2][rows], self.seen[1][0], self.seen[1][2][columns], rows, columns
        )

    def _meet(self, ca: Floats, ra: Floats, cb: Floats, rb: Floats, rows: Ints, columns: Ints) -> Meeting:
        turn = self.turn[0][rows][:, None], self.turn[1][columns][:, None]
        return meet(ca, ra, cb, rb, turn[0], turn[1], self.shift)

    def later(self, view: Sampled, rows: Ints, columns: Ints) -> Meeting:
        """With a camera's offset TIME_S larger."""
        seen = list(self.seen)
        side = 0 if view is self.a else 1
        seen[side] = view.at(self.time_s - self.offset[side] - TIME_S)
        return self._meet(seen[0][0], seen[0][2][rows], seen[1][0], seen[1][2][columns], rows, columns)

    def derivatives(self, rows: Ints, columns: Ints) -> list[tuple[int, Meeting, float]]:
        """(place of the unknown in camera a's, then b's; the meeting when it is moved; by how much)."""
        (ca, axes_a, rays_a), (cb, axes_b, rays_b) = self.seen
        ra, rb = rays_a[rows], rays_b[columns]
        found = []
        for k in range(3):
            turned_a = ra + TURN_RAD * np.cross(axes_a[:, :, k], ra)
            turned_b = rb + TURN_RAD * np.cross(axes_b[:, :, k], rb)
            found.append((k, self._meet(ca, _unit(turned_a), cb, rb, rows, columns), TURN_RAD))
            found.append((OWN + k, self._meet(ca, ra, cb, _unit(turned_b), rows, columns), TURN_RAD))
            step = SHIFT_M * np.eye(3)[k]
            found.append((3 + k, self._meet(ca + step, ra, cb, rb, rows, columns), SHIFT_M))
            found.append((OWN + 3 + k, self._meet(ca, ra, cb + step, rb, rows, columns), SHIFT_M))
        found.append((6, self.later(self.a, rows, columns), TIME_S))
        found.append((OWN + 6, self.later(self.b, rows, columns), TIME_S))
        return found

    def rough(self) -> Floats:
        """Log ratio (ma, mb) of the miss, constant errors allowed for; NEVER where it cannot be."""
        a, b, settings = self.a, self.b, self.settings
        thin = slice(None, None, max(1, len(self.time_s) // 24))
        (ca, _, ra), (cb, _, rb) = self.seen
        met = meet(
            ca[thin], ra[:, None, thin], cb[thin], rb[None, :, thin], self.turn[0][:, None, None],
            self.turn[1][None, :, None], self.shift,
        )  # fmt: skip
        valid = np.isfinite(met.miss_m)
        weight = np.where(valid, 1 / np.where(valid, met.miss_sigma_m, 1.0), 0.0)
        fit = polynomials(self.time_s[thin], weight, 3)
        bias = constant_m(met, a.sigma, b.sigma, valid)
        allowed = np.stack([(3.0 + bias) ** 2] * 3, axis=-1)
        noise = np.diagonal(fit.inverse, axis1=-2, axis2=-1)
        return mixed(
            fit.of(np.nan_to_num(met.miss_m), weight), noise, allowed, fit, met, a.still[:, None] & b.still, settings
        )


def _unit(ray: Floats) -> Floats:
    return np.asarray(ray / np.linalg.norm(ray, axis=-1, keepdims=True))


def _plausible(rough: Floats) -> tuple[Ints, Ints]:
    """Rows and columns of the pairs that are looked at."""
    keep = np.zeros(rough.shape, bool)
    for axis in (0, 1):
        order = np.argsort(np.argsort(-rough, axis=axis), axis=axis)
        keep |= order < MOST_EACH
    rows, columns = np.nonzero(keep & (rough > LEAST_ROUGH))
    return rows, columns


UPWARD = 0.2
"""How far apart two targets are in height, of how far they are level."""
HEIGHTS_M = 15.0
"""By how much more the heights at which rays of two different targets meet differ, one sigma."""
FALL = (1.0, 0.5, 0.3, 0.15, 0.1)
"""How much of a lasting error each polynomial has."""


def _noise(
    met: Meeting, valid: Bools, fits: tuple[Polynomials, Polynomials], scene: _Scene, settings: MatchSettings
) -> Floats:
    """Covariance (S, 2P, 2P) of coefficients of one target."""
    p = settings.orders
    found = np.zeros((len(valid), 2 * p, 2 * p))
    count = np.maximum(valid.sum(-1), 1)
    for part, (fit, sigma) in enumerate(zip(fits, (met.miss_sigma_m, met.height_sigma_m), strict=True)):
        typical = np.where(valid, sigma, 0).sum(-1) / count
        lasting = (settings.lasting * typical)[:, None] * np.array(FALL[:p])
        place = np.array([settings.place_m, *[settings.drift_m] * (p - 1)])
        if part == 1:
            place = np.array([settings.relief_m, *[settings.relief_m / 3] * (p - 1)])
        rows = slice(part * p, (part + 1) * p)
        found[:, rows, rows] = fit.inverse + (lasting**2 + place**2)[:, :, None] * np.eye(p)
    return found


def _different(
    c: Floats, covariance: Floats, moved_m: Floats, fits: tuple[Polynomials, Polynomials], standing: Bools,
    settings: MatchSettings,
) -> Floats:  # fmt: skip
    """Log-likelihood (S, 2) of two different targets: of the miss, of miss and height; the mixture of all kinds.

    moved_m  (S, 2P, 3) what coefficients become by where the other target is
    """
    p = settings.orders
    away = settings.apart_m * np.array([1.0, 1.0, UPWARD])
    apart = (moved_m * away**2) @ np.swapaxes(moved_m, 1, 2)
    apart[:, p, p] += HEIGHTS_M**2
    found = np.full((len(c), 2), -np.inf)
    for kind, share in kinds(settings, standing):
        factor = {"wild": settings.wild_factor, "near": settings.near_m / settings.apart_m}.get(kind, 1.0)
        wide = covariance + factor**2 * apart
        if kind not in ("still", "near"):
            rates = np.concatenate([different_m(fit.half_s, settings, kind) for fit in fits], axis=1)
            rates[:, [0, p]] = 0.0
            wide = wide + rates[:, :, None] ** 2 * np.eye(2 * p)
        told = np.stack([gaussian(c[:, :p], wide[:, :p, :p]), gaussian(c, wide)], axis=1)
        found = np.logaddexp(found, told + np.log(share)[:, None])
    return found


def typical_height(found: Terms) -> float:
    """Median height, m, at which the tracks meet that meet well; 0 where none does."""
    p = found.coefficient.shape[1] // 2
    same = gaussian(found.coefficient[:, :p], found.covariance[:, :p, :p]) - found.other[:, 0]
    good = same > max(0.0, float(np.quantile(same, 0.7))) if len(same) else np.zeros(0, bool)
    return float(np.median(found.coefficient[good, p])) if good.any() else 0.0


def gaussian(value: Floats, covariance: Floats) -> Floats:
    """Log density (...) of values (..., k), without the constant."""
    solved = np.linalg.solve(covariance, value[..., None])[..., 0]
    return np.asarray(-0.5 * (np.sum(value * solved, axis=-1) + np.linalg.slogdet(covariance)[1]))
