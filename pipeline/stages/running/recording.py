"""A solved flight as a recording of the Rerun viewer (`.rrd`): targets, cameras, tracks, videos on one time line.

    targets/NAME               Points3D at even steps, and LineStrips3D of the whole way
    cameras/NAME               Transform3D of each frame (world from camera, refined)
    cameras/NAME/image         Pinhole, and the video: one frame reference for each frame
    cameras/NAME/image/TARGET  Points2D of each fix

World: ENU metres, up is up; camera: right, down, forward. The time line `common_time` is common time in seconds.
"""

from __future__ import annotations

import contextlib
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from calibration.camera import CameraModel
from calibration.foundation.arrays import Floats
from calibration.foundation.errors import InputFileError, UsageError
from calibration.foundation.files import cannot_write, part_name
from calibration.foundation.progress import Progress, silent
from pipeline.flight import CameraSettings, Flight
from pipeline.stages.inputs.cameras import model_of

if TYPE_CHECKING:
    import rerun

TIME_LINE = "common_time"
IN_MP4 = (".mp4", ".m4v")
"""What the viewer plays."""


@dataclass(frozen=True, kw_only=True)
class RecordingMade:
    """The file, and a sentence for everything that is not in it."""

    file: Path
    warnings: tuple[str, ...]


def record_flight(
    flight: Flight, out: Path, to: Path, *, videos: bool = True, progress: Progress = silent
) -> RecordingMade:
    """Writes what a finished run left in `out` as the recording `to`, whole or not at all.

    Raises UsageError where the extra `rerun` is not installed, InputFileError where `out` holds no result.
    """
    sdk = _sdk()
    solution, tables = _results(out)
    part, notes = to.with_name(part_name(to.name)), []
    try:
        to.parent.mkdir(parents=True, exist_ok=True)
        recording = sdk.RecordingStream("runningfix", recording_id=flight.path.stem, send_properties=False)
        recording.save(str(part))
        sdk.log("/", sdk.ViewCoordinates.RIGHT_HAND_Z_UP, static=True, recording=recording)
        _targets(sdk, recording, tables["trajectory.csv"])
        cameras = [c for c in flight.cameras if c.name in {k["camera"] for k in solution["clocks"]}]
        for done, camera in enumerate(cameras):
            progress("record", done, len(cameras))
            times = _Times(camera.name, solution, tables["tracks.csv"], out)
            _camera(sdk, recording, camera.name, model_of(flight, camera), tables, times)
            notes += _video(sdk, recording, camera, times) if videos else []
        progress("record", len(cameras), len(cameras))
        recording.flush()
        recording.disconnect()
        os.replace(part, to)
    except OSError as error:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        raise cannot_write(to, error) from None
    return RecordingMade(file=to, warnings=tuple(notes))


def _sdk() -> Any:
    try:
        import rerun
    except ImportError:
        raise UsageError(
            where="export",
            seen="rerun-sdk is not installed",
            expected="the extra `rerun`",
            advice="pip install 'runningfix[rerun]'",
        ) from None
    return rerun


def _results(out: Path) -> tuple[dict[str, Any], dict[str, pd.DataFrame]]:
    names = ("trajectory.csv", "poses.csv", "tracks.csv")
    missing = next((name for name in ("solution.json", *names) if not (out / name).is_file()), None)
    if missing is not None:
        raise InputFileError(
            where=str(out),
            seen=f"no {missing}",
            expected="the folder of a finished `run` or `solve`",
            advice="give the -o folder of that command",
        )
    solution = json.loads((out / "solution.json").read_text(encoding="utf-8"))
    return solution, {name: pd.read_csv(out / name) for name in names}


class _Times:
    """Common times of one camera's frames: its video times where its tracks have them, else the nominal rate."""

    def __init__(self, camera: str, solution: dict[str, Any], tracks: pd.DataFrame, out: Path) -> None:
        clock = next(k for k in solution["clocks"] if k["camera"] == camera)
        self._offset_s, self._rate = float(clock["offset_s"]), float(clock["frame_rate"])
        self._nominal = float(clock["nominal_rate"])
        own = tracks[tracks.camera == camera].drop_duplicates("frame").sort_values("frame")
        self._frame = own.frame.to_numpy(float)
        self._lead = own.time_s.to_numpy(float) - self._frame / self._nominal
        drift = pd.read_csv(out / "clock.csv") if clock["drifts"] and (out / "clock.csv").is_file() else None
        self._drift = None if drift is None else drift[drift.camera == camera]

    def common_s(self, frame: Floats) -> Floats:
        """Common times (n,) of frames (n,)."""
        lead = np.interp(frame, self._frame, self._lead) if len(self._frame) else 0.0
        counted = frame + lead * self._nominal
        time = counted / self._rate + self._offset_s
        if self._drift is not None:
            time = time + np.interp(counted, self._drift.frame, self._drift.deviation_s)
        return np.asarray(time)


def _targets(sdk: Any, recording: rerun.RecordingStream, table: pd.DataFrame) -> None:
    for name, rows in table.groupby("target", sort=False):
        place = rows[["east_m", "north_m", "up_m"]].to_numpy(float)
        sdk.send_columns(
            f"targets/{name}", indexes=[_at(sdk, rows.time_s.to_numpy(float))],
            columns=sdk.Points3D.columns(positions=place, labels=[str(name)] * len(place), radii=[0.6] * len(place)),
            recording=recording,
        )  # fmt: skip
        sdk.log(f"targets/{name}/way", sdk.LineStrips3D([place]), static=True, recording=recording)


def _camera(
    sdk: Any, recording: rerun.RecordingStream, name: str, model: CameraModel, tables: dict[str, pd.DataFrame],
    times: _Times,
) -> None:  # fmt: skip
    poses = tables["poses.csv"]
    own = poses[poses.camera == name]
    refined = own[own.refined_east_m.notna()] if "refined_east_m" in own else own
    lead = "refined_" if len(refined) and "refined_east_m" in own else ""
    own = refined if lead else own
    at = [_at(sdk, times.common_s(own.frame.to_numpy(float)))]
    sdk.send_columns(
        f"cameras/{name}", indexes=at, recording=recording,
        columns=sdk.Transform3D.columns(
            translation=own[[f"{lead}{axis}" for axis in ("east_m", "north_m", "up_m")]].to_numpy(float),
            quaternion=own[[f"{lead}q{axis}" for axis in "xyzw"]].to_numpy(float),
        ),
    )  # fmt: skip
    image = f"cameras/{name}/image"
    pinhole = sdk.Pinhole(
        image_from_camera=model.K, resolution=model.image_size, camera_xyz=sdk.ViewCoordinates.RDF
    )  # fmt: skip
    sdk.log(image, pinhole, static=True, recording=recording)
    tracks = tables["tracks.csv"]
    seen = tracks[(tracks.camera == name) & (tracks.state != "lost")]
    for target, rows in seen.groupby("target", sort=False):
        fixes = rows[["x_px", "y_px"]].to_numpy(float) + 0.5  # the viewer's (0, 0) is the corner of the first pixel
        sdk.send_columns(
            f"{image}/{target}", indexes=[_at(sdk, times.common_s(rows.frame.to_numpy(float)))],
            columns=sdk.Points2D.columns(positions=fixes, labels=[str(target)] * len(fixes), radii=[4.0] * len(fixes)),
            recording=recording,
        )  # fmt: skip


def _video(sdk: Any, recording: rerun.RecordingStream, camera: CameraSettings, times: _Times) -> list[str]:
    """The video and where each of its frames is in common time; what is to be said where it is left out."""
    if camera.video is None:
        return [f"{camera.name} has no video here"]
    if camera.video.suffix.lower() not in IN_MP4:
        return [f"{camera.name}: the viewer plays .mp4, not {camera.video.suffix}; its video is left out"]
    try:
        asset = sdk.AssetVideo(path=camera.video)
        stamps = np.asarray(asset.read_frame_timestamps_nanos(), np.int64)
    except (OSError, RuntimeError, ValueError) as error:
        return [f"{camera.name}: its video is left out, as the viewer cannot read it ({error})"]
    image = f"cameras/{camera.name}/image"
    sdk.log(image, asset, static=True, recording=recording)
    sdk.send_columns(
        image, indexes=[_at(sdk, times.common_s(np.arange(len(stamps), dtype=float)))],
        columns=sdk.VideoFrameReference.columns_nanos(stamps), recording=recording,
    )  # fmt: skip
    return []


def _at(sdk: Any, time_s: Floats) -> Any:
    return sdk.TimeColumn(TIME_LINE, duration=time_s)
