"""A scene's measurements without a video: noisy image tracks and noisy camera poses, drawn from a seed.

    pixel      x = x_true + N(0, pixel)                                    per axis
    rotation   cam_from_enu (true) = exp(b + e_f) cam_from_enu (measured)  b once, e_f per frame, camera axes
    position   C (measured) = C_true - (p + q_f)                           p once, q_f per frame, ENU

For Monte Carlo studies of the solver; the noise of the paper's section 3.1 is `PAPER_HIGH`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calibration.camera import pixel_from_ray, unproject
from calibration.foundation.arrays import Floats, Ints
from pipeline.geometry import rotation
from pipeline.records import (
    LOST,
    REACQUIRED,
    TRACKED,
    CameraInput,
    ImageTrack,
    InstrumentSigma,
    PoseTrack,
    Problem,
    SightRays,
    TargetInput,
    Trajectory,
    Truth,
)
from pipeline.synthetic.scene import Scene, SceneCamera, camera_pose, pixels_of, visible


@dataclass(frozen=True, kw_only=True)
class Noise:
    """One sigma per axis of everything that is measured.

    offset_s          of the given time offset; None: the user says what the scene says, with no error and no prior
    frame_rate        relative error of the given frame rates, on top of what the scene says
    frame_rate_prior  relative sigma that the solver is told
    """

    pixel_px: float = 1.0
    attitude_bias_rad: float = 0.0
    attitude_rad: float = 0.0
    position_bias_m: float = 0.0
    position_m: float = 0.0
    offset_s: float | None = None
    frame_rate: float = 0.0
    frame_rate_prior: float = 0.01

    @property
    def instruments(self) -> InstrumentSigma:
        """The same as priors."""
        return InstrumentSigma(
            attitude_bias_rad=self.attitude_bias_rad,
            attitude_rad=self.attitude_rad,
            position_bias_m=self.position_bias_m,
            position_m=self.position_m,
            pixel_px=self.pixel_px,
            offset_s=self.offset_s,
            frame_rate=self.frame_rate_prior,
        )


HALF_DEGREE = float(np.radians(0.5))
PAPER_HIGH = Noise(
    pixel_px=2.0,
    attitude_bias_rad=HALF_DEGREE,
    attitude_rad=HALF_DEGREE,
    position_bias_m=3.0,
    position_m=1.0,
    frame_rate_prior=0.1,
)
PAPER_LOW = Noise(
    pixel_px=1.0,
    attitude_bias_rad=HALF_DEGREE / 5,
    attitude_rad=HALF_DEGREE / 5,
    position_bias_m=0.6,
    position_m=0.2,
    frame_rate_prior=0.1,
)
DEMO = Noise(
    pixel_px=0.5,
    attitude_bias_rad=float(np.radians(0.4)),
    attitude_rad=float(np.radians(0.1)),
    position_bias_m=1.5,
    position_m=0.2,
    frame_rate_prior=0.002,
)


def simulate(scene: Scene, *, noise: Noise, seed: int) -> tuple[Problem, Truth]:
    """Draw one flight.

    Returns what the solver is asked and what is true. The reference camera's clock has no error. The same seed
    gives the same numbers; each camera draws from its own stream, so adding one does not change the others.
    """
    truth = true_flight(scene)
    streams = np.random.SeedSequence(seed).spawn(len(scene.cameras))
    cameras = tuple(
        _camera_input(scene, index, truth, noise, np.random.default_rng(stream)) for index, stream in enumerate(streams)
    )
    targets = tuple(
        TargetInput(
            target=t.name, motion=t.motion.kind, order=t.motion.degree if t.motion.kind == "polynomial" else "auto"
        )
        for t in scene.targets
    )
    return Problem(cameras=cameras, targets=targets, reference_camera=scene.cameras[0].name), truth


@lru_cache(maxsize=8)
def true_flight(scene: Scene, rate_hz: float = 20.0) -> Truth:
    """What is true of a scene; trajectories sampled at `rate_hz` over the time of all cameras."""
    return Truth(
        trajectories=tuple(_true_trajectory(scene, i, rate_hz) for i in range(len(scene.targets))),
        offset_s={c.name: c.offset_s for c in scene.cameras},
        frame_rate={c.name: c.frame_rate for c in scene.cameras},
        poses=tuple(true_poses(c) for c in scene.cameras),
        tracks=tuple(true_track(scene, c, i) for c in scene.cameras for i in range(len(scene.targets))),
        focal_px={c.name: float(c.lens.K[0, 0]) for c in scene.cameras},
    )


def true_poses(camera: SceneCamera) -> PoseTrack:
    """The camera's pose at every frame; `time_s` is common time."""
    frame = np.arange(camera.frames)
    position, enu_from_cam = camera_pose(camera.platform, camera.frame_time_s(frame))
    return PoseTrack(
        camera=camera.name,
        frame=frame,
        time_s=camera.frame_time_s(frame),
        position_enu_m=position,
        enu_from_cam=enu_from_cam,
    )


def true_track(scene: Scene, camera: SceneCamera, target_index: int) -> ImageTrack:
    """Where the target's reference point is in every frame; lost where it is hidden or outside the image."""
    target = scene.targets[target_index]
    frame = np.arange(camera.frames)
    points = target.motion.position_enu_m(camera.frame_time_s(frame))
    pixels, centre = pixels_of(camera, frame, points)
    seen = visible(scene, camera, pixels, centre, points)
    again = seen & ~np.concatenate([[True], seen[:-1]])
    return ImageTrack(
        camera=camera.name,
        target=target.name,
        frame=frame,
        time_s=frame / camera.nominal_rate,
        xy_px=np.where(seen[:, None], pixels, np.nan),
        sigma_px=np.where(seen, 0.0, np.nan),
        state=np.where(seen, np.where(again, REACQUIRED, TRACKED), LOST),
    )


def _true_trajectory(scene: Scene, target_index: int, rate_hz: float) -> Trajectory:
    target = scene.targets[target_index]
    start, end = scene.span_s
    time = np.linspace(start, end, int(np.ceil((end - start) * rate_hz)) + 1)
    return Trajectory(
        target=target.name,
        time_s=time,
        position_enu_m=target.motion.position_enu_m(time),
        velocity_mps=target.motion.position_enu_m(time, 1),
        covariance=np.zeros((len(time), 3, 3)),
    )


def _camera_input(scene: Scene, index: int, truth: Truth, noise: Noise, rng: np.random.Generator) -> CameraInput:
    camera = scene.cameras[index]
    rate, offset = camera.nominal_rate, camera.given_offset_s
    wrong_rate, wrong_offset = rng.normal(size=2)
    if index > 0:
        rate *= 1 + noise.frame_rate * wrong_rate
        if noise.offset_s is not None:
            offset = camera.offset_s + noise.offset_s * wrong_offset
    tracks = [t for t in truth.tracks if t.camera == camera.name]
    rays = noisy_rays(camera, tracks, rate, noise.pixel_px, rng)
    poses = noisy_poses(truth.poses[index], np.unique(rays.frame), rate, noise, rng)
    return CameraInput(
        camera=camera.name,
        rays=rays,
        poses=poses,
        frame_rate=rate,
        offset_s=0.0 if index == 0 else offset,
        sigma=noise.instruments,
        clock="affine",
    )


def noisy_rays(
    camera: SceneCamera, tracks: list[ImageTrack], rate_hz: float, pixel_px: float, rng: np.random.Generator
) -> SightRays:
    """Sight rays of true tracks with white pixel noise, the lens removed; video time is frame / `rate_hz`."""
    frame = np.concatenate([t.frame[t.seen] for t in tracks])
    target = np.concatenate([np.full(int(t.seen.sum()), i) for i, t in enumerate(tracks)])
    pixels = np.concatenate([t.xy_px[t.seen] for t in tracks])
    pixels = pixels + pixel_px * rng.normal(size=pixels.shape)
    order = np.lexsort((target, frame))
    direction = unproject(camera.lens, pixels[order])
    return SightRays(
        camera=camera.name,
        targets=tuple(t.target for t in tracks),
        target=target[order],
        frame=frame[order],
        time_s=frame[order] / rate_hz,
        direction_cam=direction,
        pixel_from_ray=pixel_from_ray(camera.lens, direction),
        sigma_px=np.full(len(frame), pixel_px),
    )


def noisy_poses(true: PoseTrack, frames: Ints, rate_hz: float, noise: Noise, rng: np.random.Generator) -> PoseTrack:
    """Measured poses of the frames that saw something."""
    rotation_bias = noise.attitude_bias_rad * rng.normal(size=3)
    position_bias = noise.position_bias_m * rng.normal(size=3)
    turn = rotation_bias + noise.attitude_rad * rng.normal(size=(len(true.frame), 3))
    shift = position_bias + noise.position_m * rng.normal(size=(len(true.frame), 3))
    keep = np.isin(true.frame, frames)
    return PoseTrack(
        camera=true.camera,
        frame=true.frame[keep],
        time_s=true.frame[keep] / rate_hz,
        position_enu_m=(true.position_enu_m - shift)[keep],
        enu_from_cam=disturbed(true.enu_from_cam, turn)[keep],
    )


def disturbed(enu_from_cam: Floats, turn_cam_rad: Floats) -> Floats:
    """The measured attitude (n, 4) whose true cam_from_enu is exp(turn) times the measured one."""
    return rotation.normalised(rotation.multiply(enu_from_cam, rotation.exp(turn_cam_rad)))
