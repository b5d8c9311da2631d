"""Offsets of all cameras together that are worth a closer look: sums of the curves of their pairs, best first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.matching.sampling import Sampled
from pipeline.matching.settings import MatchSettings
from pipeline.matching.sweep import Curve, sweep
from pipeline.records import CameraInput

KEPT, EACH = 14, 8
"""Hypotheses that are carried on, and offsets of one camera that extend each."""
APART = 5
"""Steps between two offsets that count as two."""


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """Offsets (seconds) by camera; None where nothing ties it. `score`: rough, `ground_m`: guess of its height."""

    offset_s: Mapping[str, float | None]
    score: float
    ground_m: float


def offset_range(camera: CameraInput, is_reference: bool, settings: MatchSettings) -> tuple[float, float]:
    """Where a camera's offset is looked for, relative to the reference camera's clock."""
    if is_reference:
        return 0.0, 0.0
    if camera.offset_s is None:
        return -settings.search_s, settings.search_s
    reach = settings.search_s if camera.sigma.offset_s is None else 5 * camera.sigma.offset_s + settings.step_s
    return camera.offset_s - reach, camera.offset_s + reach


def curves(
    views: Sequence[Sampled], ranges: Sequence[tuple[float, float]], settings: MatchSettings
) -> dict[tuple[int, int], Curve]:
    """The curve of every pair of cameras."""
    found = {}
    for a in range(len(views)):
        for b in range(a + 1, len(views)):
            low, high = ranges[b][0] - ranges[a][1], ranges[b][1] - ranges[a][0]
            first, last = views[a].span_s, views[b].span_s
            low, high = max(low, first[0] - last[1]), min(high, first[1] - last[0])
            if low <= high:
                found[a, b] = sweep(views[a], views[b], low, high, settings)
    return found


def hypotheses(
    views: Sequence[Sampled],
    ranges: Sequence[tuple[float, float]],
    found: Mapping[tuple[int, int], Curve],
    settings: MatchSettings,
) -> list[Hypothesis]:
    """The best joint offsets, best first; at least one."""
    step = views[0].step_s
    both = {**found, **{(b, a): _turned(curve) for (a, b), curve in found.items()}}
    strongest = max(found, key=lambda pair: found[pair].score.max(initial=0.0), default=None)
    if strongest is None:
        return [_told(views, {0: 0}, 0.0, np.nan, step)]
    beam: list[tuple[dict[int, int], float, float]] = [({strongest[0]: 0}, 0.0, np.nan)]
    left = [c for c in range(len(views)) if c != strongest[0]]
    while left:
        best = max(left, key=lambda c: _most(both, beam[0][0], c))
        left.remove(best)
        grown = [child for one in beam for child in _extended(one, best, both, ranges, step)]
        beam = sorted(grown, key=lambda one: -one[1])[:KEPT] or beam
    return [_told(views, shifts, score, ground, step) for shifts, score, ground in beam]


def _turned(curve: Curve) -> Curve:
    return Curve(shift=-curve.shift[::-1], score=curve.score[::-1], ground_m=curve.ground_m[::-1])


def _most(both: Mapping[tuple[int, int], Curve], have: Mapping[int, int], camera: int) -> float:
    return max((both[c, camera].score.max(initial=0.0) for c in have if (c, camera) in both), default=-1.0)


def _extended(
    one: tuple[dict[int, int], float, float],
    camera: int,
    both: Mapping[tuple[int, int], Curve],
    ranges: Sequence[tuple[float, float]],
    step: float,
) -> list[tuple[dict[int, int], float, float]]:
    """A hypothesis with one camera more, at each of its best offsets."""
    shifts, score, ground = one
    tied = [(c, both[c, camera]) for c in shifts if (c, camera) in both and len(both[c, camera].shift)]
    if not tied:
        return [one]
    low = min(shifts[c] + int(curve.shift[0]) for c, curve in tied)
    high = max(shifts[c] + int(curve.shift[-1]) for c, curve in tied)
    total, level, most = np.zeros(high - low + 1), np.full(high - low + 1, np.nan), np.zeros(high - low + 1)
    allowed = np.ones(len(total), bool)
    steps = low + np.arange(len(total))
    for c in shifts:
        least, largest = ranges[camera][0] - ranges[c][1], ranges[camera][1] - ranges[c][0]
        allowed &= (steps - shifts[c] >= np.floor(least / step)) & (steps - shifts[c] <= np.ceil(largest / step))
    for c, curve in tied:
        rows = curve.shift + shifts[c] - low
        total[rows] += curve.score
        better = curve.score > most[rows]
        level[rows] = np.where(better, curve.ground_m, level[rows])
        most[rows] = np.maximum(most[rows], curve.score)
    total = np.where(allowed, total, -1.0)
    return [
        ({**shifts, camera: int(steps[k])}, score + float(total[k]), ground if np.isfinite(ground) else float(level[k]))
        for k in _peaks(total)
    ]


def _peaks(total: Floats) -> Ints:
    """The highest places that are apart from each other."""
    order = np.argsort(-total, kind="stable")
    chosen: list[int] = []
    for k in order:
        if total[k] < 0 or len(chosen) == EACH:
            break
        if all(abs(k - other) >= APART for other in chosen):
            chosen.append(int(k))
    return np.array(chosen, int)


def _told(views: Sequence[Sampled], shifts: Mapping[int, int], score: float, ground: float, step: float) -> Hypothesis:
    """Offsets relative to the first camera, where that is tied, else to whichever is."""
    origin = shifts.get(0, next(iter(shifts.values())))
    return Hypothesis(
        offset_s={view.camera: (shifts[c] - origin) * step if c in shifts else None for c, view in enumerate(views)},
        score=score,
        ground_m=ground,
    )
