"""Small rendered flights with known image truth: a textured ground under a moving camera, cars, and bridges over them.

Everything lies in one ground plane (units: ground pixels); image_from_ground(f) is a homography. The tracked point of a
car is the one under its first box's centre.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import cv2
import numpy as np

from pipeline.records import Box

FINE = 6
Random = np.random.Generator


@dataclass(frozen=True, kw_only=True)
class Car:
    """A car seen from above, and its way."""

    name: str
    look: np.ndarray  # (h, w, 4) BGRA, `FINE` pixels for a ground pixel
    place: np.ndarray  # (frames, 2) ground
    heading: np.ndarray  # (frames,)
    size: tuple[float, float]  # length, width on the ground


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A ground with cars on it and bridges over them, and how the camera sees it in every frame."""

    size: tuple[int, int]
    image_from_ground: np.ndarray  # (frames, 3, 3)
    ground: np.ndarray
    ground_corner: np.ndarray
    cars: tuple[Car, ...]
    bridges: tuple[np.ndarray, ...]  # polygons (k, 2) on the ground
    blur: float
    noise: float
    rate: float
    seed: int

    @property
    def frames(self) -> int:
        """How many."""
        return len(self.image_from_ground)


def scene(
    seed: int,
    frames: int = 250,
    size: tuple[int, int] = (1280, 720),
    lengths: tuple[float, ...] = (14, 22, 32, 46),
    hidden: tuple[int, ...] = (8, 12, 18, 24),
    speed: float = 2.0,
) -> Scene:
    """Cars of `lengths` image pixels, each hidden for about `hidden` frames (0: never)."""
    rng = np.random.default_rng(seed)
    t = np.arange(frames) / frames
    width, height = size
    wander = [rng.normal(size=3) for _ in range(5)]
    smooth = [sum(a * np.sin((k + 1) * 2.2 * t + a * 9) for k, a in enumerate(w)) for w in wander]
    run = rng.uniform(0, 2 * np.pi)
    east = np.cos(run) * 2.5 * frames * t + 30 * smooth[0]
    north = np.sin(run) * 2.5 * frames * t + 30 * smooth[1]
    turn, zoom = 0.15 * smooth[2] + 0.3 * t, np.exp(0.08 * smooth[3])
    lean = 2.0e-4 * np.array([np.cos(run), np.sin(run)]) * (1 + 0.2 * smooth[4][:, None])
    jitter = np.cumsum(rng.normal(0, 0.3, (frames, 2)), axis=0)
    maps = []
    for f in range(frames):
        c, s = zoom[f] * np.cos(turn[f]), zoom[f] * np.sin(turn[f])
        centre = np.array([[1, 0, -east[f] + jitter[f, 0]], [0, 1, -north[f] + jitter[f, 1]], [0, 0, 1.0]])
        rotate = np.array([[c, -s, 0], [s, c, 0], [lean[f, 0], lean[f, 1], 1.0]])
        maps.append(np.array([[1, 0, width / 2], [0, 1, height / 2], [0, 0, 1.0]]) @ rotate @ centre)
    image_from_ground = np.array(maps)
    cars: list[Car] = []
    for i, length in enumerate(lengths):
        cars.append(_plausible_car(rng, cars, f"car{i + 1}", length, image_from_ground, size, i, len(lengths), speed))
    bridges = [_free_bridge(rng, cars, i, hidden[i]) for i in range(len(cars)) if hidden[i]]
    ground, corner = _ground(rng, image_from_ground, size)
    return Scene(
        size=size,
        image_from_ground=image_from_ground,
        ground=ground,
        ground_corner=corner,
        cars=tuple(cars),
        bridges=tuple(bridges),
        blur=float(rng.uniform(0.5, 1.0)),
        noise=float(rng.uniform(1.5, 3.0)),
        rate=25.0,
        seed=seed,
    )


def _plausible_car(
    rng: Random,
    others: list[Car],
    name: str,
    length: float,
    maps: np.ndarray,
    size: tuple[int, int],
    index: int,
    count: int,
    speed_px: float,
) -> Car:
    """A car that neither spins nor flies nor leaves the image nor runs into another; else the last one tried."""
    for _ in range(200):
        car = _car(rng, name, length, maps, size, index, count, speed_px)
        speed = np.hypot(*np.gradient(car.place, axis=0).T).max() / car.size[0] * 25
        turn = np.abs(np.gradient(car.heading)).max() * 25
        outline = np.concatenate([_placed(maps[f], car, f) for f in range(0, len(maps), 5)])
        inside = bool(np.all(outline > 4) and np.all(outline < np.array(size) - 4))
        gap = [np.hypot(*(car.place - o.place).T).min() - (car.size[0] + o.size[0]) * 0.8 for o in others]
        if speed < 8 and turn < np.radians(30) and inside and min(gap, default=1.0) > 0:
            break
    return car


def _car(
    rng: Random,
    name: str,
    length: float,
    maps: np.ndarray,
    size: tuple[int, int],
    index: int,
    count: int,
    speed: float,
) -> Car:
    frames = len(maps)
    width, height = size
    spot = np.array([width * (0.3 + 0.4 * rng.random()), height * (index + 0.7) / (count + 0.4)])
    # keep the car in view: it drives with the camera, plus its own motion
    follow = np.array([_apply(np.linalg.inv(m), spot) for m in maps])
    drift = rng.normal(size=2) * speed * 0.25 * frames / 2
    u = np.linspace(-1, 1, frames)
    curve = rng.normal(size=2) * 10
    smooth_follow = np.column_stack([np.polyval(np.polyfit(u, follow[:, k], 3), u) for k in range(2)])
    place = smooth_follow + u[:, None] * drift + np.cos(2.5 * u)[:, None] * curve
    velocity = np.gradient(place, axis=0)
    heading = np.arctan2(velocity[:, 1], velocity[:, 0])
    return Car(
        name=name,
        look=_look(rng, length),
        place=place,
        heading=np.unwrap(heading),
        size=(length, length * rng.uniform(0.45, 0.65)),
    )


def _look(rng: Random, length: float) -> np.ndarray:
    w, h = round(length * FINE), round(length * 0.55 * FINE)
    base = rng.uniform(30, 225, 3) * 0.6 + rng.uniform(30, 225) * 0.4
    look = np.tile(base, (h, w, 1))
    x, y = np.linspace(0, 1, w)[None, :], np.linspace(0, 1, h)[:, None]
    roof = (x > 0.35) & (x < 0.72) & (y > 0.12) & (y < 0.88)
    look[roof] = np.clip(base + rng.normal(0, 35, 3), 10, 245)
    for a, b in ((0.27, 0.36), (0.71, 0.8)):
        look[(x > a) & (x < b) & (y > 0.1) & (y < 0.9)] = rng.uniform(15, 60, 3)
    for _ in range(4):
        a, b = rng.uniform(0, 0.9), rng.uniform(0, 0.8)
        look[(x > a) & (x < a + 0.12) & (y > b) & (y < b + 0.2)] += rng.normal(0, 40, 3)
    look = np.clip(look, 0, 255)
    alpha = np.full((h, w, 1), 255.0)
    return np.concatenate([look, alpha], axis=2).astype(np.float32)


def _free_bridge(rng: Random, cars: list[Car], own: int, hidden: int) -> np.ndarray:
    """A bridge over one car that leaves the others in view, where there is one."""
    for _ in range(30):
        bridge = _bridge(rng, cars[own], hidden)
        polygon = bridge.astype(np.float32).reshape(-1, 1, 2)
        under = [cv2.pointPolygonTest(polygon, tuple(map(float, p)), False) >= 0 for p in cars[own].place]
        others = [(car, f) for i, car in enumerate(cars) if i != own for f in range(0, len(car.place), 4)]
        apart = all(cv2.pointPolygonTest(polygon, tuple(map(float, c.place[f])), True) < -c.size[0] for c, f in others)
        if apart and sum(under) < 2.5 * hidden + 12:
            break
    return bridge


def _bridge(rng: Random, car: Car, hidden: int) -> np.ndarray:
    """A strip across the car's way in the middle third of the flight, wide enough to hide it for about `hidden`."""
    frames = len(car.place)
    at = int(frames * rng.uniform(0.4, 0.7))
    way = car.place[min(at + hidden, frames - 1)] - car.place[at]
    along = way / max(1e-6, np.linalg.norm(way))
    across = np.array([-along[1], along[0]])
    half = np.linalg.norm(way) / 2 + car.size[0] / 2
    centre = car.place[at] + way / 2
    reach = 1.5 * car.size[0]
    corners = [(half, reach), (half, -reach), (-half, -reach), (-half, reach)]
    return np.array([centre + a * along + b * across for a, b in corners])


def _ground(rng: Random, maps: np.ndarray, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    corners = np.array([[0, 0], [size[0], 0], [0, size[1]], [size[0], size[1]]], float)
    seen = np.concatenate([[_apply(np.linalg.inv(m), c) for c in corners] for m in maps[:: max(1, len(maps) // 20)]])
    low, high = np.floor(seen.min(axis=0)) - 60, np.ceil(seen.max(axis=0)) + 60
    w, h = (high - low).astype(int)
    ground = np.full((h, w, 3), 110.0, np.float32)
    for octave, strength in ((400, 25), (120, 18), (40, 14), (12, 12), (4, 10)):
        small = rng.normal(0, strength, (h // octave + 3, w // octave + 3, 3)).astype(np.float32)
        small = 0.7 * small.mean(axis=2, keepdims=True) * 1.7 + 0.3 * small
        ground += cv2.resize(small, (w, h), interpolation=cv2.INTER_CUBIC)
    for _ in range(w * h // 12000):
        x, y = rng.integers(0, w), rng.integers(0, h)
        colour = tuple(float(c) for c in rng.uniform(20, 220, 3))
        axes = (int(rng.integers(3, 25)), int(rng.integers(3, 15)))
        cv2.ellipse(ground, (int(x), int(y)), axes, float(rng.uniform(0, 180)), 0, 360, colour, -1, cv2.LINE_AA)
    return np.clip(ground, 0, 255), low


def _apply(homography: np.ndarray, point: np.ndarray) -> np.ndarray:
    p = homography @ np.array([point[0], point[1], 1.0])
    return np.asarray(p[:2] / p[2])


def image_from_car(scene: Scene, car: Car, f: int) -> np.ndarray:
    """Homography from car axes (ground pixels, origin at its middle, x forward) to the image."""
    c, s = np.cos(car.heading[f]), np.sin(car.heading[f])
    x, y = car.place[f]
    return np.asarray(scene.image_from_ground[f] @ np.array([[c, -s, x], [s, c, y], [0, 0, 1.0]]))


def _outline(scene: Scene, car: Car, f: int) -> np.ndarray:
    return _placed(scene.image_from_ground[f], car, f)


def _placed(image_from_ground: np.ndarray, car: Car, f: int) -> np.ndarray:
    """The corners of a car in the image, (4, 2)."""
    length, width = car.size
    corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * np.array([length, width]) / 2
    c, s = np.cos(car.heading[f]), np.sin(car.heading[f])
    ground = corners @ np.array([[c, s], [-s, c]]) + car.place[f]
    return np.array([_apply(image_from_ground, p) for p in ground])


def first_box(scene: Scene, car: Car, f: int = 0, slack: float = 0.0) -> Box:
    """The box around a car in frame `f`, `slack` pixels wider on every side."""
    outline = _outline(scene, car, f)
    low, high = outline.min(axis=0) - slack, outline.max(axis=0) + slack
    return Box(frame=f, x=low[0] + 0.5, y=low[1] + 0.5, width=high[0] - low[0], height=high[1] - low[1])


def truth(scene: Scene, car: Car, box: Box) -> tuple[np.ndarray, np.ndarray]:
    """Where the point under the box's centre is, (frames, 2), and the share of the car that is in view (frames,)."""
    point = _apply(np.linalg.inv(image_from_car(scene, car, box.frame)), np.array(box.centre_px))
    xy = np.array([_apply(image_from_car(scene, car, f), point) for f in range(scene.frames)])
    return xy, np.array([_visible(scene, car, f) for f in range(scene.frames)])


def _visible(scene: Scene, car: Car, f: int) -> float:
    length, width = car.size
    gx, gy = np.meshgrid(np.linspace(-0.48, 0.48, 15) * length, np.linspace(-0.48, 0.48, 9) * width)
    c, s = np.cos(car.heading[f]), np.sin(car.heading[f])
    ground = np.column_stack([c * gx.ravel() - s * gy.ravel(), s * gx.ravel() + c * gy.ravel()]) + car.place[f]
    seen = np.ones(len(ground), bool)
    for bridge in scene.bridges:
        polygon = bridge.astype(np.float32).reshape(-1, 1, 2)
        seen &= np.array([cv2.pointPolygonTest(polygon, (float(x), float(y)), False) < 0 for x, y in ground])
    image = np.array([_apply(scene.image_from_ground[f], p) for p in ground])
    seen &= (image >= -0.5).all(axis=1) & (image[:, 0] < scene.size[0] - 0.5) & (image[:, 1] < scene.size[1] - 0.5)
    return float(seen.mean())


def render(scene: Scene) -> Iterator[np.ndarray]:
    """The frames, (h, w, 3) uint8 BGR."""
    rng = np.random.default_rng(scene.seed + 1000)
    shift = np.array([[1, 0, scene.ground_corner[0]], [0, 1, scene.ground_corner[1]], [0, 0, 1.0]])
    noise = rng.normal(0, scene.noise, (scene.size[1] + 64, scene.size[0] + 64, 3)).astype(np.float32)
    for f in range(scene.frames):
        image = cv2.warpPerspective(
            scene.ground,
            scene.image_from_ground[f] @ shift,
            scene.size,
            flags=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REFLECT,
        )
        for car in scene.cars:
            _draw(image, scene, car, f)
        for bridge in scene.bridges:
            _cover(image, scene, bridge, f)
        image = cv2.GaussianBlur(image, (0, 0), scene.blur)
        a, b = rng.integers(0, 64, 2)
        grain = noise[a : a + scene.size[1], b : b + scene.size[0]]
        yield np.clip(np.rint(np.add(image, grain)), 0, 255).astype(np.uint8)


def _draw(image: np.ndarray, scene: Scene, car: Car, f: int, fine: int = 4) -> None:
    outline = _outline(scene, car, f)
    left, top = np.maximum(np.floor(outline.min(axis=0)).astype(int) - 2, 0)
    right, bottom = np.minimum(np.ceil(outline.max(axis=0)).astype(int) + 3, scene.size)
    if right - left < 2 or bottom - top < 2:
        return
    h, w = car.look.shape[:2]
    car_from_look = np.array(
        [[car.size[0] / w, 0, -car.size[0] / 2], [0, car.size[1] / h, -car.size[1] / 2], [0, 0, 1.0]]
    ) @ np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]])
    fine_from_image = np.array([[fine, 0, (0.5 - left) * fine - 0.5], [0, fine, (0.5 - top) * fine - 0.5], [0, 0, 1.0]])
    warp = fine_from_image @ image_from_car(scene, car, f) @ car_from_look
    drawn = cv2.warpPerspective(car.look, warp, ((right - left) * fine, (bottom - top) * fine), flags=cv2.INTER_LINEAR)
    drawn = cv2.resize(drawn, (right - left, bottom - top), interpolation=cv2.INTER_AREA)
    alpha = drawn[:, :, 3:] / 255
    piece = image[top:bottom, left:right]
    piece[:] = piece * (1 - alpha) + drawn[:, :, :3]


def _cover(image: np.ndarray, scene: Scene, bridge: np.ndarray, f: int) -> None:
    polygon = np.array([_apply(scene.image_from_ground[f], p) for p in bridge])
    rng = np.random.default_rng(int(abs(bridge.sum())))
    mask = np.zeros(image.shape[:2], np.uint8)
    cv2.fillPoly(mask, [np.rint(polygon * 16).astype(np.int32)], 255, cv2.LINE_AA, 4)
    look = rng.uniform(60, 190, (8, 8, 3)).astype(np.float32)
    corners = np.array([[0, 0], [7, 0], [7, 7], [0, 7]], np.float32)
    warp = cv2.getPerspectiveTransform(corners, polygon.astype(np.float32))
    x, y, w, h = cv2.boundingRect(polygon.astype(np.float32))
    x, y, w, h = max(0, x), max(0, y), min(w, image.shape[1]), min(h, image.shape[0])
    if x >= image.shape[1] or y >= image.shape[0] or w < 1 or h < 1:
        return
    to = np.array([[1, 0, -x], [0, 1, -y], [0, 0, 1.0]])
    drawn = cv2.warpPerspective(look, to @ warp, (w, h), borderMode=cv2.BORDER_REPLICATE)
    piece = image[y : y + h, x : x + w]
    alpha = mask[y : y + h, x : x + w, None].astype(np.float32) / 255
    piece[:] = piece * (1 - alpha) + drawn[: piece.shape[0], : piece.shape[1]] * alpha


def write(frames: Iterator[np.ndarray], path: Path, rate: float = 25.0, codec: str = "mp4v", crf: int = 20) -> None:
    """Writes a video; codec "h264" needs imageio_ffmpeg."""
    if codec == "h264":
        _write_h264(frames, path, rate, crf)
        return
    writer = None
    for frame in frames:
        if writer is None:
            writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), rate, (frame.shape[1], frame.shape[0]))
        writer.write(frame)
    assert writer is not None
    writer.release()


def _write_h264(frames: Iterator[np.ndarray], path: Path, rate: float, crf: int) -> None:
    import imageio_ffmpeg

    first = next(frames)
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "bgr24"]
    command += ["-s", f"{first.shape[1]}x{first.shape[0]}", "-r", str(rate), "-i", "-", "-c:v", "libx264"]
    command += ["-preset", "fast", "-threads", "1", "-crf", str(crf), "-pix_fmt", "yuv420p", str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as encoder:
        assert encoder.stdin is not None
        for frame in chain([first], frames):
            encoder.stdin.write(frame.tobytes())
        encoder.stdin.close()
