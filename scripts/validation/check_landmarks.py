"""Surveyed points on data/flight, and check points on drawn flights.

usage: python -m scripts.validation.check_landmarks [--flights 50] [--first 0] [--layouts 5] [--rows FILE]

data/flight is calibrated and tracked once and solved with none, one, three and five surveyed landmarks (0.05 m), marked
in every 20th frame to half a pixel; `--layouts` places of the landmarks are drawn. Printed: position error (3D, root
mean square over all targets) over that without, and the root of the mean of e' C^-1 e / 3. Then flights of
`drawn_flights.py`, each with three surveyed points and two check points: root mean square of the check points' error
over sigma.
"""

import argparse
import shutil
import tempfile
from pathlib import Path

import numpy as np

from calibration.foundation.errors import RunningFixError
from pipeline.cli.main import main as runningfix
from pipeline.flight import read_flight
from pipeline.stages import run_solve
from pipeline.synthetic import read_truth
from pipeline.synthetic.demo_scenes import small_scene
from pipeline.synthetic.scene import pixels_of, visible
from scripts.validation.drawn_flights import draw, project, write
from scripts.validation.figures import tell
from scripts.validation.series import rows_of

DATA = Path(__file__).parents[2] / "data" / "flight"
COUNTS = (0, 1, 3, 5)
SURVEYED_M, EVERY, MARK_PX = 0.05, 20, 0.5


def landmark(name, place_m, marks, *, sigma_m=SURVEYED_M, check=False):
    """One table of a flight file; `marks` holds (frame, x, y, sigma) by camera."""
    lines = [f"[landmarks.{name}]"]
    lines += [f"{axis}_m = {value:.6f}" for axis, value in zip(("east", "north", "up"), place_m, strict=True)]
    lines += [f"sigma_m = {sigma_m}", f"check = {str(check).lower()}"]
    for camera, points in marks.items():
        told = ", ".join(f"{{ frame = {f}, x = {x:.3f}, y = {y:.3f}, sigma_px = {s} }}" for f, x, y, s in points)
        lines.append(f"points.{camera} = [ {told} ]")
    return "\n".join(lines) + "\n"


# --- data/flight ----------------------------------------------------------------------------------------------------


def prepared(folder: Path) -> Path:
    """data/flight, calibrated and run once without landmarks."""
    flight = folder / "flight"
    shutil.copytree(DATA, flight, ignore=shutil.ignore_patterns("uav?.json", "out"))
    for name in ("uav1", "uav2"):
        board = [str(flight / f"board-{name}"), "--board", "9x6", "--square-mm", "25"]
        if runningfix(["calibrate", *board, "-o", str(flight / f"{name}.json"), "--quiet"]):
            raise SystemExit(f"{name} could not be calibrated")
    if runningfix(["run", str(flight / "flight.toml"), "-o", str(flight / "out"), "--quiet"]):
        raise SystemExit("data/flight could not be run")
    return flight


def seen_places(rng, count):
    """Places (count, 3) on the ground that both cameras see in at least half of the marked frames, and their marks."""
    scene, found = small_scene(), []
    reach = scene.landscape.half_size_m
    while len(found) < count:
        place = np.append(rng.uniform(-0.6 * reach, 0.6 * reach, 2), 0.0)
        marks = {}
        for camera in scene.cameras:
            frames = np.arange(0, camera.frames, EVERY)
            points = np.tile(place, (len(frames), 1))
            pixels, centre = pixels_of(camera, frames, points)
            ok = visible(scene, camera, pixels, centre, points)
            if ok.sum() < len(frames) / 2:
                break
            noisy = pixels[ok] + rng.normal(0, MARK_PX, (int(ok.sum()), 2))
            marks[camera.name] = [(f, x, y, MARK_PX) for f, (x, y) in zip(frames[ok], noisy, strict=True)]
        if len(marks) == len(scene.cameras):
            found.append((place, marks))
    return found


def data_flight(flight: Path, seed: int, count: int):
    """Errors (n, 3) and covariances (n, 3, 3) of data/flight with so many landmarks."""
    rng = np.random.default_rng([seed, count])
    own = flight.parent / f"landmarks-{seed}-{count}"
    shutil.copytree(flight, own)
    text = (own / "flight.toml").read_text()
    for k, (place, marks) in enumerate(seen_places(rng, count)):
        text += "\n" + landmark(f"point{k + 1}", place + rng.normal(0, SURVEYED_M, 3), marks)
    (own / "flight.toml").write_text(text)
    results = run_solve(read_flight(own / "flight.toml"), own / "out").results
    truth = read_truth(own)
    errors, claims = [], []
    for one in results.trajectories:
        true = next(t for t in truth.trajectories if t.target == one.target)
        row = np.unique(np.linspace(0, len(one.time_s) - 1, 7)[1:-1].astype(int))
        there = np.stack([np.interp(one.time_s[row], true.time_s, true.position_enu_m[:, k]) for k in range(3)], 1)
        errors.append(one.position_enu_m[row] - there)
        claims.append(one.covariance[row])
    shutil.rmtree(own)
    return np.concatenate(errors), np.concatenate(claims)


def on_data_flight(layouts: int) -> dict[str, float]:
    """Errors with landmarks over those without, printed."""
    figures, base = {}, None
    with tempfile.TemporaryDirectory() as folder:
        flight = prepared(Path(folder))
        for count in COUNTS:
            found = [data_flight(flight, seed, count) for seed in range(layouts if count else 1)]
            square = np.mean([(e**2).sum(axis=1).mean() for e, _ in found])
            claim = np.mean([np.trace(c, axis1=1, axis2=2).mean() for _, c in found])
            nees = np.mean([np.einsum("ni,nij,nj->n", e, np.linalg.inv(c), e).mean() / 3 for e, c in found])
            base = base or square
            print(
                f"data/flight, {count} landmarks: {np.sqrt(square):.3f} m, over that without "
                f"{np.sqrt(square / base):.2f}, claimed {np.sqrt(claim):.3f} m, root NEES/3 {np.sqrt(nees):.2f}",
                flush=True,
            )
            figures[f"error_{count}_m"] = float(np.sqrt(square))
            figures[f"over_without_{count}"] = float(np.sqrt(square / base))
            figures[f"root_nees_{count}"] = float(np.sqrt(nees))
    return figures


# --- check points ---------------------------------------------------------------------------------------------------


def check_points(key: str) -> dict:
    """Two check points of a drawn flight with three surveyed ones: their error over sigma."""
    seed = int(key.split()[1])
    flight, rng = draw(seed, cameras=2, targets=3, length_s=8.0), np.random.default_rng([seed, 5])
    second = flight.cameras[1]
    second.told["offset_s"], second.told_sigma["offset_s"] = round(second.begin_s, 2), 0.05
    middle = np.mean([where(np.array([4.0]))[0] for where in flight.motions.values()], axis=0) if flight.motions else 0
    text, names = "", []
    for _ in range(200):
        if len(names) == 5 or not flight.motions:
            break
        place = middle * [1, 1, 0] + rng.uniform(-60, 60, 3) * [1, 1, 0] + [0, 0, rng.uniform(0, 8)]
        marks = {}
        for cam in flight.cameras:
            rows = np.arange(0, cam.frames, EVERY)
            xy = project(cam, cam.position_m[rows], cam.enu_from_cam[rows], place)
            ok = ((xy > 4) & (xy < np.array(cam.size) - 5)).all(axis=1)
            noisy = xy[ok] + rng.normal(0, 1.0, (int(ok.sum()), 2))
            marks[cam.name] = [(f, x, y, 1.0) for f, (x, y) in zip(rows[ok], noisy, strict=True)]
        if all(len(m) >= 3 for m in marks.values()):
            names.append(f"point{len(names) + 1}")
            told = place + rng.normal(0, SURVEYED_M, 3)
            text += "\n" + landmark(names[-1], told, marks, check=len(names) > 3)
    if len(names) < 5:
        return {"statistics": []}
    with tempfile.TemporaryDirectory() as name:
        path = write(flight, Path(name))
        path.write_text(path.read_text() + text)
        try:
            solution = run_solve(read_flight(path), Path(name) / "out").results.solution
        except RunningFixError as error:
            return {"statistics": [], "words": str(error)}
    return {"statistics": [m.statistic for m in solution.landmarks if m.kind == "check"]}


def main() -> None:
    """Both parts, printed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=50)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--layouts", type=int, default=5)
    parser.add_argument("--rows", type=Path, help="file to which rows are appended; what it has is not solved again")
    given = parser.parse_args()
    figures = on_data_flight(given.layouts) if given.layouts else {}
    if not given.flights:
        tell(figures)
        return
    keys = [f"check {seed}" for seed in range(given.first, given.first + given.flights)]
    rows = [r["statistics"] for r in rows_of(keys, check_points, given.rows)]
    found = np.array([value for row in rows for value in row])
    flights = sum(bool(row) for row in rows)
    root = float(np.sqrt(found.mean() / 3)) if len(found) else float("nan")
    print(f"check points: {len(found)} on {flights} flights, error over sigma {root:.2f}, median statistic ", end="")
    print(f"{np.median(found):.2f} (2.37 where claims are true), largest {found.max():.1f}")
    tell({**figures, "check_flights": flights, "check_points": len(found), "check_error_over_sigma": root})


if __name__ == "__main__":
    main()
