"""Poses made elsewhere: a `.csv` or `.parquet` table.

Columns: `frame` or `time_s`, and east_m, north_m, up_m, qw, qx, qy, qz (enu_from_cam).
"""

from __future__ import annotations

import io
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calibration.foundation.arrays import Floats, Ints, frozen, settle
from calibration.foundation.errors import InputFileError
from calibration.foundation.files import read_bytes
from pipeline.geometry import rotation
from pipeline.records import PoseTrack
from pipeline.telemetry.camera_pose.interpolate import MAX_GAP_S, spans
from pipeline.telemetry.flight_records.flight import is_flight_record

if TYPE_CHECKING:  # slow to import, and flight logs need no tables
    import pandas as pd

PLACE = ["east_m", "north_m", "up_m"]
TURN = ["qw", "qx", "qy", "qz"]
PARQUET_ADVICE = "pip install 'runningfix[parquet]', or write the table as .csv"
MOST_COLUMNS = 1000
"""What has more is no table of poses, and takes minutes and gigabytes to be taken apart."""
UNIT_TOLERANCE = 1e-2
"""A quaternion further from unit length than rounding to two digits makes it is a mistake, not rounding."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PoseTable:
    """Poses by frame, by time, or both (n,): increasing; the missing one is None.

    position_enu_m  (n, 3) of the optical centre
    enu_from_cam    (n, 4) unit quaternions
    """

    path: Path
    frame: Ints | None
    time_s: Floats | None
    position_enu_m: Floats
    enu_from_cam: Floats

    def __post_init__(self) -> None:
        n = len(self.position_enu_m)
        settle(
            self,
            position_enu_m=frozen(self.position_enu_m, (n, 3), "position_enu_m"),
            enu_from_cam=frozen(self.enu_from_cam, (n, 4), "enu_from_cam"),
        )
        if self.frame is not None:
            settle(self, frame=frozen(self.frame, (n,), "frame", np.int64))
        if self.time_s is not None:
            settle(self, time_s=frozen(self.time_s, (n,), "time_s"))


def read_pose_table(path: Path) -> PoseTable:
    """Read and check a pose table.

    Raises InputFileError (with the row, counted as a text editor counts lines) for a missing column, a value that is
    no number, a quaternion that is no rotation, or frames or times that do not increase.
    """
    raw = read_bytes(path, expected="a table of poses (.csv or .parquet)")
    table = _parquet(path, raw) if is_parquet(path) else _csv(path, raw)
    keys = [name for name in ("frame", "time_s") if name in table]
    absent = [name for name in (*PLACE, *TURN) if name not in table]
    if absent or not keys:
        lacking = absent if absent else ["frame or time_s"]
        raise _wrong(
            path, f"no column {', '.join(lacking)} (columns: {', '.join(map(str, table))})", _columns_expected()
        )
    if len(table) == 0:
        raise _wrong(path, "no rows", "at least one pose")
    value = {name: _numbers(path, table, name) for name in (*keys, *PLACE, *TURN)}
    for name in keys:
        _check_increasing(path, table, name, value[name])
    q = np.stack([value[name] for name in TURN], axis=1)
    _check_unit(path, table, q)
    return PoseTable(
        path=path,
        frame=_whole(path, table, value["frame"]) if "frame" in value else None,
        time_s=value.get("time_s"),
        position_enu_m=np.stack([value[name] for name in PLACE], axis=1),
        enu_from_cam=rotation.normalised(q),
    )


def is_parquet(path: Path) -> bool:
    """Whether a file is named as a parquet table."""
    return path.suffix.lower() == ".parquet"


def is_pose_table(path: Path) -> bool:
    """Whether a file is named as a table, and is no flight log by its header."""
    return is_parquet(path) or (path.suffix.lower() == ".csv" and not is_flight_record(path))


def _csv(path: Path, raw: bytes) -> pd.DataFrame:
    import pandas as pd

    columns = raw[: raw.find(b"\n") + 1].count(b",") + 1
    if columns > MOST_COLUMNS:
        raise _wrong(path, f"{columns:,} columns", f"at most {MOST_COLUMNS:,}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # rows longer than the header
            table = pd.read_csv(
                io.BytesIO(raw), comment="#", skipinitialspace=True, dtype=str, skip_blank_lines=False, index_col=False
            )
    except (
        ValueError,
        pd.errors.ParserError,
        pd.errors.ParserWarning,
    ) as error:  # empty tables and wrong encodings are ValueErrors
        raise _wrong(path, f"not a table ({str(error).strip()})", "comma-separated columns under a header") from None
    return table.rename(columns=str.strip).dropna(how="all")


def _parquet(path: Path, raw: bytes) -> pd.DataFrame:
    import pandas as pd

    try:
        from pyarrow import parquet
    except ImportError:
        raise _wrong(
            path, "a parquet table, and pyarrow is not installed", "the extra `parquet`", PARQUET_ADVICE
        ) from None
    try:
        table = parquet.read_table(io.BytesIO(raw), use_threads=False)
        found = {name: table.column(i).to_pandas() for i, name in enumerate(table.column_names)}
    except Exception as error:  # whatever pyarrow trips over in a broken file
        first = (str(error).splitlines() or ["nothing"])[0]
        raise _wrong(path, f"cannot be read as parquet ({type(error).__name__}: {first})", "a whole parquet file",
                     "write the table again") from None  # fmt: skip
    return pd.DataFrame(found)


def table_poses(table: PoseTable, *, camera: str, frame: Ints, log_time_s: Floats, where: str) -> PoseTrack:
    """Poses at frames (n,): looked up by frame where the table has frames, else interpolated at times (n,).

    Raises InputFileError where the table lacks a frame, does not reach over a time, or has a gap longer than
    MAX_GAP_S there.
    """
    frame = np.asarray(frame, dtype=np.int64)
    time = np.asarray(log_time_s, float)
    if table.frame is not None:
        row = _rows_of(table, table.frame, frame, where)
        place, q = table.position_enu_m[row], table.enu_from_cam[row]
    elif table.time_s is not None and len(table.time_s) >= 2:
        span = spans(table.time_s, time, frame, source=table.path.name, where=where, max_gap_s=MAX_GAP_S)
        share = (time - table.time_s[span]) / (table.time_s[span + 1] - table.time_s[span])
        step = table.position_enu_m[span + 1] - table.position_enu_m[span]
        place = table.position_enu_m[span] + share[:, None] * step
        q = rotation.slerp(table.enu_from_cam[span], table.enu_from_cam[span + 1], share)
    else:
        raise _wrong(table.path, "one row", "two or more poses to interpolate between, or a frame column")
    return PoseTrack(camera=camera, frame=frame, time_s=time, position_enu_m=place, enu_from_cam=q)


def _rows_of(table: PoseTable, have: Ints, want: Ints, where: str) -> Ints:
    row = np.clip(np.searchsorted(have, want), 0, len(have) - 1)
    lost = have[row] != want
    if lost.any():
        raise InputFileError(
            where=where,
            seen=f"{table.path.name} has no pose for {int(lost.sum())} of {len(want)} frames"
            f" (first: frame {int(want[lost][0])}; it has {int(have[0])} to {int(have[-1])})",
            expected="a row for every frame with a sighting",
            advice="add the frames, or give the table times (time_s instead of frame) to interpolate between",
        )
    return np.asarray(row)


def _numbers(path: Path, table: pd.DataFrame, name: str) -> Floats:
    import pandas as pd

    value = pd.to_numeric(table[name], errors="coerce").to_numpy(float)
    bad = ~np.isfinite(value)
    if bad.any():
        i = int(np.flatnonzero(bad)[0])
        raise _wrong(path, f"{name} = {table[name].iloc[i]} in line {_line(table, i)}", "a finite number")
    return value


def _check_increasing(path: Path, table: pd.DataFrame, name: str, value: Floats) -> None:
    back = np.flatnonzero(np.diff(value) <= 0)
    if len(back):
        i = int(back[0]) + 1
        seen = f"{name} = {value[i]:g} in line {_line(table, i)} after {value[i - 1]:g}"
        raise _wrong(path, seen, f"increasing {name}", "sort the rows and remove doubles")


def _check_unit(path: Path, table: pd.DataFrame, q: Floats) -> None:
    with np.errstate(over="ignore"):  # then it is infinite, and no unit
        length = np.linalg.norm(q, axis=1)
    bad = np.flatnonzero(np.abs(length - 1) > UNIT_TOLERANCE)
    if len(bad):
        i = int(bad[0])
        seen = f"the quaternion in line {_line(table, i)} has length {length[i]:.4g}"
        raise _wrong(path, seen, "unit quaternions qw,qx,qy,qz (scalar first)", "normalise them; check their order")


def _whole(path: Path, table: pd.DataFrame, frame: Floats) -> Ints:
    bad = np.flatnonzero((frame != np.round(frame)) | (frame < 0))
    if len(bad):
        i = int(bad[0])
        raise _wrong(path, f"frame = {frame[i]:g} in line {_line(table, i)}", "whole numbers from 0")
    return frame.astype(np.int64)


def _line(table: pd.DataFrame, i: int) -> int:
    return int(table.index[i]) + 2


def _columns_expected() -> str:
    return "columns time_s or frame, then " + ", ".join((*PLACE, *TURN))


def _wrong(path: Path, seen: str, expected: str, advice: str = "correct the file") -> InputFileError:
    return InputFileError(where=str(path), seen=seen, expected=expected, advice=advice)
