#!/usr/bin/env python3
"""Times `runningfix solve` on flight files, as a user gives them, and Ceres on the same model in the same run.

usage: python -m scripts.validation.bench_flight [--peer CERES_MAP] [--sizes 2x50x4,4x1500x4,8x3000x8]
           [--poses frame,time,log] [--motion polynomial] [--repeats 3] [--keep FOLDER] [--json]

Sizes are cameras x frames x targets. Cameras hover and look at targets that move as parabolas; every one sees all.
Poses come as a table by frame, a table by time, or an autopilot's `.tlog`; the last two are read anew as clocks move.
The pixels, sigmas and measured poses (poses.csv) go to the peer too, with `sigma.place = 0`: the same model. It starts
from what `--method intersection` finds. One thread; the best of the repeats. The table shows
`seconds.solver`, the whole command's processor time, and how far apart the positions end.
"""

from __future__ import annotations

import argparse
import json
import resource
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.export import poses_csv, read_poses_csv
from pipeline.geometry import rotation
from pipeline.geometry.geodesy import Geodetic, geodetic_from_enu
from pipeline.records import PoseTrack
from pipeline.synthetic.instruments import LogClock, Recording
from pipeline.synthetic.mavlink_log import tlog_bytes
from pipeline.synthetic.simulate import Noise
from scripts.validation.bench_solver import (
    BIAS_M,
    BIAS_RAD,
    FOCAL_PX,
    PRINCIPAL_PX,
    RATE_HZ,
    SHIFT_M,
    SIGMA_PX,
    TURN_RAD,
    with_one_thread,
)  # fmt: skip
from scripts.validation.figures import tell

ORDER = 2
SIZE_PX = (1280, 720)
ORIGIN = Geodetic.from_degrees(28.2, 112.9, 60.0)
UTC_S, BOOT_S, AROUND_S = 1.75e9, 100.0, 5.0
"""Of the logs: UTC and time since boot at common time 0, and how long before and after the video they go on."""
DRIFT_RADPS, BOB_M = 2e-4, 0.2
"""How a hovering camera moves: poses that are read anew hardly differ, so that the peer, which cannot, has the same."""
SHARE = 0.1
"""Of the claimed moving errors, in logs."""
POSES = {"frame": "a table by frame", "time": "a table by time", "log": "a log"}


@dataclass(frozen=True, kw_only=True)
class Sortie:
    """Of every camera (first axis): pixels (f, n, 2), cam_from_enu (f, 3, 3), centre (f, 3), and seconds a frame."""

    pixels: list[Floats]
    cam_from_enu: list[Floats]
    centre_m: list[Floats]
    frame_s: list[float]


def hovering(c: int, cameras: int, time: Floats) -> tuple[Floats, Floats]:
    """Poses of a camera that hovers above a ring of 250 m and looks at its middle."""
    angle = 2 * np.pi * c / cameras * 0.7 + DRIFT_RADPS * time
    centre = np.stack([250 * np.cos(angle), 250 * np.sin(angle), 90 + BOB_M * np.sin(0.1 * time + c)], axis=1)
    ahead = -centre / np.linalg.norm(centre, axis=1, keepdims=True)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack([right, np.cross(ahead, right), ahead], axis=1), centre


def fly(cameras: int, frames: int, targets: int, seed: int = 0) -> Sortie:
    """The truth of a flight and its pixels."""
    rng = np.random.default_rng(seed)
    duration = frames / RATE_HZ
    true = rng.normal(size=(targets, ORDER + 1, 3)) * [10.0, 10.0, 2.0]
    for k in range(1, ORDER + 1):
        fast = min(8.0 / 4 ** (k - 1), 20.0 / duration**k)
        true[:, k] = rng.normal(size=(targets, 3)) * [1.0, 1.0, 0.1] * fast
    pixels, turns, centres, steps = [], [], [], []
    for c in range(cameras):
        offset = 0.0 if c == 0 else rng.uniform(-0.3, 0.3)
        step = (1 + 0.0005 * rng.normal() * (c > 0)) / RATE_HZ
        time = np.arange(frames) * step + offset
        turn, centre = hovering(c, cameras, time)
        points = np.einsum("nkj,fk->fnj", true, time[:, None] ** np.arange(ORDER + 1))
        y = np.einsum("fij,fnj->fni", turn, points - centre[:, None])
        pixels.append(FOCAL_PX * y[..., :2] / y[..., 2:] + PRINCIPAL_PX + SIGMA_PX * rng.normal(size=(*y.shape[:2], 2)))
        turns.append(turn)
        centres.append(centre)
        steps.append(step)
    return Sortie(pixels=pixels, cam_from_enu=turns, centre_m=centres, frame_s=steps)


def write(sortie: Sortie, poses: str, motion: str, folder: Path, seed: int = 0) -> Path:
    """The flight's files, poses given as `poses` says; returns its flight file."""
    rng = np.random.default_rng([seed, 1])
    lens = {"model": "pinhole", "image_size": SIZE_PX, "distortion": [],
            "K": [[FOCAL_PX, 0, PRINCIPAL_PX[0]], [0, FOCAL_PX, PRINCIPAL_PX[1]], [0, 0, 1]]}  # fmt: skip
    lines = [f'[flight]\norigin = {{ lat = 28.2, lon = 112.9, height = {ORIGIN.height_m} }}\nreference_camera = "uav1"']
    for c, pixels in enumerate(sortie.pixels):
        name = f"uav{c + 1}"
        (folder / f"{name}.json").write_text(json.dumps(lens))
        (folder / f"{name}-tracks.csv").write_text(_tracks(pixels))
        lines.append(f'[cameras.{name}]\ncalibration = "{name}.json"\ntracks = "{name}-tracks.csv"')
        lines.append(f'frame_rate = {RATE_HZ}\nclock = "affine"' + ("\noffset_s = 0.0" if c else ""))
        lines.append(_poses(sortie, c, poses, name, folder, rng))
        lines.append(
            f"sigma = {{ attitude_bias_deg = {np.degrees(BIAS_RAD)}, attitude_deg = {np.degrees(TURN_RAD)}, "
            f"position_bias_m = {BIAS_M}, position_m = {SHIFT_M}, pixel = {SIGMA_PX}, place = 0, frame_rate = 1.0, "
            "attitude_tau_s = 0, position_tau_s = 0, start_s = 0, offset_s = 1000 }"
        )
    for n in range(sortie.pixels[0].shape[1]):
        order = f"\norder = {ORDER}" if motion == "polynomial" else ""
        lines.append(f'[targets.target{n + 1}]\nmotion = "{motion}"{order}')
    path = folder / "flight.toml"
    path.write_text("\n".join([*lines, '[solve]\nrobust = "none"\n']))
    return path


def _tracks(pixels: Floats) -> str:
    rows = ["frame,target,x_px,y_px"]
    for f, seen in enumerate(pixels):
        rows += [f"{f},target{n + 1},{x!r},{y!r}" for n, (x, y) in enumerate(seen.tolist())]
    return "\n".join(rows) + "\n"


def _poses(sortie: Sortie, c: int, how: str, name: str, folder: Path, rng: np.random.Generator) -> str:
    """Writes what a camera's poses are read from; its lines in the flight file."""
    bias_rad, bias_m = BIAS_RAD * rng.normal(size=3), BIAS_M * rng.normal(size=3)
    if how != "log":
        enu_from_cam = rotation.conjugate(rotation.from_matrix(sortie.cam_from_enu[c]))
        count = len(enu_from_cam)
        turned = rotation.multiply(enu_from_cam, rotation.exp(bias_rad + TURN_RAD * rng.normal(size=(count, 3))))
        track = PoseTrack(
            camera=name, frame=np.arange(count), time_s=np.arange(count) / RATE_HZ, enu_from_cam=turned,
            position_enu_m=sortie.centre_m[c] - bias_m - SHIFT_M * rng.normal(size=(count, 3)),
        )  # fmt: skip
        table = [line.split(",") for line in poses_csv([track]).splitlines()]
        left_out = {"camera", "time_s" if how == "frame" else "frame"}
        kept = [i for i, column in enumerate(table[0]) if column not in left_out and not column.startswith("refined")]
        (folder / f"{name}-poses.csv").write_text("".join(",".join(row[i] for i in kept) + "\n" for row in table))
        return f'telemetry = "{name}-poses.csv"' + ("\nstart = 0.0" if how == "time" else "")
    (folder / f"{name}.tlog").write_bytes(tlog_bytes(_log(sortie, c, bias_rad, bias_m, rng), system=c + 1, seed=c))
    return f'telemetry = "{name}.tlog"\nstart = "camera-event"'


def _log(sortie: Sortie, c: int, bias_rad: Floats, bias_m: Floats, rng: np.random.Generator) -> Recording:
    """What the autopilot measures: attitude at 25 Hz, position at 5 Hz, errors mostly constant, as filters leave them.

    Were the moving part as large as claimed and new in every sample, rates of change would be made of it, and of them
    the peer knows nothing.
    """
    cameras, length_s = len(sortie.pixels), len(sortie.pixels[c]) * sortie.frame_s[c]
    fast = np.round(np.arange(-AROUND_S, length_s + AROUND_S, 0.04), 3)
    slow = np.round(np.arange(-AROUND_S, length_s + AROUND_S, 0.2), 3)
    turn = rotation.conjugate(rotation.from_matrix(hovering(c, cameras, fast)[0]))
    turn = rotation.multiply(turn, rotation.exp(bias_rad + SHARE * TURN_RAD * rng.normal(size=(len(fast), 3))))
    place = hovering(c, cameras, slow)[1] - bias_m - SHARE * SHIFT_M * rng.normal(size=(len(slow), 3))
    ned_from_body = rotation.multiply(
        rotation.ENU_AS_NED, rotation.multiply(turn, rotation.conjugate(rotation.CAM_AS_FRD))
    )
    return Recording(
        clock=LogClock(boot_zero_s=BOOT_S, utc_zero_s=UTC_S, recorder_zero_s=UTC_S), position_boot_s=slow + BOOT_S,
        lat_lon_height=geodetic_from_enu(place, ORIGIN), velocity_ned_mps=np.zeros((len(slow), 3)),
        attitude_boot_s=fast + BOOT_S, ned_from_body=ned_from_body, body_rate_radps=np.zeros((len(fast), 3)),
        ned_from_gimbal=None, first_frame_s=BOOT_S, noise=Noise(),
    )  # fmt: skip


def solved(flight: Path, out: Path, *more: str) -> dict[str, object]:
    """What `runningfix solve --json` tells, and the processor seconds of the whole command."""
    begun = _children_s()
    run = [sys.executable, "-m", "pipeline.cli.main", "solve", str(flight), "-o", str(out), "--json", "--quiet", *more]
    done = subprocess.run(run, capture_output=True, text=True)
    if done.returncode not in (0, 7):
        raise SystemExit(f"{' '.join(run)}: exit code {done.returncode}\n{done.stdout}\n{done.stderr}")
    return {**json.loads(done.stdout), "processor_s": _children_s() - begun}


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def powers_in(out: Path) -> Floats:
    """Coefficients (n, K + 1, 3) of powers of common time that a solution.json holds."""
    found = []
    for motion in json.loads((out / "solution.json").read_text())["motions"]:
        told = motion["polynomial"]
        found.append(_shifted(np.array(told["coefficients"], float), -float(told["epoch_s"])))
    return np.array(found)


def _shifted(coefficients: Floats, by_s: float) -> Floats:
    """The polynomial sum a_k (t + by)^k in powers of t."""
    out = np.zeros_like(coefficients)
    for j in range(coefficients.shape[1]):
        inner = np.polynomial.Polynomial([0.0])
        for k, a in enumerate(coefficients[:, j]):
            inner += a * np.polynomial.Polynomial([by_s, 1.0]) ** k
        out[: len(inner.coef), j] = inner.coef[: len(out)]
    return out


def peer(sortie: Sortie, out: Path, program: str, powers: Floats, repeats: int) -> dict[str, object]:
    """The peer's answer on the measured poses of `out`, from the motion `powers`."""
    cameras, (frames, targets, _) = len(sortie.pixels), sortie.pixels[0].shape
    head = np.zeros(16)
    head[:10] = [cameras, frames, targets, ORDER + 1, FOCAL_PX, SIGMA_PX, TURN_RAD, SHIFT_M, BIAS_RAD, BIAS_M]
    measured = read_poses_csv(out / "poses.csv")
    turns = np.array([rotation.matrix(rotation.conjugate(p.enu_from_cam)) for p in measured])
    places = np.array([p.position_enu_m for p in measured])
    clock = np.array([[0.0, 1 / RATE_HZ]] * cameras)
    arrays = (head, np.array(sortie.pixels), turns, places, powers, clock)
    path = out / "problem.bin"
    path.write_bytes(b"".join(np.ascontiguousarray(a, dtype="<f8").tobytes() for a in arrays))
    done = subprocess.run([program, str(path), "1", "sparse", str(repeats)], check=True, capture_output=True, text=True)
    found: dict[str, object] = json.loads(done.stdout)
    return {**found, "powers": np.array(found["motion"]).reshape(powers.shape)}


def row(size: str, poses: str, motion: str, program: str | None, repeats: int, folder: Path) -> dict[str, object]:
    """One line of the table."""
    cameras, frames, targets = (int(n) for n in size.split("x"))
    sortie, out = fly(cameras, frames, targets), folder / "out"
    flight = write(sortie, poses, motion, folder)
    tries = [solved(flight, out) for _ in range(repeats)]
    best = min(tries, key=lambda told: told["seconds"]["solver"])  # type: ignore[index]
    line: dict[str, object] = {
        "size": size, "poses": poses, "motion": motion, "status": best["status"], "iterations": best["iterations"],
        "solver_s": best["seconds"]["solver"], "processor_s": min(t["processor_s"] for t in tries),  # type: ignore[index,type-var]
        "seconds": best["seconds"],
    }  # fmt: skip
    if program is None or motion != "polynomial":
        return line
    mine, start = powers_in(out), folder / "start"
    solved(flight, start, "--method", "intersection")
    other = peer(sortie, out, program, powers_in(start), repeats)
    at = np.linspace(0.0, frames / RATE_HZ, 21)[:, None] ** np.arange(ORDER + 1)
    apart = np.einsum("fk,nkj->fnj", at, mine - np.asarray(other["powers"]))
    return line | {
        "peer_s": other["seconds"], "peer_iterations": other["iterations"],
        "ratio": float(other["seconds"]) / float(line["solver_s"]),  # type: ignore[arg-type]
        "apart_m": float(np.linalg.norm(apart, axis=-1).max()),
    }  # fmt: skip


def told(line: dict[str, object]) -> str:
    """A line of the table for people."""
    peer_s, its, ratio, apart = (line.get(k, np.nan) for k in ("peer_s", "peer_iterations", "ratio", "apart_m"))
    return (
        f"{line['size']:>10} {line['poses']:>6} {line['solver_s']:9.4f} {line['iterations']:3d} {peer_s:8.4f} "
        f"{its:3.0f} {ratio:6.1f} {apart:8.4f} {line['processor_s']:21.2f}"
    )


def main() -> None:
    """Reads the arguments, runs the table, prints it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peer", default=shutil.which("ceres_map"), help="the Ceres program; default: on the PATH")
    parser.add_argument("--sizes", default="2x50x4,4x1500x4,8x3000x8")
    parser.add_argument("--poses", default="frame,time,log", help=", ".join(f"{k}: {v}" for k, v in POSES.items()))
    parser.add_argument("--motion", default="polynomial", choices=("polynomial", "spline"))
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--keep", type=Path, help="the flights' files stay here")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    if given.peer is None:
        print("the peer (ceres_map) is not installed: name its program with --peer", file=sys.stderr)
    rows = []
    print(f"{'size':>10} {'poses':>6} {'solver s':>9} {'it':>3} {'Ceres s':>8} {'it':>3} {'ratio':>6} {'apart m':>8}"
          f" {'command, processor s':>21}")  # fmt: skip
    for size in given.sizes.split(","):
        for poses in given.poses.split(","):
            with tempfile.TemporaryDirectory() as scratch:
                folder = Path(scratch) if given.keep is None else given.keep / f"{size}-{poses}-{given.motion}"
                folder.mkdir(parents=True, exist_ok=True)
                line = row(size, poses, given.motion, given.peer, given.repeats, folder)
            rows.append(line)
            print(told(line), flush=True)
    tell({f"{line['size']} {line['poses']}": line for line in rows})
    if given.json:
        print(json.dumps(rows, indent=1))


if __name__ == "__main__":
    with_one_thread("bench_flight")
    main()
