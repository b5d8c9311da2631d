"""The camera model of each camera of a flight, held against the video it is used for."""

from __future__ import annotations

from collections.abc import Collection
from functools import lru_cache
from pathlib import Path

from calibration.camera import CameraModel
from calibration.camera_files import doubts, read_camera
from calibration.photos.videos import video_picture
from calibration.picture import Area, fitted
from pipeline.flight import CameraSettings, Flight, VideoArea


def read_models(flight: Flight, left_out: Collection[str] = ()) -> dict[str, CameraModel]:
    """The camera model of every camera but those `left_out`, of its video's pictures.

    Raises InputFileError where a file is no camera, UsageError where it is of other pictures than the video.
    """
    return {camera.name: model_of(flight, camera) for camera in flight.cameras if camera.name not in left_out}


def model_of(flight: Flight, camera: CameraSettings) -> CameraModel:
    """The model of one camera, as `read_models`; without a video there is nothing to hold it against."""
    video = camera.video if camera.video is not None and camera.video.is_file() else None
    where = flight.key(camera.name, "calibration")
    return fitting_model(camera.calibration, video, camera.video_area, where, camera.video_stream)


def fitting_model(
    calibration: Path, video: Path | None, area: VideoArea | None, where: str, stream: int | None = None
) -> CameraModel:
    """The model in `calibration` of the pictures of `video`, of which it shows `area`. Raises as `read_models`."""
    model = read_camera(calibration)
    if video is None:
        return model
    part = None if area is None else Area(crop=area.crop, of=area.of)
    picture = _picture(video, stream, video.stat().st_mtime_ns)
    return fitted(model, picture, file=calibration, video=video, where=where, area=part)


_picture = lru_cache(maxsize=64)(lambda video, stream, changed_ns: video_picture(video, stream))


def camera_notes(name: str, model: CameraModel) -> tuple[str, ...]:
    """What should be looked at in a camera file, one sentence each."""
    return tuple(f"{name}: {doubt}" for doubt in doubts(model))
