"""Which moments of the videos are worth a picture: first fixes, losses and outliers, in this order."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pipeline.records import LOST, Box, ImageTrack, Results
from pipeline.records.pictures import PictureKind
from pipeline.stages.pictures.settings import PictureSettings

Sighted = Mapping[tuple[str, str, int], int]
"""Camera, target, frame -> row of the sightings."""


@dataclass(frozen=True, kw_only=True)
class Moment:
    """One picture that is wanted, with what `Picture` says of it."""

    kind: PictureKind
    camera: str
    target: str
    frame: int
    time_s: float
    fix_px: tuple[float, float]
    predicted_px: tuple[float, float] = (math.nan, math.nan)
    box: Box | None = None
    residual_px: float = math.nan
    residual_sigma: float = math.nan
    weight: float = math.nan


def moments(
    results: Results, boxes: Mapping[tuple[str, str], tuple[Box, ...]], settings: PictureSettings
) -> tuple[Moment, ...]:
    """The pictures that are wanted, the most important first; `boxes` are those of the flight file by camera, target.

    Landmarks that are marked by hand are tracks, too.
    """
    s = results.solution.sightings
    rows = {key: i for i, key in enumerate(zip(s.camera, s.target, s.frame.tolist(), strict=True))}
    tracks = [t for t in results.tracks if t.seen.any()]
    firsts = [_moment("first", results, t, int(np.flatnonzero(t.seen)[0]), rows, boxes) for t in tracks]
    found = [*firsts, *_losses(results, tracks, rows, boxes, settings)]
    shown = {(m.camera, m.target, m.frame) for m in found if m.kind != "first"}
    outliers = list(_outliers(results, tracks, rows, boxes, settings))
    return (*found, *(m for m in outliers if (m.camera, m.target, m.frame) not in shown))


def _moment(
    kind: PictureKind,
    results: Results,
    track: ImageTrack,
    at: int,
    rows: Sighted,
    boxes: Mapping[tuple[str, str], tuple[Box, ...]],
) -> Moment:
    frame, xy = int(track.frame[at]), track.xy_px[at]
    clock = next((c for c in results.solution.clocks if c.camera == track.camera), None)
    time = float(clock.common_time_s(track.time_s[[at]])[0]) if clock is not None else math.nan
    drawn = next((b for b in boxes.get((track.camera, track.target), ()) if b.frame == frame), None)
    told: dict[str, float] = {}
    predicted = (math.nan, math.nan)
    row = rows.get((track.camera, track.target, frame))
    if row is not None:
        s = results.solution.sightings
        left = s.residual_px[row]
        predicted = (float(xy[0] - left[0]), float(xy[1] - left[1]))
        told = {
            "residual_px": float(np.hypot(*left)),
            "residual_sigma": float(s.residual_sigma[row]),
            "weight": float(s.weight[row]),
        }
    return Moment(
        kind=kind, camera=track.camera, target=track.target, frame=frame, time_s=time,
        fix_px=(float(xy[0]), float(xy[1])), predicted_px=predicted, box=drawn, **told,
    )  # fmt: skip


def _losses(
    results: Results,
    tracks: list[ImageTrack],
    rows: Sighted,
    boxes: Mapping[tuple[str, str], tuple[Box, ...]],
    settings: PictureSettings,
) -> Iterator[Moment]:
    """The longest losses of each camera, each with its last fix before and its first fix after."""
    for camera in dict.fromkeys(t.camera for t in tracks):
        gaps = [(t, *gap) for t in tracks if t.camera == camera for gap in _gaps(t)]
        gaps.sort(key=lambda g: (-(g[0].time_s[g[2]] - g[0].time_s[g[1]]), g[0].target, g[1]))
        for track, before, after in sorted(gaps[: settings.losses], key=lambda g: float(g[0].time_s[g[1]])):
            yield _moment("lost", results, track, before, rows, boxes)
            yield _moment("found", results, track, after, rows, boxes)


def _gaps(track: ImageTrack) -> Iterator[tuple[int, int]]:
    """Rows (last before, first after) of each stretch in which the track was lost between two fixes."""
    seen = np.flatnonzero(track.seen)
    for before, after in pairwise(seen.tolist()):
        if after > before + 1 and (track.state[before + 1 : after] == LOST).any():
            yield before, after


def _outliers(
    results: Results,
    tracks: list[ImageTrack],
    rows: Sighted,
    boxes: Mapping[tuple[str, str], tuple[Box, ...]],
    settings: PictureSettings,
) -> Iterator[Moment]:
    """The largest residuals of each camera, of one slide the largest only."""
    s = results.solution.sightings
    size = np.nan_to_num(s.residual_sigma)
    order = np.argsort(-size, kind="stable")
    order = order[size[order] > settings.outlier_sigmas]
    by_name = {(t.camera, t.target): t for t in tracks}
    taken: dict[str, list[Moment]] = {}
    for row in order.tolist():
        camera, target, time = s.camera[row], s.target[row], float(s.time_s[row])
        own, track = taken.setdefault(camera, []), by_name.get((camera, target))
        near = any(m.target == target and abs(m.time_s - time) < settings.apart_s for m in own)
        if track is None or near or len(own) == settings.outliers:
            continue
        at = int(np.searchsorted(track.frame, s.frame[row]))
        if at < len(track.frame) and track.frame[at] == s.frame[row]:
            own.append(_moment("outlier", results, track, at, rows, boxes))
    for own in taken.values():
        yield from own
