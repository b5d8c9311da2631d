"""How a camera turned from frame to frame, as its picture shows it.

Corners (Shi-Tomasi) are followed by pyramidal Lucas-Kanade on a reduced grey image and taken through the lens onto the
plane z = 1; a homography H fitted by RANSAC leaves out what moves on its own. With c = H (0, 0, 1) and J the Jacobian
of H there,

    cur_from_prev = swing(z -> c) * spin about z by atan2(J21 - J12, J11 + J22).

A camera that moves by t (camera axes) over ground at distance Z shows t / Z as well: the turn seen is the true one plus
(t_y, -t_x, 0) / Z, and, where the ground is nearer at the bottom of the picture, a spin that goes with t_x. Who
compares it with a log has to allow for that.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from calibration.camera import CameraModel, unproject
from calibration.foundation.arrays import Bools, Floats, frozen, settle
from pipeline.geometry import rotation
from pipeline.tracking.video.frames import Image, frames_of, video_head

WIDTH_PX = 640
CORNERS, REFRESH, FEWEST = 200, 5, 20
FLOW_WINDOW = (17, 17)
THRESHOLD_PX = 0.7
LEAST_INLIERS = 0.4
Points = npt.NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, eq=False)
class ImageTurning:
    """Turns between frames that follow each other.

    frame_time_s  (n + 1,) video time of the frames
    turn_rad      (n, 3) rotation vector of cur_from_prev in camera axes; NaN where the picture does not tell
    """

    frame_time_s: Floats
    turn_rad: Floats

    def __post_init__(self) -> None:
        n = len(self.frame_time_s) - 1
        settle(
            self,
            frame_time_s=frozen(self.frame_time_s, (n + 1,), "frame_time_s"),
            turn_rad=frozen(self.turn_rad, (n, 3), "turn_rad"),
        )


def image_turning(
    video: Path, camera: CameraModel, progress: Callable[[int, int], None] | None = None, stream: int | None = None
) -> ImageTurning:
    """The turns of the whole video; memory is constant.

    Raises InputFileError where there is no video.
    """
    total = video_head(video, stream).frames
    time_s: list[float] = []
    turns: list[Floats] = []
    before: Image | None = None
    corners, age = np.zeros((0, 2), np.float32), 0
    for frame in frames_of(video, stream=stream):
        grey = _reduced(frame.pixels)
        if before is not None:
            if age >= REFRESH or len(corners) < CORNERS // 2:
                corners, age = _corners(before), 0
            turn, corners = _turn(before, grey, corners, camera, frame.pixels.shape[1])
            turns.append(turn)
        before, age = grey, age + 1
        time_s.append(frame.time_s)
        if progress is not None:
            progress(frame.index + 1, max(total, frame.index + 1))
    return ImageTurning(frame_time_s=np.array(time_s), turn_rad=np.array(turns).reshape(-1, 3))


def _reduced(pixels: Image) -> Image:
    grey = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), np.uint8)
    height, width = grey.shape
    if width <= WIDTH_PX:
        return grey
    size = WIDTH_PX, max(1, round(height * WIDTH_PX / width))
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.uint8)


def _corners(grey: Image) -> Points:
    found = cv2.goodFeaturesToTrack(grey, CORNERS, 0.01, 10)
    return np.zeros((0, 2), np.float32) if found is None else np.asarray(found, np.float32).reshape(-1, 2)


def _turn(before: Image, grey: Image, corners: Points, camera: CameraModel, width: int) -> tuple[Floats, Points]:
    """The turn (3,) between two reduced images, NaN where it is not seen, and the corners that were followed."""
    unknown = np.full(3, np.nan)
    if len(corners) < FEWEST or before.shape != grey.shape:
        return unknown, np.zeros((0, 2), np.float32)
    to, found, _ = cv2.calcOpticalFlowPyrLK(before, grey, corners, corners.copy(), winSize=FLOW_WINDOW, maxLevel=4)
    seen = found.ravel() == 1
    prev, cur = corners[seen], np.asarray(to, np.float32).reshape(-1, 2)[seen]
    factor = width / grey.shape[1]
    flat = [_on_plane(points, factor, camera) for points in (prev, cur)]
    known: Bools = np.asarray(np.isfinite(flat[0] + flat[1]).all(axis=1))
    if known.sum() < FEWEST:
        return unknown, cur
    limit = THRESHOLD_PX * factor / float(camera.K[0, 0])
    H, inlier = cv2.findHomography(flat[0][known], flat[1][known], cv2.RANSAC, limit, maxIters=300, confidence=0.995)
    if H is None or inlier.sum() < max(FEWEST, LEAST_INLIERS * known.sum()):
        return unknown, cur
    return turn_of(np.asarray(H, float)), cur


def _on_plane(points: Points, factor: float, camera: CameraModel) -> Floats:
    """Points (n, 2) of the plane z = 1 of reduced pixels: a reduced pixel's centre lies at factor * (i + 1/2) - 1/2."""
    ray = unproject(camera, (points.astype(float) + 0.5) * factor - 0.5)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(ray[:, 2:] > 0.1, ray[:, :2] / ray[:, 2:], np.nan)


def turn_of(homography: Floats) -> Floats:
    """Rotation vector (3,) of what a homography (3, 3) of the plane z = 1 does around the optical axis."""
    H = homography / homography[2, 2]
    x, y = H[0, 2], H[1, 2]
    jacobian = H[:2, :2] - np.outer([x, y], H[2, :2])
    spin = np.arctan2(jacobian[1, 0] - jacobian[0, 1], jacobian[0, 0] + jacobian[1, 1])
    away = np.hypot(x, y)
    tilt = np.arctan(away) / away if away > 1e-12 else 1.0
    swing = rotation.exp(tilt * np.array([-y, x, 0.0]))
    return rotation.log(rotation.multiply(swing, rotation.exp(np.array([0.0, 0.0, spin]))))
