"""Whether ordinary flights come out right with nothing but defaults: flights drawn here, solved, error over claim.

usage: python -m scripts.validation.check_ordinary_flights [--flights 40] [--seed 1000] [--walk gnss10|gnss60|attitude]
       [--given] [--rows FILE]

Drawn are two to four cameras (flown straight, in a circle, or hovering) and one to eight targets (straight, curve, stop
and go, U-turn, roundabout, hover, parked) over 6 to 60 s, with nothing known of the clocks. This simulator shares no
code with `pipeline/synthetic`. Printed for every flight: root mean square of error over claimed sigma of all positions
(1 is right), the error in metres, how many sigmas each offset is off, the verdict, the motions chosen; with `--given`
the same with the true motion given (order 0 parked, 1 straight, else a spline); at the end the figures over all.

`--walk` adds what is correlated in time instead of white errors: a position's random walk that reaches 1 m in 10 or 60
seconds, or an attitude's that reaches 0.3 degrees in 10 seconds; instruments then have the default sigmas.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from calibration.foundation.arrays import Floats
from calibration.foundation.errors import RunningFixError
from pipeline.records import (
    CameraInput,
    InstrumentSigma,
    PoseTrack,
    Problem,
    SightRays,
    Solution,
    SolverSettings,
    TargetInput,
)
from pipeline.solver import solve
from scripts.validation.figures import tell
from scripts.validation.series import Row, rows_of

KINDS = ("straight", "curve", "stop", "uturn", "roundabout", "hover", "parked")
GIVEN_ORDER = {"parked": 0, "straight": 1}
LEAD_S, STEP_S = 6.0, 0.02
"""How long before and after the reference's video a target's path is drawn, and its steps."""
MOST_FRAMES = 500

Path3 = Callable[[Floats], Floats]


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawn:
    """One flight: the problem as a user would pose it, the kinds of motion, and the truth.

    places  of each camera: common times (f,) of its frames, and where it was (f, 3)
    """

    problem: Problem
    kinds: tuple[str, ...]
    paths: tuple[Path3, ...]
    offset_s: dict[str, float]
    places: dict[str, tuple[Floats, Floats]]


def drawn(
    seed: int, walk: str = "", cameras: int = 0, duration_s: float = 0.0, narrow: tuple[float, float] | None = None
) -> Drawn:
    """A flight by its seed; `narrow` is (metres between neighbouring cameras, metres from the targets)."""
    rng = np.random.default_rng([20261130, seed])
    duration = duration_s or float(np.exp(rng.uniform(np.log(6), np.log(60))))
    kinds = _kinds(rng, int(rng.integers(1, 9)))
    paths = tuple(_path(kind, duration, rng) for kind in kinds)
    rate = float(rng.choice([10.0, 12.5, 25.0, 29.97]))
    rate = min(rate, MOST_FRAMES / duration)
    grade = replace(InstrumentSigma(), **_grade(rng))
    if walk:
        grade = InstrumentSigma()
    count = cameras or int(rng.choice([2, 2, 3, 4]))
    distance, height = float(rng.uniform(120, 400)), float(rng.uniform(60, 200))
    heading = float(rng.uniform(0, 2 * np.pi))
    if narrow:
        distance = narrow[1]
    inputs, offsets, places = [], {}, {}
    for c in range(count):
        name = f"uav{c + 1}"
        offsets[name] = 0.0 if c == 0 else float(rng.uniform(-4, 4) * min(1.0, duration / 12))
        apart = float(rng.uniform(0.6, 1.8))
        heading += (narrow[0] / distance if narrow else apart) * (c > 0)
        spread = (1.0, 1.0) if narrow else (float(rng.uniform(0.8, 1.25)), float(rng.uniform(0.7, 1.4)))
        where = heading, distance * spread[0], height * spread[1]
        camera, common, place = _camera(name, rng, paths, grade, offsets[name], rate, duration, where, walk)
        inputs.append(camera)
        places[name] = common, place
    targets = tuple(TargetInput(target=f"car{n + 1}") for n in range(len(kinds)))
    problem = Problem(cameras=tuple(inputs), targets=targets, reference_camera="uav1")
    return Drawn(problem=problem, kinds=kinds, paths=paths, offset_s=offsets, places=places)


def _grade(rng: np.random.Generator) -> dict[str, float]:
    """RTK-like, good, or the defaults."""
    bias_deg, attitude_deg, bias_m, position_m = [(0.1, 0.05, 0.3, 0.05), (0.3, 0.2, 1.0, 0.3), (0.5, 0.5, 3.0, 1.0)][
        int(rng.integers(3))
    ]
    return {
        "attitude_bias_rad": np.radians(bias_deg),
        "attitude_rad": np.radians(attitude_deg),
        "position_bias_m": bias_m,
        "position_m": position_m,
    }


def _kinds(rng: np.random.Generator, count: int) -> tuple[str, ...]:
    """At least one of them tells the time."""
    kinds = [str(k) for k in rng.choice(KINDS, size=count)]
    if all(k in ("hover", "parked") for k in kinds):
        kinds[0] = str(rng.choice(["straight", "curve", "stop", "uturn", "roundabout"]))
    return tuple(kinds)


def _path(kind: str, duration: float, rng: np.random.Generator) -> Path3:
    """Positions (n, 3) at common times (n,), by integrating speed along a heading."""
    time_s = np.arange(-LEAD_S, duration + LEAD_S, STEP_S)
    speed, turn = np.full(len(time_s), float(rng.uniform(5, 15))), np.zeros(len(time_s))
    if kind == "parked":
        speed[:] = 0.0
    elif kind == "curve":
        turn[:] = np.radians(rng.uniform(20, 90)) / duration * rng.choice([-1, 1])
    elif kind == "stop":
        away = np.abs(time_s - duration * rng.uniform(0.25, 0.75)) - rng.uniform(0.5, 2.0)
        speed *= 0.5 * (1 - np.cos(np.pi * np.clip(away / (speed[0] / 2.5), 0, 1)))
    elif kind == "uturn":
        middle, width = duration * rng.uniform(0.35, 0.65), rng.uniform(1.5, 3.0)
        turn = np.pi * np.exp(-0.5 * ((time_s - middle) / width) ** 2) / (width * np.sqrt(2 * np.pi))
        speed *= 1 - 0.6 * np.exp(-0.5 * ((time_s - middle) / width) ** 2)
    elif kind == "roundabout":
        turn[:] = speed[0] / rng.uniform(12, 30) * rng.choice([-1, 1])
    heading = rng.uniform(0, 2 * np.pi) + np.cumsum(turn) * STEP_S
    flat = np.cumsum(speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0) * STEP_S
    if kind == "hover":
        flat = _wander(time_s, rng, 0.4)[:, :2]
    centre = flat[np.abs(time_s - duration / 2).argmin()]
    flat = flat - centre + rng.uniform(-50, 50, 2)
    up = np.full(len(time_s), rng.uniform(-3, 3)) if kind != "hover" else 30 + _wander(time_s, rng, 0.4)[:, 2]
    table = np.column_stack([flat, up])
    return lambda at: np.column_stack([np.interp(at, time_s, table[:, k]) for k in range(3)])


def _wander(time_s: Floats, rng: np.random.Generator, size_m: float) -> Floats:
    """Smooth wandering (n, 3) of a hovering drone."""
    periods, phases = rng.uniform(4, 15, (3, 3)), rng.uniform(0, 2 * np.pi, (3, 3))
    waves = np.sin(2 * np.pi * time_s[:, None, None] / periods + phases)
    return np.asarray(size_m * waves.mean(axis=2) * np.sqrt(6))


def _camera(
    name: str, rng: np.random.Generator, paths: Sequence[Path3], grade: InstrumentSigma, offset_s: float, rate: float,
    duration: float, where: tuple[float, float, float], walk: str,
) -> tuple[CameraInput, Floats, Floats]:  # fmt: skip
    """One camera's sightings and measured poses, and where it was when. Common time = frame / true rate + offset."""
    frames = np.arange(int(duration * rate))
    true_rate = rate * (1 + rng.normal() * 1e-4)
    common = frames / true_rate + offset_s
    place = _flown(common, duration, rng, *where)
    axes = _looking(place, common, paths, rng)
    focal, sigma_px = float(rng.uniform(900, 1800)), 1.0
    reported_place, reported_axes, sigma = _measured(common, place, axes, grade, rng, walk)
    rows, pixels = [], []
    for n, path in enumerate(paths):
        y = np.einsum("fij,fj->fi", axes, path(common) - place)
        xy = focal * y[:, :2] / y[:, 2:] + rng.normal(size=(len(y), 2)) * sigma_px
        seen = (y[:, 2] > 1) & (np.abs(xy) < [1500, 1000]).all(axis=1)
        rows.append(np.stack([frames[seen], np.full(seen.sum(), n)], axis=1))
        pixels.append(xy[seen])
    row, xy = np.concatenate(rows), np.concatenate(pixels)
    order = np.lexsort((row[:, 1], row[:, 0]))
    row, xy = row[order], xy[order]
    ray = np.column_stack([xy / focal, np.ones(len(xy))])
    length = np.linalg.norm(ray, axis=1)
    jacobian = np.zeros((len(xy), 2, 3))
    jacobian[:, 0, 0] = jacobian[:, 1, 1] = focal * length
    jacobian[:, :, 2] = -xy * length[:, None]
    shown = np.unique(row[:, 0])
    rays = SightRays(
        camera=name, targets=tuple(f"car{n + 1}" for n in range(len(paths))), target=row[:, 1], frame=row[:, 0],
        time_s=row[:, 0] / rate, direction_cam=ray / length[:, None], pixel_from_ray=jacobian,
        sigma_px=np.full(len(xy), sigma_px),
    )  # fmt: skip
    poses = PoseTrack(
        camera=name, frame=shown, time_s=shown / rate, position_enu_m=reported_place[shown],
        enu_from_cam=np.array([_quaternion(reported_axes[f].T) for f in shown]),
    )  # fmt: skip
    camera = CameraInput(
        camera=name, rays=rays, poses=poses, frame_rate=rate, offset_s=0.0 if name == "uav1" else None, sigma=sigma
    )
    return camera, common, place


def _flown(
    common: Floats, duration: float, rng: np.random.Generator, heading: float, distance: float, height: float
) -> Floats:
    """True positions (f, 3)."""
    kind = rng.choice(["line", "circle", "hover"])
    t = common - duration / 2
    if kind == "circle":
        angle = heading + rng.choice([-1, 1]) * rng.uniform(5, 12) / distance * t
        flat = distance * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    else:
        away = distance * np.array([np.cos(heading), np.sin(heading)])
        course = rng.uniform(0, 2 * np.pi)
        flat = away + (rng.uniform(3, 10) if kind == "line" else 0.0) * t[:, None] * [np.cos(course), np.sin(course)]
    return np.column_stack([flat, np.full(len(t), height)]) + _wander(common, rng, 0.5)


def _looking(place: Floats, common: Floats, paths: Sequence[Path3], rng: np.random.Generator) -> Floats:
    """True cam_from_enu (f, 3, 3): at the targets' middle, smoothed, and wobbling a little."""
    middle = np.mean([p(common) for p in paths], axis=0)
    forward = middle + _wander(common, rng, 2.0) - place
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack([right, np.cross(forward, right), forward], axis=1)


def _measured(
    common: Floats, place: Floats, axes: Floats, grade: InstrumentSigma, rng: np.random.Generator, walk: str
) -> tuple[Floats, Floats, InstrumentSigma]:
    """Poses as instruments report them."""
    n = len(common)
    turn = rng.normal(size=3) * grade.attitude_bias_rad + rng.normal(size=(n, 3)) * grade.attitude_rad
    shift = rng.normal(size=3) * grade.position_bias_m + rng.normal(size=(n, 3)) * grade.position_m
    step = np.sqrt(np.diff(common, prepend=common[0]))[:, None] * rng.normal(size=(n, 3))
    if walk.startswith("gnss"):
        shift = rng.normal(size=3) * grade.position_bias_m + np.cumsum(step, axis=0) / np.sqrt(float(walk[4:]))
    elif walk == "attitude":
        turn = rng.normal(size=3) * grade.attitude_bias_rad
        turn = turn + np.cumsum(step, axis=0) * np.radians(0.3) / np.sqrt(10)
    return place + shift, np.array([_rotation(w) for w in turn]) @ axes, grade


def _rotation(w: Floats) -> Floats:
    angle = float(np.linalg.norm(w))
    k = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]]) / max(angle, 1e-12)
    return np.asarray(np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k)


def _quaternion(m: Floats) -> Floats:
    """(w, x, y, z) of a rotation matrix, by the largest component."""
    four = np.array([1 + m[0, 0] + m[1, 1] + m[2, 2], 1 + m[0, 0] - m[1, 1] - m[2, 2],
                     1 - m[0, 0] + m[1, 1] - m[2, 2], 1 - m[0, 0] - m[1, 1] + m[2, 2]])  # fmt: skip
    k = int(four.argmax())
    a, b, c = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    d, e, f = m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
    rows = [[four[0], a, b, c], [a, four[1], d, e], [b, d, four[2], f], [c, e, f, four[3]]]
    q = np.array(rows[k]) / (2 * np.sqrt(four[k]))
    return np.asarray(q * np.sign(q[0] or 1.0))


@dataclass(frozen=True, kw_only=True)
class Score:
    """Of one solved flight: error over claim (rms), error in metres (rms), offsets' errors in sigmas, seconds."""

    ratio: float
    rmse_m: float
    offset_sigmas: float
    seconds: float


def score(flight: Drawn, solution: Solution, seconds: float) -> Score:
    """Against the truth, at ten times a second while a target was seen."""
    squares, errors = [], []
    claimed = {m.target: m for m in solution.motions_robust} or {m.target: m for m in solution.motions}
    for n, path in enumerate(flight.paths):
        name = f"car{n + 1}"
        if name not in claimed:
            continue
        at = np.arange(claimed[name].start_s, claimed[name].end_s, 0.1)
        off = solution.motion(name).position_enu_m(at) - path(at)
        variance = np.maximum(
            *(np.einsum("nii->n", m.position_covariance(at)) for m in (claimed[name], solution.motion(name)))
        )
        squares.append((off**2).sum(1) / variance)
        errors.append((off**2).sum(1))
    robust = solution.shared_covariance_robust
    sigmas = []
    for clock in solution.clocks:
        if clock.camera != "uav1":
            k = solution.shared_names.index(f"{clock.camera}.offset_s")
            sigma = max(clock.offset_sigma_s, np.sqrt(robust[k, k]) if robust is not None else 0.0)
            sigmas.append(abs(clock.offset_s - flight.offset_s[clock.camera]) / sigma)
    return Score(
        ratio=float(np.sqrt(np.concatenate(squares).mean())), rmse_m=float(np.sqrt(np.concatenate(errors).mean())),
        offset_sigmas=max(sigmas), seconds=seconds,
    )  # fmt: skip


def with_true_motion(flight: Drawn) -> Problem:
    """The same problem, told how its targets move."""
    targets = tuple(
        TargetInput(target=f"car{n + 1}", motion="polynomial", order=GIVEN_ORDER[kind])
        if kind in GIVEN_ORDER
        else TargetInput(target=f"car{n + 1}", motion="spline")
        for n, kind in enumerate(flight.kinds)
    )
    return replace(flight.problem, targets=targets)


def solved(flight: Drawn, problem: Problem) -> tuple[Score, Solution] | str:
    """The score, or why it was refused."""
    began = time.perf_counter()
    try:
        solution = solve(problem, SolverSettings())
    except RunningFixError as error:
        return str(error)
    return score(flight, solution, time.perf_counter() - began), solution


def row(flight: Drawn, *, given: bool) -> Row:
    """What is kept of one flight: with defaults, and with the true motion given."""
    found = solved(flight, flight.problem)
    best = solved(flight, with_true_motion(flight)) if given else ""
    out: Row = {"refused": "", "kinds": flight.kinds, "given_rmse_m": None}
    if not isinstance(best, str):
        out |= {"given_rmse_m": best[0].rmse_m, "given_ratio": best[0].ratio}
    if isinstance(found, str):
        return {**out, "refused": found}
    one, solution = found
    shape = {m.target: f"{m.degree}" if m.kind == "polynomial" else "s" for m in solution.motions}
    return {
        **out, "ratio": one.ratio, "rmse_m": one.rmse_m, "offset_sigmas": one.offset_sigmas, "seconds": one.seconds,
        "grade": solution.verdict.grade,
        "reasons": [f"{r.grade} {r.kind} {r.subject}: {r.words}" for r in solution.verdict.reasons],
        "shapes": [shape.get(f"car{n + 1}", "-") for n in range(len(flight.kinds))],
        "factor": solution.unit_weight.variance_factor if solution.unit_weight else None,
    }  # fmt: skip


def told(seed: str, r: Row) -> str:
    """A row in a line."""
    if r["refused"]:
        return f"{seed} refused: {r['refused']}"
    words = (
        f"{seed} {r['ratio']:5.2f} claims {r['rmse_m']:7.2f} m offset {r['offset_sigmas']:5.1f} {r['seconds']:5.1f} s"
    )
    if r["given_rmse_m"] is not None:
        words += f" | given {r['given_ratio']:5.2f} {r['given_rmse_m']:7.2f} m"
    words += f" | {r['grade']} " + " ".join(f"{k}:{s}" for k, s in zip(r["kinds"], r["shapes"], strict=True))
    heavy = [reason for reason in r["reasons"] if not reason.startswith("good")]
    return words + "".join(f"\n       {reason[:150]}" for reason in heavy[:2])


def figures(rows: list[Row]) -> dict[str, object]:
    """Over all flights that were solved; a refused one counts as "refused" among the grades."""
    done = [r for r in rows if not r["refused"]]
    ratio = np.array([r["ratio"] for r in done])
    silent = [r for r in done if r["grade"] != "bad"]
    over = np.array([r["rmse_m"] / r["given_rmse_m"] for r in done if r["given_rmse_m"]] or [np.nan])
    return {
        "flights": len(done),
        "error_over_claim": float(np.sqrt((ratio**2).mean())),
        "greatest": float(ratio.max()),
        "greatest_good": max((r["ratio"] for r in done if r["grade"] == "good"), default=0.0),
        "offsets_beyond_four_sigmas": sum(r["offset_sigmas"] > 4 for r in silent),
        "error_over_given": float(np.median(over)),
        "grades": dict(Counter("refused" if r["refused"] else r["grade"] for r in rows)),
    }


def main() -> None:
    """Prints a row for every flight and the figures over all."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--flights", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--walk", default="", choices=("", "gnss10", "gnss60", "attitude"))
    parser.add_argument("--given", action="store_true", help="also with the true motion given, to compare")
    parser.add_argument("--rows", type=Path, help="file to which rows are appended; what it has is not solved again")
    asked = parser.parse_args()

    def make(key: str) -> Row:
        return row(drawn(int(key.split()[-1]), asked.walk), given=asked.given)

    rows = []
    for r in rows_of(
        (f"{asked.walk} {s}".strip() for s in range(asked.seed, asked.seed + asked.flights)), make, asked.rows
    ):
        rows.append(r)
        print(told(r["key"], r), flush=True)
    found = figures(rows)
    print(f"{found['flights']} flights: error over claim {found['error_over_claim']:.2f} rms, greatest "
          f"{found['greatest']:.2f}, greatest called good {found['greatest_good']:.2f}")  # fmt: skip
    print(f"offsets beyond four sigmas, verdict not bad: {found['offsets_beyond_four_sigmas']}")
    print(f"error over that with the true motion: {found['error_over_given']:.2f} median; {found['grades']}")
    tell(found)


if __name__ == "__main__":
    main()
