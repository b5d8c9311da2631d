"""Priors of what is not exact, where the flight file does not give them: focal length, place on the target, offset."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from calibration.camera import CameraModel
from pipeline.flight import CameraSettings, Flight
from pipeline.records import InstrumentSigma, SightRays
from pipeline.stages.poses.measured import MeasuredPoses

TELLING = 0.2
"""Share of a pixel's sigma below which an error of the focal length is not worth an unknown."""
PLACE_FLOOR_PX, PLACE_SHARE = 0.25, 0.01
"""Place error of a tracked point, one sigma: measured on rendered flights with boxes of 14 to 46 px (docs/tracking.md),
where the constant and the drifting part are both 0.1 to 0.35 px."""


def with_focal(
    sigma: InstrumentSigma, given: Mapping[str, float], model: CameraModel, rays: SightRays
) -> InstrumentSigma:
    """`sigma` with the focal length's own, relative, from the calibration's covariance; what is `given` goes first.

    It stays held where even at the image's corner it moves less than observations can tell.
    """
    if "focal" in given or model.covariance is None:
        return sigma
    share = np.zeros(len(model.covariance))
    share[:2] = 0.5 / model.K[[0, 1], [0, 1]]
    relative = math.sqrt(max(0.0, float(share @ model.covariance @ share)))
    at_corner_px = relative * float(np.hypot(*model.image_size)) / 2
    if at_corner_px < TELLING * float(np.median(rays.sigma_px)):
        return sigma
    return replace(sigma, focal=relative)


def place_sigma_px(flight: Flight, camera: CameraSettings) -> tuple[float, float]:
    """How far a tracker's point may sit from where the other cameras' tracks have it: constant, drifting.

    A box is drawn around a target as this camera sees it, and its look changes with the direction. Detections made
    elsewhere are taken as the same physical point. `sigma.place` says it otherwise.
    """
    given = camera.sigma.get("place_px")
    if given is not None:
        return given, given
    boxes = list(flight.boxes(camera.name).values())
    if camera.tracks is not None or not boxes:
        return 0.0, 0.0
    size = float(np.median([math.sqrt(box.width * box.height) for box in boxes]))
    sigma = math.hypot(PLACE_FLOOR_PX, PLACE_SHARE * size)
    return sigma, sigma


def offset_sigma(settings: CameraSettings, pose: MeasuredPoses, reference: MeasuredPoses) -> InstrumentSigma:
    """The prior of an offset that two UTC times give: what both are worth, where the flight file does not say it."""
    if "offset_s" in settings.sigma or pose.utc_sigma_s is None or reference.utc_sigma_s is None:
        return pose.sigma
    return replace(pose.sigma, offset_s=float(np.hypot(pose.utc_sigma_s, reference.utc_sigma_s)))
