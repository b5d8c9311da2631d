"""Checks of the videos: frame rate against the container's, boxes against the picture, one video in two cameras."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

from pipeline.flight import CameraSettings, Flight
from pipeline.stages.checks.doubt import Doubt
from pipeline.tracking import VideoTimes

RATE_SHARE = 0.01
"""Of a frame rate: what a given one may differ from the container's unsaid. 29.97 and 30 differ by 0.001, 25 and 24 by
0.04; doubled, 24 for 24.5 would pass."""
COMPARED_BYTES = 1 << 20
"""Of the head and the end of two videos of one length: no two recordings share them."""


def video_doubts(flight: Flight, videos: Mapping[str, VideoTimes]) -> list[Doubt]:
    """Doubts about the videos of a flight, whose times are given by camera."""
    found = [doubt for name, times in videos.items() for doubt in _frame_rate(flight, flight.camera(name), times)]
    found += [doubt for name, times in videos.items() for doubt in _boxes(flight, name, times)]
    return found + _same_video(flight, list(videos))


def _frame_rate(flight: Flight, camera: CameraSettings, times: VideoTimes) -> list[Doubt]:
    given, own = camera.frame_rate, times.frame_rate
    if given is None or abs(given / own - 1) <= RATE_SHARE:
        return []
    assert camera.video is not None
    return [
        Doubt(
            kind="frame-rate",
            subject=(camera.name,),
            where=flight.key(camera.name, "frame_rate"),
            seen=f"{given:g}, but {camera.video.name} says {own:g} frames per second",
            expected="the rate at which the camera took the frames",
            advice="leave frame_rate out to take the container's; keep it for slow motion or a time lapse",
        )
    ]


def _boxes(flight: Flight, name: str, times: VideoTimes) -> list[Doubt]:
    found = []
    width, height = times.image_size
    for target in flight.targets:
        for box in target.labels.get(name, ()):
            late = box.frame >= times.frames
            outside = box.x < 0 or box.y < 0 or box.x + box.width > width or box.y + box.height > height
            if not late and not outside:
                continue
            seen = f"frame {box.frame}" if late else f"box [{box.x:g}, {box.y:g}, {box.width:g}, {box.height:g}]"
            expected = f"frames 0 to {times.frames - 1}" if late else f"a box inside the {width} x {height} picture"
            found.append(
                Doubt(
                    kind="box-outside",
                    subject=(target.name, name),
                    where=f"{flight.path}: targets.{target.name}.boxes.{name}",
                    seen=seen,
                    expected=f"{expected} of {name}",
                    advice="draw it again: `runningfix label` shows the frame; is it a box of another camera's video?",
                    certain=True,
                )
            )
    return found


def _same_video(flight: Flight, names: list[str]) -> list[Doubt]:
    first: dict[tuple[int, str], str] = {}
    found = []
    for name in names:
        path = flight.camera(name).video
        assert path is not None
        other = first.setdefault(_fingerprint(path), name)
        if other != name:
            found.append(
                Doubt(
                    kind="one-video-twice",
                    subject=(other, name),
                    where=flight.key(name, "video"),
                    seen=f"the same recording as that of {other}",
                    expected="a video of its own for each camera",
                    advice=f"name the video that {name} took",
                    certain=True,
                )
            )
    return found


def _fingerprint(path: Path) -> tuple[int, str]:
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(COMPARED_BYTES)
        file.seek(max(0, size - COMPARED_BYTES))
        return size, hashlib.sha256(head + file.read(COMPARED_BYTES)).hexdigest()
