"""The flight file: TOML in, one validated immutable `Flight` out. Unknown keys are refused, nothing is guessed."""

from pipeline.flight.read import flight_of, read_flight
from pipeline.flight.settings import (
    AUTO,
    CAMERA_EVENT,
    CameraSettings,
    Flight,
    GroundSettings,
    LandmarkSettings,
    Mark,
    MountSettings,
    SolveSettings,
    StillPose,
    TargetSettings,
    VideoArea,
)

__all__ = [
    "AUTO",
    "CAMERA_EVENT",
    "CameraSettings",
    "Flight",
    "GroundSettings",
    "LandmarkSettings",
    "Mark",
    "MountSettings",
    "SolveSettings",
    "StillPose",
    "TargetSettings",
    "VideoArea",
    "flight_of",
    "read_flight",
]
