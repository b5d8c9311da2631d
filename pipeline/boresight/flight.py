"""Boresight and start of a flight's cameras, against a surveyed still target or a solved flight's trajectories."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import GeometryError, InputFileError, UsageError
from calibration.foundation.progress import Progress, silent
from pipeline.boresight.adjust import Boresight, Known, find_boresight
from pipeline.export.text.csv_reading import read_table
from pipeline.flight import Flight
from pipeline.geometry import rotation
from pipeline.geometry.geodesy import Geodetic, enu_from_geodetic
from pipeline.records import PoseTrack, SightRays
from pipeline.stages.inputs.cameras import read_models
from pipeline.stages.inputs.sources import Sources, open_sources
from pipeline.stages.inputs.tracks import read_tracks
from pipeline.stages.poses.measure import measure_poses
from pipeline.stages.poses.measured import MeasuredPoses
from pipeline.stages.problem.build import poses_of
from pipeline.stages.problem.priors import place_sigma_px
from pipeline.stages.problem.rays import sight_rays
from pipeline.telemetry import is_pose_table

LEAST_FRAMES = 10
VAGUE_DEG = 5.0
DEFAULT_START_SIGMA_S = 1.0
REPAIR = "run `runningfix solve` again, or name a surveyed target with --still and --at"


@dataclass(frozen=True, kw_only=True)
class Surveyed:
    """A target that stood still at a known place: degrees, metres above the ellipsoid, sigma per axis."""

    target: str
    latitude_deg: float
    longitude_deg: float
    height_m: float
    sigma_m: float = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraBoresight:
    """One camera's answer.

    found        in camera axes
    angles_deg   (3,) roll, pitch, yaw of the mount as they should be in the flight file; of a pose table or a still
                 camera, which have no mount: of the correction itself
    covariance_deg2 (3, 3) of them
    key          what `angles_deg` are in the flight file: "mount", of a gimbal "mount_correction"; else "correction"
    start_s      `start` as it should be in the flight file, where that is a number
    """

    camera: str
    found: Boresight
    angles_deg: Floats
    covariance_deg2: Floats
    key: str
    start_s: float | None
    frames: int


def boresights(
    flight: Flight, out: Path, surveyed: Surveyed | None = None, *, progress: Progress = silent
) -> tuple[CameraBoresight, ...]:
    """Every camera that sees the surveyed target, or, without one, the targets of the flight solved in `out`.

    Raises UsageError (no such target), InputFileError (no solved flight), GeometryError (an angle is undetermined).
    """
    tracks = read_tracks(flight, out)
    sources = open_sources(flight)
    measured = measure_poses(flight, sources, tuple(t for t in tracks if flight.camera(t.camera).tracks is not None))
    known = _known_places(flight, out, sources, surveyed, {t.target for t in tracks})
    models, found = read_models(flight), []
    for number, pose in enumerate(measured):
        own = [t for t in tracks if t.camera == pose.camera and t.target in known and t.seen.any()]
        if own:
            names = tuple(dict.fromkeys(t.target for t in own))
            rays, _ = sight_rays(models[pose.camera], pose.camera, own, names)
            found.append(_boresight(flight, pose, rays, known, _clock(flight, out, pose, surveyed)))
        progress("boresight", number + 1, len(measured))
    if not found:
        raise GeometryError(
            where=str(flight.path),
            seen=f"no camera that sees {', '.join(sorted(known))}",
            expected="fixes of a target whose place is known",
            advice="look at tracks.csv: was the target lost at once?",
        )
    return tuple(found)


def _known_places(
    flight: Flight, out: Path, sources: Sources, surveyed: Surveyed | None, seen: set[str]
) -> dict[str, tuple[Floats, Floats, float]]:
    """Target -> (common times (k,), ENU places (k, 3), sigma of the whole); a single time for a still target."""
    if surveyed is None:
        return _solved_places(out)
    if surveyed.target not in seen:
        raise UsageError(
            where="--still",
            seen=repr(surveyed.target),
            expected=f"a tracked target ({', '.join(sorted(seen))})",
            advice="use a name of the tracks' target column",
        )
    origin = sources.origin
    if origin is None:
        raise UsageError(
            where=f"{flight.path}: flight.origin",
            seen="missing, and no log to take it from",
            expected="the origin of the ENU frame",
            advice="write origin = { lat = 28.2, lon = 112.9, height = 60.0 }",
        )
    place = Geodetic(
        lat_rad=float(np.radians(surveyed.latitude_deg)),
        lon_rad=float(np.radians(surveyed.longitude_deg)),
        height_m=surveyed.height_m,
    )
    enu = enu_from_geodetic(np.array(place.lat_rad), np.array(place.lon_rad), np.array(place.height_m), origin)
    return {surveyed.target: (np.zeros(1), enu[None], surveyed.sigma_m)}


def _solved_places(out: Path) -> dict[str, tuple[Floats, Floats, float]]:
    path = out / "trajectory.csv"
    axes = ("east_m", "north_m", "up_m")
    variances = ("cov_ee", "cov_nn", "cov_uu")
    table = read_table(path, needed=("target", "time_s", *axes, *variances), what="the trajectories of a solved flight")
    target = table.texts("target")
    number = {name: table.floats(name, advice=REPAIR) for name in ("time_s", *axes, *variances)}
    found = {}
    for name in dict.fromkeys(target.tolist()):
        mine = target == name
        sigma = float(np.sqrt(np.mean([number[v][mine].mean() for v in variances])))
        found[name] = (number["time_s"][mine], np.stack([number[a][mine] for a in axes], axis=1), sigma)
    return found


def _clock(flight: Flight, out: Path, pose: MeasuredPoses, surveyed: Surveyed | None) -> tuple[float, float]:
    """(offset, frame rate) of a camera in the solved flight."""
    if surveyed is not None:
        return 0.0, pose.frame_rate
    path = out / "timing.csv"
    table = read_table(path, needed=("camera", "offset_s", "frame_rate"), what="the clocks of a solved flight")
    row = np.flatnonzero(table.texts("camera") == pose.camera)
    if not len(row):
        raise InputFileError(
            where=str(path), seen=f"no camera {pose.camera}", expected="every camera of the flight file", advice=REPAIR
        )
    offset, rate = (table.floats(name, advice=REPAIR)[row[0]] for name in ("offset_s", "frame_rate"))
    return float(offset), float(rate)


def _boresight(
    flight: Flight,
    pose: MeasuredPoses,
    rays: SightRays,
    known: Mapping[str, tuple[Floats, Floats, float]],
    clock: tuple[float, float],
) -> CameraBoresight:
    time = rays.time_s * pose.frame_rate / clock[1] + clock[0]
    places, inside = _places_at(rays, known, time)
    rays = rays.some(inside)
    frames = np.unique(rays.frame)
    if len(frames) < LEAST_FRAMES:
        raise GeometryError(
            where=f"{flight.path}: cameras.{pose.camera}",
            seen=f"{len(frames)} frames that see a target whose place is known",
            expected=f"at least {LEAST_FRAMES}",
            advice="take a longer flight past the target",
        )
    camera = flight.camera(pose.camera)
    if camera.tracks is None:
        rays = replace(rays, place_sigma_px=place_sigma_px(flight, camera))
    base = poses_of(flight, pose, frames)
    shifted = pose.poses_at(base) if pose.poses_at is not None else None

    def poses_at(shift_s: float) -> PoseTrack:
        return base if shifted is None else shifted(np.full(len(frames), shift_s))

    start_sigma = camera.sigma.get("start_s", DEFAULT_START_SIGMA_S) if shifted is not None else 0.0
    sigma_m = float(np.mean([known[name][2] for name in rays.targets]))
    found = find_boresight(
        rays, Known(place_enu_m=places[inside], sigma_m=sigma_m), poses_at, pose.sigma, start_sigma_s=start_sigma
    )
    return _answer(flight, pose, found, len(frames), has_mount=shifted is not None and camera.telemetry is not None
                   and not is_pose_table(camera.telemetry))  # fmt: skip


def _places_at(
    rays: SightRays, known: Mapping[str, tuple[Floats, Floats, float]], time_s: Floats
) -> tuple[Floats, Any]:
    """ENU places (m, 3) of what is seen, and which observations lie within the known time."""
    places, inside = np.zeros((len(time_s), 3)), np.zeros(len(time_s), bool)
    for i, name in enumerate(rays.targets):
        mine, (when, where, _) = rays.target == i, known[name]
        inside |= mine & ((len(when) == 1) | ((time_s >= when[0]) & (time_s <= when[-1])))
        for axis in range(3):
            places[mine, axis] = np.interp(time_s[mine], when, where[:, axis])
    return places, inside


def _answer(flight: Flight, pose: MeasuredPoses, found: Boresight, frames: int, *, has_mount: bool) -> CameraBoresight:
    camera = flight.camera(pose.camera)
    corrected = camera.mount.gimbal or camera.mount_correction.given
    mount = None if not has_mount else camera.mount_correction if corrected else camera.mount
    key = "correction" if mount is None else "mount_correction" if corrected else "mount"
    before = np.zeros(3) if mount is None else np.array([mount.yaw_rad, mount.pitch_rad, mount.roll_rad])
    angles, step = _roll_pitch_yaw_deg(before, found.rotation_rad), 1e-5
    ahead, behind = (
        np.stack([_roll_pitch_yaw_deg(before, found.rotation_rad, way * step * axis) for axis in np.eye(3)], axis=1)
        for way in (1, -1)
    )
    J = (ahead - behind) / (2 * step)
    spread = np.degrees(np.sqrt(np.linalg.eigvalsh(found.covariance[:3, :3])[-1]))
    if spread > VAGUE_DEG:
        raise GeometryError(
            where=f"{flight.path}: cameras.{pose.camera}",
            seen=f"a mount angle known only to {spread:.0f} degrees",
            expected=f"{VAGUE_DEG:.0f} degrees or better",
            advice="let the target cross the image, seen from several sides: about the line of sight to a target that "
            "stays in one place of the image nothing is known",
        )
    start = camera.start + found.start_s if isinstance(camera.start, float) and found.covariance[3, 3] > 0 else None
    return CameraBoresight(
        camera=pose.camera, found=found, angles_deg=angles, covariance_deg2=J @ found.covariance[:3, :3] @ J.T,
        key=key, start_s=start, frames=frames,
    )  # fmt: skip


def _roll_pitch_yaw_deg(before_ypr_rad: Floats, w: Floats, more: Floats | None = None) -> Floats:
    """The mount's roll, pitch, yaw (3,) after the camera was turned by w, and then by `more`, in its own axes."""
    turn = rotation.exp(w) if more is None else rotation.multiply(rotation.exp(more), rotation.exp(w))
    was = rotation.ned_from_frd(*(np.array(a) for a in before_ypr_rad))
    cam_as_frd = rotation.CAM_AS_FRD
    now = rotation.multiply(
        was, rotation.multiply(cam_as_frd, rotation.multiply(rotation.conjugate(turn), rotation.conjugate(cam_as_frd)))
    )
    return np.degrees(rotation.yaw_pitch_roll(now))[::-1]


def boresight_document(found: Sequence[CameraBoresight], against: str) -> dict[str, Any]:
    """What `boresight.json` holds."""
    return {"against": against, "cameras": {b.camera: _camera_document(b) for b in found}}


def _camera_document(b: CameraBoresight) -> dict[str, Any]:
    sigma = np.sqrt(np.diag(b.covariance_deg2))
    roll, pitch, yaw = (round(float(a), 6) for a in b.angles_deg)
    time_sigma = float(np.sqrt(b.found.covariance[3, 3]))
    return {
        b.key: {"roll_deg": roll, "pitch_deg": pitch, "yaw_deg": yaw},
        "sigma_deg": [round(float(s), 6) for s in sigma],
        "covariance_deg2": b.covariance_deg2.tolist(),
        "start_shift_s": b.found.start_s if time_sigma > 0 else None,
        "start_shift_sigma_s": time_sigma if time_sigma > 0 else None,
        "start": b.start_s,
        "covariance_rad_s": b.found.covariance.tolist(),
        "frames": b.frames,
        "misfit": round(b.found.misfit, 4),
        "frames_bounded": int((b.found.weight < 1).sum()),
    }
