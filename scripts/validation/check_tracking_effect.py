"""What tracking is worth in the answer: a rendered flight solved with raw KCF centres and with ours, poses RTK-grade.

usage: python -m scripts.validation.check_tracking_effect [FLIGHT_FOLDER]        (default data/flight)

Both solve the same flight with the same settings. The measured poses are the true ones disturbed by 2 cm and 0.02
degrees (constant) and 1 cm and 0.01 degrees (frame by frame). KCF starts at the same boxes, as OpenCV ships it.
"""

import re
import shutil
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from pipeline.demo.compare import compare
from pipeline.demo.show import calibrate_boards
from pipeline.flight import Flight, read_flight
from pipeline.geometry import rotation
from pipeline.records import PoseTrack, SolverSettings
from pipeline.solver import solve
from pipeline.stages import run_solve, run_track
from pipeline.synthetic import read_truth
from scripts.validation.figures import tell

SIGMA = "attitude_bias_deg = 0.02\nattitude_deg = 0.01\nposition_bias_m = 0.02\nposition_m = 0.01\nframe_rate = 0.002\n"


def disturbed(poses: PoseTrack, rng: np.random.Generator) -> str:
    """A pose table of RTK grade."""
    n = len(poses.frame)
    position = poses.position_enu_m + rng.normal(0, 0.02, 3) + rng.normal(0, 0.01, (n, 3))
    turn = np.radians(rng.normal(0, 0.02, 3) + rng.normal(0, 0.01, (n, 3)))
    q = rotation.multiply(poses.enu_from_cam, rotation.exp(turn))
    rows = np.column_stack([poses.frame, position, q])
    lines = [",".join([f"{row[0]:.0f}", *(f"{v:.9f}" for v in row[1:])]) for row in rows]
    return "\n".join(["frame,east_m,north_m,up_m,qw,qx,qy,qz", *lines]) + "\n"


def kcf_table(flight: Flight, camera: str) -> str:
    """Centres of OpenCV's KCF as it comes, from each target's box on."""
    video, rows = str(flight.camera(camera).video), ["frame,target,x_px,y_px"]
    for target in flight.targets:
        if camera not in target.boxes:
            continue
        box, capture, tracker = target.boxes[camera], cv2.VideoCapture(video), cv2.TrackerKCF.create()
        frame = -1
        while (read := capture.read())[0]:
            frame += 1
            found = tuple(round(v) for v in (box.x, box.y, box.width, box.height))
            good = frame == box.frame
            if good:
                tracker.init(read[1], found)
            elif frame > box.frame:
                good, found = tracker.update(read[1])
            if good:
                rows.append(f"{frame},{target.name},{found[0] + found[2] / 2 - 0.5},{found[1] + found[3] / 2 - 0.5}")
    return "\n".join(rows) + "\n"


def prepared(source: Path, folder: Path, raw: bool) -> Flight:
    """The flight with good poses; with `raw`, KCF's centres as detections."""
    shutil.copytree(source, folder, dirs_exist_ok=True)
    calibrate_boards(folder, lambda *_: None)
    path, truth = folder / "flight.toml", read_truth(folder)
    first = read_flight(path)
    text = re.sub(r"(?m)^(start|mount|lever_arm_m|telemetry) = .*\n", "", path.read_text())
    text = re.sub(r"(?ms)(\[cameras\.\w+\.sigma\]\n).*?(?=^\[|\Z)", rf"\1{SIGMA}\n", text)
    rng = np.random.default_rng(7)
    for poses in truth.poses:
        name = poses.camera
        (folder / f"{name}-poses.csv").write_text(disturbed(poses, rng))
        lines = f'telemetry = "{name}-poses.csv"\n'
        if raw:
            (folder / f"{name}-kcf.csv").write_text(kcf_table(first, name))
            lines += f'tracks = "{name}-kcf.csv"\n'
        text = text.replace(f"[cameras.{name}]\n", f"[cameras.{name}]\n{lines}")
    path.write_text(text)
    return read_flight(path)


def position_errors_m(source: Path, raw: bool) -> dict[str, float]:
    """RMS position error of each target."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "flight"
        flight = prepared(source, folder, raw)
        run_track(flight, folder / "out")
        summary = run_solve(flight, folder / "out")
        assert summary.results is not None
        assert summary.problem is not None
        before = solve(summary.problem, SolverSettings(method="intersection"))
        rows = compare(summary.results, before, read_truth(folder))
    return {row.what: row.after for row in rows if row.what.startswith("position")}


def main(folder: str = "data/flight") -> None:
    """Prints both errors for every target."""
    raw, ours = (position_errors_m(Path(folder), kcf) for kcf in (True, False))
    print(f"{'RMS, m':<28}{'raw KCF':>10}{'ours':>10}{'ratio':>8}")
    for what in ours:
        kcf = raw.get(what, float("nan"))
        print(f"{what:<28}{kcf:>10.3f}{ours[what]:>10.3f}{ours[what] / kcf:>8.2f}")
    shared = [what for what in ours if what in raw]
    total = [float(np.sqrt(np.mean([errors[w] ** 2 for w in shared]))) for errors in (raw, ours)]
    tell({"raw_kcf_m": total[0], "ours_m": total[1]})
    print(f"{'all':<28}{total[0]:>10.3f}{total[1]:>10.3f}{total[1] / total[0]:>8.2f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
