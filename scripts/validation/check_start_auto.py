#!/usr/bin/env python
"""`start = "auto"` on rendered flights: is the video's start found on the log's clock, and is its sigma true?

Every flight is drawn: height, course, wind, turns, gimbal or fixed mount, when in the log the video began, how fast its
clock runs. Three flights more have nothing to match and must be refused.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from calibration import write_camera
from calibration.foundation.errors import GeometryError
from pipeline.flight import read_flight
from pipeline.stages import measure_poses, open_sources
from pipeline.synthetic.demo_scenes import demo_lens, small_scene
from pipeline.synthetic.instruments import LogClock, record
from pipeline.synthetic.landscape import Country, paint
from pipeline.synthetic.mavlink_log import tlog_bytes
from pipeline.synthetic.render import frames
from pipeline.synthetic.scene import Path as Way
from pipeline.synthetic.scene import Platform, Scene, SceneCamera
from pipeline.synthetic.simulate import DEMO, Noise
from pipeline.synthetic.video import write_video
from scripts.validation.figures import tell

LOG_S, SIZE, RATE_HZ = 100.0, (640, 360), 25.0


def drawn(rng: np.random.Generator, *, still: bool) -> tuple[Platform, bool]:
    """A UAV over the landscape for LOG_S, and whether a gimbal turns its camera."""
    time = np.arange(-8.0, LOG_S + 8.0, 0.1)
    speed, course = (0.0 if still else rng.uniform(2.0, 9.0)), rng.uniform(0, 2 * np.pi)
    along = speed * 12.0 * np.sin((time - rng.uniform(0, LOG_S)) / 12.0)  # there and back
    up = rng.uniform(80.0, 150.0) + (0.0 if still else 3.0) * np.sin(0.2 * time)
    place = np.stack([along * np.sin(course), along * np.cos(course), up], axis=1)
    turns = np.zeros((len(time), 3))
    turns[:, 1] = np.radians(rng.uniform(-65.0, -45.0))
    turns[:, 0] = rng.uniform(0, 2 * np.pi)
    for _ in range(0 if still else int(LOG_S / 7)):  # now and then the pilot turns
        at, long = rng.uniform(0, LOG_S), rng.uniform(1.5, 4.0)
        share = np.clip((time - at) / long, 0, 1)
        size = np.radians([rng.uniform(-50, 50), 0.0, 0.0])
        turns += (share**2 * (3 - 2 * share))[:, None] * size
    gimbal = bool(rng.random() < 0.5)
    wind = np.radians(0.15 if gimbal else 0.8) * (0.0 if still else 1.0)
    for _ in range(12):
        wave = np.sin(2 * np.pi * rng.uniform(0.1, 0.9) * time + rng.uniform(0, 2 * np.pi))
        turns += wind / np.sqrt(6) * wave[:, None] * rng.normal(size=3)
    camera = Way(time_s=time, value=turns)
    if gimbal:
        body = turns * [1.0, 0.0, 0.0] + np.radians(2.0) * np.sin(np.outer(time, [0.9, 1.3, 1.7])) * [0.3, 1.0, 1.0]
        return Platform(position_enu_m=Way(time_s=time, value=place), gimbal_rad=camera,
                        yaw_pitch_roll_rad=Way(time_s=time, value=body), lever_arm_m=(0.1, 0.0, 0.1)), True  # fmt: skip
    mount = float(turns[0, 1])
    body = Way(time_s=time, value=turns - [0.0, mount, 0.0])
    return Platform(position_enu_m=Way(time_s=time, value=place), yaw_pitch_roll_rad=body, mount_rad=(0.0, mount, 0.0),
                    lever_arm_m=(0.1, 0.0, 0.1)), False  # fmt: skip


def fly(folder: Path, country: Country, scene: Scene, seed: int, *, still: bool, noise: Noise, seconds: float) -> float:
    """Writes the flight into `folder`; the true log time of frame 0."""
    rng = np.random.default_rng([seed, 21])
    platform, gimbal = drawn(rng, still=still)
    begin = float(rng.uniform(5.0, LOG_S - seconds - 5.0))
    camera = SceneCamera(
        name="uav", lens=demo_lens(SIZE, 650.0), platform=platform, frame_rate=RATE_HZ * (1 + 1e-4 * rng.normal()),
        nominal_rate=RATE_HZ, offset_s=begin, frames=round(seconds * RATE_HZ),
    )  # fmt: skip
    clock = LogClock(boot_zero_s=300.0, utc_zero_s=1748770200.0, recorder_zero_s=1748770200.0)
    whole = replace(camera, frame_rate=RATE_HZ, offset_s=0.0, frames=round(LOG_S * RATE_HZ))
    log = record(whole, scene.origin, clock, noise=noise, rng=rng)
    (folder / "uav.tlog").write_bytes(tlog_bytes(log, system=1, seed=seed))
    write_video(folder / "uav.mp4", frames(scene, camera, country, seed=seed), size=SIZE, rate_hz=RATE_HZ, crf=20)
    write_camera(folder / "uav.json", camera.lens)
    mount = '"gimbal"' if gimbal else f"{{ pitch_deg = {np.degrees(platform.mount_rad[1])} }}"
    (folder / "flight.toml").write_text(
        f'[cameras.uav]\ncalibration = "uav.json"\nvideo = "uav.mp4"\ntelemetry = "uav.tlog"\nstart = "auto"\n'
        f"mount = {mount}\nlever_arm_m = [0.1, 0.0, 0.1]\n"
    )
    return begin + clock.boot_zero_s


def found(folder: Path) -> tuple[float, float] | str:
    """Start and sigma, or why not."""
    flight = read_flight(folder / "flight.toml")
    try:
        pose = measure_poses(flight, open_sources(flight))[0]
    except GeometryError as error:
        return error.seen
    return float(pose.poses.time_s[0]), pose.sigma.start_s


def main() -> int:
    """Flies, matches, counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=14.0, help="of video (default 14)")
    arguments = parser.parse_args()
    scene, half_s = small_scene(), 0.5 / RATE_HZ
    assert scene.landscape is not None
    scene = replace(scene, targets=())
    country = paint(scene.landscape)
    right, wrong, flagged, ratios, refused = 0, 0, 0, [], 0
    print(f"{'flight':<10}{'true start':>12}{'error ms':>10}{'sigma ms':>10}")
    for seed in range(arguments.flights + 3):
        still = seed >= arguments.flights
        with tempfile.TemporaryDirectory() as name:
            true_s = fly(Path(name), country, scene, seed, still=still, noise=DEMO, seconds=arguments.seconds)
            answer = found(Path(name))
        label = "still" if still else str(seed)
        if isinstance(answer, str):
            refused, flagged = refused + still, flagged + (not still)
            print(f"{label:<10}{true_s:>12.3f}  refused: {answer}", flush=True)
            continue
        error, sigma = answer[0] - true_s, answer[1]
        right, wrong = right + (abs(error) < half_s and not still), wrong + (abs(error) >= half_s or still)
        ratios.append(error / sigma)
        print(f"{label:<10}{true_s:>12.3f}{1e3 * error:>10.1f}{1e3 * sigma:>10.1f}", flush=True)
    spread = float(np.sqrt(np.mean(np.square(ratios)))) if ratios else float("nan")
    print(f"\nwithin half a frame ({1e3 * half_s:.0f} ms): {right} of {arguments.flights}; refused: {flagged};"
          f" wrong and not refused: {wrong}; still ones refused: {refused} of 3;"
          f" error / sigma RMS {spread:.2f}")  # fmt: skip
    tell({
        "flights": arguments.flights, "right": right, "refused": flagged, "wrong": wrong,
        "still_refused_of_3": refused, "error_over_sigma": spread,
    })  # fmt: skip
    fine = right >= 0.95 * arguments.flights and not wrong and refused == 3
    print("fine" if fine else "NOT fine")
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
