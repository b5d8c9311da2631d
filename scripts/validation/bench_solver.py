#!/usr/bin/env python3
"""Times the solver against its peers on the same problem: Ceres (automatic differentiation, Schur complement) and Li.

usage: python -m scripts.validation.bench_solver [--peer CERES_MAP] [--sizes 2x50x4,4x1500x4,8x3000x8] [--order 2]
           [--repeats 5] [--li] [--json]

CERES_MAP is a program that reads a problem file and prints one JSON object (seconds, iterations, cost, clock, motion);
where it is missing the table says so. Sizes are cameras x frames x targets. One thread; kernels warm; best of repeats.
The peer starts from the motion that `intersection` finds and the given clocks; ours finds that start itself, inside
its time. Both must end at the same optimum: the table shows how far apart the positions end.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.geometry import rotation
from pipeline.records import CameraInput, InstrumentSigma, PoseTrack, Problem, SightRays, SolverSettings, TargetInput
from pipeline.solver import solve
from scripts.validation.figures import tell

FOCAL_PX, SIGMA_PX, PRINCIPAL_PX = 1000.0, 1.0, (640.0, 360.0)
TURN_RAD, SHIFT_M, BIAS_RAD, BIAS_M = np.radians(0.1), 0.2, np.radians(0.3), 0.5
RATE_HZ = 25.0


@dataclass(frozen=True, kw_only=True)
class Case:
    """One problem: the solver's records, and what the peer's file begins with (all but the first guess)."""

    problem: Problem
    head: tuple[Floats, ...]
    clock: Floats
    middle_s: Floats


def make_case(cameras: int, frames: int, targets: int, order: int, seed: int = 0) -> Case:
    """Cameras on a ring of 250 m that look at targets moving as polynomials; every camera sees every target."""
    rng = np.random.default_rng(seed)
    duration = frames / RATE_HZ
    true = rng.normal(size=(targets, order + 1, 3)) * [20.0, 20.0, 3.0]
    for k in range(1, order + 1):
        true[:, k] = rng.normal(size=(targets, 3)) * [1.0, 1.0, 0.1] * min(8.0 / 4 ** (k - 1), 40.0 / duration**k)
    names = tuple(f"target{n + 1}" for n in range(targets))
    clocks = np.array([[0.0 if c == 0 else rng.uniform(-0.3, 0.3), (1 + 0.002 * rng.normal() * (c > 0)) / RATE_HZ]
                       for c in range(cameras)])  # fmt: skip
    inputs, pixels, turns, places = [], [], [], []
    for c in range(cameras):
        frame = np.arange(frames)
        time = frame * clocks[c, 1] + clocks[c, 0]
        cam_from_enu, centre = _ring(c, cameras, time)
        points = np.einsum("nkj,fk->fnj", true, time[:, None] ** np.arange(order + 1))
        y = np.einsum("fij,fnj->fni", cam_from_enu, points - centre[:, None])
        px = FOCAL_PX * y[..., :2] / y[..., 2:] + SIGMA_PX * rng.normal(size=(frames, targets, 2))
        turn = BIAS_RAD * rng.normal(size=3) + TURN_RAD * rng.normal(size=(frames, 3))
        shift = BIAS_M * rng.normal(size=3) + SHIFT_M * rng.normal(size=(frames, 3))
        measured = np.swapaxes(rotation.matrix(rotation.exp(turn)), 1, 2) @ cam_from_enu
        inputs.append(_camera(f"uav{c + 1}", frame, px, measured, centre - shift, names))
        pixels.append(px)
        turns.append(measured)
        places.append(centre - shift)
    first = np.array([[0.0, 1 / RATE_HZ]] * cameras)
    head = np.zeros(16)
    head[:10] = [cameras, frames, targets, order + 1, FOCAL_PX, SIGMA_PX, TURN_RAD, SHIFT_M, BIAS_RAD, BIAS_M]
    problem = Problem(
        cameras=tuple(inputs),
        targets=tuple(TargetInput(target=n, motion="polynomial", order=order) for n in names),
        reference_camera="uav1",
    )
    parts = (head, np.array(pixels) + PRINCIPAL_PX, np.array(turns), np.array(places))
    return Case(problem=problem, head=parts, clock=first, middle_s=np.linspace(0.0, duration, 21))


def _ring(c: int, cameras: int, time: Floats) -> tuple[Floats, Floats]:
    """Poses of a camera that flies slowly on a ring and looks at the middle."""
    angle = 2 * np.pi * c / cameras * 0.7 + 0.02 * time
    centre = np.stack([250 * np.cos(angle), 250 * np.sin(angle), 90 + 5 * np.sin(0.1 * time + c)], axis=1)
    ahead = -centre / np.linalg.norm(centre, axis=1, keepdims=True)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack([right, np.cross(ahead, right), ahead], axis=1), centre


def _camera(
    name: str, frame: Floats, px: Floats, cam_from_enu: Floats, centre: Floats, names: tuple[str, ...]
) -> CameraInput:
    n_frames, n_targets = px.shape[:2]
    flat = np.concatenate([px.reshape(-1, 2) / FOCAL_PX, np.ones((n_frames * n_targets, 1))], axis=1)
    length = np.linalg.norm(flat, axis=1)
    direction = flat / length[:, None]
    slope = np.zeros((len(flat), 2, 3))
    slope[:, 0, 0] = slope[:, 1, 1] = FOCAL_PX * length
    slope[:, :, 2] = -FOCAL_PX * length[:, None] * flat[:, :2]
    rays = SightRays(
        camera=name, targets=names, target=np.tile(np.arange(n_targets), n_frames), frame=np.repeat(frame, n_targets),
        time_s=np.repeat(frame / RATE_HZ, n_targets), direction_cam=direction, pixel_from_ray=slope,
        sigma_px=np.full(len(flat), SIGMA_PX),
    )  # fmt: skip
    poses = PoseTrack(
        camera=name, frame=frame, time_s=frame / RATE_HZ, position_enu_m=centre,
        enu_from_cam=rotation.conjugate(rotation.from_matrix(cam_from_enu)),
    )  # fmt: skip
    sigma = InstrumentSigma(
        attitude_bias_rad=float(BIAS_RAD), attitude_rad=float(TURN_RAD), position_bias_m=BIAS_M, position_m=SHIFT_M,
        pixel_px=SIGMA_PX, offset_s=None, frame_rate=1e3,
    )  # fmt: skip
    return CameraInput(
        camera=name, rays=rays, poses=poses, frame_rate=RATE_HZ, offset_s=0.0, sigma=sigma, clock="affine"
    )


def ours(case: Case, method: str, repeats: int) -> dict[str, object]:
    """The best time of our solver, and where it ended."""
    settings = SolverSettings(method=method, robust="none")  # type: ignore[arg-type]
    seconds = [solve(case.problem, settings).seconds for _ in range(repeats)][1:]
    last = solve(case.problem, settings)
    return {
        "seconds": min([*seconds, last.seconds]),
        "iterations": last.iterations,
        "cost": last.cost,
        "positions": np.array([m.position_enu_m(case.middle_s) for m in last.motions]),
        "powers": np.array([m.power_coefficients(0.0) for m in last.motions]),
    }


def peer(case: Case, program: str, powers: Floats, repeats: int) -> dict[str, object]:
    """The peer's best time from the motion `powers` (N, K + 1, 3), and where it ended."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "problem.bin"
        arrays = (*case.head, powers, case.clock)
        path.write_bytes(b"".join(np.ascontiguousarray(a, dtype="<f8").tobytes() for a in arrays))
        done = subprocess.run(
            [program, str(path), "1", "sparse", str(repeats)], check=True, capture_output=True, text=True
        )
    found = json.loads(done.stdout)
    motion = np.array(found["motion"]).reshape(powers.shape)
    positions = np.einsum("nkj,fk->nfj", motion, case.middle_s[:, None] ** np.arange(powers.shape[1]))
    return {**found, "positions": positions}


def row(size: str, order: int, program: str | None, repeats: int, with_li: bool) -> dict[str, object]:
    """One line of the table."""
    cameras, frames, targets = (int(n) for n in size.split("x"))
    case = make_case(cameras, frames, targets, order)
    mine = ours(case, "map", repeats)
    line: dict[str, object] = {"size": size, "seconds": mine["seconds"], "iterations": mine["iterations"]}
    line["peak_gb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    if program is not None:
        start = ours(case, "intersection", 0)["powers"] if repeats == 0 else ours(case, "intersection", 1)["powers"]
        other = peer(case, program, np.asarray(start), repeats)
        apart = np.linalg.norm(np.asarray(other["positions"]) - np.asarray(mine["positions"]), axis=-1).max()
        line |= {
            "peer_seconds": other["seconds"], "peer_iterations": other["iterations"], "apart_m": float(apart),
            "cost_difference": float(mine["cost"]) - float(other["cost"]),  # type: ignore[arg-type]
            "ratio": float(other["seconds"]) / float(mine["seconds"]),  # type: ignore[arg-type]
        }  # fmt: skip
    if with_li:
        lis = ours(case, "li", 1)
        line |= {"li_seconds": lis["seconds"], "li_ratio": float(lis["seconds"]) / float(mine["seconds"])}  # type: ignore[arg-type]
    return line


def main() -> None:
    """Reads the arguments, runs the table, prints it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peer", default=shutil.which("ceres_map"), help="the Ceres program; default: on the PATH")
    parser.add_argument("--sizes", default="2x50x4,4x1500x4,8x3000x8")
    parser.add_argument("--order", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--li", action="store_true", help="Li's method too")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    rows = [row(size, given.order, given.peer, given.repeats, given.li) for size in given.sizes.split(",")]
    tell({line["size"]: line for line in rows})  # type: ignore[misc]
    if given.json:
        print(json.dumps({"peer": given.peer, "rows": rows}, indent=1))
        return
    if given.peer is None:
        print("the peer (ceres_map) is not installed: name its program with --peer")
    print(
        f"{'size':>14} {'ours s':>10} {'it':>4} {'Ceres s':>10} {'it':>4} {'ratio':>7} {'apart m':>9} {'Li s':>9}"
        f" {'peak GB':>8}"
    )
    for line in rows:
        cells = [
            line.get(k, float("nan")) for k in ("peer_seconds", "peer_iterations", "ratio", "apart_m", "li_seconds")
        ]
        print(
            f"{line['size']:>14} {line['seconds']:10.5f} {line['iterations']:4d} {cells[0]:10.5f} {cells[1]:4.0f}"
            f" {cells[2]:7.1f} {cells[3]:9.5f} {cells[4]:9.4f}"
            f" {line['peak_gb']:8.2f}"
        )


def with_one_thread(module: str) -> None:
    """Starts a program of `scripts.validation` again with one thread, which libraries read when they are loaded."""
    if os.environ.get("OMP_NUM_THREADS") != "1":
        one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        program = [sys.executable, "-m", f"scripts.validation.{module}", *sys.argv[1:]]
        os.execve(sys.executable, program, {**os.environ, **one})


if __name__ == "__main__":
    with_one_thread("bench_solver")
    main()
