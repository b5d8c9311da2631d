"""Flights drawn with nothing of the project: cameras, motions, clocks and instruments vary widely.

World: ENU metres. Camera axes: x right, y down, z forward. A flight is plain values until `write` makes files of it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

MOTIONS = ("straight", "curve", "stop-and-go", "u-turn", "roundabout", "hover", "parked", "weave")
PATHS = ("hover", "straight", "arc", "orbit")
GRADES = {  # attitude bias and white (deg), position bias and white (m), pixel
    "gnss": (0.5, 0.5, 3.0, 1.0, 1.0),
    "good": (0.3, 0.2, 1.0, 0.3, 1.0),
    "rtk": (0.1, 0.1, 0.05, 0.02, 0.5),
}


@dataclass
class Camera:
    """One camera as it is, and what is claimed of it."""

    name: str
    size: tuple[int, int]
    focal_px: float
    rate_hz: float
    begin_s: float
    frames: int
    position_m: np.ndarray  # (k, 3) true at every frame
    enu_from_cam: Rotation  # (k,) true
    grade: tuple[float, ...]
    path: object = None
    told_rate_hz: float = 0.0
    told_k: np.ndarray | None = None
    told_sigma: dict = field(default_factory=dict)
    told: dict = field(default_factory=dict)  # further keys of the flight file
    table_s: np.ndarray | None = None  # a pose table by log time instead of by frame
    told_position_m: np.ndarray | None = None
    told_attitude: Rotation | None = None
    tracks: dict = field(default_factory=dict)  # target -> (frames, xy)


@dataclass
class Flight:
    """Everything, with its truth."""

    cameras: list[Camera]
    motions: dict  # target -> function of time (n,) -> (n, 3)
    kinds: dict
    told_targets: dict = field(default_factory=dict)
    span_s: tuple[float, float] = (0.0, 0.0)


def smooth(t, low, high, a, b):
    """From `a` before `low` to `b` after `high`, without a kink."""
    u = np.clip((t - low) / max(high - low, 1e-9), 0, 1)
    return a + (b - a) * u * u * (3 - 2 * u)


def motion(rng, kind, span_s, ground_m, reach_m, flies):
    """A motion of some kind over a span of time, somewhere within the reach."""
    place = np.append(rng.uniform(-reach_m, reach_m, 2), ground_m + (rng.uniform(5, 60) if flies else 0.8))
    heading, speed = rng.uniform(0, 2 * np.pi), rng.uniform(3, 16)
    middle = 0.5 * sum(span_s)
    fine = np.linspace(span_s[0] - 5, span_s[1] + 5, 4001)
    length = span_s[1] - span_s[0]
    v, turn = np.full(fine.shape, speed), np.zeros(fine.shape)
    if kind == "curve":
        turn += rng.uniform(0.03, 0.15) * rng.choice([-1, 1])
    if kind == "stop-and-go":
        at, stay = middle + rng.uniform(-0.25, 0.2) * length, rng.uniform(1, 0.3 * length + 1)
        v = smooth(fine, at - 3, at, speed, 0.0) + smooth(fine, at + stay, at + stay + 4, 0.0, speed)
    if kind == "u-turn":
        at, dur = middle + rng.uniform(-0.2, 0.2) * length, rng.uniform(3, 6)
        v = np.minimum(v, smooth(fine, at - 2, at, speed, 5.0) + smooth(fine, at + dur, at + dur + 3, 0, speed))
        turn += np.where((fine > at) & (fine < at + dur), np.pi / dur * rng.choice([-1, 1]), 0)
    if kind == "roundabout":
        radius = rng.uniform(12, 40)
        v[:] = rng.uniform(4, 9)
        turn += v[0] / radius * rng.choice([-1, 1])
    if kind == "weave":
        turn += rng.uniform(0.15, 0.4) * np.sin(2 * np.pi * fine / rng.uniform(4, 9) + rng.uniform(0, 6))
    if kind in ("hover", "parked"):
        v[:] = 0
    dt = fine[1] - fine[0]
    way = heading + np.cumsum(turn) * dt
    xy = np.cumsum(np.stack([v * np.sin(way), v * np.cos(way)], 1) * dt, 0)
    up = np.zeros(len(fine))
    if flies:
        up = rng.uniform(0, 4) * np.sin(2 * np.pi * fine / rng.uniform(8, 20) + rng.uniform(0, 6))
    if kind == "hover":
        wave = rng.uniform(0, 6, 2)
        xy = xy + rng.uniform(0.2, 1.0) * np.sin(fine[:, None] * rng.uniform(0.3, 1.0) + wave)
    xy = xy - xy[np.argmin(abs(fine - middle))]
    grid = place + np.column_stack([xy, up])
    return lambda t: np.stack([np.interp(t, fine, grid[:, k]) for k in range(3)], 1)


def looking(position, at, roll):
    """enu_from_cam (n,) of cameras that look at points, rolled."""
    z = at - position
    z = z / np.linalg.norm(z, axis=1, keepdims=True)
    x = np.cross(z, [0, 0, 1.0])
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(z, x)
    return Rotation.from_matrix(np.stack([x, y, z], 2)) * Rotation.from_rotvec(np.outer(roll, [0, 0, 1.0]))


def flown(rng, kind, t, centre, bearing, reach_m):
    """Position (n, 3) of a camera at common times."""
    distance, height = rng.uniform(0.8, 2.2) * reach_m + 40, rng.uniform(35, 160)
    speed = rng.uniform(2, 12)
    out = centre + np.array([np.sin(bearing) * distance, np.cos(bearing) * distance, height])
    middle = t - t.mean()
    if kind == "hover":
        waves = [rng.uniform(0.1, 0.6) * np.sin(t * rng.uniform(0.2, 0.9) + rng.uniform(0, 6)) for _ in range(3)]
        return out + np.stack(waves, 1)
    if kind == "straight":
        h = rng.uniform(0, 2 * np.pi)
        return out + middle[:, None] * speed * np.array([np.sin(h), np.cos(h), rng.uniform(-0.1, 0.1)])
    radius = rng.uniform(30, 120) if kind == "arc" else distance
    w = speed / radius * rng.choice([-1, 1])
    around = out - radius * np.array([np.sin(bearing), np.cos(bearing), 0])
    return around + radius * np.stack([np.sin(bearing + w * middle), np.cos(bearing + w * middle), 0 * t], 1)


def draw(seed, *, cameras=None, targets=None, length_s=None, grade=None, motions=None, by_time=False):
    """A flight without mistakes."""
    rng = np.random.default_rng(seed)
    n_cam = cameras or int(rng.choice([2, 2, 2, 3, 4]))
    n_tgt = targets or int(rng.integers(1, 9))
    length = length_s or float(np.exp(rng.uniform(np.log(6), np.log(60))))
    grade_of = GRADES[grade or str(rng.choice(list(GRADES)))]
    reach = rng.uniform(25, 90)
    kinds = [str(rng.choice(motions or MOTIONS)) for _ in range(n_tgt)]
    if all(k in ("parked", "hover") for k in kinds):
        kinds[0] = str(rng.choice(["curve", "stop-and-go", "weave"]))
    flies = rng.random() < 0.25
    span = (-3.0, length + 3.0)
    of = {f"car{i + 1}": motion(rng, k, span, 0.0, reach, flies) for i, k in enumerate(kinds)}
    bearings = rng.uniform(0, 2 * np.pi) + np.cumsum(rng.uniform(0.6, 1.9, n_cam))
    flight = Flight(cameras=[], motions=of, kinds=dict(zip(of, kinds, strict=True)), span_s=span)
    for c in range(n_cam):
        rate = float(rng.choice([24.0, 25.0, 25.0, 30.0, 15.0]))
        true_rate = rate * (1 + (rng.normal() * 2e-4 if c else 0))
        begin = 0.0 if c == 0 else float(rng.uniform(-2.5, 2.5))
        frames = int(length * rate)
        size = [(1280, 720), (1920, 1080), (640, 360)][int(rng.integers(3))]
        focal = size[0] * rng.uniform(0.7, 1.4)
        seed_path = int(rng.integers(1 << 31))
        kind = str(rng.choice(PATHS))
        sway = rng.uniform(0, 0.02, 3), rng.uniform(0.2, 1.2, 3), rng.uniform(0, 6, 3)
        aim = rng.normal(0, 0.12 * reach, 3) * [1, 1, 0]
        follow = rng.random() < 0.6

        def pose(t, seed_path=seed_path, kind=kind, bearing=bearings[c], sway=sway, aim=aim, follow=follow):
            long = np.linspace(span[0] - 10, span[1] + 10, 3001)
            p = flown(np.random.default_rng(seed_path), kind, long, np.zeros(3), bearing, reach)
            centre = np.mean([f(long) for f in of.values()], 0) * ([1, 1, 0.3] if follow else [0, 0, 0])
            at = centre + aim
            p = p + np.array([1, 1, 0]) * centre.mean(0)
            roll = sway[0][0] * np.sin(sway[1][0] * long + sway[2][0])
            r = looking(p, at, roll)
            q = r.as_quat()
            q[1:] *= np.cumprod(np.where((q[1:] * q[:-1]).sum(1) < 0, -1, 1))[:, None]
            pos = np.stack([np.interp(t, long, p[:, k]) for k in range(3)], 1)
            quat = np.stack([np.interp(t, long, q[:, k]) for k in range(4)], 1)
            return pos, Rotation.from_quat(quat)

        t = begin + np.arange(frames) / true_rate
        p, r = pose(t)
        cam = Camera(
            name=f"uav{c + 1}", size=size, focal_px=focal, rate_hz=true_rate, begin_s=begin, frames=frames,
            position_m=p, enu_from_cam=r, grade=grade_of, path=pose, told_rate_hz=rate,
        )  # fmt: skip
        measure(rng, cam, by_time)
        see(rng, cam, of, length)
        flight.cameras.append(cam)
    seen_by = {t: sum(t in c.tracks for c in flight.cameras) for t in of}
    for t, n in seen_by.items():
        if n < 2:
            for c in flight.cameras:
                c.tracks.pop(t, None)
    flight.motions = {t: f for t, f in of.items() if seen_by[t] > 1}
    return flight


def measure(rng, cam, by_time):
    """What the instruments say: constant and white errors as claimed."""
    ab, aw, pb, pw, px = cam.grade
    keys = ("attitude_bias_deg", "attitude_deg", "position_bias_m", "position_m", "pixel")
    cam.told_sigma = dict(zip(keys, (ab, aw, pb, pw, px), strict=True))
    p, r = cam.position_m, cam.enu_from_cam
    if by_time:
        cam.table_s = np.arange(-4.0, cam.frames / cam.rate_hz + 4.0, 1 / 20)
        p, r = cam.path(cam.begin_s + cam.table_s)
        cam.told |= {"start": 0.0, "frame_rate": cam.told_rate_hz}
    else:
        cam.told |= {"frame_rate": cam.told_rate_hz}
    n = len(p)
    cam.told_position_m = p + rng.normal(0, pb, 3) + rng.normal(0, pw, (n, 3))
    bias = Rotation.from_rotvec(np.radians(rng.normal(0, ab, 3)))
    cam.told_attitude = r * bias * Rotation.from_rotvec(np.radians(rng.normal(0, aw, (n, 3))))


def project(cam, position, attitude, x):
    """Pixels (n, 2) of points (n, 3); NaN behind the camera."""
    y = attitude.inv().apply(x - position)
    y[y[:, 2] < 1] = np.nan
    return cam.focal_px * y[:, :2] / y[:, 2:] + (np.array(cam.size) - 1) / 2


def see(rng, cam, motions, length):
    """Tracks with white noise; a target is lost now and then."""
    t = cam.begin_s + np.arange(cam.frames) / cam.rate_hz
    for name, f in motions.items():
        xy = project(cam, cam.position_m, cam.enu_from_cam, f(t))
        ok = ((xy > 4) & (xy < np.array(cam.size) - 5)).all(1)
        if rng.random() < 0.3:
            at = rng.integers(0, cam.frames)
            ok[at : at + int(rng.uniform(0.05, 0.2) * cam.frames)] = False
        if ok.sum() < 0.4 * cam.frames or ok.sum() < 20:
            continue
        cam.tracks[name] = (np.flatnonzero(ok), xy[ok] + rng.normal(0, cam.grade[4], (ok.sum(), 2)))


def write(flight, folder: Path) -> Path:
    """flight.toml, camera files, tracks, pose tables."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["[flight]", 'reference_camera = "uav1"', "[solve]"]
    for cam in flight.cameras:
        _write_camera(cam, folder)
        lines += [
            f"[cameras.{cam.name}]", f'calibration = "{cam.name}.json"', f'tracks = "{cam.name}-tracks.csv"',
            f'telemetry = "{cam.name}-poses.csv"',
        ]  # fmt: skip
        lines += [f"{key} = {value!r}" for key, value in cam.told.items() if key != "size"]
        lines += [f"[cameras.{cam.name}.sigma]", *(f"{key} = {value!r}" for key, value in cam.told_sigma.items())]
    for name, told in flight.told_targets.items():
        lines += [f"[targets.{name}]"] + [f"{key} = {json.dumps(value)}" for key, value in told.items()]
    (folder / "flight.toml").write_text("\n".join(lines) + "\n")
    return folder / "flight.toml"


def plain_k(cam, factor=1.0):
    """The camera's matrix, of a picture so many times as large."""
    f, (w, h) = cam.focal_px * factor, cam.size
    return np.array([[f, 0, factor * w / 2 - 0.5], [0, f, factor * h / 2 - 0.5], [0, 0, 1.0]])


def _write_camera(cam, folder):
    k = plain_k(cam) if cam.told_k is None else cam.told_k
    size = list(cam.told.get("size", cam.size))
    model = {"model": "pinhole", "image_size": size, "K": k.tolist(), "distortion": [0.0] * 5}
    (folder / f"{cam.name}.json").write_text(json.dumps(model))
    rows = sorted((int(f), n, *xy) for n, (fr, xys) in cam.tracks.items() for f, xy in zip(fr, xys, strict=True))
    text = "".join(f"{f},{n},{x:.4f},{y:.4f}\n" for f, n, x, y in rows)
    (folder / f"{cam.name}-tracks.csv").write_text(f"frame,target,x_px,y_px\n{text}")
    q = cam.told_attitude.as_quat()
    first = np.arange(len(q)) if cam.table_s is None else cam.table_s
    poses = np.column_stack([first, cam.told_position_m, q[:, 3], q[:, :3]])
    text = "".join(",".join(f"{v:.9g}" for v in row) + "\n" for row in poses)
    head = "frame" if cam.table_s is None else "time_s"
    (folder / f"{cam.name}-poses.csv").write_text(f"{head},east_m,north_m,up_m,qw,qx,qy,qz\n{text}")
