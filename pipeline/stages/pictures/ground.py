"""The ground from above: frames projected on it, where poses and cameras allow.

A place (e, n) of a sheet lies at the ground's height u. A frame shows it at pixel project(R (X - C)); what it shows
there is worth sine of the elevation / distance^2, how finely it sees the ground, and nothing at the picture's edge,
under a grazing ray, or beyond the lens. Places are averages of frames, the finer the more (power SHARPNESS), so that
seams do not show and what moves fades.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from calibration.camera import CameraModel, project, unproject
from calibration.foundation.arrays import Bools, Floats
from pipeline.geometry import rotation
from pipeline.records import Ground, GroundPicture, PoseTrack, Results
from pipeline.stages.inputs.single_frames import Pixels
from pipeline.stages.pictures.settings import PictureSettings

COARSE_PX = 8
"""Places between which the projection is taken as even."""
SHARPNESS = 4
LEAST_ABOVE_M = 5.0
"""Cameras lower above the ground see it grazing: nothing can be made of that."""
GRAZING = np.sin(np.radians(8.0))
EDGE_SHARE = 0.08
"""Of the picture's width, over which a frame fades out."""
WHOLE = 0.999
FLAT_SHARE = 0.25
"""Targets whose heights spread by less than this share of the cameras' height above them are on the ground."""


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """A rectangle of the ground, ENU metres, and the size (width, height) of its picture."""

    west_m: float
    south_m: float
    east_m: float
    north_m: float
    size: tuple[int, int]

    def places(self, step_px: int) -> tuple[Floats, Floats]:
        """East and north (h, w) of the middles of cells of `step_px` pixels."""
        across, down = (max(1, round(side / step_px)) for side in self.size)
        east = self.west_m + (np.arange(across) + 0.5) / across * (self.east_m - self.west_m)
        north = self.north_m - (np.arange(down) + 0.5) / down * (self.north_m - self.south_m)
        return np.meshgrid(east, north)


@dataclass(frozen=True, kw_only=True, eq=False)
class Level:
    """Heights of the ground: places (n, 2) -> up (n,) m, and in words how they are known."""

    at: Callable[[Floats], Floats]
    words: str


def level_of(results: Results, ground: Ground | None) -> Level | str:
    """The flight's own ground, else the height at which its targets are; a sentence where that is no ground."""
    if ground is not None:
        return Level(at=lambda places: ground.at(places).up_m, words=f"on {ground.source}")
    tops = [t.position_enu_m[np.isfinite(t.position_enu_m).all(axis=1), 2] for t in results.trajectories]
    up = np.concatenate([np.zeros(0), *tops])
    cameras = np.concatenate([np.zeros(0), *(p.position_enu_m[:, 2] for p in results.solution.poses)])
    if not len(up) or not len(cameras):
        return "The ground is not shown from above: no place on it is known."
    middle = float(np.median(up))
    above = float(np.max(cameras)) - middle
    if above < LEAST_ABOVE_M:
        return "The ground is not shown from above: no camera looks down on it."
    if float(np.subtract(*np.percentile(up, [90, 10]))) > FLAT_SHARE * above:
        return "The ground is not shown from above: targets are at different heights, and no [ground] says where it is."
    return Level(
        at=lambda places: np.full(len(places), middle),
        words=f"on a level plane at the targets' median height, {middle:.1f} m up; what is higher leans outwards",
    )


class Mosaic:
    """A picture of one sheet of the ground that grows by frames."""

    def __init__(self, sheet: Sheet, level: Level) -> None:
        self._sheet = sheet
        east, north = sheet.places(COARSE_PX)
        places = np.stack([east.ravel(), north.ravel()], axis=1)
        self._places = np.concatenate([places, level.at(places)[:, None]], axis=1)
        self._coarse = east.shape
        width, height = sheet.size
        self._sum = np.zeros((height, width, 3), np.float32)
        self._weight = np.zeros((height, width), np.float32)
        self._cover = np.zeros((height, width), np.float32)

    def add(self, shown: Pixels, camera: CameraModel, position_enu_m: Floats, enu_from_cam: Floats) -> None:
        """One more frame (h, w, 3) of a camera at a pose."""
        pixel, worth = _seen(camera, self._places, position_enu_m, enu_from_cam)
        if not (worth > 0).any():
            return
        scale = self._scale(worth, camera)
        if scale < 1:
            shown = np.asarray(cv2.resize(shown, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
        x, y, fine = (
            _spread(value.reshape(self._coarse), self._sheet.size)
            for value in (*((pixel + 0.5) * scale - 0.5).T, worth)
        )
        found = np.asarray(cv2.remap(shown, x, y, cv2.INTER_LINEAR), np.float32)
        told = (
            _spread((worth > 0).astype(float).reshape(self._coarse), self._sheet.size) > WHOLE
        )  # no neighbour is unseen
        inside = _inside(x, y, shown.shape[1], shown.shape[0]) * told
        weight = inside * (np.maximum(fine, 0) / float(worth.max())) ** SHARPNESS + 1e-9 * inside
        self._sum += weight[:, :, None] * found
        self._weight += weight
        self._cover = np.maximum(self._cover, inside)

    def _scale(self, worth: Floats, camera: CameraModel) -> float:
        """By how much a frame is finer than the sheet, so that no detail is skipped."""
        cell = (self._sheet.east_m - self._sheet.west_m) / self._sheet.size[0]
        finest = np.sqrt(np.median(worth[worth > 0])) * float(camera.K[0, 0])
        return float(np.clip(1.0 / max(finest * cell, 1e-9), 0.05, 1.0))

    def picture(self, words: str, settings: PictureSettings) -> GroundPicture | None:
        """What was seen; None where that is next to nothing."""
        if np.mean(self._cover > 0) < settings.ground_least_share:
            return None
        shown = self._sum / np.maximum(self._weight, 1e-12)[:, :, None]
        clear = np.clip(self._cover, 0, 1)[:, :, None] * 255
        pixels = np.concatenate([shown, clear], axis=2).round().astype(np.uint8)
        good, webp = cv2.imencode(".webp", pixels, [cv2.IMWRITE_WEBP_QUALITY, settings.ground_quality])
        assert good
        s = self._sheet
        return GroundPicture(
            west_m=s.west_m, south_m=s.south_m, east_m=s.east_m, north_m=s.north_m, webp=webp.tobytes(), words=words
        )


def _seen(camera: CameraModel, places: Floats, position: Floats, enu_from_cam: Floats) -> tuple[Floats, Floats]:
    """Pixels (n, 2) of places (n, 3), and what they are worth (n,), radians squared a square metre; 0 out of sight."""
    away = places - position
    ahead = rotation.rotate(rotation.conjugate(enu_from_cam), away)
    distance = np.linalg.norm(away, axis=1)
    down = -away[:, 2] / np.maximum(distance, 1e-9)
    inside = (ahead[:, 2] > 0) & (down > GRAZING) & _within_lens(camera, ahead)
    pixel = np.full((len(places), 2), -1e4)
    pixel[inside] = project(camera, ahead[inside])
    lost = ~np.isfinite(pixel).all(axis=1)
    pixel[lost] = -1e4
    worth = np.where(inside & ~lost, down / np.maximum(distance, 1e-9) ** 2, 0.0)
    return pixel, worth


def _within_lens(camera: CameraModel, ahead: Floats) -> Bools:
    """Whether directions (n, 3) are no further from the axis than the picture reaches; beyond, distortions fold."""
    width, height = camera.image_size
    edge = [(x, y) for x in (0.0, (width - 1) / 2, width - 1.0) for y in (0.0, (height - 1) / 2, height - 1.0)]
    rays = unproject(camera, np.array(edge))
    axis = np.array([0.0, 0.0, 1.0])
    reach = np.arccos(np.clip(rays[np.isfinite(rays).all(axis=1)] @ axis, -1, 1)).max(initial=0.0)
    angle = np.arctan2(np.hypot(ahead[:, 0], ahead[:, 1]), ahead[:, 2])
    return np.asarray(angle <= 1.02 * reach)


def _spread(value: Floats, size: tuple[int, int]) -> npt.NDArray[np.float32]:
    """Values of coarse cells (h, w) at every pixel of a picture of `size`, by interpolation."""
    return np.asarray(cv2.resize(np.asarray(value, np.float32), size, interpolation=cv2.INTER_LINEAR), np.float32)


def _inside(x: npt.NDArray[np.float32], y: npt.NDArray[np.float32], width: int, height: int) -> npt.NDArray[np.float32]:
    """From 0 at a frame's edge and beyond to 1 well inside."""
    near = np.minimum(np.minimum(x, width - 1 - x), np.minimum(y, height - 1 - y))
    return np.clip(near / (EDGE_SHARE * width), 0, 1).astype(np.float32)


def pose_at(poses: PoseTrack, frame: int) -> tuple[Floats, Floats] | None:
    """Position (3,) and attitude (4,) of a frame; None beyond the poses."""
    if not len(poses.frame) or not poses.frame[0] <= frame <= poses.frame[-1]:
        return None
    after = max(1, int(np.searchsorted(poses.frame, frame)))
    if len(poses.frame) == 1:
        return poses.position_enu_m[0], poses.enu_from_cam[0]
    begin, end = poses.frame[after - 1], poses.frame[after]
    share = (frame - begin) / (end - begin)
    place = (1 - share) * poses.position_enu_m[after - 1] + share * poses.position_enu_m[after]
    return place, rotation.slerp(poses.enu_from_cam[after - 1], poses.enu_from_cam[after], np.asarray(share))


def refined(name: str, camera: CameraModel, results: Results) -> CameraModel:
    """A camera with the focal length that the adjustment found."""
    scale = next((b.focal_scale for b in results.solution.biases if b.camera == name), 1.0)
    K = camera.K.copy()
    K[[0, 1], [0, 1]] *= scale
    return replace(camera, K=K)
