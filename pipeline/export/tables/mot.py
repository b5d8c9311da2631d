"""Detections in the text form of MOTChallenge, which most multiple-object trackers write: no header, a row a box.

    frame, identity, left, top, width, height [, confidence [, ...]]          frames count from 1, pixels

The middle of a box is a fix that is worth a tenth of its side. Rows of confidence 0 are there to be ignored.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import InputFileError
from calibration.foundation.files import read_bytes
from pipeline.export.tables.as_tracks import group_rows
from pipeline.records import TRACKED, ImageTrack

FEWEST = 6
"""Cells of a row: frame, identity and a box."""
WORTH = 0.1
"""Sigma of a box's middle per axis, in box sides: what people and detectors differ by. Doubled, a tracker's boxes
weigh a quarter."""
EXPECTED = "rows of frame, identity, left, top, width, height[, confidence], frames from 1 (MOTChallenge)"


def is_mot(path: Path) -> bool:
    """Whether a file begins as such a table does: no header, numbers only, six or more."""
    try:
        with path.open("rb") as file:
            first = file.readline(4096).decode("utf-8-sig")
        cells = [float(cell) for cell in first.split(",")]
    except (OSError, ValueError):
        return False
    return len(cells) >= FEWEST


def mot_tracks(path: Path, *, camera: str, frame_rate: float, least_sigma_px: float) -> tuple[ImageTrack, ...]:
    """The tracks of one camera, a target each, named by their identities.

    Raises InputFileError with file and line where a row is none, or an identity comes twice in a frame.
    """
    rows = _rows(path)
    frame, identity = rows[:, 0].astype(np.int64) - 1, rows[:, 1]
    names = [f"{number:g}" for number in identity.tolist()]
    tracks = []
    for (name,), index in group_rows(names).items():
        order = index[np.argsort(frame[index], kind="stable")]
        for step in np.flatnonzero(np.diff(frame[order]) == 0)[:1]:
            raise _wrong(path, f"identity {name} twice in frame {frame[order[step]] + 1}")
        left, top, width, height = rows[order, 2:6].T
        tracks.append(
            ImageTrack(
                camera=camera,
                target=name,
                frame=frame[order],
                time_s=frame[order] / frame_rate,
                xy_px=np.column_stack([left + width / 2 - 0.5, top + height / 2 - 0.5]),
                sigma_px=np.maximum(least_sigma_px, WORTH * np.sqrt(width * height)),
                state=np.full(len(order), TRACKED),
                box=np.ones(len(order), bool),
            )
        )
    return tuple(tracks)


def _rows(path: Path) -> Floats:
    """(n, 7) numbers of every row that counts."""
    found = []
    for line, text in enumerate(read_bytes(path, expected=EXPECTED).decode("utf-8-sig", "replace").splitlines(), 1):
        if not text.strip():
            continue
        try:
            cells = [float(cell) for cell in text.split(",")]
        except ValueError:
            raise _wrong(path, f"{text[:60]!r}", line) from None
        if len(cells) < FEWEST or not np.isfinite(cells[:FEWEST]).all():
            raise _wrong(path, f"{text[:60]!r}", line)
        if cells[0] < 1 or cells[0] != int(cells[0]) or min(cells[4:6]) <= 0:
            raise _wrong(path, f"frame {cells[0]:g}, a box of {cells[4]:g} x {cells[5]:g}", line)
        if len(cells) == FEWEST or cells[FEWEST] != 0:
            found.append([*cells[:FEWEST], 1.0])
    if not found:
        raise _wrong(path, "no row that counts")
    return np.array(found)


def _wrong(path: Path, seen: str, line: int | None = None) -> InputFileError:
    return InputFileError(
        where=str(path) if line is None else f"{path}, line {line}",
        seen=seen,
        expected=EXPECTED,
        advice="check how the tracker writes its results, or write frame,target,x_px,y_px with a header",
    )
