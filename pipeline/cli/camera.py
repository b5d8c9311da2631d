"""`runningfix camera`: a camera file for other pictures of the same camera."""

from __future__ import annotations

import re
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

from calibration import CameraModel, read_camera, write_camera
from calibration.camera_files import doubts
from calibration.foundation.errors import UsageError
from calibration.photos.videos import video_picture
from calibration.picture import Area, for_pictures, scaled, turned
from pipeline.cli.console import Console


def run(arguments: Namespace, console: Console) -> int:
    """Reads, turns, crops, scales, writes."""
    camera = read_camera(arguments.file, camera=arguments.camera)
    made = turned(camera, arguments.turn)
    if arguments.video is not None and (arguments.to or arguments.turn):
        raise UsageError(
            where="--for", seen="with --to or --turn", expected="the video says both", advice="leave the others out"
        )
    if arguments.video is not None:
        made = for_video(made, arguments.file, arguments.video, arguments.crop)
    elif arguments.to is not None or arguments.crop is not None:
        area = area_of(made, arguments.crop)
        made = scaled(made, area, _size(arguments.to, area))
    write_camera(arguments.output, made, format_name=arguments.format)
    notes = doubts(made)
    for note in notes:
        console.say(f"note: {note}")
    summary = {
        "status": "done", "command": "camera", "image_size": list(made.image_size), "K": made.K.tolist(),
        "distortion": made.distortion.tolist(), "warnings": list(notes), "files": [str(arguments.output)],
    }  # fmt: skip
    (fx, _, cx), (_, fy, cy), _ = made.K
    words = f"focal length {fx:.2f} x {fy:.2f}, principal point {cx:.2f}, {cy:.2f}"
    console.result(summary, f"written {arguments.output}: {made.image_size[0]}x{made.image_size[1]}, {words}")
    return 0


def for_video(camera: CameraModel, file: Path, video: Path, crop: Sequence[float] | None) -> CameraModel:
    """`camera` for the pictures of `video`, which shows `crop` of its own. Raises UsageError, InputFileError."""
    area = None if crop is None else area_of(camera, crop)
    return for_pictures(camera, video_picture(video), file=file, video=video, where="--for", crop=area)


def area_of(camera: CameraModel, crop: Sequence[float] | None) -> Area:
    """The part of the camera's picture that the options name; all of it without --crop."""
    if camera.image_size == (0, 0):
        raise UsageError(
            where="--crop or --to",
            seen="a camera file without a size",
            expected="a file that says of what pictures it is",
            advice="add image_size to it",
        )
    x, y, width, height = crop or (0, 0, *camera.image_size)
    return Area(crop=(x, y, width, height), of=camera.image_size)


def _size(text: str | None, area: Area) -> tuple[int, int]:
    """WIDTHxHEIGHT; without it the crop as it is."""
    if text is None:
        return round(area.crop[2]), round(area.crop[3])
    found = re.fullmatch(r"(\d{1,6})[xX](\d{1,6})", text)
    if not found or not min(int(found[1]), int(found[2])):
        raise UsageError(where="--to", seen=repr(text), expected="width x height", advice="such as 1920x1080")
    return int(found[1]), int(found[2])
