"""What the boxes show: whether a box stands out where it is, or in another camera's video; whether names are exchanged.

stands out  median over the box's inside of the distance to its surroundings' median colour (CIELAB), in their spread
exchanged   with a and b the colours of the same targets in two cameras, each less its mean over the targets (cameras
            differ in exposure and white balance), |a_i - b_k| and |a_k - b_i| are small where |a_i - b_i| + |a_k - b_k|
            is large
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import cv2
import numpy as np

from calibration.foundation.arrays import Floats
from calibration.foundation.capture import Capture
from calibration.foundation.errors import RunningFixError
from pipeline.flight import CameraSettings, Flight
from pipeline.records import Box
from pipeline.stages.checks.doubt import Doubt
from pipeline.stages.inputs.frames import video_index
from pipeline.stages.inputs.single_frames import Pixels, affordable, frames_of

DECODED_PX = 60e6
"""Of each video: 200 frames of VGA size, seven of 4K, which take some tenths of a second."""
INSIDE, BESIDE, AROUND = 0.6, 1.2, 2.0
"""Of a box's width and height: what counts as its inside, and its surroundings from there to there."""
LEAST_PX = 4
"""Pixels of an inside that say something."""
DULL, CLEAR = 1.5, 4.0
"""What stands out by less is like its surroundings, by more is a thing. Grass and asphalt reach 1 in themselves."""
UNLIKE, ALIKE = 25.0, 12.0
"""Colours (CIELAB) that differ by more are different paints, by less one paint in two lights."""
Frames = Mapping[str, Mapping[int, Pixels]]


def look_doubts(flight: Flight) -> list[Doubt]:
    """Doubts about the boxes of a flight from the pictures in them; nothing of videos that cannot be read."""
    boxes = {
        (camera, target.name): box for target in flight.targets for camera, box in target.boxes.items()
    }  # fmt: skip
    shown: dict[str, dict[int, Pixels]] = {}
    for camera in flight.cameras:
        if camera.video is not None and len({c for c, _ in boxes}) > 1:
            shown[camera.name] = _shown(camera, sorted({box.frame for box in boxes.values()}))
    return [*_of_another_video(flight, boxes, shown), *_exchanged(flight, boxes, shown)]


def _shown(camera: CameraSettings, frames: Sequence[int]) -> dict[int, Pixels]:
    """The frames that can be had for `DECODED_PX`, CIELAB."""
    assert camera.video is not None
    try:
        times, index = video_index(camera)
        chosen, _ = affordable(frames, index, int(DECODED_PX // (times.image_size[0] * times.image_size[1])))
        capture = Capture(camera.video, stream=camera.video_stream)
        try:
            return {n: _lab(pixels) for n, pixels in frames_of(capture, sorted(chosen), index)}
        finally:
            capture.close()
    except RunningFixError:
        return {}


def _lab(pixels: Pixels) -> Pixels:
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2LAB))


def _cut(shown: Pixels, box: Box, share: float) -> tuple[slice, slice]:
    middle = box.centre_px
    height, width = shown.shape[:2]
    x, y = (
        (c + 0.5 - 0.5 * share * s, c + 0.5 + 0.5 * share * s)
        for c, s in zip(middle, (box.width, box.height), strict=True)
    )
    return (
        slice(max(0, round(float(y[0]))), min(height, round(float(y[1])))),
        slice(max(0, round(float(x[0]))), min(width, round(float(x[1])))),
    )  # fmt: skip


def _inside(shown: Pixels, box: Box) -> Floats:
    """(n, 3) L, a, b of the box's inside; none where it is outside the picture."""
    return _cielab(shown[_cut(shown, box, INSIDE)])


def _cielab(part: Pixels) -> Floats:
    """(n, 3) L, a, b of pixels (..., 3) as OpenCV stores them, L in 0 to 255."""
    return np.asarray(part.reshape(-1, 3) * np.array([100 / 255, 1, 1]))


def standing_out(shown: Pixels, box: Box) -> float:
    """By how many spreads of its surroundings the box's inside differs from them; nan where too little is seen."""
    inside, around = _inside(shown, box), _cut(shown, box, AROUND)
    beside = np.ones(shown.shape[:2], dtype=bool)
    beside[_cut(shown, box, BESIDE)] = False
    ring = _cielab(shown[around][beside[around]])
    if len(inside) < LEAST_PX or len(ring) < LEAST_PX:
        return float("nan")
    usual = np.median(ring, axis=0)
    spread = 1.4826 * np.median(np.abs(ring - usual), axis=0) + 1.0
    return float(np.median(np.sqrt((((inside - usual) / spread) ** 2).mean(axis=1))))


def _of_another_video(flight: Flight, boxes: Mapping[tuple[str, str], Box], shown: Frames) -> list[Doubt]:
    """Boxes in which nothing is, where another camera's video has something at that place and frame."""
    found: dict[tuple[str, str], list[str]] = {}
    for (camera, target), box in boxes.items():
        own = shown.get(camera, {}).get(box.frame)
        if own is None or not standing_out(own, box) < DULL:
            continue
        for other, frames in shown.items():
            there = frames.get(box.frame)
            if other != camera and there is not None and standing_out(there, box) > CLEAR:
                found.setdefault((camera, other), []).append(target)
    return [
        Doubt(
            kind="box-of-another-video",
            subject=(camera, *targets),
            where=f"{flight.path}: targets.{targets[0]}.boxes.{camera}",
            seen=f"nothing that stands out in the boxes of {', '.join(targets)}, but something at that place of the "
            f"video of {other}",
            expected=f"boxes drawn in the video of {camera}",
            advice=f"look with `runningfix label`; are they boxes of {other}?",
        )
        for (camera, other), targets in found.items()
    ]


def _exchanged(flight: Flight, boxes: Mapping[tuple[str, str], Box], shown: Frames) -> list[Doubt]:
    """Targets whose colours in two cameras fit better under each other's names."""
    found = []
    for one, other in combinations(shown, 2):
        names = [
            t.name for t in flight.targets
            if all((c, t.name) in boxes and boxes[c, t.name].frame in shown[c] for c in (one, other))
        ]  # fmt: skip
        if len(names) < 2:
            continue
        a, b = (np.array([_colour(shown[c], boxes[c, name]) for name in names]) for c in (one, other))
        if not (np.isfinite(a).all() and np.isfinite(b).all()):
            continue
        apart = np.linalg.norm((a - a.mean(axis=0))[:, None] - (b - b.mean(axis=0))[None], axis=2)
        for i, k in combinations(range(len(names)), 2):
            if apart[i, i] + apart[k, k] > 2 * UNLIKE and max(apart[i, k], apart[k, i]) < ALIKE:
                found.append(_exchange(flight, one, other, names[i], names[k]))
    return found


def _exchange(flight: Flight, one: str, other: str, first: str, second: str) -> Doubt:
    return Doubt(
        kind="targets-exchanged",
        subject=(one, other, first, second),
        where=f"{flight.path}: targets.{first}.boxes",
        seen=f"{first} and {second} have other colours in {one} than in {other}, but the same if names are exchanged",
        expected="boxes of one thing under one name",
        advice=f"look with `runningfix label`: exchange the boxes of {first} and {second} in {one} or in {other}",
    )


def _colour(frames: Mapping[int, Pixels], box: Box) -> Floats:
    inside = _inside(frames[box.frame], box)
    return np.median(inside, axis=0) if len(inside) >= LEAST_PX else np.full(3, np.nan)
