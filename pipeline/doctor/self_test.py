"""Small tasks with known answers, one for each stage: does the work that this installation does come out right.

calibration  OpenCV finds the focal length of a drawn board
tracking     OpenCV's KCF follows a patch that moves 2 px a frame
log          pymavlink reads back the position that it wrote
solver       a drawn flight of two UAVs and one target: positions and offset against their claims
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from calibration.foundation.progress import Progress, silent

CLAIMS = 4.5
"""An error of more claimed sigmas than this is a failure: once in 100,000 where claims are true."""
SEED = 11
"""Of everything that is drawn here."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One task: what came out, whether that is right, and how long it took."""

    name: str
    right: bool
    seen: str
    seconds: float


def tried(progress: Progress = silent) -> tuple[Trial, ...]:
    """All tasks, one after another; one that raises is not right, and the others are still done."""
    out = []
    for done, (name, task) in enumerate(TRIALS.items()):
        progress("self-test", done, len(TRIALS))
        begin = time.perf_counter()
        try:
            right, seen = task()
        except Exception as error:  # whatever a broken installation raises is the finding
            right, seen = False, f"{type(error).__name__}: {error}"
        out.append(Trial(name=name, right=right, seen=seen, seconds=time.perf_counter() - begin))
    progress("self-test", len(TRIALS), len(TRIALS))
    return tuple(out)


def calibration() -> tuple[bool, str]:
    """A board seen from eight sides through a camera of 800 px."""
    import cv2

    rng = np.random.default_rng(SEED)
    board = np.zeros((54, 3), dtype=np.float32)
    board[:, :2] = 0.025 * np.mgrid[0:9, 0:6].T.reshape(-1, 2)
    k = np.array([[800.0, 0.0, 319.5], [0.0, 800.0, 239.5], [0.0, 0.0, 1.0]])
    seen = []
    for turn in rng.uniform(-0.5, 0.5, (8, 3)):
        pixels, _ = cv2.projectPoints(board, turn, np.array([-0.1, -0.06, 0.4]), k, np.zeros(5))
        seen.append(np.asarray(pixels, dtype=np.float32))
    _, found, *_ = cv2.calibrateCamera([board] * 8, seen, (640, 480), None, None)
    focal = float(found[0, 0])
    return abs(focal - 800.0) < 0.1, f"focal length {focal:.2f} px, true 800"


def tracking() -> tuple[bool, str]:
    """A patch of noise over a ground of noise, 40 pictures, 2 px each to the right."""
    import cv2

    rng = np.random.default_rng(SEED)
    ground = cv2.GaussianBlur(rng.integers(90, 130, (160, 240, 3), dtype=np.uint8), (5, 5), 0)
    patch = cv2.GaussianBlur(rng.integers(0, 255, (24, 32, 3), dtype=np.uint8), (3, 3), 0)
    tracker = cv2.TrackerKCF.create()
    error = 0.0
    for step in range(41):
        left = 40 + 2 * step
        picture = ground.copy()
        picture[60:84, left : left + 32] = patch
        if step == 0:
            tracker.init(picture, (left, 60, 32, 24))
            continue
        held, box = tracker.update(picture)
        if not held:
            return False, f"lost in picture {step}"
        error = max(error, abs(box[0] - left), abs(box[1] - 60))
    return error <= 2.0, f"largest error {error:.1f} px over 40 pictures"


def log() -> tuple[bool, str]:
    """One position, packed and parsed."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    link = dialect.MAVLink(None)
    packed = dialect.MAVLink_global_position_int_message(1000, 281234567, 1129876543, 61500, 40000, 0, 0, 0, 9000)
    read = next(m for m in (link.parse_char(bytes([b])) for b in packed.pack(link)) if m is not None)
    return (read.lat, read.lon, read.alt) == (281234567, 1129876543, 61500), f"{read.get_type()} read back"


def solver() -> tuple[bool, str]:
    """A drawn flight; the error of its positions and of its offset in claimed sigmas."""
    from pipeline.records import SolverSettings
    from pipeline.solver import solve
    from pipeline.synthetic import PAPER_LOW, paper_scene, simulate

    problem, truth = simulate(paper_scene(), noise=PAPER_LOW, seed=SEED)
    found = solve(problem, SolverSettings())
    true = truth.trajectories[0]
    motion = found.motions[0]
    inside = (true.time_s >= motion.start_s) & (true.time_s <= motion.end_s)
    at = true.time_s[inside]
    error_m = motion.position_enu_m(at) - true.position_enu_m[inside]
    variance = np.trace(motion.position_covariance(at), axis1=1, axis2=2)
    position = float(np.sqrt((error_m**2).sum(axis=1).mean() / variance.mean()))
    clock = found.clocks[1]
    offset = abs(clock.offset_s - truth.offset_s[clock.camera]) / clock.offset_sigma_s
    seen = f"{found.status}; position error {position:.1f}, offset error {offset:.1f} of what is claimed"
    return found.status == "converged" and max(position, offset) < CLAIMS, seen


TRIALS: Mapping[str, Callable[[], tuple[bool, str]]] = {
    "calibration": calibration,
    "tracking": tracking,
    "log": log,
    "solver": solver,
}
