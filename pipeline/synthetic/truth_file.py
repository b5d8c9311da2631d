"""The truth beside a written flight: `truth/truth.json`, read back as a Truth record."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import InputFileError
from calibration.foundation.files import read_bytes, write_whole
from pipeline.records import ImageTrack, PoseTrack, Trajectory, Truth
from pipeline.synthetic.scene import Scene

PLACE = Path("truth") / "truth.json"


def write_truth(folder: Path, scene: Scene, truth: Truth) -> Path:
    """Write the truth of a scene into the flight's folder: metres to 0.1 mm, pixels to 0.0001, quaternions to 1e-10."""
    content = {
        "what": "the true flight: common time is the clock of the first camera, frame 0 at 0; ENU metres at origin",
        "scene": scene.name,
        "origin": {
            "lat": round(float(np.degrees(scene.origin.lat_rad)), 9),
            "lon": round(float(np.degrees(scene.origin.lon_rad)), 9),
            "height": scene.origin.height_m,
        },
        "reference_point": "of each target the centre of its roof; boxes and tracks are of that point",
        "cameras": {c.name: _camera(c.name, truth) for c in scene.cameras},
        "targets": {
            t.target: {
                "motion_order": scene.targets[i].motion.degree,
                "time_s": _plain(t.time_s, 6),
                "position_enu_m": _plain(t.position_enu_m, 4),
                "velocity_mps": _plain(t.velocity_mps, 5),
            }
            for i, t in enumerate(truth.trajectories)
        },
    }
    path = folder / PLACE
    write_whole(path, json.dumps(content, separators=(",", ":"), allow_nan=False) + "\n")
    return path


def _camera(name: str, truth: Truth) -> dict[str, Any]:
    poses = next(p for p in truth.poses if p.camera == name)
    return {
        "offset_s": truth.offset_s[name],
        "frame_rate": truth.frame_rate[name],
        "focal_px": truth.focal_px[name],
        "time_s": _plain(poses.time_s, 6),
        "position_enu_m": _plain(poses.position_enu_m, 4),
        "enu_from_cam": _plain(poses.enu_from_cam, 10),
        "tracks": {
            t.target: {
                "time_s": _plain(t.time_s, 6),
                "state": t.state.tolist(),
                "xy_px": [xy if seen else None for xy, seen in zip(_plain(t.xy_px, 4), t.seen, strict=True)],
            }
            for t in truth.tracks
            if t.camera == name
        },
    }


def _plain(values: Floats, digits: int) -> list[Any]:
    return list(np.round(values, digits).tolist())


def read_truth(folder: Path) -> Truth:
    """The truth of the flight in `folder`.

    Raises InputFileError where there is none or it says something impossible.
    """
    path = folder / PLACE
    raw = read_bytes(path, expected="the truth of a rendered flight")
    try:
        content = json.loads(raw)
        cameras, targets = content["cameras"], content["targets"]
        return Truth(
            trajectories=tuple(_trajectory(name, t) for name, t in targets.items()),
            offset_s={name: float(c["offset_s"]) for name, c in cameras.items()},
            frame_rate={name: float(c["frame_rate"]) for name, c in cameras.items()},
            focal_px={name: float(c["focal_px"]) for name, c in cameras.items()},
            poses=tuple(_poses(name, c) for name, c in cameras.items()),
            tracks=tuple(_track(name, t, row) for name, c in cameras.items() for t, row in c["tracks"].items()),
        )
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputFileError(
            where=str(path),
            seen=f"not a truth file ({type(error).__name__}: {error})",
            expected="what `runningfix demo` wrote there",
            advice="render the flight again",
        ) from None


def _trajectory(name: str, row: dict[str, Any]) -> Trajectory:
    n = len(row["time_s"])
    return Trajectory(
        target=name,
        time_s=np.array(row["time_s"], float),
        position_enu_m=np.array(row["position_enu_m"], float),
        velocity_mps=np.array(row["velocity_mps"], float),
        covariance=np.zeros((n, 3, 3)),
    )


def _poses(name: str, row: dict[str, Any]) -> PoseTrack:
    q = np.array(row["enu_from_cam"], float)
    return PoseTrack(
        camera=name,
        frame=np.arange(len(q)),
        time_s=np.array(row["time_s"], float),
        position_enu_m=np.array(row["position_enu_m"], float),
        enu_from_cam=q / np.linalg.norm(q, axis=1, keepdims=True),
    )


def _track(camera: str, target: str, row: dict[str, Any]) -> ImageTrack:
    xy = np.array([[np.nan, np.nan] if point is None else point for point in row["xy_px"]], float)
    return ImageTrack(
        camera=camera,
        target=target,
        frame=np.arange(len(xy)),
        time_s=np.array(row["time_s"], float),
        xy_px=xy,
        sigma_px=np.where(np.isnan(xy[:, 0]), np.nan, 0.0),
        state=np.array(row["state"], np.int64),
    )
