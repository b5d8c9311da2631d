"""When a video began, on its log's clock: the camera's turning as the picture shows it against the log's.

    seen_i = a * turned_i(tau) + rho(t_i) * shifted_i(tau) + b + noise

per pair of frames i: `turned` is the log's rotation of the camera between the two moments, moved by tau; `shifted` is
what the camera's own movement looks like over ground at distance 1 / rho, with a rho of its own for the spin, which the
ground's slope in the picture makes; a < 1 allows for noise in the log (regression dilution), b for slow drifts.

tau is first searched over the whole log with the partial correlation r(tau) of seen and turned, shifted taken out of
both, by FFT; then refined with the video's clock rate, which has a prior, by Gauss-Newton. Evidence is
n / 2 * -log(1 - r^2) with n the number of independent samples (Bartlett, from the autocorrelations of both). The sigma
comes from the autocovariance of what is left, for log noise has a memory.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Bools, Floats, frozen, settle

GRID_S = 0.02
SMOOTH_S = 0.08
SLOW_S = 12.0
"""What changes more slowly is not matched: drifts, and the ground's distance."""
LEAST_OVERLAP = 0.75
"""Of the video inside the log."""
EVIDENCE = 8.0
"""Odds of exp(8), 3000 to 1, that a match is no chance, and that it is not the runner-up."""
APART_S = 0.5
RATE_SIGMA = 5e-4
KNOT_S = 12.0
FLOOR_S = 0.002
MEMORY_S = 1.0
MOST_CANDIDATES = 5


@dataclass(frozen=True, kw_only=True, eq=False)
class LogTurning:
    """The camera by its log, every GRID_S.

    begin_s    log time of the first sample
    rate_radps (k, 3) turn rate in camera axes (of cur_from_prev), NaN where the log has none
    shift_mps  (k, 3) the turn rate that the camera's velocity looks like over ground 1 m away
    """

    begin_s: float
    rate_radps: Floats
    shift_mps: Floats

    def __post_init__(self) -> None:
        k = len(self.rate_radps)
        settle(
            self,
            rate_radps=frozen(self.rate_radps, (k, 3), "rate_radps"),
            shift_mps=frozen(self.shift_mps, (k, 3), "shift_mps"),
        )


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One possible start: log time of frame 0, one sigma, correlation, and evidence (log of odds against chance)."""

    start_s: float
    sigma_s: float
    correlation: float
    evidence: float


@dataclass(frozen=True, kw_only=True)
class Match:
    """What matching found.

    candidates   best first; those that cannot be told apart from the best
    needed       evidence that a match needs: EVIDENCE, and more the more starts were tried
    turning_deg  root mean square of the turn rate that was seen, degrees per second
    """

    candidates: tuple[Candidate, ...]
    needed: float
    turning_deg: float

    @property
    def certain(self) -> bool:
        """Whether there is one start, beyond chance."""
        return len(self.candidates) == 1 and self.candidates[0].evidence >= self.needed


def match_turns(frame_time_s: Floats, turn_rad: Floats, log: LogTurning) -> Match:
    """Candidates for the log time of frame 0, from turns (n, 3) between frames at video times (n + 1,).

    No candidate where the video has too little to match or is longer than the log.
    """
    seen = _seen_rates(frame_time_s, turn_rad)
    known = np.asarray(np.isfinite(seen).all(axis=1))
    have = np.asarray(np.isfinite(log.rate_radps).all(axis=1) & np.isfinite(log.shift_mps).all(axis=1))
    turning = float(np.degrees(np.sqrt(np.nanmean(seen**2) * 3))) if known.any() else 0.0
    nothing = Match(candidates=(), needed=EVIDENCE, turning_deg=turning)
    if known.sum() * GRID_S < 2.0 or have.sum() < LEAST_OVERLAP * known.sum():
        return nothing
    lag, r, independent = _correlation(seen, known, log, have)
    if not len(lag):
        return nothing
    evidence = np.where(r > 0, -0.5 * independent * np.log1p(-(np.minimum(r, 0.9999) ** 2)), 0.0)
    tried = len(lag) * GRID_S / (2 * SMOOTH_S)
    peaks = _peaks(evidence, tried)
    found = [_refined(frame_time_s, turn_rad, log, lag[p] * GRID_S, float(r[p]), float(evidence[p])) for p in peaks]
    return Match(
        candidates=_distinct([c for c in found if c is not None]),
        needed=EVIDENCE + float(np.log(max(tried, 1.0))),
        turning_deg=turning,
    )


def _seen_rates(frame_time_s: Floats, turn_rad: Floats) -> Floats:
    """Turn rates (m, 3) on a grid from frame 0: what cumulated between its points, NaN next to unknown turns."""
    time = frame_time_s - frame_time_s[0]
    good = np.asarray(np.isfinite(turn_rad).all(axis=1))
    whole = np.concatenate([np.zeros((1, 3)), np.cumsum(np.where(good[:, None], turn_rad, 0.0), axis=0)])
    grid = np.arange(0.0, time[-1] + 1e-9, GRID_S)
    at = np.stack([np.interp(grid, time, column) for column in whole.T], axis=1)
    unknown = np.interp(grid, time, np.concatenate([[0.0], np.cumsum(~good)]))
    rate = np.diff(at, axis=0) / GRID_S
    rate[np.diff(unknown) > 0] = np.nan
    return rate


# --- the search ----------------------------------------------------------------------------------------------------


def _correlation(seen: Floats, known: Bools, log: LogTurning, have: Bools) -> tuple[Floats, Floats, Floats]:
    """Lags (grid steps of the video's frame 0 in the log), partial correlations and independent samples at each."""
    x = _banded(seen, known)
    w, u = _banded(log.rate_radps, have), _banded(log.shift_mps, have)
    size = len(x) + len(w) - 1
    mask, there = known.astype(float)[:, None], have.astype(float)[:, None]
    xx, xw, ww = (_cross(a, b, size) for a, b in ((x**2, there), (x, w), (mask, w**2)))
    for axes in ([0, 1], [2]):  # each with a ground distance of its own, so what it explains is taken out of each
        pairs = ((x, u), (mask * np.ones(3), w * u), (mask * np.ones(3), u**2))
        xu, wu, uu = (_cross(a[:, axes], b[:, axes], size) for a, b in pairs)
        tiny = 1e-6 * float(np.max(uu)) + 1e-30
        out = np.where(uu > tiny, 1.0 / np.maximum(uu, tiny), 0.0)
        xx, xw, ww = xx - xu**2 * out, xw - xu * wu * out, ww - wu**2 * out
    common = _cross(mask, there, size)
    lag = np.arange(size) - (len(x) - 1)
    r = xw / np.sqrt(np.maximum(xx, 1e-300) * np.maximum(ww, 1e-300))
    usable = common >= LEAST_OVERLAP * known.sum()
    independent = 3.0 * common / _memory(x, known, w, have)
    return lag[usable], np.clip(r[usable], -1, 1), independent[usable]


def _banded(rate: Floats, known: Bools) -> Floats:
    """Rates (n, 3) without what is slow and what is too quick to be matched; zero where unknown."""
    from scipy.ndimage import gaussian_filter1d  # slow to import

    value, weight = np.where(known[:, None], rate, 0.0), known.astype(float)[:, None]

    def smooth(sigma_s: float) -> Floats:
        part = [gaussian_filter1d(a, sigma_s / GRID_S, axis=0, mode="nearest") for a in (value, weight)]
        return np.asarray(part[0] / np.maximum(part[1], 1e-9))

    return np.where(known[:, None], smooth(SMOOTH_S) - smooth(SLOW_S / 4), 0.0)


def _cross(short: Floats, long: Floats, size: int) -> Floats:
    """sum_ij short[i, j] long[i + lag, j] for every lag from -(len(short) - 1) on; one column serves for all."""
    n = 1 << (size - 1).bit_length()
    product = np.fft.irfft((np.fft.rfft(long, n, axis=0) * np.conj(np.fft.rfft(short, n, axis=0))).sum(axis=1), n)
    first = len(short) - 1
    return np.concatenate([product[n - first :], product[: size - first]]) if first else product[:size]


def _memory(x: Floats, known: Bools, w: Floats, have: Bools) -> float:
    """Grid samples that one independent sample takes (Bartlett): sum over lags of both autocorrelations' product."""
    reach = min(int(4.0 / GRID_S), len(x) - 1, len(w) - 1)
    both = [_autocorrelation(a, reach) for a in (x, w)]
    return float(max(1.0, 1.0 + 2.0 * np.sum(both[0][1:] * both[1][1:])))


def _autocorrelation(a: Floats, reach: int) -> Floats:
    n = 1 << (2 * len(a)).bit_length()
    power = (np.abs(np.fft.rfft(a, n, axis=0)) ** 2).sum(axis=1)
    whole = np.fft.irfft(power, n)[: reach + 1]
    return np.asarray(whole / max(whole[0], 1e-300))


def _peaks(evidence: Floats, tried: float) -> list[int]:
    """Places of local maxima APART_S from better ones, best first: those that odds do not rule out."""
    left, apart = evidence.copy(), int(APART_S / GRID_S)
    found: list[int] = []
    while len(found) < MOST_CANDIDATES:
        best = int(left.argmax())
        if left[best] <= 0 or (found and left[best] < evidence[found[0]] - EVIDENCE):
            break
        found.append(best)
        left[max(0, best - apart) : best + apart + 1] = 0.0
    return found


def _distinct(found: list[Candidate]) -> tuple[Candidate, ...]:
    """Best first, without those that ended at a better one's start."""
    kept: list[Candidate] = []
    for one in sorted(found, key=lambda c: -c.evidence):
        if all(abs(one.start_s - other.start_s) > APART_S / 2 for other in kept):
            kept.append(one)
    return tuple(kept)


# --- refinement ----------------------------------------------------------------------------------------------------


def _refined(
    frame_time_s: Floats, turn_rad: Floats, log: LogTurning, lag_s: float, r: float, evidence: float
) -> Candidate | None:
    """The start near `lag_s` (from the log's begin) by least squares on the pairs of frames themselves."""
    video = frame_time_s - frame_time_s[0]
    turned, shifted = _cumulated(log.rate_radps), _cumulated(log.shift_mps)
    stamps = np.asarray(np.arange(len(turned)) * GRID_S, float)
    middle = video[-1] / 2
    start, stretch, steps = lag_s, 0.0, []
    for _ in range(8):
        time = start + video + stretch * (video - middle)
        use = np.isfinite(turn_rad).all(axis=1) & (time[:-1] >= 2 * GRID_S) & (time[1:] <= stamps[-1] - 2 * GRID_S)
        use &= _alike(stamps, log, time)
        if use.sum() < 30:
            return None
        w, u = _between(stamps, turned, time), _between(stamps, shifted, time)
        slope = (_between(stamps, turned, time + GRID_S) - _between(stamps, turned, time - GRID_S)) / (2 * GRID_S)
        step, fit = _step(turn_rad[use], w[use], u[use], slope[use], video[:-1][use], middle, stretch)
        start, stretch = start + float(np.clip(step[0], -0.1, 0.1)), stretch + float(step[1])
        steps.append(abs(float(step[0])))
        if steps[-1] < 1e-5:
            break
    sigma = np.sqrt(fit[0, 0] - middle * 2 * fit[0, 1] + middle**2 * fit[1, 1])
    return Candidate(
        start_s=log.begin_s + start - stretch * middle,
        sigma_s=float(np.hypot(sigma, FLOOR_S)),
        correlation=r,
        evidence=evidence,
    )


def _cumulated(rate: Floats) -> Floats:
    return np.concatenate([np.zeros((1, 3)), np.cumsum(np.nan_to_num(rate) * GRID_S, axis=0)])


def _between(stamps: Floats, whole: Floats, time: Floats) -> Floats:
    return np.asarray(np.diff(np.stack([np.interp(time, stamps, column) for column in whole.T], axis=1), axis=0))


def _alike(stamps: Floats, log: LogTurning, time: Floats) -> Bools:
    """Pairs of frames between which the log has no gap."""
    lost = ~(np.isfinite(log.rate_radps).all(axis=1) & np.isfinite(log.shift_mps).all(axis=1))
    count = np.concatenate([[0.0], np.cumsum(lost)])
    return np.asarray(np.diff(np.interp(time, stamps, count)) <= 0)


def _step(
    seen: Floats, w: Floats, u: Floats, slope: Floats, time_s: Floats, middle_s: float, stretch: float
) -> tuple[Floats, Floats]:
    """One Gauss-Newton step of (start, stretch), and their covariance (2, 2) with the memory of what is left."""
    n = len(seen)
    other = _nuisances(w, u, time_s)
    y = seen.T.ravel()
    size = float(np.clip((w * seen).sum() / max((w * w).sum(), 1e-300), 0.2, 1.0))
    g = size * np.stack([slope.T.ravel(), (slope * (time_s - middle_s)[:, None]).T.ravel()], axis=1)
    weight = np.ones(3 * n)
    for _ in range(4):
        root = np.sqrt(weight)[:, None]
        basis, _ = np.linalg.qr(root * other)
        free = root * g - basis @ (basis.T @ (root * g))
        left = root[:, 0] * y - basis @ (basis.T @ (root[:, 0] * y))
        noise = float(np.mean(left**2))
        prior = np.diag([0.0, noise / RATE_SIGMA**2])
        normal = free.T @ free + prior
        step = np.linalg.solve(normal, free.T @ left - prior @ np.array([0.0, stretch]))
        rest = y - other @ np.linalg.lstsq(root * other, root[:, 0] * (y - g @ step), rcond=None)[0] - g @ step
        weight = _weights(rest, n)
    inverse = np.linalg.inv(free.T @ (root * _own_slope(seen, time_s, middle_s)) + prior)
    dt = float(np.median(np.diff(time_s))) if n > 1 else GRID_S
    meat = _long_run(free * (root[:, 0] * rest)[:, None], n, round(MEMORY_S / dt)) + noise * prior
    return step, inverse @ meat @ inverse.T


def _own_slope(seen: Floats, time_s: Floats, middle_s: float) -> Floats:
    """What a step changes (3 n, 2), by the picture's own slope: noise in the log's makes the match look sharper."""
    from scipy.ndimage import gaussian_filter1d  # slow to import

    dt = float(np.median(np.diff(time_s)))
    slope = np.gradient(gaussian_filter1d(seen, SMOOTH_S / dt, axis=0), dt, axis=0)
    return np.stack([slope.T.ravel(), (slope * (time_s - middle_s)[:, None]).T.ravel()], axis=1)


def _weights(rest: Floats, n: int) -> Floats:
    """Weights (3 n,): by each axis' own scatter, as Huber's loss gives them."""
    axes = np.abs(rest.reshape(3, n))
    scale = 1.4826 * np.median(axes, axis=1, keepdims=True) + 1e-12
    return np.asarray((np.minimum(1.0, 2.0 * scale / np.maximum(axes, 1e-12)) / scale**2).ravel())


def _nuisances(w: Floats, u: Floats, time_s: Floats) -> Floats:
    """Columns (3 n, k): the log's turning itself, the ground's distance in hats of KNOT_S, a drift of each axis."""
    n = len(w)
    knots = max(1, round(float(time_s[-1] - time_s[0]) / KNOT_S)) + 1
    place = (time_s - time_s[0]) / max(float(time_s[-1] - time_s[0]), 1e-9) * (knots - 1)
    hats = np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(knots)))
    sides = np.array([1.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    columns = [w.T.ravel(), *((u * side * hat[:, None]).T.ravel() for hat in hats.T for side in sides)]
    for axis in range(3):
        for hat in hats.T:
            column = np.zeros((3, n))
            column[axis] = hat
            columns.append(column.ravel())
    return np.stack(columns, axis=1)


def _long_run(score: Floats, n: int, reach: int) -> Floats:
    """Covariance (2, 2) of the sum of scores (3 n, 2) whose neighbours in time go together (Newey-West)."""
    total = np.zeros((2, 2))
    for axis in score.reshape(3, n, 2):
        total += axis.T @ axis
        for lag in range(1, min(reach, n - 1) + 1):
            cross = axis[lag:].T @ axis[:-lag]
            total += (1 - lag / (reach + 1)) * (cross + cross.T)
    return total
