"""Stage 2: a video and first boxes become an ImageTrack for each target."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from calibration.arrays import Floats
from pipeline.errors import TrackingError, UsageError
from pipeline.records import LOST, REACQUIRED, TRACKED, Box, ImageTrack
from pipeline.tracking.background import advance, first_background
from pipeline.tracking.follow import Fix, Followed, Scene, begin, follow
from pipeline.tracking.records import VideoTracks
from pipeline.tracking.settings import TrackingSettings
from pipeline.tracking.video import Frame, frames_of, video_head

LEAST_BOX_PX, LEAST_FIXES = 4.0, 3
Progress = Callable[[int, int], None]


def track_video(
    path: Path,
    *,
    camera: str,
    boxes: Mapping[str, Box],
    settings: TrackingSettings | None = None,
    progress: Progress | None = None,
) -> VideoTracks:
    """Follows every target of `boxes` through one video, which is decoded once.

    A fix is where the point of the target lies that was under the first box's centre, in image coordinates
    (pixel (0, 0) is the centre of the top-left pixel), with its sigma per axis. The result depends on the arguments
    alone, not on the machine's load.

    camera    its name, for the tracks and for messages
    progress  called with (frames done, frames the container claims)
    Raises InputFileError (no video, nothing decodes), UsageError (a box that cannot be), TrackingError (a target with
    practically no fix).
    """
    settings = settings or TrackingSettings()
    head = video_head(path)
    for name, box in boxes.items():
        _check_box(box, f"targets.{name}.boxes.{camera}", head.image_size)
    with _one_thread():
        fixes, times, size, notes = _followed(path, boxes, settings, progress, head.frames)
    for name, box in boxes.items():
        _check_frame(box, f"targets.{name}.boxes.{camera}", len(times), path)
    tracks = tuple(_track(camera, name, box, fixes[name], times) for name, box in boxes.items())
    for track in tracks:
        _check_followed(track, path)
    return VideoTracks(
        tracks=tracks,
        frame_time_s=times,
        frame_rate=head.frame_rate,
        image_size=size,
        outlines_px=tuple(_outlines(box, fixes[name], len(times)) for name, box in boxes.items()),
        notes=(*notes, *_losses(tracks), *_gaps(times, head.frame_rate, head.frames)),
    )


def _followed(
    path: Path, boxes: Mapping[str, Box], settings: TrackingSettings, progress: Progress | None, claimed: int
) -> tuple[dict[str, list[Fix]], Floats, tuple[int, int], list[str]]:
    """The loop over the frames: fixes by target, times of all frames, image size, notes."""
    fixes: dict[str, list[Fix]] = {name: [] for name in boxes}
    targets: dict[str, Followed] = {}
    times: list[float] = []
    notes: list[str] = []
    background, size = None, (0, 0)
    for frame in frames_of(path):
        if not times:
            size = frame.pixels.shape[1], frame.pixels.shape[0]
        elif (frame.pixels.shape[1], frame.pixels.shape[0]) != size:
            notes.append(_size_note(frame, size))
            break
        if background is None:
            background, motion = first_background(frame.pixels), np.eye(3)
        else:
            background, motion = advance(background, frame.pixels)
        dt_s = frame.time_s - times[-1] if times else 0.0
        scene = Scene(dt_s=dt_s, cur_from_prev=motion, keys=background.keys)
        for name, box in boxes.items():
            if frame.index == box.frame:
                targets[name], first = begin(frame.pixels, box, settings)
                fixes[name].append(first)
            elif name in targets:
                targets[name], new = follow(targets[name], frame.pixels, frame.index, scene, settings)
                fixes[name] += new
        times.append(frame.time_s)
        if progress is not None:
            progress(len(times), max(claimed, len(times)))
    return fixes, np.asarray(times), size, notes


def _track(camera: str, target: str, box: Box, fixes: list[Fix], times: Floats) -> ImageTrack:
    """A row for each frame from the box on."""
    n = len(times) - box.frame
    xy, sigma, state = np.full((n, 2), np.nan), np.full(n, np.nan), np.full(n, LOST)
    for fix in fixes:
        row = fix.frame - box.frame
        xy[row], sigma[row] = fix.xy_px, fix.sigma_px
        state[row] = REACQUIRED if row and state[row - 1] == LOST else TRACKED
    frame = np.arange(box.frame, len(times))
    return ImageTrack(
        camera=camera, target=target, frame=frame, time_s=times[box.frame :], xy_px=xy, sigma_px=sigma, state=state
    )


def _outlines(box: Box, fixes: list[Fix], frames: int) -> Floats:
    """Corners (n, 4, 2) of the box as it was carried along."""
    corner = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.array([box.width, box.height]) / 2
    outlines = np.full((frames - box.frame, 4, 2), np.nan)
    for fix in fixes:
        outlines[fix.frame - box.frame] = corner @ fix.linear.T + np.array(fix.xy_px)
    return outlines


@contextmanager
def _one_thread() -> Iterator[None]:
    """OpenCV on this thread only: the pieces here are too small to share, and cameras run side by side."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)


def _check_box(box: Box, key: str, image_size: tuple[int, int]) -> None:
    width, height = image_size
    seen = f"box [{box.x:g}, {box.y:g}, {box.width:g}, {box.height:g}]"
    if not min(box.width, box.height) >= LEAST_BOX_PX:
        raise UsageError(
            where=key,
            seen=seen,
            expected=f"a box of at least {LEAST_BOX_PX:g} x {LEAST_BOX_PX:g} pixels",
            advice="draw it around the whole target: x, y of the top-left corner, then width, height",
        )
    if not (box.x >= 0 and box.y >= 0 and box.x + box.width <= width and box.y + box.height <= height):
        raise UsageError(
            where=key,
            seen=seen,
            expected=f"a box inside the image of {width} x {height} pixels",
            advice="x, y of the top-left corner, then width, height; choose a frame in which all of the target is seen",
        )
    if box.frame < 0:
        raise UsageError(
            where=key, seen=f"frame {box.frame}", expected="0 or more", advice="frames count from 0, the first"
        )


def _check_frame(box: Box, key: str, frames: int, path: Path) -> None:
    if box.frame >= frames:
        raise UsageError(
            where=key,
            seen=f"frame {box.frame}",
            expected=f"a frame of {path}, 0 to {frames - 1}",
            advice="frames count from 0; draw the box on a frame that the video has",
        )


def _check_followed(track: ImageTrack, path: Path) -> None:
    fixes, frames = int(track.seen.sum()), len(track.frame)
    if fixes < min(LEAST_FIXES, frames):
        raise TrackingError(
            where=f"{path}: target {track.target} (targets.{track.target}.boxes.{track.camera})",
            seen=f"lost right after its box on frame {track.frame[0]}, and never found again in {frames} frames",
            expected="a target that can be told from what is behind it",
            advice="draw the box closely around the target, on a frame in which it is large and sharp",
        )


def _losses(tracks: tuple[ImageTrack, ...]) -> Iterator[str]:
    for track in tracks:
        seen = np.flatnonzero(track.seen)
        last, end = int(track.frame[seen[-1]]), int(track.frame[-1])
        if last < end:
            yield (
                f"{track.camera}: {track.target} was last seen on frame {last} ({track.time_s[seen[-1]]:.2f} s) and "
                f"not found again in the remaining {end - last} frames"
            )


def _gaps(times: Floats, rate: float, claimed: int) -> Iterator[str]:
    """Broken or missing frames, as far as times and the container's claim betray them."""
    steps = np.diff(times)
    if len(steps) and steps.max() > 1.5 * np.median(steps):
        wide = np.flatnonzero(steps > 1.5 * np.median(steps))
        if len(wide) <= max(3, len(steps) // 20):
            where = ", ".join(str(int(i) + 1) for i in wide[:5])
            yield f"gaps in the video's times before frames {where}{' ...' if len(wide) > 5 else ''}"
    if len(times) < claimed - max(2, claimed // 50):
        yield f"the container claims {claimed} frames; {len(times)} could be decoded: the video is cut off or broken"


def _size_note(frame: Frame, size: tuple[int, int]) -> str:
    height, width = frame.pixels.shape[:2]
    return (
        f"frame {frame.index} is {width} x {height} instead of {size[0]} x {size[1]}: tracking ends there, the "
        "camera's calibration would not hold"
    )
