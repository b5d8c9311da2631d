"""What a camera of the scene sees, frame by frame.

Every picture element is mapped exactly: the ground by inverting x_px = K distort(H X) with the distortion's inverse
tabled once per camera, solids and vehicles by projecting their corners through the lens. Vehicles are drawn eight
times finer than the image and averaged down, so that they move by fractions of a pixel.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from calibration.camera import CameraModel, project
from calibration.foundation.arrays import Bools, Floats
from pipeline.geometry import rotation
from pipeline.synthetic.landscape import SHIFT, Country, Image, Solid
from pipeline.synthetic.scene import Scene, SceneCamera, SceneTarget, camera_pose
from pipeline.synthetic.vehicles import Body, axes_of, body

Grain = npt.NDArray[np.int8]
FINE = 8
SHADOW = 0.6


@dataclass(frozen=True, kw_only=True)
class Optics:
    """How the picture is degraded: Gaussian blur of the lens and noise of the sensor, both one sigma."""

    blur_px: float = 0.65
    noise: float = 2.5


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """A camera at one instant."""

    lens: CameraModel
    centre_enu_m: Floats
    cam_from_enu: Floats

    def pixels(self, points_enu_m: Floats) -> Floats:
        """Pixels (n, 2) of points (n, 3); NaN behind the camera."""
        return project(self.lens, (points_enu_m - self.centre_enu_m) @ self.cam_from_enu.T)


def frames(
    scene: Scene, camera: SceneCamera, country: Country, *, seed: int, optics: Optics | None = None
) -> Iterator[Image]:
    """The camera's frames, (rows, columns, 3) blue, green, red; the same seed gives the same bytes."""
    optics = optics or Optics()
    rng = np.random.default_rng([seed, 4])
    rays = ray_table(camera.lens).astype(np.float32)
    grain = grain_of(camera.lens.image_size, optics.noise, rng)
    bodies = [(t, body(t.shape)) for t in scene.targets if t.shape is not None]
    for frame in range(camera.frames):
        time = float(camera.frame_time_s(np.array([frame]))[0])
        view = view_at(camera, time)
        image = ground_seen(view, country, rays)
        _draw_vehicles(image, view, bodies, time)
        if country.bridge is not None:
            _draw_solids(image, view, (country.bridge,))
        _draw_solids(image, view, country.solids)
        yield sensed(image, optics, grain, rng)


def view_at(camera: SceneCamera, time_s: float) -> View:
    """The camera at a common time."""
    centre, enu_from_cam = camera_pose(camera.platform, np.array([time_s]))
    return View(lens=camera.lens, centre_enu_m=centre[0], cam_from_enu=rotation.matrix(enu_from_cam[0]).T)


def ray_table(lens: CameraModel) -> Floats:
    """For every pixel the point (rows, columns, 2) of the plane z = 1 that it looks through: the lens' inverse."""
    width, height = lens.image_size
    columns, rows = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 1, 2)
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 30, 1e-9)
    if lens.model == "fisheye":
        flat = cv2.fisheye.undistortPoints(pixels, lens.K, lens.distortion, criteria=stop)
    else:
        flat = cv2.undistortPoints(pixels, lens.K, lens.distortion, None, None, None, stop)
    return np.asarray(flat.reshape(height, width, 2))


def ground_seen(view: View, country: Country, rays: npt.NDArray[np.floating]) -> Image:
    """The ground plane up = 0 through the camera, which is mirrored at the texture's edges."""
    plane_in_cam = np.column_stack(
        [view.cam_from_enu[:, 0], view.cam_from_enu[:, 1], -view.cam_from_enu @ view.centre_enu_m]
    )
    texel_from_ray = country.texel_from_plane @ np.linalg.inv(plane_in_cam)
    lookup = cv2.perspectiveTransform(rays, texel_from_ray).astype(np.float32, copy=False)
    border = cv2.BORDER_REFLECT_101
    seen = cv2.remap(country.ground, lookup, None, cv2.INTER_LINEAR, borderMode=border)  # type: ignore[call-overload]
    return np.asarray(seen, np.uint8)


def _draw_solids(image: Image, view: View, solids: tuple[Solid, ...]) -> None:
    """Solids from far to near, straight into the picture."""
    if not solids:
        return
    height, width = image.shape[:2]
    corners = [c for s in solids for c in s.corners_enu_m]
    pixels = view.pixels(np.concatenate(corners))
    starts = np.cumsum([0, *(len(c) for c in corners)])
    low, high = (extreme.reduceat(pixels, starts[:-1]) for extreme in (np.minimum, np.maximum))
    meets: Bools = np.asarray(np.all((high > 0) & (low < (width, height)) & (high - low < width), axis=1))
    fixed = np.round(np.nan_to_num(np.clip(pixels, -2 * width, 3 * width)) * (1 << SHIFT)).astype(np.int32)
    first = np.cumsum([0, *(len(s.corners_enu_m) for s in solids)])
    away = [-np.linalg.norm(s.corners_enu_m[0].mean(axis=0) - view.centre_enu_m) for s in solids]
    for k in np.argsort(away, kind="stable"):
        for piece in range(first[k], first[k + 1]):
            if meets[piece]:
                points = fixed[starts[piece] : starts[piece + 1]]
                cv2.fillPoly(image, [points], solids[k].colours[piece - first[k]], cv2.LINE_AA, SHIFT)


def _draw_vehicles(image: Image, view: View, bodies: list[tuple[SceneTarget, Body]], time_s: float) -> None:
    placed = [(*axes_of(target, time_s), shape) for target, shape in bodies]
    placed.sort(key=lambda one: -float(np.linalg.norm(one[0] - view.centre_enu_m)))
    for centre, enu_from_vehicle, shape in placed:
        draw_vehicle(image, view, shape, centre, enu_from_vehicle)


def draw_vehicle(image: Image, view: View, shape: Body, centre_enu_m: Floats, enu_from_vehicle: Floats) -> None:
    """Draw one vehicle into `image`: soft shadow, the walls that face the camera, the roof and its panels."""
    sight = (view.centre_enu_m - centre_enu_m) @ enu_from_vehicle
    front = [i for i, out in enumerate(shape.facing) if (sight - out) @ out > 0]
    pieces = [shape.shadow, *(shape.walls[i] for i in front), *shape.roof]
    colours = [*(shape.wall_colour[i] for i in front), *shape.roof_colour]
    pixels = view.pixels(centre_enu_m + np.concatenate(pieces) @ enu_from_vehicle.T)
    if not np.isfinite(pixels).all():
        return
    left, top = np.maximum(np.floor(pixels.min(axis=0)).astype(int) - 4, 0)
    right, bottom = np.minimum(np.ceil(pixels.max(axis=0)).astype(int) + 5, image.shape[1::-1])
    if right <= left or bottom <= top:
        return
    window = image[top:bottom, left:right]
    fine = (pixels - np.array([left, top]) + 0.5) * FINE - 0.5
    shadow, *polygons = np.split(
        np.round(fine * (1 << SHIFT)).astype(np.int32), np.cumsum([len(p) for p in pieces])[:-1]
    )
    canvas = cv2.resize(_shaded(window, shadow), None, fx=FINE, fy=FINE, interpolation=cv2.INTER_NEAREST)
    for polygon, colour in zip(polygons, colours, strict=True):
        cv2.fillConvexPoly(canvas, polygon, colour, cv2.LINE_AA, SHIFT)
    window[:] = cv2.resize(canvas, window.shape[1::-1], interpolation=cv2.INTER_AREA)


def _shaded(window: Image, shadow: Floats) -> Image:
    mask = np.zeros((window.shape[0] * FINE, window.shape[1] * FINE), np.uint8)
    cv2.fillConvexPoly(mask, shadow, 255, cv2.LINE_8, SHIFT)
    small = cv2.resize(mask, window.shape[1::-1], interpolation=cv2.INTER_AREA)
    keep = 1 - (1 - SHADOW) / 255 * cv2.GaussianBlur(small, (0, 0), 0.8).astype(np.float32)
    return np.asarray(window * keep[:, :, None], np.uint8)


def grain_of(size: tuple[int, int], noise: float, rng: np.random.Generator) -> Grain:
    """Noise a little larger than the image; every frame takes another part of it."""
    width, height = size
    return np.round(noise * rng.standard_normal((height + 96, width + 96, 3), dtype=np.float32)).astype(np.int8)


def sensed(image: Image, optics: Optics, grain: Grain, rng: np.random.Generator) -> Image:
    """The picture after lens and sensor; which part of the noise it gets is drawn from `rng`."""
    if optics.blur_px > 0:
        image = np.asarray(cv2.GaussianBlur(image, (5, 5), optics.blur_px), np.uint8)
    if optics.noise <= 0:
        return image
    row, column = rng.integers(0, 96, 2)
    part = grain[row : row + image.shape[0], column : column + image.shape[1]]
    return np.asarray(cv2.add(image, part, dtype=cv2.CV_8U), np.uint8)
