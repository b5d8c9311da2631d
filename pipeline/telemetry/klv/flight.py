"""From ST 0601 metadata to a FlightLog.

Log time is the precision time stamp, POSIX seconds. The presentation time stamps beside it tell the log time of the
video's frame 0; they are log time themselves, counted from frame 0, where there is no precision time stamp or where it
jumped against the video. Sensor angles are intrinsic azimuth, elevation, roll against the platform's body.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from calibration.foundation.arrays import Bools, Floats
from calibration.foundation.errors import InputFileError
from pipeline.geometry import rotation
from pipeline.telemetry.clocks.boot_clock import another_recording, continued
from pipeline.telemetry.clocks.clock_model import fit_clock
from pipeline.telemetry.clocks.utc import believed_utc
from pipeline.telemetry.heights.undulation import Undulation, on_ellipsoid, undulation_of
from pipeline.telemetry.klv import items
from pipeline.telemetry.klv.local_set import Sets, local_sets
from pipeline.telemetry.klv.transport import MetadataStream, Transport, read_transport, seconds_between
from pipeline.telemetry.log.flight_log import BODY, AttitudeSeries, ClockModel, FlightLog, GimbalSeries, PositionSeries
from pipeline.telemetry.log.series import attitude_series, gimbal_series, position_series
from pipeline.telemetry.log.tables import Progress

SYNCHRONOUS_SIGMA_S = 0.02
"""Between a frame and metadata of its own: half a frame."""
ASYNCHRONOUS_SIGMA_S = 0.2
"""Metadata that only comes near its frame: encoders put it half a second off at most."""
BESIDE_SIGMA_S = 0.5
"""Metadata without a time of its own, beside the frame that came last."""
STAMP_SIGMA_S = 0.1
"""What precision time stamps differ from UTC where the platform's clock is set by GPS."""
JUMP_S = 0.5
"""Time stamps that jump by more than this against the video come from a clock that was set."""
HEIGHT_STEP_M = 0.31
"""Heights of two bytes are 0.304 m apart."""
SAME_PLACE_DEG = 1e-4
"""Two streams whose typical places are within ten metres of each other tell of one sensor, at two rates."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Metadata:
    """The sets of one stream: item -> bytes of each, video time (n,) of each, NaN where unknown, and its sigma."""

    number: int
    sets: tuple[Mapping[int, bytes], ...]
    video_s: Floats
    video_sigma_s: float
    corrupt: int
    unchecked: int

    def column(self, item: int) -> Floats:
        """One item of every set (n,)."""
        return items.column(self.sets, item)


@dataclass(frozen=True, kw_only=True, eq=False)
class Times:
    """Log time (n,) of the sets, that of frame 0 with its sigma, UTC, and notes."""

    log_s: Floats
    start_s: float
    start_sigma_s: float
    utc: ClockModel | None
    notes: tuple[str, ...] = ()


def read_klv(path: Path, *, system: int | None = None, progress: Progress = None) -> FlightLog:
    """The metadata in the transport stream at `path`; of several streams that differ, the `system`-th, else the first.

    Raises InputFileError where there is none.
    """
    transport = read_transport(path)
    streams = _streams(transport)
    asked = [one for one in streams if system in (None, one.number)]
    if not asked:
        raise InputFileError(
            where=str(path),
            seen="a transport stream without metadata of MISB ST 0601"
            if not streams
            else f"no stream of metadata number {system}; there are {', '.join(str(one.number) for one in streams)}",
            expected="KLV metadata beside the video",
            advice="give the flight's log as `telemetry`" if not streams else "take one of them as `system`",
        )
    chosen, different = asked[0], _different(streams)
    times = _times(chosen)
    position, height_notes = _position(chosen, times.log_s)
    if progress is not None:
        progress(1.0)
    return FlightLog(
        path=path,
        format="misb klv",
        system=chosen.number if different else None,
        systems=different,
        counts={"ST 0601": sum(len(one.sets) for one in streams)},
        corrupt_packets=sum(one.corrupt for one in streams) + transport.broken,
        position=position,
        attitude=_attitude(chosen, times.log_s),
        gimbal=_gimbal(chosen, times.log_s),
        utc=times.utc,
        video_start_s=times.start_s,
        video_start_sigma_s=times.start_sigma_s,
        notes=(*times.notes, *_source_notes(chosen, times.log_s), *height_notes),
    )


def _streams(transport: Transport) -> list[Metadata]:
    """Every stream that carries sets, in the order of its PID, the synchronous first: those know their frames."""
    found = []
    for number, (_, stream) in enumerate(sorted(transport.streams.items()), 1):
        sets = local_sets(bytes(stream.data))
        if sets.sets or sets.corrupt:
            found.append((stream.synchronous, _metadata(number, stream, sets, transport.first_pts)))
    return [one for _, one in sorted(found, key=lambda each: (not each[0], each[1].number))]


def _metadata(number: int, stream: MetadataStream, sets: Sets, first_pts: int | None) -> Metadata:
    part = np.searchsorted(stream.begin, [one.begin for one in sets.sets], side="right") - 1
    own = [stream.pts[i] for i in part.tolist()]
    beside = [stream.beside[i] for i in part.tolist()]
    told = any(pts is not None for pts in own)
    video = [np.nan if first_pts is None or pts is None else seconds_between(first_pts, pts)
             for pts in (own if told else beside)]  # fmt: skip
    sigma = SYNCHRONOUS_SIGMA_S if stream.synchronous else ASYNCHRONOUS_SIGMA_S
    return Metadata(
        number=number,
        sets=tuple(one.items for one in sets.sets),
        video_s=np.array(video, float),
        video_sigma_s=sigma if told else BESIDE_SIGMA_S,
        corrupt=sets.corrupt,
        unchecked=sets.unchecked,
    )


def _different(streams: list[Metadata]) -> tuple[int, ...]:
    """The numbers of streams that give positions, where they are not one and the same sensor's; else none."""
    places = [(one, one.column(items.LATITUDE), one.column(items.LONGITUDE)) for one in streams]
    told = [(one, lat, lon) for one, lat, lon in places if np.isfinite(lat + lon).sum() >= 2]
    if len(told) < 2:
        return ()
    middles = np.array([[np.nanmedian(lat), np.nanmedian(lon)] for _, lat, lon in told])
    same = bool(np.ptp(middles, axis=0).max() < SAME_PLACE_DEG)
    return () if same else tuple(sorted(one.number for one, _, _ in told))


def _times(data: Metadata) -> Times:
    stamp, video = data.column(items.TIME), data.video_s
    stamp, thrown = believed_utc("precision time stamps", video, stamp)
    bare = (f"{data.unchecked} metadata sets carry no checksum: they are believed",) if data.unchecked else ()
    video, parts = continued(video, stamp)
    notes = (*thrown, *bare, *(another_recording(offset) for _, offset in parts))
    if not np.isfinite(stamp).any():
        said = "no set has a precision time stamp: log time is the video's own"
        return Times(log_s=video, start_s=0.0, start_sigma_s=data.video_sigma_s, utc=None, notes=(*notes, said))
    leap = data.column(items.LEAP_SECONDS)
    leap_s = float(np.nanmedian(leap)) if np.isfinite(leap).any() else 0.0
    source = "precision time stamps" + (f" and {leap_s:+.0f} leap seconds" if leap_s else ", taken as UTC")
    beside = fit_clock(source, video, stamp + leap_s, floor_s=data.video_sigma_s)
    jumps = np.abs(np.diff((stamp - video)[np.isfinite(stamp + video)])) > JUMP_S
    if not jumps.any():
        middle = float(np.nanmedian(stamp))
        utc = ClockModel(
            source=source, epoch_s=middle + leap_s, log_epoch_s=middle, rate=1.0, sigma_s=STAMP_SIGMA_S,
            pairs=int(np.isfinite(stamp).sum()), outliers=0,
        )  # fmt: skip
        start = np.nan if beside is None else beside.other_s(0.0) - leap_s
        sigma = np.nan if beside is None else beside.sigma_s
        return Times(log_s=stamp, start_s=float(start), start_sigma_s=float(sigma), utc=utc, notes=notes)
    said = f"precision time stamps jump against the video, {jumps.sum()} times: log time is the video's own"
    set_last = fit_clock(source, video, stamp + leap_s, floor_s=STAMP_SIGMA_S, set_later=True)
    return Times(log_s=video, start_s=0.0, start_sigma_s=data.video_sigma_s, utc=set_last, notes=(*notes, said))


def _position(data: Metadata, log_s: Floats) -> tuple[PositionSeries | None, tuple[str, ...]]:
    """Sensor positions of the sets that name one, and notes."""
    rows = _having(data, items.LATITUDE, items.LONGITUDE)
    if not rows.any():
        return None, ()
    lat, lon = data.column(items.LATITUDE)[rows], data.column(items.LONGITUDE)[rows]
    nowhere = (lat == 0) & (lon == 0)
    lat, lon = (np.where(nowhere, np.nan, angle) for angle in (lat, lon))
    sea, undulation, above = _heights(data, rows, lat, lon)
    words, height = on_ellipsoid(sea, undulation, lat, lon)
    if np.isfinite(above).any() and (undulation is None or undulation.believed):
        words, height = "above the ellipsoid (items 75, 104)", np.where(np.isfinite(above), above, height)
    series = position_series(
        source="ST 0601", datum="ellipsoid", height_from=words, time_s=log_s[rows], lat_deg=lat, lon_deg=lon,
        height_m=height, velocity_ned_mps=np.full((int(rows.sum()), 3), np.nan),
    )  # fmt: skip
    return series, () if undulation is None else undulation.notes


def _heights(data: Metadata, rows: Bools, lat: Floats, lon: Floats) -> tuple[Floats, Undulation | None, Floats]:
    """Heights above mean sea level, what lies between it and the ellipsoid, and heights above the ellipsoid."""
    sea = data.column(items.TRUE_ALTITUDE)[rows]
    narrow, wide = (data.column(item)[rows] for item in (items.ELLIPSOID_HEIGHT, items.WIDE_ELLIPSOID_HEIGHT))
    above = np.where(np.isfinite(wide), wide, narrow)
    both = np.isfinite(sea + above + lat + lon)
    undulation = undulation_of("ST 0601", (above - sea)[both], lat[both], lon[both], equal_m=HEIGHT_STEP_M)
    return sea, undulation, above


def _attitude(data: Metadata, log_s: Floats) -> AttitudeSeries | None:
    """The platform's attitude: pitch and roll of full range where they are given."""
    rows = _having(data, items.HEADING)
    if not rows.any():
        return None
    heading = data.column(items.HEADING)[rows]
    pitch, roll = (
        np.where(np.isfinite(full), full, narrow)
        for full, narrow in (
            (data.column(f)[rows], data.column(n)[rows])
            for f, n in ((items.FULL_PITCH, items.PITCH), (items.FULL_ROLL, items.ROLL))
        )
    )
    q = rotation.ned_from_frd(*np.radians([heading, pitch, roll]))
    return attitude_series(source="ST 0601", time_s=log_s[rows], ned_from_body=q)


def _gimbal(data: Metadata, log_s: Floats) -> GimbalSeries | None:
    """The sensor's attitude against the platform; its roll is zero where it is never given."""
    rows = _having(data, items.AZIMUTH, items.ELEVATION)
    if not rows.any():
        return None
    roll = data.column(items.SENSOR_ROLL)[rows]
    if not np.isfinite(roll).any():
        roll = np.zeros(len(roll))
    q = rotation.ned_from_frd(*np.radians([data.column(items.AZIMUTH)[rows], data.column(items.ELEVATION)[rows], roll]))
    return gimbal_series(source="ST 0601", time_s=log_s[rows], attitude=q, frame=np.full(len(q), BODY))


def _having(data: Metadata, *wanted: int) -> Bools:
    """True (n,) for the sets that have one of the items: others are not about it."""
    return np.array([any(item in found for item in wanted) for found in data.sets], bool)


def _source_notes(data: Metadata, log_s: Floats) -> tuple[str, ...]:
    """A note where the platform, or the sensor that the picture comes from, changes."""
    notes = []
    for item, what in ((items.DESIGNATION, "platform"), (items.SOURCE, "image source")):
        named = [(t, found[item]) for t, found in zip(log_s.tolist(), data.sets, strict=True) if item in found]
        changes = [(t, a, b) for (_, a), (t, b) in pairwise(named) if a != b]
        if changes:
            t, a, b = changes[0]
            before, after = (name.decode("utf-8", "replace") for name in (a, b))
            notes.append(f"the {what} changes, first at log time {t:.1f} s from {before} to {after}: one calibration"
                         " and one mount hold for one of them")  # fmt: skip
    return tuple(notes)
