"""Random flights with unknown clocks: how often does the global search find the right basin, and in what time?

usage: python -m scripts.validation.check_offset_search [--scenes 100] [--first-seed 0] [--verbose]

Each flight: two moving cameras on curved paths about 300 m from one to four targets that move as polynomials of order
1 or 2; 20 s at 10 to 25 Hz; the tracks overlap by at least a third; offset uniform in +-60 s; the second camera's
frame rate is told 5 % wrong; noise of the paper (2 px, 0.5 degrees constant and per frame, 3 m constant, 1 m per
frame). The right basin is the one that polishing reaches from the true clocks: an answer is right where the middle of
the second camera's track is within 50 ms, or three sigmas, of what that reaches (a target on a straight line fixes an
offset only as well as the camera's position is known). Others should at least be flagged as ambiguous.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.geometry import rotation
from pipeline.records import (
    CameraInput,
    InstrumentSigma,
    OffsetCandidate,
    PoseTrack,
    Problem,
    SightRays,
    SolverSettings,
    TargetInput,
)
from pipeline.solver.offset_search.crossing import ClockPrior
from pipeline.solver.offset_search.polynomial_polish import polish_polynomial
from pipeline.solver.offset_search.search import is_ambiguous, search_offsets
from pipeline.solver.offset_search.sweep import ClockRange
from pipeline.solver.offset_search.views import views
from scripts.validation.figures import tell

FOCAL_PX = 1000.0
SIGMA = InstrumentSigma(
    attitude_bias_rad=float(np.radians(0.5)),
    attitude_rad=float(np.radians(0.5)),
    position_bias_m=3.0,
    position_m=1.0,
    pixel_px=2.0,
    frame_rate=0.05,
)


@dataclass(frozen=True, kw_only=True)
class RandomFlight:
    """A problem and the true clock (offset, rate) of its second camera."""

    problem: Problem
    offset_s: float
    frame_rate: float

    def middle_error_s(self, candidate: OffsetCandidate) -> float:
        """Error of the common time at the middle of the second camera's track."""
        camera = self.problem.cameras[1]
        frame = 0.5 * (camera.rays.frame[0] + camera.rays.frame[-1])
        found = frame / candidate.frame_rate[camera.camera] + candidate.offset_s[camera.camera]
        return float(found - frame / self.frame_rate - self.offset_s)

    def from_truth(self) -> tuple[OffsetCandidate, float]:
        """The bottom of the right basin, what polishing reaches from the true clocks, and the sigma of that middle."""
        first, second = self.problem.cameras
        wide = ClockRange(low_s=-1e3, high_s=1e3, clock_scale=0.1)
        fit = polish_polynomial(
            list(views(self.problem).values()),
            [(0.0, 1.0), (self.offset_s, second.frame_rate / self.frame_rate)],
            [None, ClockPrior(clock_scale_sigma=second.sigma.frame_rate, allowed=wide)],
            orders={t.target: int(t.order) for t in self.problem.targets},
        )
        offset, clock_scale = fit.clock[second.camera]
        bottom = OffsetCandidate(
            offset_s={first.camera: 0.0, second.camera: offset},
            frame_rate={first.camera: first.frame_rate, second.camera: second.frame_rate / clock_scale},
            cost=fit.cost,
        )
        return bottom, fit.sigma_s[second.camera]


def random_flight(
    seed: int, *, wrong_rate: float = 0.05, outliers: float = 0.0, order: int | None = None
) -> RandomFlight:
    """Draw one flight; `outliers` is the share of gross errors among the labels, `order` that of the motion."""
    rng = np.random.default_rng(seed)
    duration = 20.0
    degree = int(rng.integers(1, 3)) if order is None else order
    paths = [_target(rng, degree) for _ in range(int(rng.integers(1, 5)))]
    azimuth = rng.uniform(0, 2 * np.pi)
    shift = rng.uniform(-1, 1) * duration * 2 / 3
    wanted = rng.uniform(-60, 60)
    rates = rng.uniform(10, 25, 2)
    told = [rates[0], rates[1] * (1 + wrong_rate * rng.choice([-1, 1]))]
    delay = wanted - shift
    first = [max(round(delay * rates[0]), 0), max(round(-delay * rates[1]), 0)]
    begin = [-first[0] / rates[0], shift - first[1] / rates[1]]
    cameras = []
    for c in range(2):
        frame = first[c] + np.arange(round(duration * rates[c]))
        around = azimuth + (0 if c == 0 else rng.uniform(0.7, 2.4))
        centre = _camera_path(rng, around, frame / rates[c] + begin[c])
        cameras.append(
            _camera(rng, f"uav{c + 1}", frame, frame / rates[c] + begin[c], centre, paths, told[c], outliers)
        )
    problem = Problem(
        cameras=tuple(cameras),
        targets=tuple(TargetInput(target=f"t{n}", order=degree) for n in range(len(paths))),
        reference_camera="uav1",
    )
    return RandomFlight(problem=problem, offset_s=begin[1] - begin[0], frame_rate=float(rates[1]))


def _target(rng: np.random.Generator, degree: int) -> Floats:
    """Coefficients (K + 1, 3) about the middle of the flight at 10 s."""
    heading = rng.uniform(0, 2 * np.pi)
    flat = np.array([np.cos(heading), np.sin(heading), 0.0])
    rows = [rng.uniform(-60, 60, 3) * [1, 1, 0.1], rng.uniform(4, 15) * flat, rng.normal(0, 0.5, 3) * [1, 1, 0.2]]
    return np.array(rows[: degree + 1])


def _camera_path(rng: np.random.Generator, azimuth: float, time_s: Floats) -> Floats:
    """A curve (n, 3) at about 300 m, some 15 m/s."""
    t = time_s - 10
    away = rng.uniform(250, 350)
    angle = azimuth + rng.choice([-1, 1]) * rng.uniform(8, 18) * t / away
    up = rng.uniform(80, 180) + rng.normal(0, 2) * t + rng.normal(0, 0.1) * t**2
    radius = away + rng.normal(0, 3) * t + rng.normal(0, 0.2) * t**2
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), up], axis=1)


def _camera(
    rng: np.random.Generator,
    name: str,
    frame: Floats,
    time_s: Floats,
    centre: Floats,
    paths: list[Floats],
    told_hz: float,
    outliers: float,
) -> CameraInput:
    """What one camera measures of the paths (K + 1, 3) at true times (n,) from true centres (n, 3)."""
    n, k = len(frame), len(paths)
    points = np.stack([((time_s[:, None] - 10) ** np.arange(len(a))) @ a for a in paths], axis=1)
    forward = points.mean(axis=1) - centre
    yaw = np.arctan2(forward[:, 0], forward[:, 1])
    pitch = np.arctan2(forward[:, 2], np.hypot(forward[:, 0], forward[:, 1]))
    attitude = rotation.enu_from_cam(rotation.ned_from_frd(yaw, pitch, np.zeros(n)))
    seen = rotation.rotate(rotation.conjugate(attitude)[:, None], points - centre[:, None])
    flat = seen[..., :2] / seen[..., 2:] + rng.normal(0, SIGMA.pixel_px / FOCAL_PX, (n, k, 2))
    flat += (rng.random((n, k, 1)) < outliers) * rng.normal(0, 0.1, (n, k, 2))
    shown = ((seen[..., 2] > 0) & (np.abs(flat) < 1).all(axis=2)).ravel()
    ray = np.concatenate([flat, np.ones((n, k, 1))], axis=2).reshape(-1, 3)[shown]
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    turn = rng.normal(0, SIGMA.attitude_bias_rad, 3) + rng.normal(0, SIGMA.attitude_rad, (n, 3))
    moved = rng.normal(0, SIGMA.position_bias_m, 3) + rng.normal(0, SIGMA.position_m, (n, 3))
    rays = SightRays(
        camera=name,
        targets=tuple(f"t{i}" for i in range(k)),
        target=np.tile(np.arange(k), n)[shown],
        frame=np.repeat(frame, k)[shown],
        time_s=np.repeat(frame, k)[shown] / told_hz,
        direction_cam=ray,
        pixel_from_ray=_pinhole_jacobian(ray),
        sigma_px=np.full(len(ray), SIGMA.pixel_px),
    )
    poses = PoseTrack(
        camera=name,
        frame=frame,
        time_s=frame / told_hz,
        position_enu_m=centre + moved,
        enu_from_cam=rotation.multiply(attitude, rotation.exp(turn)),
    )
    return CameraInput(camera=name, rays=rays, poses=poses, frame_rate=told_hz, sigma=SIGMA)


def _pinhole_jacobian(ray: Floats) -> Floats:
    """Pixels per radian (m, 2, 3) of a pinhole without distortion."""
    x, y, z = ray.T
    zero = np.zeros(len(ray))
    return FOCAL_PX * np.stack([np.stack([1 / z, zero, -x / z**2], 1), np.stack([zero, 1 / z, -y / z**2], 1)], axis=1)


def main() -> None:
    """Draw, search, count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=100)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--outliers", type=float, default=0.0, help="share of gross errors among the labels")
    parser.add_argument("--verbose", action="store_true")
    given = parser.parse_args()
    right, flagged, silent, seconds, errors = 0, 0, 0, [], []
    for seed in range(given.first_seed, given.first_seed + given.scenes):
        flight = random_flight(seed, outliers=given.outliers)
        begin = time.perf_counter()
        found = search_offsets(flight.problem, SolverSettings())
        seconds.append(time.perf_counter() - begin)
        error = flight.middle_error_s(found[0])
        errors.append(abs(error))
        unsure = is_ambiguous(found)
        best, sigma = flight.from_truth()
        hit = abs(error - flight.middle_error_s(best)) < max(0.05, 3 * sigma)
        right, flagged, silent = right + hit, flagged + unsure, silent + (not hit and not unsure)
        if given.verbose or not hit:
            targets = len(flight.problem.targets)
            told = [(round(flight.middle_error_s(c), 2), round(c.cost, 1)) for c in found[:4]]
            print(
                f"seed {seed}: {targets} targets of order {flight.problem.targets[0].order}, error {error:+.3f} s",
                "ambiguous" if unsure else "",
                told,
                f"from truth {flight.middle_error_s(best):+.3f} +- {sigma:.3f} s at {best.cost:.1f}",
            )
    tell({
        "flights": given.scenes, "right": right, "ambiguous": flagged, "wrong_and_silent": silent,
        "median_error_s": float(np.median(errors)), "seconds_a_flight": float(np.mean(seconds)),
    })  # fmt: skip
    print(f"right basin in {right} of {given.scenes}; {flagged} flagged ambiguous; wrong and not flagged: {silent}")
    print(
        f"error of the middle: median {np.median(errors):.3f} s, 95 % {np.percentile(errors, 95):.3f} s; "
        f"{np.mean(seconds):.2f} s a flight, slowest {max(seconds):.2f} s"
    )


if __name__ == "__main__":
    main()
