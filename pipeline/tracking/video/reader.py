"""Any frame of a video by its number, exactly, for people who look here and there."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np

from pipeline.tracking.video.backwards import go_to
from pipeline.tracking.video.frames import Image, first_stamp_s, opened, video_times

NEAR_FRAMES = 30  # that are rather decoded through than sought


class FrameReader:
    """One video held open; `times` are those of its frames. Safe to use from several threads."""

    def __init__(self, path: Path) -> None:
        """Raises InputFileError where there is no video."""
        self.path, self.times = path, video_times(path)
        self._stamp_s = self.times.frame_time_s + first_stamp_s(path)
        self._capture, self._at = opened(path), -1
        self._lock = threading.Lock()

    def read(self, index: int) -> Image | None:
        """The pixels (h, w, 3) of a frame; None where the video has no such frame."""
        if not 0 <= index < self.times.frames:
            return None
        with self._lock:
            if not self._at < index <= self._at + NEAR_FRAMES:
                self._capture, self._at = go_to(self._capture, self.path, index, self._stamp_s)
            while self._at < index and self._capture.grab():
                self._at += 1
            good, pixels = self._capture.retrieve()
        return np.asarray(pixels, np.uint8) if good else None

    def close(self) -> None:
        """Lets go of the file."""
        with self._lock:
            self._capture.release()
