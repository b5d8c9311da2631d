"""Rolling shutters: what a flight file may say of them, and how cameras go on while one is read out."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from calibration.foundation.errors import UsageError
from pipeline.flight import Flight
from pipeline.geometry.pose_rates import pose_rates
from pipeline.records import PoseTrack, SightRays
from pipeline.stages.poses.measured import MeasuredPoses

LONGEST_SHARE = 1.05
"""Of the time from frame to frame: what a readout may last, with room for rounded numbers."""


def rates_of(poses: PoseTrack, frame: Ints) -> Floats:
    """(m, 6) how a camera turns and moves at some of its frames, from all of its poses."""
    return pose_rates(poses.time_s, poses.enu_from_cam, poses.position_enu_m)[np.searchsorted(poses.frame, frame)]


def check_readout(flight: Flight, pose: MeasuredPoses, rays: SightRays) -> None:
    """Raises UsageError where a readout is asked for that cannot be, or whose rows nobody knows."""
    settings = flight.camera(pose.camera)
    if settings.readout_s == 0 and pose.sigma.readout_s == 0:
        return
    if rays.row is None:
        raise UsageError(
            where=flight.key(pose.camera, "readout_s"),
            seen=f"a calibration without the size of its picture ({settings.calibration.name})",
            expected="image_size in the camera file, which says how many rows the readout goes over",
            advice=f'add "image_size": [width, height] to {settings.calibration.name}',
        )
    if abs(settings.readout_s) * pose.frame_rate > LONGEST_SHARE:
        raise UsageError(
            where=flight.key(pose.camera, "readout_s"),
            seen=f"{settings.readout_s:g} s at {pose.frame_rate:g} frames a second",
            expected=f"at most the time from frame to frame, {1 / pose.frame_rate:.4g} s",
            advice="write seconds from the first row to the last; for slow motion give the true frame_rate",
        )
