"""Image tracks of a flight: tracked in a video, or read from detections made elsewhere."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from calibration.foundation.errors import InputFileError, UsageError
from calibration.foundation.progress import Progress
from pipeline.export import read_detections_csv, read_tracks_csv
from pipeline.flight import CameraSettings, Flight
from pipeline.records import TRACKED, Box, ImageTrack
from pipeline.stages.inputs.frames import VideoClock, frame_rate, video_clock, video_time_s
from pipeline.tracking import TrackingSettings, VideoTracks

DEFAULT_PIXEL_SIGMA = 1.0


def boxes_of(flight: Flight, camera: CameraSettings) -> dict[str, tuple[Box, ...]]:
    """The boxes of every target in one camera.

    Raises UsageError where there are none.
    """
    boxes = {t.name: t.labels[camera.name] for t in flight.targets if camera.name in t.labels}
    boxes |= {m.name: (m.boxes[camera.name],) for m in flight.landmarks if camera.name in m.boxes}
    if not boxes:
        raise UsageError(
            where=flight.key(camera.name, "video"),
            seen="a video, but no target has a box in it",
            expected=f"boxes.{camera.name} in at least one [targets.NAME]",
            advice=f"write boxes.{camera.name} = {{ frame = 0, box = [x, y, width, height] }}, or give tracks = a csv",
        )
    return boxes


def track_camera(
    flight: Flight, camera: CameraSettings, progress: Callable[[int, int], None] | None = None
) -> VideoTracks:
    """The tracks in one camera's video, at the flight file's frame rate.

    A given `sigma.pixel` is what the median fix of a surface point is worth; the tracker's own sigmas then say how the
    others differ. The middle of a box keeps the sigma it has.
    """
    from pipeline.tracking import track_video  # slow to import

    assert camera.video is not None
    settings = TrackingSettings(tracker=camera.tracker)
    found = track_video(
        camera.video, camera=camera.name, boxes=boxes_of(flight, camera), settings=settings, progress=progress,
        stream=camera.video_stream,
    )  # fmt: skip
    scale = found.frame_rate / (camera.frame_rate or found.frame_rate)
    every = np.concatenate([track.sigma_px[track.seen & ~track.by_box] for track in found.tracks])
    given = camera.sigma.get("pixel_px")
    worth = 1.0 if given is None or not len(every) else given / float(np.median(every))
    tracks = tuple(
        replace(track, time_s=track.time_s * scale, sigma_px=track.sigma_px * np.where(track.by_box, 1.0, worth))
        for track in found.tracks
    )
    return replace(found, tracks=tracks)


def draw_overlay(flight: Flight, name: str, found: VideoTracks, out: Path, progress: Progress) -> str:
    """Writes one camera's video with its tracks drawn on; the file's name in `out`.

    Raises WriteError where it cannot be written.
    """
    from pipeline.tracking import write_overlay  # slow to import

    camera = flight.camera(name)
    assert camera.video is not None
    plain = re.fullmatch(r"[A-Za-z0-9_-]+", name)
    file = f"overlay-{name if plain else [c.name for c in flight.cameras].index(name)}.mp4"
    write_overlay(
        camera.video, found, out / file, lambda done, total: progress(f"overlay {name}", done, total),
        camera.video_stream,
    )  # fmt: skip
    return file


def detections(flight: Flight, camera: CameraSettings) -> tuple[ImageTrack, ...]:
    """The tracks that a camera's detections file holds; container times where there is a video."""
    assert camera.tracks is not None
    clock = video_clock(camera)
    rate = frame_rate(flight, camera, clock)
    sigma = camera.sigma.get("pixel_px", DEFAULT_PIXEL_SIGMA)
    tracks = read_detections_csv(camera.tracks, camera=camera.name, frame_rate=rate, default_sigma_px=sigma)
    if clock is not None:
        tracks = tuple(_retimed(camera, track, rate, clock) for track in tracks)
    return tracks


def _retimed(camera: CameraSettings, track: ImageTrack, rate: float, clock: VideoClock) -> ImageTrack:
    if len(track.frame) and track.frame[-1] >= len(clock.time_s):
        raise InputFileError(
            where=f"{camera.tracks}: target {track.target}",
            seen=f"frame {track.frame[-1]}",
            expected=f"frames 0 to {len(clock.time_s) - 1} of {camera.video}",
            advice="check that the detections were made in this video; frames count from 0",
        )
    return replace(track, time_s=video_time_s(track.frame, rate, clock))


def read_tracks(flight: Flight, out: Path) -> tuple[ImageTrack, ...]:
    """All tracks of a flight: detections files, and what `track` left in `out`/tracks.csv.

    Raises UsageError where a video has not been tracked yet.
    """
    tracked: tuple[ImageTrack, ...] = ()
    if any(c.tracks is None and c.video is not None for c in flight.cameras) and (out / "tracks.csv").exists():
        tracked = read_tracks_csv(out / "tracks.csv")
    found: list[ImageTrack] = []
    for camera in flight.cameras:
        if camera.tracks is not None:
            found += detections(flight, camera)
        else:
            own = [t for t in tracked if t.camera == camera.name]
            if not own:
                raise _untracked(flight, camera, out)
            found += own
        found += marks_of(flight, camera)
    return tuple(found)


def marks_of(flight: Flight, camera: CameraSettings) -> tuple[ImageTrack, ...]:
    """The landmarks that the flight file marks in one camera, a track of few points each."""
    marked = [(mark.name, mark.points[camera.name]) for mark in flight.landmarks if camera.name in mark.points]
    if not marked:
        return ()
    clock = video_clock(camera)
    rate = frame_rate(flight, camera, clock)
    found = []
    for name, points in marked:
        frame = np.array([p.frame for p in points], dtype=np.int64)
        if clock is not None and frame[-1] >= len(clock.time_s):
            raise UsageError(
                where=f"{flight.path}: landmarks.{name}.points.{camera.name}",
                seen=f"frame {frame[-1]}",
                expected=f"frames 0 to {len(clock.time_s) - 1} of {camera.video}",
                advice="frames count from 0",
            )
        found.append(
            ImageTrack(
                camera=camera.name, target=name, frame=frame, time_s=video_time_s(frame, rate, clock),
                xy_px=np.array([[p.x_px, p.y_px] for p in points]), sigma_px=np.array([p.sigma_px for p in points]),
                state=np.full(len(points), TRACKED),
            )
        )  # fmt: skip
    return tuple(found)


def _untracked(flight: Flight, camera: CameraSettings, out: Path) -> UsageError:
    if camera.video is None:
        return UsageError(
            where=flight.key(camera.name, "tracks"),
            seen="neither tracks nor video",
            expected="one of them",
            advice='write video = "..." and boxes in [targets.NAME], or tracks = "..." for detections made elsewhere',
        )
    return UsageError(
        where=str(out / "tracks.csv"),
        seen=f"no tracks of camera {camera.name}",
        expected="the tracks of its video",
        advice=f"run `runningfix track {flight.path} -o {out}` first, or `runningfix run` for everything",
    )


def wanted(flight: Flight, tracks: tuple[ImageTrack, ...]) -> tuple[ImageTrack, ...]:
    """The tracks of the targets and landmarks that the flight file names; all, where it names no target."""
    names = [t.name for t in flight.targets]
    if names:
        names += [mark.name for mark in flight.landmarks]
    return tuple(t for t in tracks if not names or t.target in names)
