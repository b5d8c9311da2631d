"""Thirty kinds of mistake, each made in a drawn flight that was right.

A mistake is a function (rng, flight, camera, target, half) that alters the flight and returns the names of which one
has to be among the culprits; `half` is the frame of the camera at which what happens half way happens.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from scripts.validation.drawn_flights import Camera, Flight, draw, motion, plain_k, project

Names = set[str]


def smaller_sigmas(*keys: str):
    """Priors of all cameras ten times too small."""

    def alter(rng, flight: Flight, camera: Camera, target: str, half: float) -> Names:
        for one in flight.cameras:
            for key in keys:
                one.told_sigma[key] /= 10
        return {one.name for one in flight.cameras}

    return alter


def noisy_pixels(rng, flight, camera, target, half) -> Names:
    """Pixel sigma three times too small in one camera."""
    camera.told_sigma["pixel"] /= 3
    return {camera.name}


def moved(shift):
    """Positions changed by `shift` (rng, camera, half, n) metres."""

    def alter(rng, flight, camera, target, half) -> Names:
        camera.told_position_m = camera.told_position_m + shift(rng, camera, half, len(camera.told_position_m))
        return {camera.name}

    return alter


def turned(turn):
    """Attitudes turned by `turn` (rng, camera, half, n), a rotation vector in camera axes."""

    def alter(rng, flight, camera, target, half) -> Names:
        vector = turn(rng, camera, half, len(camera.told_position_m))
        camera.told_attitude = camera.told_attitude * Rotation.from_rotvec(vector)
        return {camera.name}

    return alter


def three_metres(rng, camera, half, n):
    """A jump of three metres half way."""
    way = rng.normal(size=3)
    return np.where((np.arange(n) >= half)[:, None], 3 * way / np.linalg.norm(way), 0.0)


def wander(size, within_s=10.0):
    """A random walk of `size` in ten seconds."""

    def walk(rng, camera, half, n):
        steps = np.cumsum(rng.normal(0, size / np.sqrt(within_s * camera.rate_hz), (n, 3)), 0)
        return steps - steps.mean(0)

    return walk


def rescaled(change):
    """Positions as a function of the measured ones."""

    def alter(rng, flight, camera, target, half) -> Names:
        camera.told_position_m = change(camera.told_position_m)
        return {camera.name}

    return alter


def inverse(rng, flight, camera, target, half) -> Names:
    """cam_from_enu in place of enu_from_cam."""
    camera.told_attitude = camera.told_attitude.inv()
    return {camera.name}


def lens(factor, size_too=False, down=0.0):
    """A camera file of another focal length, picture size or crop."""

    def alter(rng, flight, camera, target, half) -> Names:
        camera.told_k = plain_k(camera, factor)
        if size_too:
            camera.told["size"] = [int(factor * v) for v in camera.size]
        else:
            camera.told_k[:2, 2] = plain_k(camera)[:2, 2]
        camera.told_k[1, 2] += down * camera.size[0]
        return {camera.name}

    return alter


def other_rate(rng, flight, camera, target, half) -> Names:
    """A frame rate a fifth off; of the reference camera, the others are as good a culprit."""
    camera.told["frame_rate"] = camera.told_rate_hz * float(rng.choice([1.2, 0.8]))
    return {camera.name} if camera is not flight.cameras[0] else {one.name for one in flight.cameras}


def other_start(low, high):
    """A start that is off."""

    def alter(rng, flight, camera, target, half) -> Names:
        camera.told["start"] = float(rng.choice([-1, 1]) * rng.uniform(low, high))
        return {camera.name}

    return alter


def other_log(rng, flight, camera, target, half) -> Names:
    """The poses of another camera."""
    other = next(one for one in flight.cameras if one is not camera)
    rows = np.minimum(np.arange(len(camera.told_position_m)), len(other.told_position_m) - 1)
    camera.told_position_m, camera.told_attitude = other.told_position_m[rows], other.told_attitude[rows]
    return {camera.name, other.name}


def other_offset(rng, flight, camera, target, half) -> Names:
    """An offset a second off, claimed to a tenth."""
    late = flight.cameras[-1]
    late.told["offset_s"] = late.begin_s + 1.0
    late.told_sigma["offset_s"] = 0.1
    return {late.name}


def exchanged(half_way):
    """Two targets exchanged in one camera."""

    def alter(rng, flight, camera, target, half) -> Names:
        others = [t for t in camera.tracks if t != target and all(t in c.tracks for c in flight.cameras)]
        other = str(rng.choice(others or [t for t in camera.tracks if t != target]))
        since = half if half_way else -1.0
        a, b = camera.tracks[target], camera.tracks[other]
        camera.tracks[target], camera.tracks[other] = _joined(a, b, since), _joined(b, a, since)
        return {target, other}

    return alter


def _joined(before, after, since):
    """One track up to a frame, another from then on."""
    early, late = before[0] < since, after[0] >= since
    return np.concatenate([before[0][early], after[0][late]]), np.concatenate([before[1][early], after[1][late]])


def sliding(rng, flight, camera, target, half) -> Names:
    """A tracker that stays on the ground where its target was half way."""
    frames, xy = camera.tracks[target]
    at = frames[min(int(np.searchsorted(frames, half)), len(frames) - 1)]
    place = flight.motions[target](np.array([camera.begin_s + at / camera.rate_hz]))
    ground = np.repeat(place, len(frames), axis=0)
    still = project(camera, camera.position_m[frames], camera.enu_from_cam[frames], ground)
    late = frames >= half
    xy = np.where(late[:, None], still + rng.normal(0, 0.5, xy.shape), xy)
    shown = np.isfinite(xy).all(axis=1)
    camera.tracks[target] = frames[shown], xy[shown]
    return {target}


def other_object(rng, flight, camera, target, half) -> Names:
    """Another thing under the same name in one camera."""
    frames, _ = camera.tracks[target]
    path = motion(rng, "straight", flight.span_s, 0.0, 40.0, False)
    points = path(camera.begin_s + frames / camera.rate_hz)
    xy = project(camera, camera.position_m[frames], camera.enu_from_cam[frames], points)
    shown = np.isfinite(xy).all(axis=1)
    camera.tracks[target] = frames[shown], xy[shown] + rng.normal(0, 1, (shown.sum(), 2))
    return {target}


def frames_lost(rng, flight, camera, target, half) -> Names:
    """Half a second to a second and a half left out, the later frames counted on."""
    lost = int(rng.uniform(0.5, 1.5) * camera.rate_hz)
    for name, (frames, xy) in list(camera.tracks.items()):
        kept = (frames < half) | (frames >= half + lost)
        camera.tracks[name] = np.where(frames < half, frames, frames - lost)[kept], xy[kept]
    rows = np.arange(len(camera.told_position_m))
    kept = (rows < half) | (rows >= half + lost)
    camera.told_position_m, camera.told_attitude = camera.told_position_m[kept], camera.told_attitude[kept]
    return {camera.name}


def upside_down(rng, flight, camera, target, half) -> Names:
    """The picture turned by half a turn."""
    for name, (frames, xy) in list(camera.tracks.items()):
        camera.tracks[name] = frames, np.array(camera.size) - 1 - xy
    return {camera.name}


def _mount(rng, camera, half, n):
    return np.radians(rng.uniform(-40, 40, 3) * [1, 0.3, 0.2])


def _slight_mount(rng, camera, half, n):
    return np.radians(rng.choice([-1, 1]) * rng.uniform(4, 8) * np.eye(3)[rng.integers(3)])


def _drift(rng, camera, half, n):
    return np.linspace(-1, 1, n)[:, None] * np.radians(2.0) * [0, 1, 0]


def _height(rng, camera, half, n):
    return np.array([0, 0, rng.choice([-1, 1]) * rng.uniform(17, 50)])


KINDS = {
    "attitude-sigma": smaller_sigmas("attitude_bias_deg"),
    "position-sigma": smaller_sigmas("position_bias_m"),
    "both-sigmas": smaller_sigmas("attitude_bias_deg", "position_bias_m"),
    "pixel-sigma": noisy_pixels,
    "jump": moved(three_metres),
    "wander-position": moved(wander(1.0)),
    "wander-attitude": turned(wander(np.radians(0.5))),
    "drift-attitude": turned(_drift),
    "mount": turned(_mount),
    "mount-slight": turned(_slight_mount),
    "mount-sign": turned(lambda rng, camera, half, n: np.radians([2 * rng.uniform(20, 38), 0, 0])),
    "height": moved(_height),
    "feet": rescaled(lambda p: p / [1, 1, 0.3048]),
    "feet-all": rescaled(lambda p: p / 0.3048),
    "exchanged-axes": rescaled(lambda p: p[:, [1, 0, 2]]),
    "inverse": inverse,
    "focal": lens(1.06),
    "resolution": lens(1.5, size_too=True),
    "crop": lens(1.0, down=0.18),
    "rate": other_rate,
    "rate-log": other_rate,
    "start": other_start(0.8, 1.5),
    "start-slight": other_start(0.2, 0.4),
    "wrong-log": other_log,
    "offset": other_offset,
    "swap": exchanged(False),
    "swap-half": exchanged(True),
    "slide": sliding,
    "other-object": other_object,
    "frames-lost": frames_lost,
    "upside-down": upside_down,
}
BY_TIME = ("start", "start-slight", "rate-log")
RTK = ("jump", "wander-position", "wander-attitude", "drift-attitude")


def mistaken(kind: str, seed: int) -> tuple[Flight, Names]:
    """A flight of two or three cameras and three to five cars with one mistake, and the names of its culprits."""
    rng = np.random.default_rng([seed, sum(kind.encode())])
    size = {"cameras": int(rng.choice([2, 2, 3])), "targets": int(rng.integers(3, 6))}
    length_s, grade = float(rng.uniform(9, 20)), "rtk" if kind in RTK else "good"
    for attempt in range(100):
        own = seed + 1000 * attempt
        flight = draw(own, **size, length_s=length_s, grade=grade, motions=("straight",), by_time=kind in BY_TIME)
        if len(flight.motions) >= 3 and all(len(c.tracks) >= 3 for c in flight.cameras):
            break
    camera = flight.cameras[int(rng.integers(len(flight.cameras)))]
    shared = [t for t in camera.tracks if all(t in c.tracks for c in flight.cameras)] or list(camera.tracks)
    half = camera.frames * float(rng.uniform(0.35, 0.65))
    for one in flight.cameras[1:]:
        one.told["offset_s"], one.told_sigma["offset_s"] = round(one.begin_s, 2), 0.05
    return flight, KINDS[kind](rng, flight, camera, str(rng.choice(shared)), half)
