"""Runs of frames of one camera inside one span of the motion and one segment of its clock.

Inside a block everything global acts through few local unknowns: the power series of the targets, and twelve columns
of the camera, [rotation bias 3, position bias 3, focal, time at u = 0, time per u, pose time at u = 0, per u, readout].
Time moves the targets; pose time moves the camera along its log; the readout of a rolling shutter moves both, each
sighting by its row. `local_from_camera` maps the camera's parameters [rotation 3, position 3, focal, offset, scale,
start, readout, left and right deviation knot] to these columns.
Place errors (constant and drifting) have a pair of columns each for every target and axis, at u = 0 and per u; they are
put between where it is known which targets take part (`with_places`).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.solver.observation.clocks import (
    CAMERA_PARAMETERS,
    FOCAL,
    OFFSET,
    PLACE_PARAMETERS,
    READOUT,
    SCALE,
    START,
    Drift,
)
from pipeline.solver.observation.motion_basis import MotionBasis
from pipeline.solver.observation.observations import Frames
from pipeline.solver.observation.pose_wander import PoseWander

LONGEST = 2048
"""Frames: what a block may hold at most, so that the memory of a pass is bounded."""
LOCAL_COLUMNS = 12
BLOCK_PARAMETERS = 13


@dataclass(frozen=True, kw_only=True, eq=False)
class Blocks:
    """B blocks.

    begin    (B + 1,) first frame of each; camera, span, segment, cluster (B,)
    u        (F,) time of each frame inside its span, -1 to 1
    half_s   (B,) half the span's length
    local_from_camera  (B, 12, 13); 12 more columns, left and right knot, where poses wander
    place    (B, 2) the share of drifting place errors at u = 0, and per u; None: there are none
    wander   (B,) left knot of each block's pose errors, -1: none; None where no camera's wander
    """

    begin: Ints
    camera: Ints
    span: Ints
    segment: Ints
    cluster: Ints
    u: Floats
    half_s: Floats
    local_from_camera: Floats
    wander: Ints | None = None
    place: Floats | None = None


def partition(
    frames: Frames, basis: MotionBasis, drift: Drift, time_s: Floats, camera: Floats, deviation: Floats,
    cluster: Ints | None = None, wander: PoseWander | None = None,
) -> Blocks:  # fmt: skip
    """Cut the frames into blocks at common times `time_s` (F,); `cluster` (F,) and pieces of `wander` cut further."""
    span = basis.span(time_s)
    u = (time_s - basis.mid_s[span]) / basis.half_s[span]
    begin = frames.first
    wanders = wander is not None and wander.count > 0
    if len(basis.grid_s) > 2 or drift.count or cluster is not None or wanders:
        keys = [frames.camera, span, drift.segment] + ([] if cluster is None else [cluster])
        keys += [wander.piece] if wander is not None else []
        change = np.zeros(frames.count, dtype=bool)
        for key in keys:
            change[1:] |= key[1:] != key[:-1]
        begin = np.concatenate([[0], np.flatnonzero(change), [frames.count]])
    begin = shortened(begin)
    at = begin[:-1]
    half = basis.half_s[span[at]]
    slope = half / clock_rates(frames, drift, at, camera, deviation)
    local = _local_from_camera(frames, drift, at, u, slope)
    if wander is not None and wanders:
        local = np.concatenate([local, _local_from_wander(wander, at, local.shape[1])], axis=2)
    place = None
    if camera.shape[1] > CAMERA_PARAMETERS:
        per_u = slope * share_per_second(frames)[frames.camera[at]]
        place = np.stack([frames.place_share[at] - u[at] * per_u, per_u], axis=1)
    return Blocks(
        begin=begin,
        camera=frames.camera[at],
        span=span[at],
        segment=drift.segment[at],
        cluster=np.zeros(len(at), dtype=np.int64) if cluster is None else cluster[at],
        u=u,
        half_s=half,
        local_from_camera=local,
        wander=None if wander is None or not wanders else wander.left[at],
        place=place,
    )


def shortened(begin: Ints) -> Ints:
    """The same cuts and further ones, so that no block is longer than LONGEST."""
    if begin[-1] - begin[0] <= LONGEST or np.diff(begin).max() <= LONGEST:
        return begin
    cuts = [np.arange(low, high, LONGEST) for low, high in pairwise(begin)]
    return np.concatenate([*cuts, begin[-1:]])


def clock_rates(frames: Frames, drift: Drift, at: Ints, camera: Floats, deviation: Floats) -> Floats:
    """(B,) video seconds per second of common time at the frames `at`."""
    rate = 1 + camera[frames.camera[at], SCALE]
    left = drift.segment[at]
    drifting = left >= 0
    if drifting.any():
        width = drift.knot_s[left[drifting] + 1] - drift.knot_s[left[drifting]]
        rate[drifting] += (deviation[left[drifting] + 1] - deviation[left[drifting]]) / width
    return np.asarray(rate)


def _local_from_camera(frames: Frames, drift: Drift, at: Ints, u: Floats, slope: Floats) -> Floats:
    """(B, 12, 13): the chain rule dt = d beta + tau ds + sum of hat_j d deviation_j, with tau linear in u."""
    left = drift.segment[at]
    drifting = left >= 0
    middle = frames.video_s[at] - u[at] * slope
    out = np.zeros((len(at), LOCAL_COLUMNS, BLOCK_PARAMETERS))
    out[:, range(FOCAL + 1), range(FOCAL + 1)] = 1.0
    out[:, 7, OFFSET] = 1.0
    out[:, 9, START] = 1.0
    out[:, 11, READOUT] = 1.0
    for zero, linear in ((7, 8), (9, 10)):
        out[:, zero, SCALE], out[:, linear, SCALE] = middle, slope
        if drifting.any():
            width = drift.knot_s[left[drifting] + 1] - drift.knot_s[left[drifting]]
            share = (middle[drifting] - drift.knot_s[left[drifting]]) / width
            out[drifting, zero, -2], out[drifting, zero, -1] = 1 - share, share
            per_u = slope[drifting] / width
            out[drifting, linear, -2], out[drifting, linear, -1] = -per_u, per_u
    return out


def with_places(blocks: Blocks, targets: int) -> Floats:
    """(B, 12 + 4 N, 13 + 4 N [+ 12]): `local_from_camera` with the place errors of so many targets."""
    base, places = blocks.local_from_camera, PLACE_PARAMETERS * targets
    if blocks.place is None or not places:
        return base
    n, rows, columns = base.shape
    out = np.zeros((n, rows + places, columns + places))
    out[:, :rows, :CAMERA_PARAMETERS] = base[..., :CAMERA_PARAMETERS]
    out[:, :rows, CAMERA_PARAMETERS + places :] = base[..., CAMERA_PARAMETERS:]
    for i in range(0, places, 2):
        row, column = LOCAL_COLUMNS + i, CAMERA_PARAMETERS + i
        out[:, row, column], out[:, row, column + 1] = 1.0, blocks.place[:, 0]
        out[:, row + 1, column + 1] = blocks.place[:, 1]
    return out


def _local_from_wander(wander: PoseWander, at: Ints, columns: int) -> Floats:
    """(B, columns, 12): a block's pose errors from those at the left and at the right knot."""
    out = np.zeros((len(at), columns, 12))
    inside, share = wander.left[at] >= 0, wander.share[at]
    for k in range(6):
        out[:, k, k], out[:, k, 6 + k] = np.where(inside, 1 - share, 0.0), np.where(inside, share, 0.0)
    return out


def share_per_second(frames: Frames) -> Floats:
    """(C,) by how much a camera's `place_share` grows per second of video time."""
    ends = [
        (frames.video_s[frames.of(c)].min(), frames.video_s[frames.of(c)].max()) for c in range(len(frames.cameras))
    ]
    return np.array([2 / max(high - low, 1e-9) for low, high in ends])
