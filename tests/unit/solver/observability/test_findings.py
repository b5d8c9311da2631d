"""Every degenerate scene is named or refused, and its well-posed neighbour is not."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import GeometryError
from pipeline.geometry import rotation
from pipeline.records import (
    CameraInput,
    Clock,
    Finding,
    InstrumentSigma,
    PoseTrack,
    Problem,
    SightRays,
    SolverSettings,
    TargetInput,
)
from pipeline.solver.observability.findings import find_degeneracies

Path = Callable[[Floats], Floats]
FOCAL_PX = 1000.0
SIGMA = InstrumentSigma(
    attitude_bias_rad=np.radians(0.2),
    attitude_rad=np.radians(0.1),
    position_bias_m=1.0,
    position_m=0.2,
    pixel_px=1.0,
    frame_rate=0.01,
)


def poly(*coefficients: Sequence[float]) -> Path:
    rows = np.array(coefficients, float)
    return lambda t: (np.asarray(t, float)[:, None] ** np.arange(len(rows))) @ rows


@dataclass(frozen=True)
class Cam:
    path: Path
    offset_s: float = 0.0
    start_s: float = 0.0
    sees: tuple[int, ...] | None = None
    sigma: InstrumentSigma = SIGMA
    tell_offset: bool = False


def camera(cam: Cam, name: str, targets: Sequence[Path], seed: int, seconds: float = 10.0) -> CameraInput:
    rng = np.random.default_rng(seed)
    frame = np.arange(round(seconds * 10)) + round(cam.start_s * 10)
    time = frame / 10 + cam.offset_s
    centre = cam.path(time)
    chosen = tuple(range(len(targets))) if cam.sees is None else cam.sees
    points = np.stack([targets[i](time) for i in chosen], axis=1)
    forward = points.mean(axis=1) - centre
    yaw = np.arctan2(forward[:, 0], forward[:, 1])
    pitch = np.arctan2(forward[:, 2], np.hypot(forward[:, 0], forward[:, 1]))
    attitude = rotation.enu_from_cam(rotation.ned_from_frd(yaw, pitch, 0 * yaw))
    seen = rotation.rotate(rotation.conjugate(attitude)[:, None], points - centre[:, None])
    n, k = len(frame), len(chosen)
    flat = seen[..., :2] / seen[..., 2:] + rng.normal(0, cam.sigma.pixel_px / FOCAL_PX, (n, k, 2))
    ray = np.concatenate([flat, np.ones((n, k, 1))], axis=2).reshape(-1, 3)
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    x, y, z = ray.T
    zero = 0 * x
    jacobian = FOCAL_PX * np.stack([np.stack([1 / z, zero, -x / z**2], 1), np.stack([zero, 1 / z, -y / z**2], 1)], 1)
    turn = rng.normal(0, cam.sigma.attitude_bias_rad, 3) + rng.normal(0, cam.sigma.attitude_rad, (n, 3))
    shift = rng.normal(0, cam.sigma.position_bias_m, 3) + rng.normal(0, cam.sigma.position_m, (n, 3))
    return CameraInput(
        camera=name,
        rays=SightRays(
            camera=name,
            targets=tuple(f"t{i}" for i in chosen),
            target=np.tile(np.arange(k), n),
            frame=np.repeat(frame, k),
            time_s=np.repeat(frame, k) / 10,
            direction_cam=ray,
            pixel_from_ray=jacobian,
            sigma_px=np.full(n * k, cam.sigma.pixel_px),
        ),
        poses=PoseTrack(
            camera=name,
            frame=frame,
            time_s=frame / 10,
            position_enu_m=centre + shift,
            enu_from_cam=rotation.multiply(attitude, rotation.exp(turn)),
        ),
        frame_rate=10.0,
        offset_s=cam.offset_s if cam.tell_offset else None,
        sigma=cam.sigma,
    )


def scene(cams: Sequence[Cam], targets: Sequence[Path], order: int | None = 1) -> Problem:
    return Problem(
        cameras=tuple(camera(c, f"cam{i}", targets, i) for i, c in enumerate(cams)),
        targets=tuple(
            TargetInput(target=f"t{i}", motion="spline") if order is None else TargetInput(target=f"t{i}", order=order)
            for i in range(len(targets))
        ),
        reference_camera="cam0",
    )


def solved(cams: Sequence[Cam]) -> tuple[Clock, ...]:
    return tuple(
        Clock(
            camera=f"cam{i}",
            offset_s=c.offset_s,
            frame_rate=10.0,
            nominal_rate=10.0,
            offset_sigma_s=0.0,
            frame_rate_sigma=0.0,
        )
        for i, c in enumerate(cams)
    )


def kinds(findings: Sequence[Finding]) -> set[str]:
    return {f.kind for f in findings}


MAP = SolverSettings()
CAR = poly([0, 0, 0], [8, 3, 0])
VAN = poly([20, 10, 0], [-4, 7, 0])
STILL_WEST = poly([-200, 0, 80])
STILL_SOUTH = poly([0, -200, 60])
STRAIGHT = poly([-150, -80, 100], [3, 12, 0])
CURVED = poly([-150, -80, 100], [3, 12, 0], [1.5, -0.8, 0.6])


def test_time_gauge_is_always_named_with_the_camera_that_holds_it() -> None:
    findings = find_degeneracies(scene([Cam(CURVED), Cam(STILL_SOUTH)], [CAR]), MAP)
    gauge = next(f for f in findings if f.kind == "time-gauge")
    assert "cam0" in gauge.words
    assert gauge.carried_by


@pytest.mark.parametrize(
    ("path", "target", "words"),
    [
        (STRAIGHT, CAR, "no less simply than the target"),
        (STILL_WEST, CAR, "one point"),
        (poly([-150, -80, 100], [8, 3, 0]), CAR, "parallel"),
        (poly([-200, -75, 0]), poly([0, 0, 0], [8, 3, 0]), "parallel"),
    ],
    ids=["camera order", "still camera", "parallel rays", "along the ray"],
)
def test_a_single_camera_that_cannot_know_the_distance_is_refused(path: Path, target: Path, words: str) -> None:
    with pytest.raises(GeometryError, match=words) as caught:
        find_degeneracies(scene([Cam(path)], [target]), MAP)
    assert caught.value.exit_code == 5
    assert caught.value.where == "target t0"


def test_rays_through_one_point_are_refused_though_the_camera_curves() -> None:
    point = np.array([0.0, 0.0, 30.0])

    def through(t: Floats) -> Floats:
        away = CAR(t) - point + np.array([0, 0, -30.0])
        return point - (2 + 0.1 * np.sin(t))[:, None] * away

    with pytest.raises(GeometryError, match="one point"):
        find_degeneracies(scene([Cam(through)], [poly([0, 0, 0], [8, 3, 0])]), MAP)


def test_a_single_camera_that_curves_is_enough() -> None:
    assert kinds(find_degeneracies(scene([Cam(CURVED)], [CAR]), MAP)) == set()


def test_a_second_camera_makes_each_of_them_well_posed() -> None:
    for path in (STRAIGHT, STILL_WEST):
        problem = scene([Cam(path), Cam(STILL_SOUTH, tell_offset=True)], [CAR, VAN])
        assert "time-gauge" in kinds(find_degeneracies(problem, MAP))


def test_a_spline_needs_two_cameras_at_one_time() -> None:
    with pytest.raises(GeometryError, match="only cam0 sees it"):
        find_degeneracies(scene([Cam(CURVED)], [CAR], order=None), MAP)
    known = replace(SIGMA, offset_s=0.1)
    apart = scene([Cam(CURVED), Cam(STILL_SOUTH, offset_s=30.0, tell_offset=True, sigma=known)], [CAR], order=None)
    with pytest.raises(GeometryError, match="at the same time"):
        find_degeneracies(apart, MAP)
    together = scene([Cam(CURVED), Cam(STILL_SOUTH, offset_s=3.0, tell_offset=True, sigma=known)], [CAR], order=None)
    find_degeneracies(together, MAP)


def flat(height_m: float) -> list[Cam]:
    return [Cam(poly([-200, 0, 0])), Cam(poly([0, -200, height_m]))]


def test_coplanar_rays_lean_on_the_rate_and_are_refused_without_it() -> None:
    cams = flat(0.0)
    findings = find_degeneracies(scene(cams, [CAR]), MAP, clocks=solved(cams))
    plane = next(f for f in findings if f.kind == "coplanar-rays")
    assert plane.subject == "cam1"
    assert "sigma.frame_rate" in plane.carried_by
    with pytest.raises(GeometryError, match="one plane"):
        find_degeneracies(scene(cams, [CAR]), replace(MAP, method="algorithm-1"), clocks=solved(cams))
    with pytest.raises(GeometryError, match="one plane"):
        find_degeneracies(scene(cams, [CAR], order=None), MAP, clocks=solved(cams))


def test_cameras_at_different_heights_are_not_coplanar() -> None:
    cams = flat(80.0)
    for method in ("map", "algorithm-1"):
        findings = find_degeneracies(scene(cams, [CAR, VAN]), replace(MAP, method=method), clocks=solved(cams))
        assert "coplanar-rays" not in kinds(findings)


def test_two_still_cameras_may_turn_about_their_base_line() -> None:
    findings = find_degeneracies(scene([Cam(STILL_WEST), Cam(STILL_SOUTH)], [CAR]), MAP)
    line = next(f for f in findings if f.kind == "rotation-about-base-line")
    assert "attitude_bias" in line.carried_by
    held = replace(SIGMA, attitude_bias_rad=0.0, attitude_rad=0.0)
    exact = scene([Cam(STILL_WEST, sigma=held), Cam(STILL_SOUTH, sigma=held)], [CAR])
    assert "rotation-about-base-line" not in kinds(find_degeneracies(exact, MAP))
    three = scene([Cam(STILL_WEST), Cam(STILL_SOUTH), Cam(poly([150, 150, 40]))], [CAR])
    assert "rotation-about-base-line" not in kinds(find_degeneracies(three, MAP))
    moving = scene([Cam(CURVED), Cam(STILL_SOUTH)], [CAR])
    assert "rotation-about-base-line" not in kinds(find_degeneracies(moving, MAP))


def test_constant_velocity_trades_offset_and_position() -> None:
    cams = [Cam(CURVED), Cam(STILL_SOUTH, offset_s=2.0)]
    findings = find_degeneracies(scene(cams, [CAR]), MAP, clocks=solved(cams))
    trade = next(f for f in findings if f.kind == "offset-and-position")
    assert trade.subject == "cam1"
    assert "sigma.position_bias_m" in trade.carried_by


def test_turning_targets_tell_the_time() -> None:
    turning = [poly([0, 0, 0], [8, 3, 0], [-1.5, 1.0, 0]), poly([20, 10, 0], [-4, 7, 0], [1.0, 1.5, 0])]
    cams = [Cam(CURVED), Cam(STILL_SOUTH, offset_s=2.0)]
    findings = find_degeneracies(scene(cams, turning, order=2), MAP, clocks=solved(cams))
    assert "offset-and-position" not in kinds(findings)


def test_an_offset_that_nothing_tells_is_refused_or_carried_by_its_prior() -> None:
    straight_at_it = poly([0, 0, 0], [0, -6, 0])
    watcher = Cam(poly([0, -200, 0]), offset_s=1.0, sees=(0,))
    cams = [Cam(CURVED), watcher]
    with pytest.raises(GeometryError, match="offset is known to"):
        find_degeneracies(scene(cams, [straight_at_it]), MAP, clocks=solved(cams))
    known = [cams[0], replace(watcher, tell_offset=True, sigma=replace(SIGMA, offset_s=0.1))]
    findings = find_degeneracies(scene(known, [straight_at_it]), MAP, clocks=solved(known))
    assert "offset-from-prior" in kinds(findings)


def test_too_few_equations_are_counted() -> None:
    problem = scene([Cam(CURVED), Cam(STILL_SOUTH)], [CAR])
    with pytest.raises(GeometryError, match="algorithm-2"):
        find_degeneracies(problem, replace(MAP, method="algorithm-2"))
    two = scene([Cam(CURVED), Cam(STILL_SOUTH)], [CAR, VAN])
    find_degeneracies(two, replace(MAP, method="algorithm-2"))
    unseen = replace(problem, targets=(*problem.targets, TargetInput(target="t1", order=1)))
    with pytest.raises(GeometryError, match="target t1"):
        find_degeneracies(unseen, MAP)


def test_cameras_without_a_common_target_are_refused() -> None:
    problem = scene([Cam(CURVED, sees=(0,)), Cam(STILL_SOUTH, sees=(1,))], [CAR, VAN])
    with pytest.raises(GeometryError, match="target in common"):
        find_degeneracies(problem, MAP)
