"""What the label page works on: one flight file, its videos, and a run of the tracker in the background."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from calibration.foundation.errors import RunningFixError, UsageError
from calibration.foundation.files import read_bytes, write_whole
from pipeline.export import read_tracks_csv
from pipeline.flight import Flight, flight_of, read_flight
from pipeline.label.edit import boxes_swapped, with_box, without_box
from pipeline.records import STATE_NAMES, Box, ImageTrack
from pipeline.stages import run_track
from pipeline.tracking import FrameReader

JPEG_QUALITY, PATIENCE_S = 90, 2.0
BOM = b"\xef\xbb\xbf"


class LabelSession:
    """State of a labelling: the flight file is read anew for every answer, so edits by hand are seen too."""

    def __init__(self, path: Path, out: Path) -> None:
        """Raises InputFileError and UsageError for what is wrong in the flight file or its videos."""
        self.path, self.out = path, out
        self._readers = {
            c.name: FrameReader(c.video, c.video_stream) for c in read_flight(path).cameras if c.video is not None
        }
        if not self._readers:
            raise UsageError(
                where=str(path), seen="no camera with a video", expected="video = \"...\" in a [cameras.NAME]",
                advice="name the videos in the flight file; boxes are drawn in them",
            )  # fmt: skip
        self._editing = threading.Lock()
        self._changed = threading.Condition()
        self._work: threading.Thread | None = None
        self._told: dict[str, Any] = {"running": False, "done": {}, "message": "", "number": 0}

    @property
    def flight(self) -> Flight:
        """The flight file as it is now."""
        return read_flight(self.path)

    def state(self) -> dict[str, Any]:
        """Cameras with a video, targets, and their boxes."""
        flight = self.flight
        return {
            "title": flight.title,
            "cameras": [
                {
                    "name": name,
                    "frames": reader.times.frames,
                    "frame_rate": reader.times.frame_rate,
                    "size": list(reader.times.image_size),
                }
                for name, reader in self._readers.items()
            ],
            "targets": [
                {
                    "name": target.name,
                    "boxes": {
                        camera: {"frame": box.frame, "box": [box.x, box.y, box.width, box.height]}
                        for camera, box in target.boxes.items()
                    },
                }
                for target in flight.targets
            ],
        }

    def frame_jpeg(self, camera: str, index: int) -> bytes | None:
        """One frame as it is shown; None where there is none."""
        reader = self._readers.get(camera)
        pixels = None if reader is None else reader.read(index)
        if pixels is None:
            return None
        return bytes(cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes())

    def tracks(self, camera: str) -> list[dict[str, Any]]:
        """The tracks in `out`/tracks.csv of one camera; none where it has not been tracked."""
        path = self.out / "tracks.csv"
        if not path.is_file():
            return []
        return [_shown(track) for track in read_tracks_csv(path) if track.camera == camera]

    def set_box(self, target: str, camera: str, box: Box) -> None:
        """Writes one box into the flight file.

        Raises UsageError where it cannot be.
        """
        self._check(target, camera, box)
        self._edit(lambda text: with_box(text, target, camera, box))

    def delete_box(self, target: str, camera: str) -> None:
        """Takes one box out of the flight file.

        Raises UsageError where it cannot be.
        """
        self._edit(lambda text: without_box(text, target, camera))

    def swap(self, camera: str, one: str, other: str) -> None:
        """Exchanges two targets in one camera: which one here is which one there.

        Raises UsageError where it cannot be.
        """
        if not other.strip() or one == other:
            raise _wrong(camera, f"target name {other!r}", "the name of another target")
        if camera not in self._readers:
            raise _wrong(camera, "no camera of this name has a video", ", ".join(self._readers))
        self._edit(lambda text: boxes_swapped(text, camera, one, other))

    def start_tracking(self) -> None:
        """Tracks every video in the background, as `runningfix track` does."""
        with self._changed:
            if self._told["running"]:
                return
            self._told = {"running": True, "done": {}, "message": "", "number": self._told["number"] + 1}
        self._work = threading.Thread(target=self._track, daemon=True)
        self._work.start()

    def progress(self, after: int) -> dict[str, Any]:
        """How far tracking is; waits a little for news after number `after`."""
        with self._changed:
            self._changed.wait_for(lambda: self._told["number"] > after or not self._told["running"], PATIENCE_S)
            return dict(self._told)

    def close(self) -> None:
        """Lets go of the videos."""
        for reader in self._readers.values():
            reader.close()

    def _track(self) -> None:
        def tell(stage: str, done: int, total: int) -> None:
            with self._changed:
                self._told["done"][stage] = [done, total]
                self._told["number"] += 1
                self._changed.notify_all()

        message = "tracked"
        try:
            notes = run_track(self.flight, self.out, progress=tell).warnings
            message = "\n".join((message, *notes))
        except Exception as error:  # whatever ends it, the page must not wait for ever
            message = str(error) if isinstance(error, RunningFixError) else f"tracking failed: {error}"
        with self._changed:
            self._told |= {"running": False, "message": message, "number": self._told["number"] + 1}
            self._changed.notify_all()

    def _edit(self, change: Any) -> None:
        with self._editing:
            raw = read_bytes(self.path, expected="a flight file (TOML)")
            flight_of(raw, self.path)  # a file broken by hand is said, not edited
            mark, text = (BOM, raw[len(BOM) :]) if raw.startswith(BOM) else (b"", raw)
            edited = mark + change(text.decode()).encode()
            flight_of(edited, self.path)
            write_whole(self.path.resolve(), edited)  # a link stays one

    def _check(self, target: str, camera: str, box: Box) -> None:
        reader = self._readers.get(camera)
        if reader is None:
            raise _wrong(camera, "no such camera with a video", "one of " + ", ".join(self._readers))
        if not target.strip():
            raise _wrong(camera, "a target without a name", "a name")
        width, height = reader.times.image_size
        sides = np.array([box.x, box.y, box.width, box.height])
        inside = bool(np.isfinite(sides).all()) and box.x >= 0 and box.y >= 0 and min(box.width, box.height) >= 4
        if not inside or box.x + box.width > width or box.y + box.height > height:
            raise _wrong(camera, f"box {sides.tolist()}", f"a box of at least 4 x 4 px inside {width} x {height}")
        if not 0 <= box.frame < reader.times.frames:
            raise _wrong(camera, f"frame {box.frame}", f"0 to {reader.times.frames - 1}")


def _wrong(camera: str, seen: str, expected: str) -> UsageError:
    return UsageError(where=f"label page, camera {camera}", seen=seen, expected=expected, advice="draw it again")


def _shown(track: ImageTrack) -> dict[str, Any]:
    """A track for the page: rows of x, y, sigma; null while lost."""
    rows: list[list[float] | None] = [
        [round(float(x), 3), round(float(y), 3), round(float(sigma), 3)] if seen else None
        for (x, y), sigma, seen in zip(track.xy_px, track.sigma_px, track.seen, strict=True)
    ]
    states = [STATE_NAMES[s] for s in track.state]
    return {
        "target": track.target,
        "first": int(track.frame[0]) if len(track.frame) else 0,
        "fixes": rows,
        "reacquired": states.count("reacquired"),
    }
