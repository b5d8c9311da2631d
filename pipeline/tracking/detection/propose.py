"""Starting without a mouse: proposes boxes around what moves.

Every half second what moves against the background is boxed (`moving`), and each box that is not on a target already
followed is followed as a target would be (`follow`). It is proposed when it could be followed and has left its place
over the ground, and among its surroundings, by more than a fraction of its size; what only seems to move (parallax, a
piece of road) does neither.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.records import Box
from pipeline.tracking.detection.surroundings import surroundings_shift
from pipeline.tracking.following.follow import begin, follow
from pipeline.tracking.scene.background import Scene, moved, scenes
from pipeline.tracking.scene.moving import moving_boxes
from pipeline.tracking.settings import TrackingSettings
from pipeline.tracking.target.track_state import TrackState
from pipeline.tracking.video.frames import Image, frames_of, video_head
from pipeline.tracking.video.prefetch import prefetched

EVERY_S, APART_S = 0.5, 0.3  # between looks; of the three frames that are compared
TRIAL_S, LEAST_HELD = 1.0, 0.75
LEAST_WAY_PX, LEAST_WAY_SIZES = 4.0, 0.35
LOST_S, MOST_AT_ONCE = 0.5, 16
PICTURES_S = (0.0, 0.5, 1.0, 2.0, 4.0)
PICTURE_PX, CONTEXT = (160, 120), 3.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Proposal:
    """Something that moves.

    box         where it was first seen moving
    last_frame  until which it could be followed
    fixes       how often it was found; way_px  how far it went over the ground in that time
    pictures    (120, 160, 3) each, as time went on
    """

    box: Box
    last_frame: int
    fixes: int
    way_px: float
    pictures: tuple[Image, ...]

    @property
    def worth(self) -> float:
        """By which proposals are ordered: long followed, and far gone for its size."""
        size = float(np.sqrt(self.box.width * self.box.height))
        return self.fixes * min(1.0, self.way_px / (4.0 * size))


@dataclass(kw_only=True, eq=False)
class _Candidate:
    """A box on trial: the target, where its first place on the ground is now, and what became of it."""

    box: Box
    target: TrackState
    anchor_px: Floats
    begun_s: float
    last_s: float
    last_frame: int
    fixes: int = 1
    looks: int = 1
    way_px: float = 0.0
    against_px: Floats = field(default_factory=lambda: np.zeros(2))  # way against its surroundings
    pictures: list[Image] = field(default_factory=list)


def propose_targets(
    path: Path, *, most: int = 12, progress: Callable[[int, int], None] | None = None
) -> tuple[Proposal, ...]:
    """Up to `most` moving targets of a video, the surest first; memory is constant.

    Raises InputFileError where there is no video.
    """
    head = video_head(path)
    apart = max(1, round(APART_S * head.frame_rate))
    every = max(1, round(EVERY_S * head.frame_rate))
    found = prefetched(scenes(frames_of(path)), 4)
    window = deque(islice(found, 2 * apart), maxlen=2 * apart + 1)
    search = _Search()
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        for done, scene in enumerate(found):
            window.append(scene)
            search.go_on(window[apart])
            if done % every == 0:
                search.look(window, apart)
            if progress is not None:
                progress(done + 2 * apart + 1, max(head.frames, done + 2 * apart + 1))
        search.finish()
    finally:
        cv2.setNumThreads(threads)
    return tuple(sorted(search.proposals, key=lambda p: -p.worth)[:most])


class _Search:
    """Candidates that are being followed, and what has been proposed."""

    def __init__(self) -> None:
        self.settings = TrackingSettings()
        self.candidates: list[_Candidate] = []
        self.proposals: list[Proposal] = []
        self.before: Image | None = None

    def look(self, window: Sequence[Scene], apart: int) -> None:
        """Takes up what moves in the window's middle and is not followed yet."""
        now = window[apart]
        boxes = moving_boxes(window[0], now, window[-1], _to_middle(window, apart), _from_end(window, apart))
        for box in boxes[: MOST_AT_ONCE - len(self.candidates)]:
            if not any(_covers(c.target, box) for c in self.candidates) and min(box.width, box.height) >= 4:
                target, _ = begin(now.pixels, box, self.settings)
                candidate = _Candidate(
                    box=box, target=target, anchor_px=np.array(box.centre_px), begun_s=now.time_s, last_s=now.time_s,
                    last_frame=now.frame,
                )  # fmt: skip
                candidate.pictures.append(_picture(now.pixels, candidate))
                self.candidates.append(candidate)

    def go_on(self, scene: Scene) -> None:
        """Follows every candidate one frame further; ends those that are lost or do not move."""
        for candidate in tuple(self.candidates):
            was = np.array(candidate.target.course.position_px)
            self._follow(candidate, scene)
            self._against(candidate, was, scene)
            lost = scene.time_s - candidate.last_s > LOST_S or candidate.target.gone
            tried = scene.time_s - candidate.begun_s > TRIAL_S
            if lost or (tried and candidate.looks >= 5 and not _moves(candidate)):
                self._end(candidate)
        self.before = scene.pixels

    def _against(self, candidate: _Candidate, was: Floats, scene: Scene) -> None:
        """Adds to a candidate's way against its surroundings; no way is longer than that."""
        if self.before is None:
            return
        shift = surroundings_shift(
            self.before, scene.pixels, was, candidate.target.template.size_px, scene.cur_from_prev
        )
        carried = moved(scene.cur_from_prev, was)[0]
        turned = moved(scene.cur_from_prev, was + candidate.against_px)[0] - carried
        candidate.against_px = turned + np.array(candidate.target.course.position_px) - carried - shift
        candidate.way_px = min(candidate.way_px, float(np.hypot(*candidate.against_px)))

    def finish(self) -> None:
        """Ends every candidate."""
        for candidate in tuple(self.candidates):
            self._end(candidate)

    def _follow(self, candidate: _Candidate, scene: Scene) -> None:
        candidate.target, new = follow(candidate.target, scene, self.settings)
        candidate.anchor_px = moved(scene.cur_from_prev, candidate.anchor_px)[0]
        candidate.looks += 1
        if not new:
            return
        candidate.fixes += len(new)
        candidate.last_s, candidate.last_frame = scene.time_s, scene.frame
        candidate.way_px = float(np.hypot(*(np.array(new[-1].xy_px) - candidate.anchor_px)))
        shown = len(candidate.pictures)
        if shown < len(PICTURES_S) and scene.time_s - candidate.begun_s >= PICTURES_S[shown]:
            candidate.pictures.append(_picture(scene.pixels, candidate))

    def _end(self, candidate: _Candidate) -> None:
        self.candidates.remove(candidate)
        long_enough = candidate.last_s - candidate.begun_s >= TRIAL_S / 2
        if long_enough and _moves(candidate) and candidate.fixes >= 5:
            self.proposals.append(
                Proposal(
                    box=candidate.box,
                    last_frame=candidate.last_frame,
                    fixes=candidate.fixes,
                    way_px=candidate.way_px,
                    pictures=tuple(candidate.pictures),
                )
            )


def _moves(candidate: _Candidate) -> bool:
    """Whether it was held and left its place on the ground."""
    size = float(np.sqrt(candidate.box.width * candidate.box.height))
    lost = max(0, candidate.looks - candidate.fixes)
    held = candidate.fixes >= LEAST_HELD * candidate.looks or (candidate.fixes > 25 and lost < candidate.fixes)
    return held and candidate.way_px > max(LEAST_WAY_PX, LEAST_WAY_SIZES * size)


def _covers(target: TrackState, box: Box) -> bool:
    """Whether a box lies on a target, or all around it."""
    x, y = target.course.position_px
    reach = 0.6 * max(target.template.size_px) * max(0.3, target.scale) + 3.0
    near = np.hypot(x - box.centre_px[0], y - box.centre_px[1]) < reach + 0.3 * max(box.width, box.height)
    return bool(near or (box.x <= x <= box.x + box.width and box.y <= y <= box.y + box.height))


def _to_middle(window: Sequence[Scene], apart: int) -> Floats:
    motion = np.eye(3)
    for scene in islice(window, 1, apart + 1):
        motion = scene.cur_from_prev @ motion
    return motion


def _from_end(window: Sequence[Scene], apart: int) -> Floats:
    motion = np.eye(3)
    for scene in islice(window, apart + 1, None):
        motion = scene.cur_from_prev @ motion
    return np.asarray(np.linalg.inv(motion))


def _picture(pixels: Image, candidate: _Candidate) -> Image:
    """The candidate and what is around it, with its box."""
    width, height = candidate.target.template.size_px
    scale = PICTURE_PX[0] / max(CONTEXT * width, CONTEXT * height * PICTURE_PX[0] / PICTURE_PX[1], 40.0)
    x, y = candidate.target.course.position_px
    middle = (np.array(PICTURE_PX) - 1) / 2
    shown = cv2.warpAffine(
        pixels, np.array([[scale, 0, middle[0] - scale * x], [0, scale, middle[1] - scale * y]]), PICTURE_PX
    )
    half = np.array([width, height]) / 2 * scale
    low, high = np.rint(middle - half).astype(int).tolist(), np.rint(middle + half).astype(int).tolist()
    cv2.rectangle(shown, low, high, (60, 220, 255), 1, cv2.LINE_AA)
    return np.asarray(shown, np.uint8)
