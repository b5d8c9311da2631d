"""tracks.csv: where every target was in every image. Floats are exact, so what is read is what was written."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calibration.foundation.arrays import Bools, Ints
from pipeline.export.text.cells import Cell, exact, table
from pipeline.export.text.csv_reading import CsvTable, read_table
from pipeline.records import LOST, STATE_NAMES, ImageTrack

TRACK_COLUMNS = ("camera", "target", "frame", "time_s", "x_px", "y_px", "sigma_px", "state")

WRITTEN_COLUMNS = (*TRACK_COLUMNS, "fix")
FIX_NAMES = ("surface", "box")


def tracks_csv(tracks: Sequence[ImageTrack]) -> str:
    """The table of `tracks`, one after the other: pixels, seconds of video time. Empty tracks leave nothing."""
    columns: list[list[Cell]] = [[] for _ in WRITTEN_COLUMNS]
    for track in tracks:
        n = len(track.frame)
        parts = (
            [track.camera] * n,
            [track.target] * n,
            track.frame.tolist(),
            exact(track.time_s),
            exact(track.xy_px[:, 0]),
            exact(track.xy_px[:, 1]),
            exact(track.sigma_px),
            [STATE_NAMES[s] for s in track.state.tolist()],
            ["" if lost else FIX_NAMES[int(box)] for lost, box in zip(track.state == LOST, track.by_box, strict=True)],
        )
        for column, part in zip(columns, parts, strict=True):
            column.extend(part)
    return table(WRITTEN_COLUMNS, columns)


def read_tracks_csv(path: Path) -> tuple[ImageTrack, ...]:
    """The tracks of a tracks.csv in the order in which they begin.

    Raises InputFileError with file, line and column where the table is not one that `tracks_csv` wrote.
    """
    found = read_table(path, needed=TRACK_COLUMNS, optional=("fix",), what="a table of tracks")
    camera, target, state = (np.array(found.columns[name]) for name in ("camera", "target", "state"))
    for row in np.flatnonzero(~np.isin(state, STATE_NAMES))[:1]:
        found.wrong(int(row), "state", expected=f"one of {', '.join(STATE_NAMES)}", advice=_AGAIN)
    code = np.array([STATE_NAMES.index(name) for name in state.tolist()], dtype=np.int64)
    box = _boxes(found)
    frame, number = found.frames(), _numbers(found, code)
    tracks = []
    for name, rows in group_rows(camera.tolist(), target.tolist()).items():
        for step in np.flatnonzero(np.diff(frame[rows]) <= 0)[:1]:
            expected = f"a frame after {frame[rows[step]]}"
            found.wrong(int(rows[step + 1]), "frame", expected=expected, advice=_AGAIN)
        time_s, x_px, y_px, sigma_px = number[:, rows]
        tracks.append(
            ImageTrack(
                camera=name[0],
                target=name[1],
                frame=frame[rows],
                time_s=time_s,
                xy_px=np.column_stack([x_px, y_px]),
                sigma_px=sigma_px,
                state=code[rows],
                box=box[rows],
            )
        )
    return tuple(tracks)


_AGAIN = "run `runningfix track` again rather than editing its table"


def _numbers(found: CsvTable, state: Ints) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """time_s, x_px, y_px, sigma_px as (4, n); only a lost row may leave its position and sigma empty."""
    rows = [found.floats("time_s", advice=_AGAIN)]
    for name in ("x_px", "y_px", "sigma_px"):
        values = found.floats(name, advice=_AGAIN, may_be_empty=True)
        for row in np.flatnonzero(np.isnan(values) & (state != LOST))[:1]:
            found.wrong(int(row), name, expected="a finite number, as the target is not lost", advice=_AGAIN)
        rows.append(values)
    return np.array(rows).reshape(4, len(found))


def _boxes(found: CsvTable) -> Bools:
    """(n,) where a fix is a box's middle; a table without that column has none."""
    if "fix" not in found.columns:
        return np.zeros(len(found), bool)
    fix = np.array(found.columns["fix"])
    for row in np.flatnonzero(~np.isin(fix, ("", *FIX_NAMES)))[:1]:
        found.wrong(int(row), "fix", expected=f"one of {', '.join(FIX_NAMES)}", advice=_AGAIN)
    return np.asarray(fix == "box")


def group_rows(*keys: Sequence[str]) -> dict[tuple[str, ...], Ints]:
    """Row numbers of every combination of names, in the order of first appearance."""
    groups: dict[tuple[str, ...], list[int]] = {}
    for row, key in enumerate(zip(*keys, strict=True)):
        groups.setdefault(key, []).append(row)
    return {key: np.array(rows, dtype=np.int64) for key, rows in groups.items()}
