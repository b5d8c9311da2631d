"""The pictures themselves: each video is gone through once, from key frame to key frame where frames are wanted."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import cv2
import numpy as np

from calibration.foundation.arrays import Floats
from calibration.foundation.capture import Capture
from calibration.foundation.errors import RunningFixError
from calibration.foundation.progress import Progress, silent
from pipeline.flight import CameraSettings, Flight
from pipeline.records import Box, Film, Ground, Picture, PoseTrack, Results
from pipeline.report.data.participants import time_span
from pipeline.stages.inputs.frames import frame_rate, video_clock, video_index, video_time_s
from pipeline.stages.inputs.single_frames import Pixels, affordable, frames_of
from pipeline.stages.pictures.above import Look, from_above
from pipeline.stages.pictures.films import evenly, film_of, shrunk
from pipeline.stages.pictures.moments import Moment, moments
from pipeline.stages.pictures.settings import SETTINGS, PictureSettings

NO_VIDEO = "No camera of this flight has its video here, so there are no pictures from it."


def with_pictures(
    flight: Flight,
    results: Results,
    *,
    poses: Sequence[PoseTrack] = (),
    ground: Ground | None = None,
    progress: Progress = silent,
    settings: PictureSettings = SETTINGS,
) -> Results:
    """The results with pictures from the videos, and with a sentence for each reason why some are missing.

    `poses` are the refined ones of all frames: with them the ground is shown from above, at `ground` or, where that is
    None, at the height of the targets.
    """
    cameras = [c for c in flight.cameras if c.video is not None]
    if not cameras:
        return replace(results, picture_notes=(NO_VIDEO,))
    boxes = drawn_boxes(flight)
    wanted = moments(results, boxes, settings)
    notes = [f"{c.name} has no video here." for c in flight.cameras if c.video is None]
    above = from_above(results, ground, settings) if poses else None
    left, taken, films = settings.decoded_px, [], []
    for done, camera in enumerate(cameras):
        progress("pictures", done, len(cameras))
        own = [m for m in wanted if m.camera == camera.name]
        try:
            share = left / (len(cameras) - done)  # what one does not use is the others'
            room = replace(
                settings, film_decoded_px=settings.film_decoded_px / len(cameras),
                film_bytes=settings.film_bytes // len(cameras),
            )  # fmt: skip
            look = None if above is None else above.through(flight, camera, poses)
            found, film, unspent, dropped = _of_video(flight, camera, results, own, boxes, share, room, look)
        except RunningFixError as error:
            notes.append(f"The video of {camera.name} could not be read again: {error.seen}.")
            continue
        left += unspent - share
        taken += found
        films += [film] if film is not None else []
        if dropped:
            left_out = "1 moment" if dropped == 1 else f"{dropped} moments"
            notes.append(f"Not shown of {camera.name}: {left_out} deep inside its video, too long to decode.")
    progress("pictures", len(cameras), len(cameras))
    kept = list(_within(taken, wanted, settings.most_bytes))
    if len(kept) < len(taken):
        out = len(taken) - len(kept)
        notes.append(f"{out} further picture{' is' if out == 1 else 's are'} left out, to keep the page small.")
    maps, said = ((), ()) if above is None else above.pictures()
    return replace(
        results, pictures=tuple(kept), picture_notes=(*notes, *said), films=tuple(films), ground_pictures=maps
    )


def drawn_boxes(flight: Flight) -> dict[tuple[str, str], tuple[Box, ...]]:
    """The boxes that the flight file has, by camera and target or landmark."""
    boxes = {(camera, t.name): tuple(b) for t in flight.targets for camera, b in t.labels.items()}
    return boxes | {(camera, m.name): (box,) for m in flight.landmarks for camera, box in m.boxes.items()}


def _within(taken: Iterable[Picture], wanted: Sequence[Moment], most_bytes: int) -> Iterator[Picture]:
    """The pictures in the order in which they are wanted, as many as the page bears."""
    order = {(m.kind, m.camera, m.target, m.frame): i for i, m in enumerate(wanted)}
    total = 0
    for picture in sorted(taken, key=lambda p: order[p.kind, p.camera, p.target, p.frame]):
        total += len(picture.jpeg)
        if total > most_bytes:
            return
        yield picture


def _of_video(
    flight: Flight,
    camera: CameraSettings,
    results: Results,
    wanted: Sequence[Moment],
    boxes: Mapping[tuple[str, str], tuple[Box, ...]],
    most_px: float,
    settings: PictureSettings,
    look: Look | None,
) -> tuple[list[Picture], Film | None, float, int]:
    """Pictures of one video, its film, the pixels that may still be decoded, and how many moments that left out."""
    assert camera.video is not None
    times, index = video_index(camera)
    area = float(times.image_size[0] * times.image_size[1])
    chosen, cost = affordable([m.frame for m in wanted], index, int(most_px // area))
    sought = [m for m in wanted if m.frame in chosen]
    common = _common_time_s(flight, camera, results, len(index.entry))
    filmed = evenly(common, time_span(results), settings.film_frames) if common is not None else []
    within, _ = affordable(filmed, index, int(settings.film_decoded_px // area))
    filmed = [f for f in filmed if f in within]
    looked = set(filmed[: settings.ground_frames])  # the coarsest spacing comes first
    pictures: list[Picture] = []
    small: dict[int, tuple[bytes, tuple[int, int]]] = {}
    capture = Capture(camera.video, stream=camera.video_stream)
    try:
        for frame, shown in frames_of(capture, sorted({*chosen, *filmed}), index):
            pictures += [_cut(shown, m, boxes, settings) for m in sought if m.frame == frame]
            if frame in filmed:
                small[frame] = shrunk(shown, settings)
            if look is not None and frame in looked:
                look(frame, shown)
    finally:
        capture.close()
    film = None if common is None else film_of(
        camera.name, common, small, results.tracks, times.image_size, settings.film_bytes
    )  # fmt: skip
    return pictures, film, most_px - cost * area, len(wanted) - len(sought)


def _common_time_s(flight: Flight, camera: CameraSettings, results: Results, frames: int) -> Floats | None:
    """Common times (frames,) of a video's frames; None where the camera took no part."""
    clock = next((c for c in results.solution.clocks if c.camera == camera.name), None)
    if clock is None:
        return None
    video = video_clock(camera)
    return clock.common_time_s(video_time_s(np.arange(frames), frame_rate(flight, camera, video), video))


def _cut(
    shown: Pixels, of: Moment, boxes: Mapping[tuple[str, str], tuple[Box, ...]], settings: PictureSettings
) -> Picture:
    """The cut-out of a moment; at the image's edge it is moved inwards."""
    height, width = shown.shape[:2]
    side = min(_side_px(of, boxes, settings), width, height)
    middle = _middle(of)
    left = int(np.clip(round(middle[0] - side / 2 + 0.5), 0, width - side))
    top = int(np.clip(round(middle[1] - side / 2 + 0.5), 0, height - side))
    part: Pixels = np.ascontiguousarray(shown[top : top + side, left : left + side])
    out = min(side, settings.encoded_px)
    if out < side:
        part = np.asarray(cv2.resize(part, (out, out), interpolation=cv2.INTER_AREA), np.uint8)
    good, jpeg = cv2.imencode(".jpg", part, [cv2.IMWRITE_JPEG_QUALITY, settings.quality])
    assert good
    box = None if of.box is None else (of.box.x - 0.5, of.box.y - 0.5, of.box.width, of.box.height)
    return Picture(
        kind=of.kind, camera=of.camera, target=of.target, frame=of.frame, time_s=of.time_s, jpeg=jpeg.tobytes(),
        size=(out, out), corner_px=(left - 0.5, top - 0.5), zoom=out / side, fix_px=of.fix_px,
        predicted_px=of.predicted_px, box_px=box, residual_px=of.residual_px, residual_sigma=of.residual_sigma,
        weight=of.weight,
    )  # fmt: skip


def _side_px(of: Moment, boxes: Mapping[tuple[str, str], tuple[Box, ...]], settings: PictureSettings) -> int:
    """Wide enough for the target and its surroundings, and for a residual."""
    drawn = boxes.get((of.camera, of.target), ())
    usual = settings.boxes_wide * max((max(b.width, b.height) for b in drawn), default=0.0) or settings.unknown_px
    away = 2.5 * of.residual_px if np.isfinite(of.residual_px) else 0.0
    return int(np.clip(round(max(usual, away)), settings.least_px, settings.most_px))


def _middle(of: Moment) -> Floats:
    """Between where the target was tracked and where the solution has it."""
    both = np.array([of.fix_px, of.predicted_px])
    return np.asarray(both[np.isfinite(both).all(axis=1)].mean(axis=0))
