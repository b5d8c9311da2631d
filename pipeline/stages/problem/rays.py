"""Image tracks as sight rays: the lens taken away, pose and clock not yet applied (paper eq. 4 before R)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.camera import CameraModel, pixel_from_ray, unproject
from calibration.foundation.arrays import Floats
from calibration.foundation.errors import InputFileError
from pipeline.flight import Flight
from pipeline.records import ImageTrack, SightRays


def sight_rays(
    model: CameraModel, camera: str, tracks: Sequence[ImageTrack], targets: tuple[str, ...]
) -> tuple[SightRays, int]:
    """The sight rays of one camera (paper eq. 4 before R), and how many fixes no direction maps to."""
    frame = np.concatenate([t.frame[t.seen] for t in tracks])
    target = np.concatenate([np.full(t.seen.sum(), targets.index(t.target)) for t in tracks])
    order = np.lexsort((target, frame))
    time, pixel, sigma = (
        np.concatenate([getattr(t, name)[t.seen] for t in tracks])[order] for name in ("time_s", "xy_px", "sigma_px")
    )
    direction = unproject(model, pixel)
    good = np.isfinite(direction).all(axis=1)
    rays = SightRays(
        camera=camera,
        targets=targets,
        target=target[order][good],
        frame=frame[order][good],
        time_s=time[good],
        direction_cam=direction[good],
        pixel_from_ray=pixel_from_ray(model, direction[good]),
        sigma_px=sigma[good],
        row=row_fractions(model, pixel[good]),
    )
    return rays, int((~good).sum())


def row_fractions(model: CameraModel, xy_px: Floats) -> Floats | None:
    """Where rows are in the picture (n,), -1/2 at the first and 1/2 at the last; None where its height is unknown."""
    height = model.image_size[1]
    return None if height < 2 else xy_px[:, 1] / (height - 1) - 0.5


OUTSIDE = 0.05
"""Share of a side by which a target's middle may be outside: half of a large target that leaves the picture. Tracks
made in a picture a tenth larger are found where a target comes near its border."""


def check_inside(flight: Flight, model: CameraModel, tracks: Sequence[ImageTrack]) -> None:
    """Raises InputFileError where a fix lies outside of the image that the camera was calibrated for."""
    width, height = model.image_size
    if not width or not height:
        return
    for track in tracks:
        xy = track.xy_px
        margin = OUTSIDE * np.array([width, height])
        out = track.seen & ((xy < -margin) | (xy > np.array([width, height]) + margin)).any(axis=1)
        if out.any():
            row = int(np.flatnonzero(out)[0])
            camera = flight.camera(track.camera)
            raise InputFileError(
                where=f"{camera.tracks or camera.video}: target {track.target}, frame {track.frame[row]}",
                seen=f"({xy[row, 0]:.1f}, {xy[row, 1]:.1f}) px",
                expected=f"a place in the {width} x {height} image that {camera.calibration.name} was made for",
                advice="check that calibration and tracks are of the same camera, and of the same image size",
            )
