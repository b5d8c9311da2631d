"""A flight of hours, cheaply drawn: two hovering cameras over a field that cars cross, a minute rendered and repeated.

A target is one crossing: twenty of them, evenly over the flight, labelled where the car comes into view and gone some
forty seconds later, as what drives through a picture is. Sway and cars have the period of the loop, so that nothing
jumps where it begins anew; logs are written for the whole time, their errors never repeat. Both clocks run at the
nominal rate, as else the loops would part.
"""

from __future__ import annotations

import json
import subprocess
from dataclasses import replace
from pathlib import Path as File

import numpy as np
from scipy.interpolate import make_interp_spline

from calibration.foundation.arrays import Floats
from pipeline.geometry.geodesy import Geodetic
from pipeline.records import Motion
from pipeline.synthetic.demo_scenes import demo_lens
from pipeline.synthetic.flight import UTC_ZERO_S, first_box
from pipeline.synthetic.instruments import LogClock, record
from pipeline.synthetic.landscape import paint
from pipeline.synthetic.mavlink_log import tlog_bytes
from pipeline.synthetic.render import frames
from pipeline.synthetic.scene import (
    Landscape,
    Path,
    Platform,
    Scene,
    SceneCamera,
    SceneTarget,
    VehicleShape,
    look_at,
)
from pipeline.synthetic.scenes import ORIGIN
from pipeline.synthetic.simulate import DEMO, true_track
from pipeline.synthetic.video import ffmpeg_program, write_video

LOOP_S, OFFSET_S = 60.0, 1.6
SIZE, FOCAL_PX = (480, 270), 465.0
MARGIN_S = 8.0
TARGETS = 20
LANES = ((-18.0, 5.0, 0.1), (-4.0, -4.5, -0.15), (10.0, 4.8, -0.2), (24.0, -5.2, 0.12))
"""Of the cars: north of the middle (m), speed eastwards (m/s), and slope of the lane."""
ROOF_M = 1.5
SEED = 3
COLOURS = ((40, 45, 190), (60, 175, 225), (150, 60, 150), (165, 120, 40))


def place(lane: int, time_s: Floats) -> Floats:
    """Where the car of a lane is (n, 3) so long after its loop began; it is in the middle half way."""
    north_m, speed_mps, slope = LANES[lane]
    east = speed_mps * (np.asarray(time_s) - LOOP_S / 2)
    return np.stack([east, north_m + slope * east, np.full_like(east, ROOF_M)], axis=1)


def crossings(seconds: float) -> dict[str, tuple[int, int]]:
    """Lane and loop of every target."""
    loops = round(seconds / LOOP_S)
    return {f"car{number + 1:02d}": (number % len(LANES), number * loops // TARGETS) for number in range(TARGETS)}


def drawn(seconds: float, rate_hz: float) -> Scene:
    """The scene for so long, seen at so many frames a second."""
    time = np.arange(-MARGIN_S, seconds + OFFSET_S + MARGIN_S, 0.5)
    targets = []
    for lane, colour in enumerate(COLOURS):
        fit = make_interp_spline(time, place(lane, time), k=1)
        motion = Motion(
            target=str(lane),
            kind="spline",
            degree=1,
            knots_s=fit.t,
            coefficients=fit.c,
            start_s=time[0],
            end_s=time[-1],
        )
        shape = VehicleShape(length_m=5.2, width_m=3.0, roof_m=ROOF_M, skirt_m=0.15, colour=colour, seed=lane)
        targets.append(SceneTarget(name=motion.target, motion=motion, shape=shape))
    cameras = tuple(
        SceneCamera(
            name=f"uav{index + 1}", lens=demo_lens(SIZE, FOCAL_PX, index), platform=_hovering(index, seconds),
            frame_rate=rate_hz, nominal_rate=rate_hz, offset_s=OFFSET_S * index, frames=round(rate_hz * seconds),
        )
        for index in range(2)
    )  # fmt: skip
    landscape = Landscape(half_size_m=260.0, texel_m=0.25, seed=SEED)
    return Scene(name="hours", cameras=cameras, targets=tuple(targets), origin=ORIGIN, landscape=landscape)


def _hovering(index: int, seconds: float) -> Platform:
    """South and east of the cars, swaying with the loop's period; the camera looks along the body."""
    time = np.arange(-2 * MARGIN_S, seconds + 2 * MARGIN_S, 0.25)
    turn = 2 * np.pi * time / LOOP_S
    away = np.array([[20.0, -105.0, 85.0], [112.0, 15.0, 80.0]])[index]
    sway = np.stack([2 * np.sin(3 * turn + index), 2 * np.cos(2 * turn), np.sin(4 * turn)], axis=1)
    yaw, pitch = look_at(away + sway, np.zeros(3))
    wind = np.radians([0.5, 0.4, 0.6]) * np.stack([np.sin(k * turn + index) for k in (11, 9, 7)], axis=1)
    return Platform(
        position_enu_m=Path(time_s=time, value=away + sway),
        yaw_pitch_roll_rad=Path(time_s=time, value=np.stack([yaw, pitch, 0 * yaw], axis=1) + wind),
    )


def write_hours(folder: File, seconds: float, rate_hz: float) -> File:
    """Videos, logs, cameras and the flight file; its path."""
    folder.mkdir(parents=True, exist_ok=True)
    loop, whole = drawn(LOOP_S, rate_hz), drawn(seconds, rate_hz)
    assert loop.landscape is not None
    country = replace(paint(loop.landscape), solids=())  # trees and houses would stand in the cars' way
    boxes: dict[str, list[str]] = {name: [] for name in crossings(seconds)}
    tables = [_origin(whole.origin)]  # positions are compared in the scene's own frame
    for index, camera in enumerate(whole.cameras):
        short = loop.cameras[index]
        part = folder / f"{camera.name}-loop.mp4"
        write_video(part, frames(loop, short, country, seed=index), size=SIZE, rate_hz=rate_hz, crf=24)
        repeated(part, folder / f"{camera.name}.mp4", round(seconds / LOOP_S))
        clock = LogClock(boot_zero_s=400.0, utc_zero_s=UTC_ZERO_S, recorder_zero_s=UTC_ZERO_S)
        log = record(camera, whole.origin, clock, noise=DEMO, rng=np.random.default_rng([SEED, index]))
        (folder / f"{camera.name}.tlog").write_bytes(tlog_bytes(log, system=index + 1, seed=index))
        lens = {
            "model": "pinhole", "image_size": list(SIZE), "K": camera.lens.K.tolist(),
            "distortion": camera.lens.distortion.tolist(),
        }  # fmt: skip
        (folder / f"{camera.name}.json").write_text(json.dumps(lens))
        tables.append(_camera(camera.name))
        first = [first_box(loop, short, car, true_track(loop, short, lane)) for lane, car in enumerate(loop.targets)]
        for name, (lane, number) in crossings(seconds).items():
            box, frame = first[lane], first[lane].frame + number * short.frames
            sides = ", ".join(f"{side:g}" for side in (box.x, box.y, box.width, box.height))
            boxes[name].append(f"boxes.{camera.name} = {{ frame = {frame}, box = [{sides}] }}")
    tables += ["\n".join([f"[targets.{name}]", *lines]) for name, lines in boxes.items()]
    flight = folder / "flight.toml"
    flight.write_text("\n\n".join(tables) + "\n")
    return flight


def _origin(origin: Geodetic) -> str:
    lat, lon = (float(np.degrees(angle)) for angle in (origin.lat_rad, origin.lon_rad))
    return f"[flight]\norigin = {{ lat = {lat:.7f}, lon = {lon:.7f}, height = {origin.height_m:g} }}"


def _camera(name: str) -> str:
    sigma = {
        "attitude_bias_deg": np.degrees(DEMO.attitude_bias_rad), "attitude_deg": np.degrees(DEMO.attitude_rad),
        "position_bias_m": DEMO.position_bias_m, "position_m": DEMO.position_m, "pixel": DEMO.pixel_px,
        "offset_s": 0.5, "frame_rate": 1e-5,
    }  # fmt: skip
    lines = [
        f"[cameras.{name}]", f'calibration = "{name}.json"', f'video = "{name}.mp4"', f'telemetry = "{name}.tlog"',
        'start = "camera-event"', f"[cameras.{name}.sigma]", *(f"{key} = {value:g}" for key, value in sigma.items()),
    ]  # fmt: skip
    return "\n".join(lines)


def repeated(loop: File, long: File, times: int) -> None:
    """The loop so many times in one file, as it is compressed."""
    again = ["-stream_loop", str(times - 1), "-i", str(loop), "-c", "copy", str(long)]
    subprocess.run([ffmpeg_program(), "-loglevel", "error", "-y", *again], check=True)
    loop.unlink()
