"""poses.csv: where every camera was (enu_from_cam, metres, scalar first), as measured and, after `solve`, refined.

Floats are exact. A frame that only one of the two knows leaves the other's cells empty.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.export.tables.as_tracks import group_rows
from pipeline.export.text.cells import Cell, exact, table
from pipeline.export.text.csv_reading import CsvTable, read_table
from pipeline.records import PoseTrack

_POSE = ("east_m", "north_m", "up_m", "qw", "qx", "qy", "qz")
POSE_COLUMNS = ("camera", "frame", "time_s", *_POSE)
REFINED_COLUMNS = tuple(f"refined_{name}" for name in _POSE)
_AGAIN = "run `runningfix poses` again rather than editing its table"


def poses_csv(poses: Sequence[PoseTrack], refined: Sequence[PoseTrack] = ()) -> str:
    """The table of `poses`, camera by camera; where `refined` has any, with seven more columns for those."""
    names = list(dict.fromkeys(p.camera for p in (*poses, *refined)))
    header = (*POSE_COLUMNS, *REFINED_COLUMNS) if refined else POSE_COLUMNS
    columns: list[list[Cell]] = [[] for _ in header]
    for name in names:
        sides = [next((p for p in side if p.camera == name), None) for side in (poses, refined)]
        for column, part in zip(columns, _camera_columns(name, sides, both=bool(refined)), strict=True):
            column.extend(part)
    return table(header, columns)


def read_poses_csv(path: Path, *, refined: bool = False) -> tuple[PoseTrack, ...]:
    """The poses of a poses.csv, measured or `refined`, in the order of the cameras there; rows without one are skipped.

    Raises InputFileError with file, line and column where the table is not one that `poses_csv` wrote.
    """
    names = REFINED_COLUMNS if refined else _POSE
    found = read_table(path, needed=("camera", "frame", "time_s", *names), what="a table of camera poses")
    number = np.array([found.floats(name, advice=_AGAIN, may_be_empty=True) for name in names]).reshape(7, len(found)).T
    given = np.isfinite(number)
    for row in np.flatnonzero(given.any(axis=1) & ~given.all(axis=1))[:1]:
        column = names[int(np.flatnonzero(~given[row])[0])]
        found.wrong(int(row), column, expected="a finite number, as the rest of the pose is there", advice=_AGAIN)
    keep = given.all(axis=1)
    return _pose_tracks(found.rows(keep), number[keep])


def _camera_columns(name: str, sides: list[PoseTrack | None], *, both: bool) -> list[list[Cell]]:
    """The cells of one camera: (measured, refined) poses over the union of their frames."""
    frame = np.unique(np.concatenate([p.frame for p in sides if p is not None]))
    values = np.full((2, len(frame), 8), np.nan)
    for side, poses in zip(values, sides, strict=True):
        if poses is not None:
            at = np.searchsorted(frame, poses.frame)
            side[at] = np.column_stack([poses.time_s, poses.position_enu_m, poses.enu_from_cam])
    time_s = np.where(np.isnan(values[0, :, 0]), values[1, :, 0], values[0, :, 0])
    first: list[list[Cell]] = [[name] * len(frame), frame.tolist(), exact(time_s)]
    return first + [exact(column) for side in values[: 1 + both] for column in side[:, 1:].T]


def _pose_tracks(found: CsvTable, pose: Floats) -> tuple[PoseTrack, ...]:
    frame, time_s = found.frames(), found.floats("time_s", advice=_AGAIN)
    length = np.linalg.norm(pose[:, 3:], axis=1)
    for row in np.flatnonzero(np.abs(length - 1) > 1e-6)[:1]:
        column = next(name for name in found.columns if name.endswith("qw"))
        seen = f"a quaternion of length {length[row]:.6g}"
        found.wrong(int(row), column, seen=seen, expected="a unit quaternion (qw, qx, qy, qz)", advice=_AGAIN)
    tracks = []
    for (camera,), rows in group_rows(found.columns["camera"]).items():
        for step in np.flatnonzero(np.diff(frame[rows]) <= 0)[:1]:
            expected = f"a frame after {frame[rows[step]]}"
            found.wrong(int(rows[step + 1]), "frame", expected=expected, advice=_AGAIN)
        tracks.append(
            PoseTrack(
                camera=camera,
                frame=frame[rows],
                time_s=time_s[rows],
                position_enu_m=pose[rows, :3],
                enu_from_cam=pose[rows, 3:],
            )
        )
    return tuple(tracks)
