"""Tracks drawn on their video, to be looked at by a person.

Each target has a colour of its own: the outline of its first box as it was carried along, a cross at the tracked point
with a circle of three sigmas, and its way over the last frames. Where it is lost, a hollow cross is where it was looked
for, in a circle of one sigma of the prediction; at its last place where it was not looked for any more.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import WriteError
from pipeline.records import ImageTrack
from pipeline.tracking.records import VideoTracks
from pipeline.tracking.video.frames import Image, frames_of

Colour = tuple[int, int, int]
COLOURS: tuple[Colour, ...] = ((60, 220, 255), (90, 255, 90), (255, 160, 60), (230, 110, 255), (80, 140, 255))
LOST_COLOUR: Colour = (160, 160, 160)
TRAIL_FRAMES, SIGMAS = 50, 3.0
SHIFT = 4  # binary digits of a pixel's fraction in drawing


def overlay_frame(pixels: Image, tracks: VideoTracks, frame: int) -> Image:
    """The frame (h, w, 3) with every target of `tracks` as it is on frame number `frame`; a new image."""
    drawn = pixels.copy()
    for k, track in enumerate(tracks.tracks):
        row = frame - int(track.frame[0]) if len(track.frame) else -1
        if 0 <= row < len(track.frame):
            outline = tracks.outlines_px[k][row] if tracks.outlines_px else None
            predicted = tracks.predicted_px[k][row] if tracks.predicted_px else np.full(3, np.nan)
            _draw(drawn, track, row, outline, predicted, COLOURS[k % len(COLOURS)])
    cv2.putText(drawn, f"frame {frame}", (8, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1, cv2.LINE_AA)
    return drawn


def overlay_frames(video: Path, tracks: VideoTracks, stream: int | None = None) -> Iterator[Image]:
    """Every frame of the tracked video, drawn on."""
    for frame in frames_of(video, also_damaged=True, stream=stream):
        if frame.index >= len(tracks.frame_time_s):
            return
        yield overlay_frame(frame.pixels, tracks, frame.index)


def write_overlay(
    video: Path, tracks: VideoTracks, to: Path, progress: Callable[[int, int], None] | None = None,
    stream: int | None = None,
) -> Path:  # fmt: skip
    """Writes the drawn-on video as MPEG-4 to `to` (.mp4), whole or not at all.

    Raises InputFileError where the video cannot be read, WriteError where `to` cannot be written.
    """
    total = len(tracks.frame_time_s)
    part = _part_of(to)
    kind = cv2.VideoWriter.fourcc(*"mp4v")
    writer = cv2.VideoWriter(str(part), cv2.CAP_FFMPEG, kind, tracks.frame_rate, tracks.image_size)
    try:
        if not writer.isOpened():
            raise _unwritable(to, "the encoder cannot write there")
        for done, image in enumerate(overlay_frames(video, tracks, stream), start=1):
            writer.write(image)
            if progress is not None:
                progress(done, total)
        writer.release()
        os.replace(part, to)
    finally:
        writer.release()
        part.unlink(missing_ok=True)
    return to


def _draw(image: Image, track: ImageTrack, row: int, outline: Floats | None, predicted: Floats, colour: Colour) -> None:
    """Draws one target into `image`."""
    seen = np.flatnonzero(track.seen[: row + 1])
    if len(seen) == 0:
        return
    last = int(seen[-1])
    here = last == row
    trail = track.xy_px[max(0, row - TRAIL_FRAMES) : row + 1]
    for a, b in pairwise(trail):
        if np.isfinite(a).all() and np.isfinite(b).all():
            cv2.line(image, _fine(a), _fine(b), colour, 1, cv2.LINE_AA, SHIFT)
    x, y = track.xy_px[last]
    if here and outline is not None and np.isfinite(outline).all():
        corners = np.array([_fine(c) for c in outline], np.int32)
        cv2.polylines(image, [corners], True, colour, 1, cv2.LINE_AA, SHIFT)
    if here:
        radius = round(SIGMAS * float(track.sigma_px[row]) * (1 << SHIFT))
        cv2.circle(image, _fine(track.xy_px[row]), max(radius, 1 << SHIFT), colour, 1, cv2.LINE_AA, SHIFT)
    else:
        if np.isfinite(predicted).all():
            x, y = predicted[:2]
            radius = round(float(predicted[2]) * (1 << SHIFT))
            cv2.circle(image, _fine(predicted[:2]), radius, LOST_COLOUR, 1, cv2.LINE_AA, SHIFT)
        cv2.drawMarker(image, (round(x), round(y)), LOST_COLOUR, cv2.MARKER_TILTED_CROSS, 12, 1, cv2.LINE_AA)
    text = f"{track.target} {track.sigma_px[row]:.2f} px" if here else f"{track.target} lost"
    at = (round(x) + 14, round(y) - 10)
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour if here else LOST_COLOUR, 1, cv2.LINE_AA)


def _fine(point: Floats) -> tuple[int, int]:
    return round(float(point[0]) * (1 << SHIFT)), round(float(point[1]) * (1 << SHIFT))


def _part_of(to: Path) -> Path:
    try:
        to.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{to.stem}.", suffix=".mp4", dir=to.parent)
    except OSError as error:
        raise _unwritable(to, f"cannot be written ({error.strerror})") from None
    os.close(handle)
    os.chmod(name, 0o644)
    return Path(name)


def _unwritable(to: Path, seen: str) -> WriteError:
    return WriteError(
        where=str(to), seen=seen, expected="a writable folder with free space", advice="choose another -o folder"
    )
