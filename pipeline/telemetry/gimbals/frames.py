"""What a gimbal's angles count from.

GIMBAL_DEVICE_ATTITUDE_STATUS keeps roll and pitch against the horizon; its yaw counts from north (earth frame) or
from the vehicle's heading (vehicle frame), as the flags say. Where neither frame flag is set, an older definition
holds: yaw lock means north.

MOUNT_STATUS and old MNT do not say it: stabilised mounts send angles against the horizon, mounts on servos send the
servos' angles, against the body. A mount that is stabilised keeps the horizon steady in one of the two readings, and
that reading is taken. Flags are held against the same measure: ArduPilot sends a servo gimbal's angles against the body
and flags them as locked to the horizon (from 4.6 on). Angles that never move are commands: they hold the horizon steady
in the reading in which they are written, whatever the camera does, and tell nothing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints, distinct, median, whole_numbers
from pipeline.geometry import rotation
from pipeline.telemetry.log.flight_log import BODY, EARTH, HEADING, AttitudeSeries, GimbalSeries

NEUTRAL = 2
ROLL_LOCK, PITCH_LOCK, YAW_LOCK = 4, 8, 16
YAW_IN_VEHICLE_FRAME = 32
YAW_IN_EARTH_FRAME = 64
ENCODER_ERROR = 8
"""Of GIMBAL_DEVICE_ERROR_FLAGS: the angles themselves are not to be believed; the others are limits and power."""
STEADIER = 0.5
"""Against the body, if that leaves less than this share of the unrest; both leave the same where nothing moves."""
STILL_RAD = 2e-4
"""Unrest from sample to sample below this is the noise of a mount at rest, and tells nothing."""
DOUBT_DEG = 2.0
"""Two readings closer than this are within what a gimbal is worth; further apart, doubt is said."""
TURNING_RAD = np.radians(10.0)
"""The heading's spread from which yaw can be held against it."""
STEEP_RAD = np.radians(75.0)
"""Steeper than this yaw and roll of a camera turn about nearly one axis."""
OWN_NORTH_RAD = np.radians(1.0)
"""A gimbal's north closer than this to the vehicle's is the vehicle's."""
RELAYED_RAD = np.radians(3.0)
"""Two senders whose gimbals look this nearly the same way tell of one gimbal."""
RUNS, RUN_ROWS = 32, 256
"""Of a longer series so many runs of so many samples, evenly over it, tell what its angles count from: no more is
learnt from all of them."""
FRAME_NAMES = {
    EARTH: "north and the horizon",
    HEADING: "the vehicle's heading and the horizon",
    BODY: "the vehicle's body",
}


def frame_of_flags(flags: Floats) -> Ints:
    """EARTH or HEADING (n,) of GIMBAL_DEVICE_FLAGS."""
    bits = whole_numbers(flags)
    earth = np.where(states_frame(flags), (bits & YAW_IN_VEHICLE_FRAME) == 0, (bits & YAW_LOCK) != 0)
    return np.where(earth, EARTH, HEADING)


def states_frame(flags: Floats) -> Bools:
    """Whether flags (n,) say what yaw counts from, by the bits that newer definitions have for it."""
    bits = whole_numbers(flags)
    return np.asarray((bits & (YAW_IN_VEHICLE_FRAME | YAW_IN_EARTH_FRAME)) != 0)


def as_outputs(source: str, who: str, frame: Ints, flags: Floats, outputs: Bools) -> tuple[Ints, list[str]]:
    """What yaw counts from where an autopilot sends the angles of its own `outputs` (n,), and a note where that is new.

    Those turn with the vehicle, whatever yaw lock says: it means what was asked for, not what is sent.
    """
    lies = outputs & (frame == EARTH) & ~states_frame(flags)
    if not lies.any():
        return frame, []
    said = f"{source}: {who}'s own yaw counts from the vehicle's heading, whatever yaw lock says"
    return np.where(lies, HEADING, frame), [said]


def heading_turn(ned_from_body: Floats) -> Floats:
    """ned_from_level (n, 4): the turn about down by the vehicle's heading."""
    yaw = rotation.yaw_pitch_roll(ned_from_body)[..., 0]
    zero = np.zeros_like(yaw)
    return rotation.exp(np.stack([zero, zero, yaw], axis=-1))


def ned_from_mount(attitude: Floats, frame: Ints, ned_from_body: Floats) -> Floats:
    """ned_from_mount (n, 4) of mount attitudes (n, 4) in their frames (n,), by the body's attitude (n, 4) then."""
    nothing = np.array([1.0, 0.0, 0.0, 0.0])
    kind = np.asarray(frame)[:, None]
    turn = np.where(kind == EARTH, nothing, np.where(kind == BODY, ned_from_body, heading_turn(ned_from_body)))
    return rotation.multiply(turn, attitude)


def steadier_frame(gimbal: GimbalSeries, body: AttitudeSeries | None) -> int:
    """HEADING or BODY: in which of the two the mount keeps the horizon steadier."""
    seen = beside_body(gimbal, body)
    if seen is None:
        return HEADING
    mount, turned = seen
    return BODY if _unrest(rotation.multiply(turned, mount)) < STEADIER * _unrest(mount) else HEADING


def told_frame(gimbal: GimbalSeries, body: AttitudeSeries | None) -> tuple[GimbalSeries, list[str]]:
    """A mount whose messages do not say what they count from, with the frame its motion tells, and a note."""
    frame = steadier_frame(gimbal, body)
    note = f"{gimbal.source} does not say what its angles count from; by the vehicle's motion: {FRAME_NAMES[frame]}"
    doubt = _doubt(beside_body(gimbal, body), commanded=True)
    return replace(gimbal, frame=np.full(len(gimbal.frame), frame)), [note + (f" ({doubt})" if doubt else "")]


def held_frame(
    gimbal: GimbalSeries,
    body: AttitudeSeries | None,
    against_body: Floats | None = None,
    *,
    commanded: bool = False,
) -> tuple[GimbalSeries, list[str]]:
    """A mount whose messages say what they count from, held against what its angles do, and what to say of it.

    `against_body` (n, 4) is its attitude as it reads against the body, where that is another than as it stands. With
    `commanded` its angles may be what an autopilot asks for rather than what an encoder reads.
    """
    attitude = gimbal.attitude if against_body is None else against_body
    seen = beside_body(gimbal, body)
    servos = seen if against_body is None else beside_body(replace(gimbal, attitude=attitude), body)
    if seen is None or servos is None:
        return gimbal, []
    mount, _ = seen
    level, servo = _unrest(mount), _unrest(rotation.multiply(servos[1], servos[0]))
    if level > STILL_RAD**2 and servo < STEADIER * level:
        return replace(gimbal, attitude=attitude, frame=np.full(len(gimbal.frame), BODY)), [
            f"{gimbal.source} says that roll and pitch count from the horizon, but they undo the vehicle's own:"
            f" they are read as angles against its body (servos); the two readings are"
            f" {_apart_deg(servos[0], servos[1]):.1f} degrees apart"
        ]
    gimbal, notes = _held_yaw(gimbal, body, seen)
    doubt = _doubt(servos, commanded=commanded)
    if doubt and not notes:
        stated = " or ".join(FRAME_NAMES[kind] for kind in distinct(gimbal.frame).tolist())
        notes = [f"{gimbal.source}: {doubt}; it is read as it says, against {stated}"]
    return gimbal, notes


def _held_yaw(
    gimbal: GimbalSeries, body: AttitudeSeries | None, all_seen: tuple[Floats, Floats]
) -> tuple[GimbalSeries, list[str]]:
    """The mount with yaw held against the vehicle's heading, the rows of each stated frame by themselves.

    `all_seen` is `beside_body` of all of it.
    """
    frame, notes = gimbal.frame.copy(), []
    kinds = distinct(gimbal.frame).tolist()
    for stated in kinds:
        rows = gimbal.frame == stated
        seen: tuple[Floats, Floats] | None = all_seen
        if len(kinds) > 1:
            part = replace(gimbal, time_s=gimbal.time_s[rows], attitude=gimbal.attitude[rows], frame=gimbal.frame[rows])
            seen = beside_body(part, body)
        yaw = stated if seen is None else _yaw_frame(*seen, stated)
        if yaw != stated:
            frame[rows] = yaw
            notes.append(
                f"{gimbal.source} says that yaw counts from {FRAME_NAMES[stated]}, but it turns with the vehicle as one"
                f" that counts from {FRAME_NAMES[yaw]}: it is read so"
            )
    return (replace(gimbal, frame=frame) if notes else gimbal), notes


def own_north(
    gimbal: GimbalSeries, delta_yaw_rad: Floats, body: AttitudeSeries | None
) -> tuple[GimbalSeries, list[str]]:
    """A gimbal whose north is its own, brought to the vehicle's heading by the yaw (n,) that it sees the vehicle at."""
    told = gimbal.valid & np.isfinite(delta_yaw_rad) & (gimbal.frame == EARTH)
    if body is None or not (told & (delta_yaw_rad != 0)).any():
        return gimbal, []
    at, inside = attitude_at(body, gimbal.time_s[told])
    if inside.sum() < 2:
        return gimbal, []
    heading = rotation.yaw_pitch_roll(at[inside])[:, 0]
    north = _wrapped(heading - delta_yaw_rad[told][inside])
    middle = float(np.angle(np.exp(1j * north).mean()))
    moves, left = _spread(heading), _spread(north)
    if moves > np.radians(5) and left > 0.5 * moves:
        return gimbal, [f"{gimbal.source}: delta_yaw does not follow the vehicle's heading, and is not used"]
    if abs(middle) < OWN_NORTH_RAD:
        return gimbal, []
    zero = np.zeros(int(told.sum()))
    back = rotation.exp(np.stack([zero, zero, -delta_yaw_rad[told]], axis=-1))
    attitude, frame = gimbal.attitude.copy(), gimbal.frame.copy()
    attitude[told], frame[told] = rotation.multiply(back, gimbal.attitude[told]), HEADING
    return replace(gimbal, attitude=attitude, frame=frame), [
        f"{gimbal.source}: the gimbal's north is {np.degrees(middle):.1f} degrees off the vehicle's, by its delta_yaw;"
        " its yaw is taken against the vehicle's heading"
    ]


def same_gimbal(first: GimbalSeries, second: GimbalSeries, body: AttitudeSeries | None) -> bool:
    """Whether two series tell of one gimbal: their optical axes differ by less than RELAYED_RAD typically."""
    faces = []
    for series in (first, second):
        keep = series.valid
        kind, q = series.frame[keep], series.attitude[keep]
        at, inside = (q, np.ones(len(q), bool)) if body is None else attitude_at(body, series.time_s[keep])
        if body is None and (kind != EARTH).any():
            inside = kind == EARTH
        faces.append((series.time_s[keep][inside], ned_from_mount(q[inside], kind[inside], at[inside])))
    (t1, q1), (t2, q2) = faces
    if len(t1) < 2 or len(t2) < 2:
        return False
    near = np.clip(np.searchsorted(t2, t1), 1, len(t2) - 1)
    near = np.where(np.abs(t2[near - 1] - t1) < np.abs(t2[near] - t1), near - 1, near)
    close = np.abs(t2[near] - t1) < 0.5
    if not close.any():
        return False
    x1, x2 = (rotation.matrix(q)[..., 0] for q in (q1[close], q2[near[close]]))
    return bool(median(np.arccos(np.clip((x1 * x2).sum(axis=1), -1, 1))) < RELAYED_RAD)


def attitude_at(body: AttitudeSeries, time_s: Floats) -> tuple[Floats, Bools]:
    """ned_from_body (n, 4) at times (n,), and which of them lie inside the attitudes."""
    keep = body.valid
    stamp, q = body.time_s[keep], body.ned_from_body[keep]
    if len(stamp) < 2:
        return np.full((len(time_s), 4), np.nan), np.zeros(len(time_s), bool)
    inside = np.asarray((time_s >= stamp[0]) & (time_s <= stamp[-1]))
    left = np.clip(np.searchsorted(stamp, time_s, side="right") - 1, 0, len(stamp) - 2)
    step = stamp[left + 1] - stamp[left]
    share = np.where(step > 0, (time_s - stamp[left]) / np.where(step > 0, step, 1.0), 0.0)
    return rotation.slerp(q[left], q[left + 1], np.where(inside, share, 0.0)), inside


def beside_body(gimbal: GimbalSeries, body: AttitudeSeries | None) -> tuple[Floats, Floats] | None:
    """Mount attitudes and the body's beside them (k, 4); None where there are too few."""
    told = np.flatnonzero(gimbal.valid)
    if body is None or len(told) < 10:
        return None
    rows = in_runs(told)
    turned, inside = attitude_at(body, gimbal.time_s[rows])
    return gimbal.attitude[rows][inside], turned[inside]


def in_runs(rows: Ints) -> Ints:
    """All of few rows (n,), of more RUNS evenly spread runs of RUN_ROWS neighbours."""
    if len(rows) <= RUNS * RUN_ROWS:
        return rows
    begin = np.linspace(0, len(rows) - RUN_ROWS, RUNS).astype(np.int64)
    return np.asarray(rows[(begin[:, None] + np.arange(RUN_ROWS)).ravel()])


def _doubt(seen: tuple[Floats, Floats] | None, *, commanded: bool = False) -> str:
    """What to say where the motion does not tell the horizon from the body and the two readings differ.

    `seen` is `beside_body` of the mount as it reads against the body.
    """
    if seen is None:
        return ""
    mount, turned = seen
    level, servo = _unrest(mount), _unrest(rotation.multiply(turned, mount))
    apart = _apart_deg(mount, turned)
    if apart < DOUBT_DEG:
        return ""
    if commanded and level <= STILL_RAD**2 < servo:
        return (
            "its angles never move, as commands do not: the camera may hold them against the horizon or against the"
            f" body, and the two readings are {apart:.1f} degrees apart"
        )
    if servo * STEADIER > level or (level > 0 and servo < STEADIER * level):
        return ""
    return (
        "the vehicle's motion does not tell the horizon from its body,"
        f" and the two readings are {apart:.1f} degrees apart"
    )


def _apart_deg(mount: Floats, body: Floats) -> float:
    """Typical angle between the optical axis read against the horizon and heading, and against the body."""
    axis, other = (rotation.matrix(rotation.multiply(t, mount))[..., 0] for t in (heading_turn(body), body))
    return float(np.degrees(median(np.arccos(np.clip((axis * other).sum(axis=1), -1, 1))))) if len(mount) else 0.0


def _yaw_frame(mount: Floats, body: Floats, stated: int) -> int:
    """EARTH or HEADING: what yaw counts from; another than stated only where that would turn the camera twice."""
    ypr = rotation.yaw_pitch_roll(mount)
    level = np.abs(ypr[:, 1]) < STEEP_RAD
    yaw, heading = (np.unwrap(a[level]) for a in (ypr[:, 0], rotation.yaw_pitch_roll(body)[:, 0]))
    if len(yaw) < 10 or np.std(heading) < TURNING_RAD:
        return stated
    x, y = heading - heading.mean(), yaw - yaw.mean()
    slope = float(x @ y / (x @ x))
    if np.std(y - slope * x) > 0.3 * np.std(x):
        return stated
    if stated == HEADING and abs(slope - 1) < 0.25:
        return EARTH
    return HEADING if stated == EARTH and abs(slope + 1) < 0.25 else stated


def _wrapped(angle: Floats) -> Floats:
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)


def _spread(angle: Floats) -> float:
    """Root mean square of angles about their middle."""
    return float(np.sqrt(np.mean(_wrapped(angle - np.angle(np.exp(1j * angle).mean())) ** 2)))


def _unrest(frame_from_mount: Floats) -> float:
    """Mean square of the changes of pitch and roll from sample to sample, the largest tenth left out."""
    change = np.diff(rotation.yaw_pitch_roll(frame_from_mount)[:, 1:], axis=0)
    square = np.sort((change**2).sum(axis=1))
    return float(square[: max(1, int(0.9 * len(square)))].mean()) if len(square) else 0.0
