"""Whether the sights of the first boxes meet, where, at which angle, and what positions can be worth there."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from calibration.camera import CameraModel
from pipeline.flight import Flight
from pipeline.stages.checks.doubt import Doubt
from pipeline.stages.checks.sights import SIGMAS, Sight, angle_between, closest, offset_between, sights_of
from pipeline.stages.poses.measured import MeasuredPoses
from pipeline.telemetry import is_pose_table

NARROW_RAD = math.radians(2.0)
"""Sights that meet at less than this: the distance is worth thirty times less than the direction."""

LEVEL_RAD, DOWN_RAD = math.radians(10.0), math.radians(20.0)
"""A camera that nobody mounted sees its targets this near to the horizon, and the others so much farther down."""


@dataclass(frozen=True, kw_only=True)
class Expected:
    """What a target's position can come to at best, from its first boxes alone: one sigma per axis."""

    target: str
    sigma_m: float
    angle_rad: float


def sight_doubts(flight: Flight, measured: Sequence[MeasuredPoses], models: Mapping[str, CameraModel]) -> list[Doubt]:
    """Doubts about what the cameras look at."""
    sights = sights_of(flight, measured, models)
    missed = _missing_each_other(flight, sights, measured)
    return [
        *missed,
        *_bare_mount(flight, sights),
        *_above_horizon(flight, sights, missed),
        *_narrow(flight, sights, measured),
    ]


def expected_sigmas(
    flight: Flight, measured: Sequence[MeasuredPoses], models: Mapping[str, CameraModel]
) -> list[Expected]:
    """What positions can be worth by the first boxes: the inverse of the sights' information, P / sigma^2 each."""
    found = []
    sights = sights_of(flight, measured, models)
    for target in flight.targets:
        own = [s for s in sights if s.target == target.name]
        pairs = [(a, b, closest(a, b, 0.0)) for a, b in combinations(own, 2)]
        met = [(a, b, near) for a, b, near in pairs if near is not None]
        if not met:
            continue
        a, b, (depth_a, depth_b, _) = met[0]
        middle = (a.origin_m + depth_a * a.direction + b.origin_m + depth_b * b.direction) / 2
        information = np.zeros((3, 3))
        for sight in own:
            across = np.eye(3) - np.outer(sight.direction, sight.direction)
            depth = np.linalg.norm(middle - sight.origin_m)
            information += across / float(sight.across_m(np.array(depth))) ** 2
        angle = max(angle_between(p, q) for p, q, _ in pairs)
        sigma = float(np.sqrt(np.trace(np.linalg.inv(information)) / 3)) if angle > 1e-4 else math.inf
        found.append(Expected(target=target.name, sigma_m=sigma, angle_rad=angle))
    return found


def _missing_each_other(flight: Flight, sights: Sequence[Sight], measured: Sequence[MeasuredPoses]) -> list[Doubt]:
    """Cameras whose sights of the same targets pass each other."""
    found = []
    for one, other in combinations(measured, 2):
        between = offset_between(flight, one, other)
        if between is None:
            continue
        offset, sigma = between
        pairs = [
            (a, b)
            for a, b in product(sights, sights)
            if (a.camera, b.camera) == (one.camera, other.camera) and a.target == b.target
        ]
        missed = []
        for a, b in pairs:
            apart_s = abs(a.time_s - (b.time_s + offset)) + SIGMAS * min(sigma, 1.0)
            near = closest(a, b, apart_s)
            if near is not None and near[2] > 1.0:
                missed.append(a.target)
        if missed:
            found.append(_miss(flight, one, other, missed, len(pairs)))
    return found


def _miss(flight: Flight, one: MeasuredPoses, other: MeasuredPoses, missed: list[str], of: int) -> Doubt:
    every = len(missed) == of
    advice = "look at mount, start and heights of both cameras" if every else "look at the boxes of these targets"
    bare = [m.camera for m in (one, other) if not m.still and not flight.camera(m.camera).mount.given]
    if every and bare:
        advice = f"{' and '.join(bare)} has no mount: does it look forward along the body? Else write mount"
    return Doubt(
        kind="sights-miss",
        subject=(one.camera, other.camera, *missed),
        where=f"{flight.path}: cameras.{one.camera} and cameras.{other.camera}",
        seen=f"their sights of {', '.join(missed)} pass each other: no place fits the first boxes of both",
        expected="first boxes of one target, cameras where their logs have them, turned as their mounts say",
        advice=advice,
    )


def _bare_mount(flight: Flight, sights: Sequence[Sight]) -> list[Doubt]:
    """A camera without a mount whose targets lie along the horizon, while the others look down at them."""
    found = []
    for camera in flight.cameras:
        own = [s.elevation_rad for s in sights if s.camera == camera.name]
        others = [s.elevation_rad for s in sights if s.camera != camera.name]
        if camera.telemetry is None or camera.mount.given or not own or not others or not camera.video:
            continue
        level, below = float(np.median(own)), float(np.median(others))
        if level > -LEVEL_RAD and below < level - DOWN_RAD and not is_pose_table(camera.telemetry):
            found.append(
                Doubt(
                    kind="mount-missing",
                    subject=(camera.name,),
                    where=flight.key(camera.name, "mount"),
                    seen=f"missing: looking along the body its targets are {math.degrees(level):.0f} degrees from the "
                    f"horizon, where the others look {-math.degrees(below):.0f} degrees down",
                    expected="how the camera is turned against the body",
                    advice="write mount with its angles, or mount = { pitch_deg = 0 } if it does look forward",
                )
            )
    return found


def _above_horizon(flight: Flight, sights: Sequence[Sight], missed: Sequence[Doubt]) -> list[Doubt]:
    """A camera that sees all its targets in the sky, where nobody said how it is turned, or others see them below."""
    found = []
    told = {name for doubt in missed for name in doubt.subject}
    for name in dict.fromkeys(s.camera for s in sights):
        own = [s for s in sights if s.camera == name]
        others = [s for s in sights if s.camera != name]
        sure = SIGMAS * max(math.hypot(s.sigma.attitude_bias_rad, s.sigma.attitude_rad) for s in own)
        below = bool(others) and all(s.elevation_rad < -sure for s in others)
        if min(s.elevation_rad for s in own) <= sure or name in told or not below:
            continue
        lowest = math.degrees(min(s.elevation_rad for s in own))
        found.append(
            Doubt(
                kind="above-horizon",
                subject=(name,),
                where=flight.key(name, "mount"),
                seen=f"by log and mount all its targets are {lowest:.0f} degrees or more above the horizon",
                expected="targets below it, as the other cameras see them",
                advice="look at the mount; pitch_deg is negative for a camera that looks down",
            )
        )
    return found


def _narrow(flight: Flight, sights: Sequence[Sight], measured: Sequence[MeasuredPoses]) -> list[Doubt]:
    """Targets that all cameras see from nearly the same direction."""
    found = []
    for target in flight.targets:
        own = [s for s in sights if s.target == target.name]
        angles = [angle_between(a, b) for a, b in combinations(own, 2)]
        if angles and max(angles) < NARROW_RAD:
            found.append(
                Doubt(
                    kind="narrow",
                    subject=(target.name,),
                    where=f"{flight.path}: targets.{target.name}",
                    seen=f"the cameras see it from directions {math.degrees(max(angles)):.1f} degrees apart",
                    expected="at least a few degrees, so that its distance can be known",
                    advice="use a camera that looks from elsewhere, or expect poor distances",
                )
            )
    return found
