"""A scene as a folder of files that a user could have brought home from a real flight.

flight.toml               what the user knows: instruments' worth, first boxes, nothing of the other camera's clock
uav1.mp4, uav2.mp4        H.264
uav1.tlog, uav2.tlog      MAVLink 2
board-uav1/, board-uav2/  checkerboard photos through each camera's lens; `runningfix calibrate` makes uav1.json ...
truth/truth.json          for judging, not for processing
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np

from calibration.foundation.files import write_whole
from pipeline.geometry.geodesy import Geodetic
from pipeline.records import LOST, Box, ImageTrack, Truth
from pipeline.synthetic.board_photos import PrintedBoard, photos
from pipeline.synthetic.instruments import LogClock, Recording, record
from pipeline.synthetic.landscape import Image, paint
from pipeline.synthetic.mavlink_log import tlog_bytes
from pipeline.synthetic.render import Optics, frames
from pipeline.synthetic.scene import Scene, SceneCamera, SceneTarget, pixels_of
from pipeline.synthetic.simulate import DEMO, Noise, true_flight
from pipeline.synthetic.truth_file import write_truth
from pipeline.synthetic.vehicles import outline_enu_m
from pipeline.synthetic.video import write_video

Progress = Callable[[str, int, int], None]
BOARD = PrintedBoard()
FIRST_FRAME_BOOT_S = (412.345, 187.62)
UTC_ZERO_S = 1748770200.0
"""2025-06-01T09:30:00Z, as UAV 1 knows it; the second ground station's clock is over an hour wrong."""
RECORDER_WRONG_S = (0.0, -4387.219)
POLL_S = 0.2
CHOICE, MARGIN_PX = 20, 8


@dataclass(frozen=True, kw_only=True)
class Quality:
    """Sizes of the files: quality of the videos (x264 crf), number and JPEG quality of the photos, and the optics.

    pixel_px  what the flight file says that a tracked point is worth in such videos; None: what the noise says
    """

    crf: int = 18
    photos: int = 20
    jpeg: int = 92
    optics: Optics = field(default_factory=Optics)
    pixel_px: float | None = None


def write_flight(
    scene: Scene,
    folder: Path,
    *,
    seed: int,
    noise: Noise = DEMO,
    quality: Quality | None = None,
    progress: Progress | None = None,
) -> Path:
    """Render, record and write a scene into `folder`; returns the path of its flight.toml, which is written last.

    The same scene, seed and program give the same bytes. Raises UsageError without a video encoder, WriteError where
    the folder cannot be written.
    """
    if scene.landscape is None:
        raise ValueError(f"{scene.name}: a scene without a landscape cannot be rendered")
    quality = quality or Quality()
    for index, camera in enumerate(scene.cameras):
        log = _recording(scene, index, noise, seed)
        write_whole(folder / f"{camera.name}.tlog", tlog_bytes(log, system=index + 1, seed=seed + index))
        _write_photos(camera, folder / f"board-{camera.name}", seed + index, quality)
    _write_videos(scene, folder, seed, quality, progress)
    truth = true_flight(scene)
    write_truth(folder, scene, truth)
    path = folder / "flight.toml"
    write_whole(path, flight_toml(scene, truth, _told(noise, quality)))
    return path


def _recording(scene: Scene, index: int, noise: Noise, seed: int) -> Recording:
    camera = scene.cameras[index]
    clock = LogClock(
        boot_zero_s=FIRST_FRAME_BOOT_S[index % 2] - camera.offset_s,
        utc_zero_s=UTC_ZERO_S if index == 0 else None,
        recorder_zero_s=UTC_ZERO_S + RECORDER_WRONG_S[index % 2],
    )
    return record(camera, scene.origin, clock, noise=noise, rng=np.random.default_rng([seed, 8, index]))


def _write_photos(camera: SceneCamera, folder: Path, seed: int, quality: Quality) -> None:
    for number, photo in enumerate(photos(camera.lens, BOARD, count=quality.photos, seed=seed)):
        _, packed = cv2.imencode(".jpg", photo, [cv2.IMWRITE_JPEG_QUALITY, quality.jpeg])
        write_whole(folder / f"photo-{number + 1:02d}.jpg", packed.tobytes())


def _write_videos(scene: Scene, folder: Path, seed: int, quality: Quality, progress: Progress | None) -> None:
    """All cameras at once, a thread and an encoder each; progress is told from the calling thread."""
    assert scene.landscape is not None
    country = paint(scene.landscape)
    done = dict.fromkeys((c.name for c in scene.cameras), 0)
    total = sum(c.frames for c in scene.cameras)

    def counted(camera: SceneCamera, index: int) -> Iterator[Image]:
        for image in frames(scene, camera, country, seed=seed + index, optics=quality.optics):
            yield image
            done[camera.name] += 1

    with ThreadPoolExecutor(max_workers=len(scene.cameras)) as pool:
        jobs = [
            pool.submit(
                write_video,
                folder / f"{camera.name}.mp4",
                counted(camera, index),
                size=camera.lens.image_size,
                rate_hz=camera.nominal_rate,
                crf=quality.crf,
            )
            for index, camera in enumerate(scene.cameras)
        ]
        _wait(jobs, lambda: progress and progress("render", sum(done.values()), total))


def _wait(jobs: list[Future[int]], tell: Callable[[], object]) -> None:
    while not all(job.done() for job in jobs):
        time.sleep(POLL_S)
        tell()
    for job in jobs:
        job.result()
    tell()


def first_box(scene: Scene, camera: SceneCamera, target: SceneTarget, track: ImageTrack) -> Box:
    """The box a careful person would draw: whole pixels, on an early frame, its centre on the roof's.

    Of the first CHOICE frames that show the whole roof, MARGIN_PX inside the image, the one where the centre of such
    a box comes nearest to the reference point: a tracker follows what lies under it, in every camera the same point.
    """
    size = np.array(camera.lens.image_size)
    best, nearest, shown = None, np.inf, 0
    for frame in track.frame[track.state != LOST]:
        when = float(camera.frame_time_s(np.array([frame]))[0])
        corners, _ = pixels_of(camera, np.full(4, frame), outline_enu_m(target, when))
        if not ((corners > MARGIN_PX) & (corners < size - MARGIN_PX)).all():
            continue
        centre = track.xy_px[np.searchsorted(track.frame, frame)]
        reach = np.abs(corners - centre).max(axis=0)
        (x, width), (y, height) = (_whole_side(float(c), float(r)) for c, r in zip(centre, reach, strict=True))
        box = Box(frame=int(frame), x=x, y=y, width=width, height=height)
        miss = float(np.abs(np.array(box.centre_px) - centre).max())
        if miss < nearest:
            best, nearest = box, miss
        shown += 1
        if shown == CHOICE:
            break
    if best is None:
        raise ValueError(f"{camera.name} never sees all of {target.name}")
    return best


def _whole_side(centre_px: float, reach_px: float) -> tuple[int, int]:
    """Left edge and length in whole pixels of a side that reaches 1 px past `reach_px` on both sides of `centre_px`."""
    return min(
        (
            (round(centre_px + 0.5 - length / 2), length)
            for length in (round(2 * reach_px + 2), round(2 * reach_px + 3))
        ),
        key=lambda side: abs(side[0] + side[1] / 2 - 0.5 - centre_px),
    )


def _told(noise: Noise, quality: Quality) -> Noise:
    return noise if quality.pixel_px is None else replace(noise, pixel_px=quality.pixel_px)


def flight_toml(scene: Scene, truth: Truth, noise: Noise) -> str:
    """The flight file: all that a user knows, and nothing that only the truth knows."""
    parts = [_head(scene.origin, scene.cameras[0].name)]
    parts += [_camera_table(camera, noise) for camera in scene.cameras]
    parts += [_target_table(scene, target, truth) for target in scene.targets]
    parts.append('[solve]\nmethod = "map"\n')
    return "\n".join(parts)


def _head(origin: Geodetic, reference: str) -> str:
    lat, lon = (float(np.degrees(angle)) for angle in (origin.lat_rad, origin.lon_rad))
    return (
        "# Rendered by `runningfix demo`: two UAVs whose clocks know nothing of each other watch four vehicles.\n"
        f"# First: runningfix calibrate board-uav1 --board {BOARD.columns}x{BOARD.rows}"
        f" --square-mm {BOARD.square_m * 1000:g} -o uav1.json, and the same for uav2.\n"
        "[flight]\n"
        f"origin = {{ lat = {lat:.7f}, lon = {lon:.7f}, height = {origin.height_m:g} }}\n"
        f'reference_camera = "{reference}"\n'
    )


def _camera_table(camera: SceneCamera, noise: Noise) -> str:
    platform = camera.platform
    yaw, pitch, roll = (f"{np.degrees(angle):g}" for angle in platform.mount_rad)
    fixed = f"{{ roll_deg = {roll}, pitch_deg = {pitch}, yaw_deg = {yaw} }}"
    return (
        f"[cameras.{camera.name}]\n"
        f'calibration = "{camera.name}.json"\n'
        f'video = "{camera.name}.mp4"\n'
        f'telemetry = "{camera.name}.tlog"\n'
        'start = "camera-event"\n'
        f"frame_rate = {camera.nominal_rate:.1f}\n"
        f"mount = {fixed if platform.gimbal_rad is None else chr(34) + 'gimbal' + chr(34)}\n"
        f"lever_arm_m = [{', '.join(f'{v:g}' for v in platform.lever_arm_m)}]\n\n"
        f"[cameras.{camera.name}.sigma]\n"
        f"attitude_bias_deg = {np.degrees(noise.attitude_bias_rad):g}\n"
        f"attitude_deg = {np.degrees(noise.attitude_rad):g}\n"
        f"position_bias_m = {noise.position_bias_m:g}\n"
        f"position_m = {noise.position_m:g}\n"
        f"pixel = {noise.pixel_px:g}\n"
        f"frame_rate = {noise.frame_rate_prior:g}\n"
    )


def _target_table(scene: Scene, target: SceneTarget, truth: Truth) -> str:
    lines = [f"[targets.{target.name}]", 'motion = "polynomial"', f"order = {target.motion.degree}"]
    for camera in scene.cameras:
        track = next(t for t in truth.tracks if (t.camera, t.target) == (camera.name, target.name))
        box = first_box(scene, camera, target, track)
        sides = ", ".join(f"{side:g}" for side in (box.x, box.y, box.width, box.height))
        lines.append(f"boxes.{camera.name} = {{ frame = {box.frame}, box = [{sides}] }}")
    return "\n".join(lines) + "\n"
