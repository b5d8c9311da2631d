"""The real flights, offsets unknown: errors against RTK truth, clocks, coverage of the claimed sigmas, seconds, memory.

usage: python -m scripts.validation.check_flights FOLDER

FOLDER holds flight1 and flight3, each with flight.toml and truth/ (rtk.csv; reference.json with the true clocks).
Each flight is solved by the command line in a process of its own, whose seconds and memory are printed.
An RTK epoch counts where at least two cameras have labels within 0.2 s of it. Coverage is the share of errors, per axis
over all epochs, within 1 and 1.96 of the claimed sigmas (cluster-robust, as trajectory.csv holds them): "absolute" as
they are, errors of the whole flight's position and heading included; "aligned" with the best rigid motion taken out of
the errors but not out of the claims, which are then wide for it. Clocks are judged at mid-video; where a clock's rate
varies, also how far the reference clocks (pieces of 600 frames) are off there by RTK and the reference poses.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

from calibration.camera import CameraModel, project
from calibration.foundation.arrays import Floats
from scripts.validation.figures import tell

FLIGHTS = ("flight1", "flight3")
SUPPORT_S = 0.2
NEAR_S, FEWEST_LABELS = 3.0, 30
"""How near RTK judges the reference clocks, and with how many labels at least."""


@dataclass(frozen=True, kw_only=True)
class Run:
    """What a process took: from its start to its end, and the stage `solve` of it (search and covariances included)."""

    wall_s: float
    solve_s: float
    user_s: float
    peak_mb: float


def solved(flight: Path, out: Path) -> Run:
    """Solves a flight by the command line."""
    script = "import sys; from pipeline.cli.main import main; sys.exit(main())"
    command = [sys.executable, "-c", script, "solve", str(flight / "flight.toml"), "-o", str(out), "--quiet", "--json"]
    began = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.PIPE)
    assert process.stdout is not None
    said = json.loads(process.stdout.read())
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{flight.name}: exit code {process.returncode}")
    return Run(
        wall_s=time.perf_counter() - began, solve_s=said["seconds"]["solve"], user_s=used.ru_utime,
        peak_mb=used.ru_maxrss / 1024,
    )  # fmt: skip


def true_time_s(clock: dict, frame: Floats) -> Floats:  # type: ignore[type-arg]
    """RTK time of frames by a camera's true clock."""
    time = clock["offset_s"] + frame / clock["fps"]
    warp = clock["warp"]
    return np.asarray(time + np.interp(frame, warp["frame"], warp["d_seconds"]) if warp else time)


def errors(flight: Path, out: Path, clocks: dict) -> tuple[Floats, Floats, Floats]:  # type: ignore[type-arg]
    """Found positions and true ones (n, 3) at the epochs that count, and the claimed covariance (n, 3, 3)."""
    rtk, found = pd.read_csv(flight / "truth/rtk.csv"), pd.read_csv(out / "trajectory.csv")
    timing = pd.read_csv(out / "timing.csv").set_index("camera")
    reference = next(iter(clocks))
    frame = (found.time_s - timing.offset_s[reference]) * timing.frame_rate[reference]
    time, epoch = true_time_s(clocks[reference], frame.to_numpy()), rtk.time_s.to_numpy()
    support = np.zeros(len(epoch), dtype=int)
    for camera, clock in clocks.items():
        seen = np.sort(true_time_s(clock, pd.read_csv(flight / f"{camera}-tracks.csv").frame.to_numpy(float)))
        support += np.searchsorted(seen, epoch + SUPPORT_S) > np.searchsorted(seen, epoch - SUPPORT_S)
    use = (support >= 2) & (epoch >= time[0]) & (epoch <= time[-1])

    def at(columns: list[str]) -> Floats:
        return np.column_stack([np.interp(epoch[use], time, found[c]) for c in columns])

    axes = ["east_m", "north_m", "up_m"]
    covariance = at([f"cov_{k}" for k in ("ee", "en", "eu", "en", "nn", "nu", "eu", "nu", "uu")]).reshape(-1, 3, 3)
    return at(axes), rtk[axes].to_numpy()[use], covariance


def aligned(found: Floats, real: Floats) -> Floats:
    """(n, 3) what is left of the error after the best rigid motion."""
    a, b = found - found.mean(axis=0), real - real.mean(axis=0)
    u, _, vt = np.linalg.svd(b.T @ a)
    return np.asarray(a @ (u @ np.diag([1, 1, np.sign(np.linalg.det(u @ vt))]) @ vt).T - b)


def told(error: Floats) -> str:
    """RMSE and median of the distance."""
    length = np.linalg.norm(error, axis=1)
    return f"RMSE {np.sqrt((length**2).mean()):.3f} m, median {np.median(length):.3f} m"


def rms_m(error: Floats) -> float:
    """Root mean square of the distance."""
    return float(np.sqrt((error**2).sum(axis=1).mean()))


def share_percent(error: Floats, covariance: Floats, sigmas: float) -> float:
    """Of the errors, per axis, within so many sigmas."""
    return float(100 * (np.abs(error) < sigmas * np.sqrt(np.einsum("nii->ni", covariance))).mean())


def covered(error: Floats, covariance: Floats) -> str:
    """Share of the errors within 1 and 1.96 sigmas, per axis and in all."""
    ratio = np.abs(error) / np.sqrt(np.einsum("nii->ni", covariance))
    parts = []
    for bound, name in ((1.0, "68 %"), (1.96, "95 %")):
        axes = ", ".join(f"{100 * share:.0f}" for share in (ratio < bound).mean(axis=0))
        parts.append(f"{name}: {100 * (ratio < bound).mean():.1f} % (east, north, up {axes})")
    return "; ".join(parts) + f"; RMS of error/sigma {np.sqrt((ratio**2).mean()):.2f}"


def reference_lag(flight: Path, clocks: dict, camera: str, time_s: float) -> tuple[float, float]:  # type: ignore[type-arg]
    """By how much, and how surely, RTK and the reference pose say that the reference clock of a camera is early then.

    The camera's labels within `NEAR_S` of an RTK time are moved along the drone's image until they lie on it; labels'
    errors last about a second, so every second counts once.
    """
    clock, lens = clocks[camera], json.loads((flight / f"{camera}.json").read_text())
    rtk, labels = pd.read_csv(flight / "truth/rtk.csv"), pd.read_csv(flight / f"{camera}-tracks.csv")
    path = CubicSpline(rtk.time_s, rtk[["east_m", "north_m", "up_m"]])
    time = true_time_s(clock, labels.frame.to_numpy(float))
    near = np.abs(time - time_s) < NEAR_S
    if near.sum() < FEWEST_LABELS:
        return 0.0, np.inf
    K = np.array(lens["K"]) * [clock["focal_scale"], clock["focal_scale"], 1]
    turn, centre = np.array(clock["R_cam_from_enu"]), np.array(clock["centre_enu_m"])
    model = CameraModel(image_size=lens["image_size"], K=K, distortion=np.array(lens["distortion"]))

    def pixel(when: Floats) -> Floats:
        return project(model, (path(when) - centre) @ turn.T)

    time, seen = time[near], labels[["x_px", "y_px"]].to_numpy()[near]
    speed = (pixel(time + 0.02) - pixel(time - 0.02)) / 0.04
    off, lag = seen - pixel(time), 0.0
    for _ in range(20):
        rest = off - speed * lag
        weight = 1 / (1 + (rest**2).sum(axis=1))[:, None]
        lag = float((weight * speed * off).sum() / (weight * speed**2).sum())
    seconds = len(np.unique(np.floor(time)))
    spread = np.sqrt((weight * rest**2).sum() / weight.sum())
    return lag, float(spread / np.sqrt((weight * speed**2).sum() / weight.sum() * seconds))


def clock_lines(flight: Path, out: Path, clocks: dict) -> list[str]:  # type: ignore[type-arg]
    """Each clock's error at mid-video, with its plain and its robust sigma there."""
    timing = pd.read_csv(out / "timing.csv").set_index("camera")
    shared = json.loads((out / "solution.json").read_text())["shared"]
    robust = np.array(shared["covariance_robust"])
    names = list(shared["names"])
    reference, *others = clocks
    drift = pd.read_csv(out / "clock.csv") if (out / "clock.csv").exists() else None
    lines = []
    for camera in others:
        frame = float(pd.read_csv(flight / f"{camera}-tracks.csv").frame.median())
        own = None if drift is None else drift[drift.camera == camera]
        drifts = own is not None and len(own) > 0
        away = float(np.interp(frame, own.frame, own.deviation_s)) if own is not None and drifts else 0.0
        rate = timing.frame_rate[camera]
        common = frame / rate + timing.offset_s[camera] + away
        cam0 = (common - timing.offset_s[reference]) * timing.frame_rate[reference]
        error = float(true_time_s(clocks[reference], cam0) - true_time_s(clocks[camera], np.float64(frame)))
        place = [names.index(f"{camera}.{name}") for name in ("offset_s", "frame_rate")]
        slope = np.array([1.0, -frame / rate**2])
        sigma = float(np.sqrt(slope @ robust[np.ix_(place, place)] @ slope))
        kind = "variable" if clocks[camera]["warp"] else "fixed"
        lines.append(f"  {camera} ({kind} rate{', drifts' if drifts else ''}): {1e3 * error:+.1f} ms"
                     + ("" if drifts else f", robust sigma {1e3 * sigma:.1f} ms"))  # fmt: skip
        if clocks[camera]["warp"]:
            then = float(true_time_s(clocks[camera], np.float64(frame)))
            lags = {c: reference_lag(flight, clocks, c, then) for c in clocks}
            told = [f"{c} {1e3 * lag:+.0f} +- {1e3 * s:.0f}" for c, (lag, s) in lags.items() if s < np.inf]
            lines.append(
                f"    the reference clocks' own lag within {NEAR_S:.0f} s of then, by RTK, ms: {', '.join(told)}"
            )
    return lines


def main(folder: str) -> None:
    """Prints the table of each flight."""
    if not Path(folder).is_dir():
        raise SystemExit(f"{folder}: no such folder; give the folder that holds {' and '.join(FLIGHTS)}")
    for name in FLIGHTS:
        flight = Path(folder) / name
        clocks = json.loads((flight / "truth/reference.json").read_text())["cameras"]
        with tempfile.TemporaryDirectory() as place:
            out = Path(place) / "out"
            run = solved(flight, out)
            found, real, covariance = errors(flight, out, clocks)
            print(
                f"{name}: {run.wall_s:.1f} s ({run.solve_s:.1f} s of it the solve; {run.user_s:.1f} user s on all cores"
                f"), {run.peak_mb:.0f} MB"
            )
            rest = aligned(found, real)
            tell({name: {
                "seconds": run.wall_s, "memory_mb": run.peak_mb, "absolute_m": rms_m(found - real),
                "aligned_m": rms_m(rest), "within_1_sigma_percent": share_percent(found - real, covariance, 1.0),
                "within_1.96_sigma_percent": share_percent(found - real, covariance, 1.96),
            }})  # fmt: skip
            print(f"  absolute {told(found - real)}; aligned {told(rest)}; {len(found)} epochs")
            print(f"  coverage, absolute  {covered(found - real, covariance)}")
            print(f"  coverage, aligned   {covered(rest, covariance)}")
            print("\n".join(clock_lines(flight, out, clocks)))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit(__doc__)
    main(sys.argv[1])
