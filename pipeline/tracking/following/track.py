"""Stage 2: a video and first boxes become an ImageTrack for each target."""

from __future__ import annotations

import os
from array import array
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice, repeat
from pathlib import Path

import cv2
import numpy as np

from calibration.foundation.arrays import Floats, Ints
from calibration.foundation.capture import Capture, VideoHead
from calibration.foundation.errors import RunningFixError, TrackingError, UsageError
from pipeline.records import LOST, REACQUIRED, TRACKED, Box, ImageTrack
from pipeline.tracking.following.labels import Fixes, bound
from pipeline.tracking.following.watch import Watched, begin_watch, watch
from pipeline.tracking.records import VideoTracks
from pipeline.tracking.scene.background import Scene, scenes
from pipeline.tracking.settings import TrackingSettings
from pipeline.tracking.target.track_state import Fix, TrackState
from pipeline.tracking.video.backwards import frames_back
from pipeline.tracking.video.frames import frames_of, from_first, opened_to_the_end
from pipeline.tracking.video.prefetch import prefetched

LEAST_BOX_PX, LEAST_FIXES = 4.0, 3
PART_FRAMES = 4  # handed to the targets' threads at a time
NAMED_RANGES = 5  # of frame numbers in a note
CUT_SHARE, CUT_S = 0.02, 0.5  # of a container's claimed end that its last frame may lack
Counter = Callable[[int, int], None]
Progress = Callable[[int, int], None]


def track_video(
    path: Path,
    *,
    camera: str,
    boxes: Mapping[str, Box | Sequence[Box]],
    settings: TrackingSettings | None = None,
    progress: Progress | None = None,
    stream: int | None = None,
) -> VideoTracks:
    """Follows every target of `boxes` through one video, from its box to the video's end and back to its beginning.

    Each of several boxes of a target, on different frames, begins anew; between two of them a fix is what both ways
    say, each by its nearness to its box, and what they differ by is part of its sigma.

    The video is decoded once, and once more up to the last of the boxes where one lies on a later frame than the first.

    A fix is where the point of the target lies that was under the first box's centre, in image coordinates
    (pixel (0, 0) is the centre of the top-left pixel), with its sigma per axis. The result depends on the arguments
    alone, not on the machine's load.

    camera    its name, for the tracks and for messages
    progress  called with (frames done, frames the container claims)
    stream    the number of the video stream; else the one that moves
    Raises InputFileError (no video, nothing decodes), UsageError (a box that cannot be), TrackingError (a target with
    practically no fix).
    """
    settings = settings or TrackingSettings()
    labels = {name: _in_order(given) for name, given in boxes.items()}
    capture = opened_to_the_end(path, stream)
    try:
        head = capture.head()
        for name, box in _every(labels):
            _check_box(box, f"targets.{name}.boxes.{camera}", head.image_size)
    except RunningFixError:
        capture.close()
        raise
    back = max((box.frame for _, box in _every(labels)), default=0)
    tell = None if progress is None else _counted(progress, back)
    with _one_thread(), ThreadPoolExecutor(max(1, min(len(boxes), os.cpu_count() or 1))) as pool:
        follower = _Follower(boxes=labels, settings=settings, pool=pool)
        video = _forwards(path, capture, follower, tell, head)
        for name, box in _every(labels):
            _check_frame(box, f"targets.{name}.boxes.{camera}", len(video.time_s), path)
        _backwards(path, stream, follower, video, back, tell)
    fixes = {name: follower.fixes(name) for name in boxes}
    tracks = tuple(_track(camera, name, fixes[name], video.time_s) for name in boxes)
    for track, given in zip(tracks, labels.values(), strict=True):
        _check_followed(track, given[0], path)
    return VideoTracks(
        tracks=tracks,
        frame_time_s=video.time_s,
        frame_rate=head.frame_rate,
        image_size=video.size,
        outlines_px=tuple(_outlines(given, fixes[name], len(video.time_s)) for name, given in labels.items()),
        predicted_px=tuple(follower.predicted(name, fixes[name], len(video.time_s)) for name in boxes),
        notes=(*video.notes, *_losses(tracks), *_by_box(tracks), *_gaps(video.time_s, video.claim, head)),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Video:
    """What the whole video turned out to be; `claim` is how many frames its container says it has, 0 if it does not."""

    time_s: Floats
    size: tuple[int, int]
    notes: tuple[str, ...]
    claim: int


class _Follower:
    """Every target at its present frame, and its fixes so far; targets are followed side by side in threads."""

    def __init__(
        self, *, boxes: Mapping[str, tuple[Box, ...]], settings: TrackingSettings, pool: ThreadPoolExecutor
    ) -> None:
        self.boxes, self.settings, self.pool = boxes, settings, pool
        self.way = 0  # 0 forwards, 1 backwards
        self.targets: dict[str, Watched] = {}
        self.label: dict[str, int] = {}  # the box that each target is followed from
        self.known: dict[tuple[str, int], TrackState] = {}  # every target as it was when it ceased to be new, by box
        # by way; small, however long the video
        self._rows: dict[str, tuple[array[float], array[float]]] = {n: (array("d"), array("d")) for n in boxes}
        self._taken_back: dict[str, tuple[array[int], array[int]]] = {n: (array("q"), array("q")) for n in boxes}
        self._looked: dict[str, array[float]] = {name: array("d") for name in boxes}

    def turn_round(self) -> None:
        """From here on every target starts at its box again, with what is known of it by now."""
        self.targets, self.label, self.way = {}, {}, 1

    def go_on(self, part: Sequence[Scene]) -> None:
        """Follows every target through consecutive scenes."""
        side_by_side = self.pool.map if len(self.boxes) > 1 else map
        for name, (target, new) in zip(self.boxes, side_by_side(self._through, self.boxes, repeat(part)), strict=True):
            if target is not None:
                self.targets[name] = target
            for fix in new:
                kind = float(fix.kind == "box")
                row = (fix.frame, *fix.xy_px, fix.sigma_px, *fix.linear.ravel(), kind, self._label_at(name, fix.frame))
                self._rows[name][self.way].extend(row)

    def fixes(self, name: str) -> Fixes:
        """Of one target, in order of time."""
        return bound(self._kept(name, 0), self._kept(name, 1), self.boxes[name])

    def _kept(self, name: str, way: int) -> Fixes:
        """Those of one way that were not taken back."""
        rows = np.frombuffer(self._rows[name][way], float).reshape(-1, 10)
        rows = rows[~np.isin(rows[:, 0], np.frombuffer(self._taken_back[name][way], np.int64))]
        frame, first = np.unique(rows[:, 0].astype(int), return_index=True)
        rows = rows[first]
        return Fixes(
            frame=frame, xy_px=rows[:, 1:3], sigma_px=rows[:, 3], linear=rows[:, 4:8].reshape(-1, 2, 2),
            box=rows[:, 8] > 0, label=rows[:, 9].astype(int),
        )  # fmt: skip

    def _label_at(self, name: str, frame: int) -> int:
        """Which of a target's boxes a frame is followed from, on the present way."""
        frames = [box.frame for box in self.boxes[name]]
        return bisect_right(frames, frame) - 1 if self.way == 0 else bisect_left(frames, frame)

    def predicted(self, name: str, fixes: Fixes, frames: int) -> Floats:
        """Where one target was looked for (n, 3), a row for each of its track's."""
        first = int(fixes.frame[0])
        looked = np.frombuffer(self._looked[name], float).reshape(-1, 4)
        looked = looked[looked[:, 0] >= first]
        places = np.full((frames - first, 3), np.nan)
        places[looked[:, 0].astype(int) - first] = looked[:, 1:]
        places[fixes.frame - first] = np.nan
        return places

    def _through(self, name: str, part: Sequence[Scene]) -> tuple[Watched | None, list[Fix]]:
        target, fixes = self.targets.get(name), list[Fix]()
        at = {box.frame: k for k, box in enumerate(self.boxes[name])}
        for scene in part:
            if scene.frame in at:
                self.label[name] = label = at[scene.frame]
                known = self.known.get((name, label))
                target, first = begin_watch(scene, self.boxes[name][label], self.settings, known)
                fixes.append(first)
            elif target is not None:
                target, seen = watch(target, scene, self.settings)
                fixes = [fix for fix in fixes if fix.frame not in seen.taken_back]
                fixes += seen.fixes
                self._taken_back[name][self.way].extend(f for f in seen.taken_back if f not in at)
                surface = target.surface
                if not surface.new and not surface.hidden:
                    self.known.setdefault((name, self.label[name]), surface)
                if surface.hidden and not surface.gone:
                    self._looked[name].extend((scene.frame, *surface.course.position_px, surface.course.sigma_px))
        return target, fixes


def _forwards(path: Path, capture: Capture, follower: _Follower, tell: Counter | None, head: VideoHead) -> _Video:
    """The whole video once, to its end or to where the frames change their size."""
    seen, damaged, woven = array("q"), array("q"), False
    notes: list[str] = []
    size, end = (0, 0), None
    part: list[Scene] = []
    found = prefetched(scenes(frames_of(path, also_damaged=True, capture=capture)), PART_FRAMES)
    for scene in found:
        now = scene.pixels.shape[1], scene.pixels.shape[0]
        size = size if seen else now
        if now != size:
            notes.append(_size_note(scene.frame, now, size))
            end = scene.frame
            break
        part.append(scene)
        woven = scene.woven
        seen.append(scene.frame)
        if scene.damaged:
            damaged.append(scene.frame)
        if len(part) == PART_FRAMES:
            follower.go_on(part)
            part = []
        if tell is not None:
            tell(scene.frame + 1, max(head.frames, scene.frame + 1))
    found.close()
    follower.go_on(part)
    time_s = from_first(capture.stamps_s()[:end])
    if len(seen) < len(time_s):
        missing = np.setdiff1d(np.arange(len(time_s)), seen)
        notes.append(f"{_frames(missing, len(time_s))} could not be decoded; they are rows without a fix")
    if damaged:
        notes.append(
            f"{_frames(np.array(damaged), len(time_s))} are damaged, or were predicted from what is: the decoder made "
            "up what it could not read; they are rows without a fix"
        )
    if tell is not None:
        tell(len(time_s), len(time_s))
    if woven:
        notes.append(
            "the video is interlaced: the upper field of each frame is used, the lines between are interpolated"
        )
    if head.moving > 1:
        notes.append(
            f"the file holds {head.moving} moving pictures; stream {capture.stream} ({size[0]} x {size[1]}) is used, "
            "video_stream = ... asks for another"
        )
    claim = 0 if end is not None or not head.frames else head.frames - capture.hidden
    return _Video(time_s=time_s, size=size, notes=tuple(notes), claim=claim)


def _frames(numbers: Ints, total: int) -> str:
    """Frame numbers as ranges, the first few of them."""
    starts = np.flatnonzero(np.diff(numbers, prepend=-2) > 1)
    ends = np.append(starts[1:], len(numbers)) - 1
    pairs = list(zip(numbers[starts].tolist(), numbers[ends].tolist(), strict=True))
    ranges = [f"{a}" if a == b else f"{a} to {b}" for a, b in pairs[:NAMED_RANGES]]
    more = f" and {len(pairs) - NAMED_RANGES} more stretches" if len(pairs) > NAMED_RANGES else ""
    return f"{len(numbers)} of {total} frames ({', '.join(ranges)}{more})"


def _backwards(
    path: Path, stream: int | None, follower: _Follower, video: _Video, back: int, tell: Counter | None
) -> None:
    """From the last of the boxes to the beginning of the video."""
    if back == 0:
        return
    follower.turn_round()
    found = prefetched(scenes(frames_back(path, back, stream)), PART_FRAMES)
    while part := list(islice(found, PART_FRAMES)):
        follower.go_on(part)
        if tell is not None:
            tell(len(video.time_s) + back + 1 - part[-1].frame, len(video.time_s))


def _counted(progress: Progress, back: int) -> Counter:
    """Counts the frames of both ways together."""
    more = back + 1 if back else 0
    return lambda done, forward: progress(done, forward + more)


def _track(camera: str, target: str, fixes: Fixes, times: Floats) -> ImageTrack:
    """A row for each frame from the first fix on."""
    first = int(fixes.frame[0])
    n, rows = len(times) - first, fixes.frame - first
    xy, sigma, state = np.full((n, 2), np.nan), np.full(n, np.nan), np.full(n, LOST)
    boxed = np.zeros(n, bool)
    xy[rows], sigma[rows], boxed[rows] = fixes.xy_px, fixes.sigma_px, fixes.box
    state[rows] = np.where(np.diff(rows, prepend=-1) > 1, REACQUIRED, TRACKED)
    frame = np.arange(first, len(times))
    return ImageTrack(
        camera=camera, target=target, frame=frame, time_s=times[first:], xy_px=xy, sigma_px=sigma, state=state,
        box=boxed,
    )  # fmt: skip


def _outlines(boxes: tuple[Box, ...], fixes: Fixes, frames: int) -> Floats:
    """Corners (n, 4, 2) of the box as it was carried along."""
    half = np.array([[box.width, box.height] for box in boxes])[fixes.label] / 2
    corner = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half[:, None]
    first = int(fixes.frame[0])
    outlines = np.full((frames - first, 4, 2), np.nan)
    outlines[fixes.frame - first] = corner @ fixes.linear.transpose(0, 2, 1) + fixes.xy_px[:, None]
    return outlines


def _in_order(given: Box | Sequence[Box]) -> tuple[Box, ...]:
    return (given,) if isinstance(given, Box) else tuple(sorted(given, key=lambda box: box.frame))


def _every(labels: Mapping[str, tuple[Box, ...]]) -> Iterator[tuple[str, Box]]:
    return ((name, box) for name, boxes in labels.items() for box in boxes)


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


def _check_followed(track: ImageTrack, box: Box, path: Path) -> None:
    fixes, frames = int(track.seen.sum()), len(track.frame)
    if fixes < min(LEAST_FIXES, frames):
        raise TrackingError(
            where=f"{path}: target {track.target} (targets.{track.target}.boxes.{track.camera})",
            seen=f"lost right after its box on frame {box.frame}, and never found again in {frames} frames",
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


def _by_box(tracks: tuple[ImageTrack, ...]) -> Iterator[str]:
    for track in tracks:
        if track.by_box.any():
            yield (
                f"{track.camera}: {track.target} shows no lasting surface point in {int(track.by_box.sum())} of "
                f"{int(track.seen.sum())} fixes; there the middle of its box is given, to "
                f"{float(np.median(track.sigma_px[track.by_box])):.1f} px"
            )


def _gaps(times: Floats, claimed: int, head: VideoHead) -> Iterator[str]:
    """Missing frames, as far as times and the container's claims betray them."""
    steps = np.diff(times)
    if len(steps) and steps.max() > 1.5 * np.median(steps):
        wide = np.flatnonzero(steps > 1.5 * np.median(steps))
        if len(wide) <= max(3, len(steps) // 20):
            where = ", ".join(str(int(i) + 1) for i in wide[:5])
            yield f"gaps in the video's times before frames {where}{' ...' if len(wide) > 5 else ''}"
    if len(times) < claimed - max(2, claimed // 50):
        yield f"the container claims {claimed} frames and holds {len(times)}: the video is cut off or broken"
    elif not claimed and times[-1] + head.begin_s < head.end_s * (1 - CUT_SHARE) - CUT_S:
        yield (
            f"the container claims to end at {head.end_s:.1f} s, its last frame is at "
            f"{times[-1] + head.begin_s:.1f} s: the video is cut off or broken"
        )


def _size_note(frame: int, now: tuple[int, int], size: tuple[int, int]) -> str:
    return (
        f"frame {frame} is {now[0]} x {now[1]} instead of {size[0]} x {size[1]}: tracking ends there, the "
        "camera's calibration would not hold"
    )
