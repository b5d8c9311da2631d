"""Any frame of a video by its number, exactly, for people who look here and there."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

from calibration.foundation.capture import Capture, Shot
from pipeline.tracking.records import VideoTimes
from pipeline.tracking.video.frames import Image, from_first

NEAR_FRAMES = 30  # that are rather decoded through than sought


class FrameReader:
    """One video held open; `times` are those of its frames. Safe to use from several threads."""

    def __init__(self, path: Path, stream: int | None = None) -> None:
        """Raises InputFileError where there is no video."""
        self.path, self._capture = path, Capture(path, stream=stream)
        head, self._index = self._capture.head(), self._capture.index()
        self.times = VideoTimes(
            frame_time_s=from_first(self._index.stamp_s), frame_rate=head.frame_rate, image_size=head.image_size
        )
        self._shots: Iterator[Shot] = iter(())
        self._at: Shot | None = None
        self._lock = threading.Lock()

    def read(self, index: int) -> Image | None:
        """The pixels (h, w, 3) of a frame; None where the video has no such frame, or it does not decode."""
        if not 0 <= index < self.times.frames:
            return None
        with self._lock:
            if self._at is None or not self._at.number <= index <= self._at.number + NEAR_FRAMES:
                self._shots = self._capture.shots_from(index, self._index)
                self._at = next(self._shots, None)
            while self._at is not None and self._at.number < index:
                self._at = next(self._shots, None)
            if self._at is None or self._at.number != index:
                return None
            return self._capture.pixels(self._at)

    def close(self) -> None:
        """Lets go of the file."""
        with self._lock:
            self._capture.close()
