"""Flights drawn for matching: each camera follows targets that others follow too, and as many of its own.

Cameras, motions and noise as in `drawn_flights`; beside free motions there are convoys in lanes and rows of parked
cars, on ground that is level, sloping or hilly; now and then something flies. Nothing here knows how matching works.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.records import CameraInput, InstrumentSigma, PoseTrack, SightRays
from scripts.validation.drawn_flights import MOTIONS, PATHS, flown, looking, motion

PLACES = ("mixed", "mixed", "road", "car park", "road and car park")
LEAST_COMMON_S = 5.0
"""What two cameras must see of a target at the same time for the pair to count."""


@dataclass(frozen=True, kw_only=True)
class Strangers:
    """A drawn flight: what matching gets, and which pairs ((camera, track), (camera, track)) are of one target.

    ever  also those that are hardly seen at the same time
    """

    cameras: tuple[CameraInput, ...]
    pairs: frozenset
    ever: frozenset
    offset_s: dict
    kind: str


def objects(rng, kind, count, span, reach):
    """`count` motions (time (n,) -> (n, 3)) at one kind of place."""
    height = ground(rng, reach)
    if kind == "mixed":
        found = []
        for _ in range(count):
            flies = rng.random() < 0.06
            found.append(on(height, motion(rng, str(rng.choice(MOTIONS)), span, 0.0, reach, flies)))
        return found
    if kind == "road":
        return [on(height, m) for m in convoy(rng, count, span, reach)]
    if kind == "car park":
        moving = max(1, count // 4)
        free = [
            motion(rng, str(rng.choice(("curve", "stop-and-go", "weave"))), span, 0.0, reach, False)
            for _ in range(moving)
        ]
        return [on(height, m) for m in [*parked_rows(rng, count - moving, reach), *free]]
    half = count // 2
    return [on(height, m) for m in [*convoy(rng, count - half, span, reach), *parked_rows(rng, half, reach)]]


def ground(rng, reach):
    """Height of the ground over (n,), (n,) metres: level, sloping, hilly."""
    slope = rng.normal(0, rng.choice([0.0, 0.02, 0.05]), 2)
    hill, wave = rng.choice([0.0, 0.0, 1.5, 4.0]), rng.uniform(1.5, 4.0) * reach
    phase, base = rng.uniform(0, 6.3, 2), rng.uniform(-40, 40)
    return lambda x, y: (
        base
        + slope[0] * x
        + slope[1] * y
        + hill * np.sin(6.3 * x / wave + phase[0]) * np.sin(6.3 * y / wave + phase[1])
    )


def on(height, move):
    """A motion with the ground under it."""

    def lifted(t):
        xyz = move(t)
        return xyz + np.column_stack([0 * t, 0 * t, height(xyz[:, 0], xyz[:, 1])])

    return lifted


def convoy(rng, count, span, reach):
    """Cars in up to four lanes of one road, both ways, at like speeds."""
    heading, bend = rng.uniform(0, 6.3), rng.choice([0.0, 0.0, rng.uniform(1 / 600, 1 / 150)])
    lanes = int(rng.integers(1, 5))
    speeds = rng.uniform(7, 24) * (1 + rng.normal(0, 0.08, lanes))
    spread, breath, wave = rng.choice([0.0, 0.02, 0.06]), rng.uniform(0, 0.25), rng.uniform(8, 40)
    middle, phase = 0.5 * sum(span), rng.uniform(0, 6.3, lanes)
    place = rng.uniform(-0.3, 0.3, 2) * reach
    ahead = np.zeros(lanes)
    found = []
    for k in range(count):
        lane = k % lanes
        sign = 1 if lane < (lanes + 1) // 2 else -1
        ahead[lane] += rng.uniform(9, 45)
        v = speeds[lane] * (1 + rng.normal(0, spread))
        start, side = ahead[lane] - 0.25 * count / lanes * 27, 3.5 * (lane - lanes / 2) + rng.normal(0, 0.2)

        def move(t, v=v, start=start, side=side, sign=sign, w=phase[lane]):
            gone = v * (t - middle) + v * breath * wave / 6.3 * np.sin(6.3 * (t - start / v) / wave + w)
            s = sign * (start + gone)
            if bend:
                r = 1 / bend
                x, y = (r - side) * np.sin(s * bend), r - (r - side) * np.cos(s * bend)
            else:
                x, y = s, np.full_like(s, side)
            c, n = np.cos(heading), np.sin(heading)
            return np.stack([place[0] + c * x - n * y, place[1] + n * x + c * y, np.full_like(s, 0.8)], 1)

        found.append(move)
    return [found[k] for k in rng.permutation(count)]


def parked_rows(rng, count, reach):
    """Cars side by side in rows."""
    heading, gap = rng.uniform(0, 6.3), rng.uniform(2.6, 6.0)
    place = rng.uniform(-0.5, 0.5, 2) * reach
    long = max(4, int(rng.uniform(1.0, 2.0) * np.sqrt(4 * count)))
    slots = rng.permutation(2 * long)[:count] if count <= 2 * long else np.arange(count)
    found = []
    for k in slots:
        x, y = gap * (k % long) + rng.normal(0, 0.15), 14.0 * (k // long) + rng.normal(0, 0.3)
        c, n = np.cos(heading), np.sin(heading)
        at = np.array([place[0] + c * x - n * y, place[1] + n * x + c * y, 0.8])
        found.append(lambda t, at=at: np.tile(at, (len(t), 1)))
    return found


def draw(seed):
    """One flight."""
    rng = np.random.default_rng([seed, 2210])
    n_cam, n_each = int(rng.integers(2, 5)), int(rng.integers(3, 13))
    common = (n_each + 1) // 2
    kind, reach = str(rng.choice(PLACES)), rng.uniform(30, 110)
    length = rng.uniform(20, 75)
    begin = np.concatenate([[0.0], rng.uniform(-1, 1, n_cam - 1) * min(30.0, 0.5 * length)])
    span = (begin.min() - 1, begin.max() + length + 1)
    every = objects(rng, kind, common + n_cam * (n_each - common), span, reach)
    order = rng.permutation(len(every))
    bearings = rng.uniform(0, 2 * np.pi) + np.cumsum(rng.uniform(0.4, 2.2, n_cam))
    sigma = InstrumentSigma(
        attitude_bias_rad=float(np.radians(0.5)),
        attitude_rad=float(np.radians(rng.choice([0.1, 0.3, 0.5]))),
        position_bias_m=float(rng.choice([0.05, 1.0, 3.0])),
        position_m=float(rng.choice([0.02, 0.3, 1.0])),
        pixel_px=float(rng.choice([0.5, 1.0, 2.0])),
    )
    cameras, seen = [], []
    for c in range(n_cam):
        own = order[common + c * (n_each - common) :][: n_each - common]
        mine = rng.permutation(np.concatenate([order[:common], own]))
        camera, when = one_camera(rng, f"uav{c + 1}", every, mine, begin[c], length, bearings[c], reach, sigma)
        if when:  # one that sees nothing for five seconds takes no part
            cameras.append(camera)
            seen.append(when)
    pairs, ever = set(), set()
    for a in range(len(cameras)):
        for b in range(a + 1, len(cameras)):
            for target in set(seen[a]) & set(seen[b]):
                both = np.intersect1d(seen[a][target][1], seen[b][target][1])
                pair = (cameras[a].camera, seen[a][target][0]), (cameras[b].camera, seen[b][target][0])
                ever.add(pair)
                if len(both) >= LEAST_COMMON_S * 5:
                    pairs.add(pair)
    starts = {f"uav{c + 1}": float(begin[c]) for c in range(n_cam)}
    offsets = {camera.camera: starts[camera.camera] - starts[cameras[0].camera] for camera in cameras}
    return Strangers(cameras=tuple(cameras), pairs=frozenset(pairs), ever=frozenset(ever), offset_s=offsets, kind=kind)


def one_camera(rng, name, every, mine, begin, length, bearing, reach, sigma):
    """What a camera sees of some objects: its input, and of each its track's name and when (fifths of a second)."""
    rate = float(rng.choice([10.0, 15.0, 25.0]))
    told = rate * (1 + rng.normal() * 2e-4)
    width = float(rng.choice([1280, 1920]))
    focal = width * rng.uniform(0.7, 1.3)
    t = begin + np.arange(int(length * rate)) / rate
    centre = np.mean([every[k](t) for k in mine], 0)
    follow = rng.random() < 0.5
    at = (centre if follow else np.tile(centre.mean(0), (len(t), 1))) + rng.normal(0, 0.1 * reach, 3) * [1, 1, 0]
    position = flown(rng, str(rng.choice(PATHS)), t, centre.mean(0), bearing, reach)
    sway = rng.uniform(0, 0.02) * np.sin(rng.uniform(0.2, 1.2) * t + rng.uniform(0, 6))
    attitude = looking(position, at, sway)
    n = len(t)
    wrong = Rotation.from_rotvec(rng.normal(0, sigma.attitude_bias_rad, 3))
    noisy = attitude * wrong * Rotation.from_rotvec(rng.normal(0, sigma.attitude_rad, (n, 3)))
    measured = position + rng.normal(0, sigma.position_bias_m, 3) + rng.normal(0, sigma.position_m, (n, 3))
    names, frames, targets, rays, when = [], [], [], [], {}
    for target in mine:
        place = every[target](t) + rng.normal(0, 0.5, 3) * [1, 1, 0.6]  # another point of it than the others track
        y = attitude.inv().apply(place - position)
        ahead = y[:, 2] > 5
        flat = y[:, :2] / np.where(ahead, y[:, 2], 1.0)[:, None]
        inside = ahead & (np.abs(flat) < np.array([0.5, 0.5 * 9 / 16]) * width / focal).all(1)
        if rng.random() < 0.3:
            gap = int(rng.integers(0, n))
            inside[gap : gap + int(rng.uniform(0.05, 0.25) * n)] = False
        if inside.sum() < 5 * rate:
            continue
        flat = flat + rng.normal(0, sigma.pixel_px / focal, flat.shape)
        ray = np.column_stack([flat, np.ones(n)])[inside]
        label = f"id{len(names) + 1}"
        when[int(target)] = label, np.unique(np.floor(5 * t[inside]).astype(int))
        frames.append(np.flatnonzero(inside))
        targets.append(np.full(inside.sum(), len(names)))
        rays.append(ray / np.linalg.norm(ray, axis=1, keepdims=True))
        names.append(label)
    if not names:
        return None, {}
    return _input(name, names, frames, targets, rays, told, focal, measured, noisy, sigma), when


def _input(name, names, frames, targets, rays, told, focal, measured, noisy, sigma):
    q = noisy.as_quat()[:, [3, 0, 1, 2]]
    frame, target, ray = np.concatenate(frames), np.concatenate(targets), np.concatenate(rays)
    order = np.lexsort((target, frame))
    frame, target, ray = frame[order], target[order], ray[order]
    x, y, z = ray.T
    zero = np.zeros(len(ray))
    jacobian = focal * np.stack([np.stack([1 / z, zero, -x / z**2], 1), np.stack([zero, 1 / z, -y / z**2], 1)], axis=1)
    used = np.unique(frame)
    return CameraInput(
        camera=name,
        rays=SightRays(
            camera=name, targets=tuple(names), target=target, frame=frame, time_s=frame / told, direction_cam=ray,
            pixel_from_ray=jacobian, sigma_px=np.full(len(ray), sigma.pixel_px),
        ),
        poses=PoseTrack(
            camera=name, frame=used, time_s=used / told, position_enu_m=measured[used], enu_from_cam=q[used]
        ),
        frame_rate=told,
        sigma=sigma,
    )  # fmt: skip
