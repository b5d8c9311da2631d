"""Small drawn videos: a chequered square over a panning texture, written with every codec that the tests need."""

from __future__ import annotations

import subprocess
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.records import Box

SIZE = (160, 120)


def textured(seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    coarse = rng.uniform(40, 210, (SIZE[1] // 6 + 2, SIZE[0] // 6 + 2, 3)).astype(np.float32)
    return cv2.resize(coarse, (SIZE[0] + 60, SIZE[1] + 60), interpolation=cv2.INTER_CUBIC)


def panning(frames: int) -> list[np.ndarray]:
    """The texture pans one pixel right each frame, a bright chequered square 1.5 further."""
    ground = textured()
    out = []
    for f in range(frames):
        image = ground[20 : 20 + SIZE[1], 40 - f % 40 : 40 - f % 40 + SIZE[0]].copy()
        x = 30 + round(1.5 * f)
        image[50:66, x : x + 24] = (30, 30, 230)
        image[54:62, x + 4 : x + 12] = (240, 240, 40)
        image[52:58, x + 15 : x + 21] = (20, 200, 20)
        out.append(np.clip(image, 0, 255).astype(np.uint8))
    return out


def written(
    path: Path, frames: Iterable[np.ndarray], codec: str = "MJPG", rate: float = 25.0, size: tuple[int, int] = SIZE
) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), rate, size)
    for frame in frames:
        writer.write(frame)
    writer.release()
    return path


BOX = Box(frame=0, x=30, y=50, width=24, height=16)


def encoded(source: Path, to: Path, *options: str) -> Path:
    ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="needs an H.264 encoder")
    command = [ffmpeg.get_ffmpeg_exe(), "-loglevel", "error", "-i", str(source), *options, "-c:v", "libx264", str(to)]
    subprocess.run(command, check=True)
    return to


UNEVEN = ("-vf", "settb=1/1000,setpts='(N+N*N/40)/25/TB'", "-fps_mode", "passthrough", "-enc_time_base", "1/1000")
