"""Detections made elsewhere: frame, target, x_px, y_px [, sigma_px] [, time_s] become image tracks.

Rows may come in any order, targets may be interleaved; what a target has in one frame must be one row. Columns that
are not ours are ignored. A tracks.csv of our own is read too, the rows of the camera asked for, and the text files of
multiple-object trackers (`mot`).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from calibration.foundation.errors import InputFileError
from pipeline.export.tables.as_tracks import TRACK_COLUMNS, group_rows, read_tracks_csv
from pipeline.export.tables.mot import is_mot, mot_tracks
from pipeline.export.text.csv_reading import CsvTable, read_table
from pipeline.records import TRACKED, ImageTrack

_ABSENT = "leave the row out where the target was not seen"


def read_detections_csv(
    path: Path, *, camera: str, frame_rate: float, default_sigma_px: float
) -> tuple[ImageTrack, ...]:
    """Tracks of one camera, a target each, in the order in which targets first appear; every row is a fix.

    camera            whose detections these are
    frame_rate        Hz; video time is `time_s` where the file has it, else frame / frame_rate
    default_sigma_px  per axis, where the file gives none (no column, or an empty cell)

    Raises InputFileError with file, line, column, what was seen and what was expected.
    """
    if is_mot(path):
        return mot_tracks(path, camera=camera, frame_rate=frame_rate, least_sigma_px=default_sigma_px)
    needed = ("frame", "target", "x_px", "y_px")
    found = read_table(path, needed=needed, optional=("sigma_px", "time_s"), what="a table of detections")
    if set(TRACK_COLUMNS) <= set(found.columns):
        return _own_tracks(path, camera)
    if len(found) == 0:
        raise InputFileError(
            where=str(path),
            seen="a header and no row",
            expected="at least one detection",
            advice="check that the tracker which wrote the file found something",
        )
    frame, target = found.frames(), found.texts("target")
    xy = np.column_stack([found.floats(name, advice=_ABSENT) for name in ("x_px", "y_px")])
    sigma, time = _sigma(found, default_sigma_px), _time(found, frame, frame_rate)
    tracks = []
    for (name,), rows in group_rows(target.tolist()).items():
        order = rows[np.argsort(frame[rows], kind="stable")]
        _refuse_doubles(found, order, frame, name)
        state = np.full(len(order), TRACKED)
        tracks.append(
            ImageTrack(
                camera=camera,
                target=name,
                frame=frame[order],
                time_s=time[order],
                xy_px=xy[order],
                sigma_px=sigma[order],
                state=state,
            )
        )
    return tuple(tracks)


def _own_tracks(path: Path, camera: str) -> tuple[ImageTrack, ...]:
    tracks = read_tracks_csv(path)
    chosen = tuple(track for track in tracks if track.camera == camera)
    if not chosen:
        there = ", ".join(dict.fromkeys(track.camera for track in tracks)) or "no row"
        raise InputFileError(
            where=f"{path}, column camera",
            seen=there,
            expected=f"rows of {camera}",
            advice="name the camera in the flight file as the table does",
        )
    return chosen


def _sigma(found: CsvTable, default_sigma_px: float) -> Floats:
    if "sigma_px" not in found.columns:
        return np.full(len(found), default_sigma_px)
    advice = "give one standard deviation per axis in pixels, or leave the cell empty for the camera's default"
    sigma = found.floats("sigma_px", advice=advice, may_be_empty=True)
    for row in np.flatnonzero(sigma <= 0)[:1]:
        found.wrong(int(row), "sigma_px", expected="a number above 0", advice=advice)
    return np.where(np.isnan(sigma), default_sigma_px, sigma)


def _time(found: CsvTable, frame: Ints, frame_rate: float) -> Floats:
    """Video time (n,); a later frame must have a later time, the same frame the same."""
    if "time_s" not in found.columns:
        return np.asarray(frame / frame_rate)
    advice = "give video time in seconds for every row, or remove the column to use frame / frame rate"
    time = found.floats("time_s", advice=advice)
    order = np.lexsort((time, frame))
    later, tick = np.diff(frame[order]) > 0, np.diff(time[order])
    for step in np.flatnonzero(np.where(later, tick <= 0, tick != 0))[:1]:
        before, row = int(order[step]), int(order[step + 1])
        told = f"time {time[row]:g} s at frame {frame[row]}"
        found.wrong(
            row,
            "time_s",
            seen=told,
            expected=f"a time that grows with the frame (line {found.line[before]}: {time[before]:g} s at frame "
            f"{frame[before]})",
            advice=advice,
        )
    return time


def _refuse_doubles(found: CsvTable, order: Ints, frame: Ints, target: str) -> None:
    for step in np.flatnonzero(np.diff(frame[order]) == 0)[:1]:
        first, again = int(order[step]), int(order[step + 1])
        found.wrong(
            again,
            "frame",
            seen=f"{target} a second time in frame {frame[again]} (first on line {found.line[first]})",
            expected="one row for each target in a frame",
            advice="delete one of the two rows, or give the two objects different names",
        )
