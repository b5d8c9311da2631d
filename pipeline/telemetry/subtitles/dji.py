"""DJI's subtitles (.SRT): one block per frame or second, in as many dialects as DJI has models.

    [latitude: 41.42] [longitude: 2.23] [abs_alt: 117.0]      brackets; "longtitude" in old ones
    GPS (-58.85, -34.23, 15), H 85.8m                         longitude, latitude, satellites
    GPS(36.6146,-6.1120,0.0M)                                 latitude, longitude, height, told by unit or decimals
    F.PRY (2.7, -7.0, 110.1), G.PRY (-24.4, 0.0, 110.4)       pitch, roll, yaw in degrees of flight and gimbal
    [gb_yaw: -162.8 gb_pitch: 0.0 gb_roll: 0.0]

Log time is the subtitle's own time: video time, so frame 0 is at `start = 0`. Dates are local and of no known zone:
they give no UTC. Heights are mostly above the take-off place.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

import numpy as np

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import InputFileError
from calibration.foundation.files import read_bytes
from pipeline.geometry import rotation
from pipeline.telemetry.clocks.boot_clock import another_recording, continued
from pipeline.telemetry.gimbals.still_heading import still_heading
from pipeline.telemetry.heights.dji import RECEIVER_SIGMA_M, dji_heights
from pipeline.telemetry.log.flight_log import (
    EARTH,
    Accuracy,
    AttitudeSeries,
    FlightLog,
    GimbalSeries,
    PositionSeries,
)
from pipeline.telemetry.log.series import attitude_series, gimbal_series, position_series
from pipeline.telemetry.log.tables import Progress
from pipeline.telemetry.subtitles.in_video import VIDEO_NAMES, subtitles_in

NUMBER = r"\s*([-+]?\d+(?:\.\d+)?)"
CUE = re.compile(r"(\d+):(\d\d):(\d\d)[,.](\d{3})\s*-->")
DATE = re.compile(r"(\d{4})[-.](\d\d)[-.](\d\d) (\d\d):(\d\d):(\d\d)(?:[,.](\d{1,3}))?")
GPS = re.compile(rf"GPS\s*\({NUMBER}\s*,{NUMBER}\s*,{NUMBER}\s*(M?)\)")
RELATIVE = re.compile(rf"(?:rel_alt\s*:|BAROMETER\s*[:(]|\bH\b){NUMBER}")
ABSOLUTE = re.compile(rf"(?:abs_alt|altitude)\s*:{NUMBER}")
TRIPLE = rf"\s*\({NUMBER}°?\s*,{NUMBER}°?\s*,{NUMBER}°?\s*\)"
FLIGHT, GIMBAL = re.compile(r"F\.PRY" + TRIPLE), re.compile(r"G\.PRY" + TRIPLE)
BRACKETS = {
    name: re.compile(rf"\b{words}\s*:{NUMBER}")
    for name, words in (("lat", "latitude"), ("lon", "longt?itude"), ("yaw", "gb_yaw"), ("pitch", "gb_pitch"),
                        ("roll", "gb_roll"))
}  # fmt: skip
TIME_NOTE = "log time is the video's own; dates in the subtitles are of an unknown time zone"
NOTHING = float("nan")
IN_VIDEO_SIGMA_S = 0.02
"""Between a subtitle and its own frame: half a frame."""


def read_dji_srt(path: Path, *, progress: Progress = None) -> FlightLog:
    """The flight in a DJI subtitle file, or in the subtitles of a video.

    Raises InputFileError where the file cannot be read or holds no subtitle with a time.
    """
    inside = path.suffix.lower() in VIDEO_NAMES
    if inside:
        text = subtitles_in(path)
    else:
        text = read_bytes(path, expected="DJI subtitles (.SRT)").decode("utf-8", "replace").replace("\r", "")
    blocks = [part for block in re.split(r"\n\s*\n", text) for part in _cues(block) if part.strip()]
    time, parts = continued(_times(blocks))
    timed = np.isfinite(time)
    if not timed.any():
        raise InputFileError(
            where=str(path),
            seen="no subtitle with a time",
            expected="DJI subtitles (.SRT)",
            advice="check that it is the subtitle file of the video",
        )
    used = [block for block, good in zip(blocks, timed.tolist(), strict=True) if good]
    if progress is not None:
        progress(1.0)
    position, accuracy, height_notes = _position(used, time[timed])
    attitude, gimbal = _attitude(used, time[timed]), _gimbal(used, time[timed])
    return FlightLog(
        path=path,
        format="dji srt",
        counts={"subtitle": len(used)},
        corrupt_packets=int((~timed).sum()),
        position=position,
        attitude=attitude,
        gimbal=gimbal,
        accuracy=accuracy,
        video_start_s=0.0 if inside else NOTHING,
        video_start_sigma_s=IN_VIDEO_SIGMA_S if inside else NOTHING,
        notes=(
            "log time is the video's own; dates in the subtitles are of an unknown time zone",
            *(another_recording(offset) for _, offset in parts),
            *height_notes,
            *still_heading(gimbal, attitude),
        ),
    )


def _cues(block: str) -> list[str]:
    """The subtitles in a block: one, unless blank lines between them are missing."""
    begins = [found.start() for found in CUE.finditer(block)]
    return [block[a:b] for a, b in pairwise([0, *begins[1:], len(block)])] if len(begins) > 1 else [block]


def _times(blocks: list[str]) -> Floats:
    """Seconds (n,): of the cue, else of the date counted from the first."""
    cues = np.array([_cue(block) for block in blocks])
    if np.isfinite(cues).any():
        return cues
    dates = np.array([_date(block) for block in blocks])
    return dates - np.nanmin(dates) if np.isfinite(dates).any() else dates


def _cue(block: str) -> float:
    found = CUE.search(block)
    if found is None:
        return NOTHING
    hours, minutes, seconds, milliseconds = map(int, found.groups())
    return hours * 3600 + minutes * 60 + seconds + milliseconds / 1000


def _date(block: str) -> float:
    found = DATE.search(block)
    if found is None:
        return NOTHING
    try:
        moment = datetime.strptime(" ".join(found.groups()[:6]), "%Y %m %d %H %M %S").replace(tzinfo=UTC).timestamp()
    except ValueError:
        return NOTHING
    return moment + float("0." + (found.group(7) or "0"))


def _numbers(pattern: re.Pattern[str], blocks: list[str], many: int = 1) -> Floats:
    """(n, many) numbers that a pattern finds, NaN where it finds none."""
    rows = []
    for block in blocks:
        found = pattern.search(block)
        rows.append([float(g) for g in found.groups()[:many]] if found else [NOTHING] * many)
    return np.array(rows, float).reshape(-1, many)


def _position(blocks: list[str], time_s: Floats) -> tuple[PositionSeries | None, Accuracy, tuple[str, ...]]:
    lat, lon = (_numbers(BRACKETS[name], blocks)[:, 0] for name in ("lat", "lon"))
    pair = _numbers(GPS, blocks, 3)
    metres = np.array([bool(found and (found[4] or "." in found[3])) for found in map(GPS.search, blocks)])
    lat = np.where(np.isfinite(lat), lat, np.where(metres, pair[:, 0], pair[:, 1]))
    lon = np.where(np.isfinite(lon), lon, np.where(metres, pair[:, 1], pair[:, 0]))
    lat, lon = (np.where((lat == 0) & (lon == 0), np.nan, angle) for angle in (lat, lon))
    if not np.isfinite(lat).any():
        return None, Accuracy(), ()
    above_home = _numbers(RELATIVE, blocks)[:, 0]
    heights = dji_heights(_numbers(ABSOLUTE, blocks)[:, 0], above_home, lat, lon)
    series = position_series(
        source="subtitles",
        datum=heights.datum,
        height_from=heights.words,
        time_s=time_s,
        lat_deg=lat,
        lon_deg=lon,
        height_m=heights.height_m,
        velocity_ned_mps=np.full((len(blocks), 3), np.nan),
        above_home_m=above_home,
    )
    stated = Accuracy(horizontal_m=RECEIVER_SIGMA_M, vertical_m=heights.sigma_m, source=f"DJI's {heights.words}")
    return series, stated, heights.notes


def _attitude(blocks: list[str], time_s: Floats) -> AttitudeSeries | None:
    pitch, roll, yaw = np.radians(_numbers(FLIGHT, blocks, 3)).T
    if not np.isfinite(pitch).any():
        return None
    return attitude_series(source="F.PRY", time_s=time_s, ned_from_body=rotation.ned_from_frd(yaw, pitch, roll))


def _gimbal(blocks: list[str], time_s: Floats) -> GimbalSeries | None:
    angles = _numbers(GIMBAL, blocks, 3)
    source = "G.PRY"
    if not np.isfinite(angles).any():
        angles = np.concatenate([_numbers(BRACKETS[name], blocks) for name in ("pitch", "roll", "yaw")], axis=1)
        source = "gb_yaw, gb_pitch, gb_roll"
    if not np.isfinite(angles).any():
        return None
    pitch, roll, yaw = np.radians(angles).T
    q = rotation.ned_from_frd(yaw, pitch, roll)
    return gimbal_series(source=source, time_s=time_s, attitude=q, frame=np.full(len(blocks), EARTH))
