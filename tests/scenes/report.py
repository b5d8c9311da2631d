"""Made-up but believable Results for the report's tests: cameras fly arcs, targets drive, everything is seeded."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
from scipy.interpolate import make_lsq_spline

from pipeline.geometry import rotation
from pipeline.geometry.geodesy import Geodetic
from pipeline.records import (
    LOST,
    REACQUIRED,
    Bias,
    Clock,
    Comparison,
    Correction,
    Film,
    Finding,
    GroundPicture,
    ImageTrack,
    Motion,
    OffsetCandidate,
    Picture,
    PoseTrack,
    Results,
    Sightings,
    Solution,
    Trajectory,
    Truth,
)
from pipeline.report.views.overhead_map import map_sheets

FOCAL_PX = 1100.0
IMAGE = (1280, 720)
NAMES = ("van", "car red", "lorry", "motorbike", "bus", "tram", "dog", "boat", "taxi", "crane")


def fake_results(
    *,
    targets: int = 4,
    cameras: int = 2,
    seconds: float = 20.0,
    rate_hz: float = 25.0,
    seed: int = 3,
    drift: bool = True,
) -> Results:
    """A flight of `cameras` x `targets` seen for `seconds`, with truth, biases, candidates and a finding."""
    rng = np.random.default_rng(seed)
    frame = np.arange(int(seconds * rate_hz))
    clocks = tuple(_clock(c, rate_hz, frame, drift and c == 1) for c in range(cameras))
    motions = tuple(_motion(n, seconds, rng) for n in range(targets))
    true_poses = tuple(_poses(c, cameras, frame, clocks[c].common_time_s(frame / rate_hz)) for c in range(cameras))
    sights = [_sight(true_poses[c], clocks[c], m, rate_hz, rng) for c in range(cameras) for m in motions]
    names = _shared_names(cameras)
    covariance = _covariance(len(names), rng)
    biases = tuple(_bias(c, rng) for c in range(cameras))
    solution = Solution(
        method="map",
        status="converged",
        message="the step became smaller than 1e-9 of the unknowns",
        iterations=11,
        cost=2016.4,
        chi_square=4071.2,
        degrees_of_freedom=3987,
        clocks=clocks,
        poses=true_poses,
        motions=motions,
        sightings=_joined([s for s, _ in sights]),
        biases=biases,
        corrections=tuple(c for b in biases for c in _corrections(b)),
        findings=(
            Finding(
                kind="time-gauge",
                subject="uav1",
                words="No observation fixes when uav1 started or how fast its clock runs.",
                carried_by="the reference camera's clock is held",
            ),
        ),
        offset_candidates=_candidates(cameras),
        shared_names=names,
        shared_covariance=covariance,
        shared_covariance_robust=covariance * 1.3,
        motions_robust=tuple(dataclasses.replace(m, covariance_band=1.4 * m.covariance_band) for m in motions),
        seconds=0.31,
    )
    trajectories = tuple(_trajectory(m) for m in motions)
    return Results(
        title="Demo: two UAVs over a town",
        solution=solution,
        trajectories=trajectories,
        tracks=tuple(t for _, t in sights),
        measured_poses=tuple(_disturbed(p, rng) for p in true_poses),
        image_size={p.camera: IMAGE for p in true_poses},
        origin=Geodetic.from_degrees(28.2213, 112.9921, 60.0),
        utc_s=1_741_507_200.25,
        inputs={"uav1.tlog": "3f" * 32, "uav1.mp4": "a0" * 32, "camera.json": "77" * 32},
        settings={"solve": {"method": "map", "robust": "huber", "rate_hz": 10}, "flight": {"reference_camera": "uav1"}},
        versions={"runningfix": "0.1.0", "numpy": "2.3.1", "opencv": "5.0.0"},
        warnings=("uav2.tlog: 3 packets fail their checksum and were left out.",),
        pictures=tuple(p for _, t in sights for p in _pictures(t)),
        truth=_truth(trajectories, clocks, true_poses, rng),
        comparison=_comparison(motions, cameras),
    )


def with_films(results: Results) -> Results:
    """The same with a frame a second of each camera, and a striped ground under each map."""
    films = []
    for camera in dict.fromkeys(t.camera for t in results.tracks):
        own = [t for t in results.tracks if t.camera == camera]
        clock = next(c for c in results.solution.clocks if c.camera == camera)
        frames = own[0].frame[:: round(clock.nominal_rate)]
        times = clock.common_time_s(frames / clock.nominal_rate)
        shades = [np.full((90, 160, 3), 40 + 15 * (i % 10), np.uint8) for i in range(len(frames))]
        films.append(
            Film(
                camera=camera, frame=tuple(frames.tolist()), time_s=tuple(times.tolist()), size=(160, 90),
                jpeg=tuple(cv2.imencode(".jpg", shade)[1].tobytes() for shade in shades),
                marks=tuple(
                    tuple((t.target, float(t.xy_px[f, 0] / IMAGE[0]), float(t.xy_px[f, 1] / IMAGE[1]))
                          for t in own if t.seen[f])
                    for f in frames.tolist()
                ),
            )
        )  # fmt: skip
    stripes = np.zeros((60, 80, 4), np.uint8)
    stripes[:, ::4] = (60, 120, 90, 255)
    grounds = tuple(
        GroundPicture(
            west_m=s.west, north_m=s.north, east_m=s.west + s.width / s.scale, south_m=s.north - s.height / s.scale,
            webp=cv2.imencode(".webp", stripes)[1].tobytes(), words="The ground is made of stripes.",
        )
        for s in map_sheets(results)
    )  # fmt: skip
    return dataclasses.replace(results, films=tuple(films), ground_pictures=grounds)


def _clock(c: int, rate_hz: float, frame: np.ndarray, drifts: bool) -> Clock:
    knots = np.linspace(0, frame[-1], 9)
    more = (
        {}
        if not drifts
        else {
            "deviation_frame": knots,
            "deviation_s": 0.004 * np.sin(knots / frame[-1] * 5),
            "deviation_sigma_s": 0.0008 + 0.0004 * np.cos(knots / frame[-1] * 6) ** 2,
        }
    )
    first = c == 0
    return Clock(
        camera=f"uav{c + 1}",
        offset_s=1.6003 * c,
        frame_rate=rate_hz * (1 + 2.1e-4 * c),
        nominal_rate=rate_hz,
        offset_sigma_s=0.0 if first else 0.0041,
        frame_rate_sigma=0.0 if first else 0.0012,
        **more,
    )


def _motion(n: int, seconds: float, rng: np.random.Generator) -> Motion:
    t = np.linspace(0, seconds, 400)
    heading, speed = rng.uniform(0, 2 * np.pi), rng.uniform(4, 14)
    turn = rng.uniform(-1.2, 1.2) * np.sin(2 * np.pi * t / 20) + heading
    start = np.append(rng.uniform(-60, 60, 2), 2.0)
    step = np.stack([np.cos(turn), np.sin(turn), 0.03 * np.cos(t / 3)], axis=1) * (speed * (t[1] - t[0]))
    path = start + np.cumsum(step, axis=0)
    p = max(8, int(seconds / 2.5))
    knots = np.concatenate([[0.0] * 3, np.linspace(0, seconds, p - 2), [seconds] * 3])
    spline = make_lsq_spline(t, path, knots, k=3)
    across = np.array([[0.09, 0.03, 0.01], [0.03, 0.06, 0.02], [0.01, 0.02, 0.14]])
    size = 1 + 2.0 * np.linspace(-1, 1, p) ** 4 + (0.8 * n) * np.exp(-((np.linspace(0, 1, p) - 0.6) ** 2) / 0.01)
    band = np.zeros((p, 4, 3, 3))
    for j in range(4):
        band[: p - j, j] = 0.55**j * np.sqrt(size[: p - j] * size[j:])[:, None, None] * across
    return Motion(
        target=NAMES[n],
        kind="spline",
        degree=3,
        knots_s=knots,
        coefficients=spline.c,
        covariance_band=band,
        start_s=0.0,
        end_s=seconds,
    )


def _poses(c: int, cameras: int, frame: np.ndarray, time_s: np.ndarray) -> PoseTrack:
    angle = 2 * np.pi * c / cameras * 0.4 - 2.2 + 0.02 * time_s
    place = np.stack([290 * np.cos(angle), 250 * np.sin(angle), 95 + 4 * np.sin(time_s / 5) + 10 * c], axis=1)
    yaw = np.arctan2(-place[:, 0], -place[:, 1]) + 0.01 * np.sin(time_s)
    pitch = -np.arctan2(place[:, 2], np.hypot(place[:, 0], place[:, 1]))
    q = rotation.enu_from_cam(rotation.ned_from_frd(yaw, pitch, 0.02 * np.sin(time_s / 2)))
    return PoseTrack(camera=f"uav{c + 1}", frame=frame, time_s=time_s + 1000.0, position_enu_m=place, enu_from_cam=q)


def _disturbed(poses: PoseTrack, rng: np.random.Generator) -> PoseTrack:
    turn = rng.normal(0, np.radians(0.4), 3) + np.cumsum(rng.normal(0, 2e-4, (len(poses.frame), 3)), axis=0)
    return dataclasses.replace(
        poses,
        position_enu_m=poses.position_enu_m + rng.normal(0, 1.5, 3),
        enu_from_cam=rotation.multiply(poses.enu_from_cam, rotation.exp(turn)),
    )


def _sight(
    poses: PoseTrack, clock: Clock, motion: Motion, rate_hz: float, rng: np.random.Generator
) -> tuple[Sightings, ImageTrack]:
    m = len(poses.frame)
    time = clock.common_time_s(poses.frame / rate_hz)
    point = motion.position_enu_m(np.clip(time, motion.start_s, motion.end_s))
    cam = rotation.rotate(rotation.conjugate(poses.enu_from_cam), point - poses.position_enu_m)
    noise = rng.normal(0, 0.4, (m, 2)) * np.where(rng.random(m) < 0.01, 9, 1)[:, None]
    pixel = FOCAL_PX * cam[:, :2] / cam[:, 2:] + (np.array(IMAGE) - 1) / 2 + noise
    hidden_from = int(rng.uniform(0.2, 0.7) * m)
    state = np.zeros(m, int)
    state[hidden_from : hidden_from + m // 15] = LOST
    state[hidden_from + m // 15] = REACQUIRED
    pixel[state == LOST] = np.nan
    track = ImageTrack(
        camera=poses.camera,
        target=motion.target,
        frame=poses.frame,
        time_s=poses.frame / rate_hz,
        xy_px=pixel,
        sigma_px=np.where(state == LOST, np.nan, 0.4),
        state=state,
    )
    keep = track.seen & (time >= motion.start_s) & (time <= motion.end_s)
    size = np.linalg.norm(noise[keep], axis=1) / 0.4
    sightings = Sightings(
        camera=(poses.camera,) * int(keep.sum()),
        target=(motion.target,) * int(keep.sum()),
        frame=poses.frame[keep],
        time_s=time[keep],
        residual_px=noise[keep],
        residual_sigma=size,
        weight=np.minimum(1, 2.5 / np.maximum(size, 1e-9)),
        position_enu_m=point[keep],
    )
    return sightings, track


def _joined(parts: list[Sightings]) -> Sightings:
    arrays = ("frame", "time_s", "residual_px", "residual_sigma", "weight", "position_enu_m")
    return Sightings(
        camera=tuple(c for s in parts for c in s.camera),
        target=tuple(t for s in parts for t in s.target),
        **{name: np.concatenate([getattr(s, name) for s in parts]) for name in arrays},
    )


def _pictures(track: ImageTrack) -> list[Picture]:
    """The first fix, an outlier of 12 px, the last fix before the loss and the first after it."""
    seen, jpeg = np.flatnonzero(track.seen), picture_of_nothing()
    back = int(np.flatnonzero(track.state == REACQUIRED)[0])
    last = int(seen[seen < back][-1])
    found = []
    for kind, at, off in (
        ("first", seen[0], 0.3),
        ("outlier", seen[5], 12.0),
        ("lost", last, 0.2),
        ("found", back, 0.4),
    ):
        x, y = (float(v) for v in track.xy_px[at])
        found.append(
            Picture(
                kind=kind,
                camera=track.camera,
                target=track.target,
                frame=int(track.frame[at]),
                time_s=float(track.time_s[at]),
                jpeg=jpeg,
                size=(64, 64),
                corner_px=(x - 32, y - 32),
                zoom=1.0,
                fix_px=(x, y),
                predicted_px=(x - off, y),
                box_px=(x - 8, y - 6, 16.0, 12.0) if kind == "first" else None,
                residual_px=off,
                residual_sigma=off / 0.4,
                weight=0.083 if kind == "outlier" else 1.0,
            )
        )
    return found


def picture_of_nothing() -> bytes:
    """A JPEG of a shaded square."""
    shade = np.add.outer(np.arange(64), np.arange(64)).astype(np.uint8) + 40
    return cv2.imencode(".jpg", shade)[1].tobytes()


def _shared_names(cameras: int) -> tuple[str, ...]:
    clock = [f"uav{c + 1}.{what}" for c in range(1, cameras) for what in ("offset_s", "frame_rate")]
    pose = [f"uav{c + 1}.{what}_{axis}" for c in range(cameras) for what in ("rotation", "position") for axis in "xyz"]
    return (*clock, *pose)


def _covariance(n: int, rng: np.random.Generator) -> np.ndarray:
    mix = rng.normal(size=(n, n)) + 2 * np.eye(n)
    size = rng.uniform(0.001, 0.3, n)
    return mix @ mix.T / n * np.outer(size, size)


def _bias(c: int, rng: np.random.Generator) -> Bias:
    return Bias(
        camera=f"uav{c + 1}",
        rotation_rad=rng.normal(0, 0.007, 3),
        rotation_sigma_rad=rng.uniform(6e-4, 2e-3, 3),
        position_m=rng.normal(0, 1.5, 3),
        position_sigma_m=rng.uniform(0.2, 0.9, 3),
    )


def _corrections(bias: Bias) -> list[Correction]:
    """Priors of half a degree and of 0.4 m, so that one shift lies beyond three of them."""
    rows = [
        (f"rotation_bias_{a}_rad", "attitude", bias.rotation_rad[i], np.radians(0.5), bias.rotation_sigma_rad[i])
        for i, a in enumerate("xyz")
    ]
    rows += [
        (f"position_bias_{a}_m", "position", bias.position_m[i], 0.4, bias.position_sigma_m[i])
        for i, a in enumerate(("east", "north", "up"))
    ]
    rows.append(("van.place_x_px", "place", 0.31, 0.25, 0.2))
    return [
        Correction(
            camera=bias.camera,
            parameter=f"{bias.camera}.{name}",
            block=block,
            value=float(value),
            prior_sigma=float(prior),
            sigma=float(sigma),
            in_sigmas=float(value / prior),
            beyond=bool(abs(value / prior) > 3),
            chi_square=12.5,
            freedom=3,
        )
        for name, block, value, prior, sigma in rows
    ]


def _candidates(cameras: int) -> tuple[OffsetCandidate, ...]:
    found = ((1.6, 2016.4), (-3.2, 9120.0), (11.7, 14077.1))
    return tuple(
        OffsetCandidate(offset_s={f"uav{c + 1}": offset * c for c in range(cameras)}, cost=cost)
        for offset, cost in found
    )


def _trajectory(motion: Motion) -> Trajectory:
    time = np.linspace(motion.start_s, motion.end_s, round(10 * (motion.end_s - motion.start_s)) + 1)
    return Trajectory(
        target=motion.target,
        time_s=time,
        position_enu_m=motion.position_enu_m(time),
        velocity_mps=motion.position_enu_m(time, 1),
        covariance=motion.position_covariance(time),
    )


def _truth(
    trajectories: tuple[Trajectory, ...],
    clocks: tuple[Clock, ...],
    poses: tuple[PoseTrack, ...],
    rng: np.random.Generator,
) -> Truth:
    def moved(t: Trajectory) -> Trajectory:
        n = len(t.time_s)
        wave = np.sin(t.time_s[:, None] / 4 + rng.uniform(0, 6, 3)) * rng.normal(0, 0.35, 3)
        return dataclasses.replace(t, position_enu_m=t.position_enu_m + wave, covariance=np.zeros((n, 3, 3)))

    return Truth(
        trajectories=tuple(moved(t) for t in trajectories),
        offset_s={c.camera: c.offset_s for c in clocks},
        frame_rate={c.camera: c.frame_rate for c in clocks},
        poses=poses,
    )


def _comparison(motions: tuple[Motion, ...], cameras: int) -> tuple[Comparison, ...]:
    position = [
        Comparison(
            what=f"position of {m.target}", unit="m", before=9.1 + 3 * i, after=0.38 + 0.1 * i, sigma=0.44 + 0.07 * i
        )
        for i, m in enumerate(motions)
    ]
    clock = [
        Comparison(what=f"offset of uav{c + 1}", unit="s", before=1.6, after=0.0031, sigma=0.0041)
        for c in range(1, cameras)
    ]
    rate = [
        Comparison(what=f"frame rate of uav{c + 1}", unit="Hz", before=0.00525, after=0.0009, sigma=0.0012)
        for c in range(1, cameras)
    ]
    turn = [
        Comparison(what=f"orientation of uav{c + 1}", unit="deg", before=0.71, after=0.21 * (1 + c), sigma=0.09)
        for c in range(cameras)
    ]
    return (*position, *clock, *rate, *turn)
