"""The normal equations of every block, with the frames' own pose errors eliminated in closed form.

All that a frame observes touches z = (target positions 3 N, bias 6, focal, time, pose time, readout) of that instant.
With A its derivative by the pose, J by z, W the robust weights, S the spread and H = S A'WA S + prior:

    information M = J'WJ - E'H^-1 E        E = S A'WJ
    gradient    m = J'Wr - E'H^-1 h        h = S A'Wr + prior u
    afterwards  du = -H^-1 (h + E dz)

(design of the elimination: a Schur complement whose blocks are 6 x 6). The motion makes dz out of power series in u, so
that a block's normal matrix is made of the moments sum_f M(f) u^k: one pass, cost linear in frames, no matrix larger
than one block. This file is the plain numpy form; `_kernels.py` computes the same compiled.
"""

from __future__ import annotations

import mmap
from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.solver.adjustment import _kernels
from pipeline.solver.adjustment._kernels import Loosely, Observed, Point, Runs
from pipeline.solver.observation.clocks import CAMERA_PARAMETERS, PLACE_PARAMETERS
from pipeline.solver.observation.frame_blocks import LOCAL_COLUMNS, Blocks
from pipeline.solver.observation.observations import Frames
from pipeline.solver.observation.residuals import Linearised, linearise, place_shift

CHUNK_FRAMES = 2048
CHUNK_BYTES = 4096 * 28_000
"""Of blocks' matrices that are held at once; of four targets with splines one takes 28 kB, of twenty half a megabyte.
Twice as many are not quicker."""
KEPT_NUMBERS, LARGE_PAGES = 25_000_000, 8_000_000
"""200 MB: beyond, the frames' steps are computed anew instead of kept. 64 MB: up to there in large pages."""
POPULATE_WRITE = 23
"""MADV_POPULATE_WRITE of Linux, which Python's mmap does not name."""
NONE, HUBER, CAUCHY = 0, 1, 2
ANY = 1 << 62
NO_RATE: Floats = np.zeros((0, 6))


@dataclass(frozen=True, kw_only=True, eq=False)
class PoseError:
    """What a frame's pose may be wrong by.

    spread, prior  (C, 6): e = bias + spread u, prior (0 or 1) u^2 / 2 added to the cost; spread 0 holds
    damping        relative, added to the data's part of H (methods without prior)
    """

    spread: Floats
    prior: Floats
    damping: float = 0.0

    @property
    def free(self) -> bool:
        """Whether any frame has an error of its own."""
        return bool(self.spread.any())


@dataclass(frozen=True, kw_only=True, eq=False)
class Loss:
    """rho of the squared length of a residual: `kind` NONE, HUBER or CAUCHY, and where it bends, in sigmas."""

    kind: int = NONE
    bend: float = 1.0

    def weight(self, square: Floats) -> Floats:
        """rho'(square): what a sighting counts, 0 to 1."""
        if self.kind == HUBER:
            return np.asarray(self.bend / np.sqrt(np.maximum(square, self.bend**2)))
        if self.kind == CAUCHY:
            return np.asarray(1 / (1 + square / self.bend**2))
        return np.ones_like(square)

    def cost(self, square: Floats) -> Floats:
        """rho(square)."""
        if self.kind == HUBER:
            linear = 2 * self.bend * np.sqrt(square) - self.bend**2
            return np.where(square > self.bend**2, linear, square)
        if self.kind == CAUCHY:
            return np.asarray(self.bend**2 * np.log1p(square / self.bend**2))
        return np.asarray(square)


@dataclass(frozen=True, kw_only=True, eq=False)
class At:
    """Where to linearise: `series` (B, N, 3, K + 1), `bias` (B, 6) of every block, `focal` (C,), `own` (F, 6).

    camera (C, W): the cameras' parameters, of which the place errors are taken
    shift  (F, N, 2) what these add to the residuals, where it is known already
    """

    series: Floats
    bias: Floats
    focal: Floats
    own: Floats
    camera: Floats
    shift: Floats | None = None

    @property
    def placed(self) -> bool:
        """Whether there are place errors."""
        return bool(self.camera.shape[1] > CAMERA_PARAMETERS)


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockNormals:
    """`normal` (B, L, L) and `gradient` (B, L) of the local unknowns: target, axis, power; then the 12 columns.

    kept        what the frames' steps need, (F, ...); None: they are computed anew
    cost        half of rho summed, and of the frames' own priors
    frame_gain  what moving the frames' own errors alone would take off the cost
    """

    normal: Floats
    gradient: Floats
    cost: float
    frame_gain: float
    kept: Floats | None = None


def _target_motion(series: Floats, u: Floats, half_s: Floats) -> tuple[Floats, Floats]:
    """Positions and velocities (n, N, 3) of power series (n, N, 3, K + 1) at u (n,)."""
    degree = series.shape[-1] - 1
    powers = u[:, None] ** np.arange(degree + 1)
    position = np.einsum("bnij,bj->bni", series, powers)
    speed = powers[:, :degree] * np.arange(1, degree + 1)
    return position, np.einsum("bnij,bj->bni", series[..., 1:], speed) / half_s[:, None, None]


def _frame_index(blocks: Blocks, low: int, high: int) -> Ints:
    """Block of every frame from block `low` up to `high`."""
    return np.repeat(np.arange(low, high), np.diff(blocks.begin[low : high + 1]))


def _columns(found: Linearised, velocity: Floats, by_readout: Floats, place_gain: Floats | None) -> Floats:
    """J (n, 2 N, 3 N + 10 [+ 2 N]): by targets' positions, bias, focal, time, pose time, readout [and places].

    by_readout (n, N, 2); without frames where no readout is refined
    """
    n, targets = found.residual.shape[:2]
    out = np.zeros((n, targets, 2, 3 * targets + 10 + (0 if place_gain is None else 2 * targets)))
    for t in range(targets):
        out[:, t, :, 3 * t : 3 * t + 3] = found.by_position[:, t]
    rest = 3 * targets
    out[..., rest : rest + 6] = found.by_pose
    out[..., rest + 6] = found.by_focal
    out[..., rest + 7] = (found.by_position @ velocity[..., None])[..., 0]
    out[..., rest + 8] = found.by_pose_time
    if len(by_readout):
        out[..., rest + 9] = by_readout
    if place_gain is not None:
        for t in range(targets):
            for axis in range(2):
                out[:, t, axis, rest + 10 + 2 * t + axis] = place_gain[:, t]
    return out.reshape(n, 2 * targets, -1)


def _weighted(frames: Frames, pose: PoseError, loss: Loss, at: At, blocks: Blocks, low: int, high: int):  # type: ignore[no-untyped-def]
    """Everything of the frames of blocks `low` to `high`, multiplied by the root of the robust weight."""
    part = slice(int(blocks.begin[low]), int(blocks.begin[high]))
    block, camera = _frame_index(blocks, low, high), frames.camera[part]
    position, velocity = _target_motion(at.series[block], blocks.u[part], blocks.half_s[block])
    error = at.bias[block] + pose.spread[camera] * at.own[part]
    found = linearise(frames, part, position, error, at.focal[camera])
    residual = found.residual
    if at.placed and frames.angular:
        residual = residual + (place_shift(frames, part, at.camera) if at.shift is None else at.shift[part])
    square = (residual**2).sum(-1)
    root = np.repeat(np.sqrt(loss.weight(square)), 2, axis=1)
    placed = frames.place_gain[part] if at.placed else None
    J = _columns(found, velocity, frames.by_readout[part], placed) * root[..., None]
    n_targets = len(frames.targets)
    A = J[..., 3 * n_targets : 3 * n_targets + 6] * pose.spread[camera][:, None]
    r = residual.reshape(len(camera), -1) * root
    At_ = np.swapaxes(A, 1, 2)
    H = At_ @ A
    diagonal = np.einsum("nii->ni", H)
    diagonal += pose.prior[camera] + pose.damping * diagonal
    diagonal += np.where(diagonal == 0, 1.0, 0.0)
    h = (At_ @ r[..., None])[..., 0] + pose.prior[camera] * at.own[part]
    cost = 0.5 * loss.cost(square).sum() + 0.5 * (pose.prior[camera] * at.own[part] ** 2).sum()
    return part, J, r, H, At_ @ J, h, float(cost)


def block_normals_plain(frames: Frames, pose: PoseError, loss: Loss, at: At, blocks: Blocks) -> BlockNormals:
    """See the head of this file; numpy only."""
    n_blocks, n_targets, degree = len(blocks.camera), len(frames.targets), at.series.shape[-1] - 1
    size = local_size(n_targets, degree, at.placed)
    normal, gradient = np.zeros((n_blocks, size, size)), np.zeros((n_blocks, size))
    powers, place = _local_powers(n_targets, degree, at.placed)
    cost = gain = 0.0
    for low, high in _chunks(blocks, size):
        part, J, r, H, E, h, own_cost = _weighted(frames, pose, loss, at, blocks, low, high)
        solved = np.linalg.solve(H, np.concatenate([E, h[..., None]], axis=-1))
        Jt = np.swapaxes(J, 1, 2)
        M = Jt @ J - np.swapaxes(E, 1, 2) @ solved[..., :-1]
        m = (Jt @ r[..., None])[..., 0] - (h[:, None] @ solved[..., :-1])[:, 0]
        cost += own_cost
        gain += 0.5 * float((h * solved[..., -1]).sum())
        begin = blocks.begin[low:high] - blocks.begin[low]
        u = blocks.u[part]
        for k in range(max(2 * degree, degree + 1, 2) + 1):
            moment = np.add.reduceat(M * (u**k)[:, None, None], begin, axis=0)
            a, b = np.nonzero(powers[:, None] + powers[None, :] == k)
            normal[low:high, a, b] = moment[:, place[a], place[b]]
            if k <= max(degree, 1):
                own = np.flatnonzero(powers == k)
                gradient[low:high, own] = np.add.reduceat(m * (u**k)[:, None], begin, axis=0)[:, place[own]]
    return BlockNormals(normal=normal, gradient=gradient, cost=cost, frame_gain=gain)


def _local_powers(n_targets: int, degree: int, placed: bool = False) -> tuple[Ints, Ints]:
    """Of every local unknown: its power of u, and its place in z."""
    columns = 3 * n_targets
    powers = np.concatenate([np.tile(np.arange(degree + 1), columns), [0] * 7, [0, 1, 0, 1, 0]])
    place = np.concatenate([np.repeat(np.arange(columns), degree + 1), columns + np.array([*range(7), 7, 7, 8, 8, 9])])
    if placed:
        powers = np.concatenate([powers, np.tile([0, 1], 2 * n_targets)])
        place = np.concatenate([place, columns + 10 + np.repeat(np.arange(2 * n_targets), 2)])
    return powers, place


def _chunks(blocks: Blocks, size: int) -> list[tuple[int, int]]:
    """Block ranges of about CHUNK_FRAMES frames, and of CHUNK_BYTES of matrices of `size`: both bound the memory."""
    out, low, most = [], 0, blocks_within(size)
    while low < len(blocks.camera):
        high = int(np.searchsorted(blocks.begin, blocks.begin[low] + CHUNK_FRAMES, side="right")) - 1
        high = max(min(high, low + most), low + 1)
        out.append((low, high))
        low = high
    return out


def blocks_within(size: int) -> int:
    """How many matrices of `size` may be held at once."""
    return max(1, CHUNK_BYTES // (8 * size * size))


def local_size(targets: int, degree: int, placed: bool) -> int:
    """Local unknowns of a block: every target's power series by axis, and the columns that cameras' parameters move."""
    return 3 * targets * (degree + 1) + LOCAL_COLUMNS + (PLACE_PARAMETERS * targets if placed else 0)


def frame_steps_plain(frames: Frames, pose: PoseError, loss: Loss, at: At, blocks: Blocks, step: Floats) -> Floats:
    """du (F, 6) that belongs to the local step (B, L); numpy only."""
    out = np.zeros((frames.count, 6))
    n_targets, degree = len(frames.targets), at.series.shape[-1] - 1
    powers, place = _local_powers(n_targets, degree, at.placed)
    for low, high in _chunks(blocks, local_size(n_targets, degree, at.placed)):
        part, _, _, H, E, h, _ = _weighted(frames, pose, loss, at, blocks, low, high)
        scaled = step[_frame_index(blocks, low, high)] * blocks.u[part][:, None] ** powers
        dz = np.zeros((len(scaled), int(place.max()) + 1))
        for i, z in enumerate(place):
            dz[:, z] += scaled[:, i]
        right = h + (E @ dz[..., None])[..., 0]
        out[part] = -np.linalg.solve(H, right[..., None])[..., 0]
    return out


def block_normals(
    frames: Frames, pose: PoseError, loss: Loss, at: At, blocks: Blocks, keep: bool = True
) -> BlockNormals:
    """See the head of this file; compiled where numba is installed. `keep` what the frames' steps need, if it fits."""
    if not _kernels.AVAILABLE:
        return block_normals_plain(frames, pose, loss, at, blocks)
    kept = kept_room(frames, blocks.begin, at.placed, KEPT_NUMBERS if pose.free and keep else 0)
    normal, gradient, cost, gain = _kernels.block_normals(
        observed_of(frames, at.placed),
        loosely_of(_by_block(pose, blocks), loss),
        _runs(blocks),
        _point(frames, at, blocks),
        kept,
    )
    return BlockNormals(normal=normal, gradient=gradient, cost=cost, frame_gain=gain, kept=kept if len(kept) else None)


def kept_room(frames: Frames, begin: Ints, placed: bool, most: int) -> Floats:
    """Room for what the compiled elimination keeps of every frame; none where it takes more than `most` numbers.

    NumPy asks for large pages, which are quick to touch unless a virtual machine has to fetch each from outside.
    """
    rated, rolled = frames.pose_rate is not None, len(frames.by_readout) > 0
    chunks, rows, lanes = _kernels.kept_shape(begin, len(frames.targets), rated, rolled, placed)
    if chunks * rows * lanes > most:
        chunks = 0
    shape = (chunks, rows, lanes)
    return np.empty(shape) if chunks * rows * lanes <= LARGE_PAGES else _in_small_pages(shape)


def _in_small_pages(shape: tuple[int, int, int]) -> Floats:
    """Uninitialised memory in small pages, fetched all at once where the system can (Linux 5.14)."""
    try:
        memory = mmap.mmap(-1, 8 * shape[0] * shape[1] * shape[2], flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
        memory.madvise(mmap.MADV_NOHUGEPAGE)
        memory.madvise(POPULATE_WRITE)
    except (AttributeError, OSError):
        return np.asarray(_kernels.room(*shape))
    return np.frombuffer(memory).reshape(shape)


def frame_steps(
    frames: Frames, pose: PoseError, loss: Loss, at: At, blocks: Blocks, step: Floats, kept: Floats | None = None
) -> Floats:
    """du (F, 6) that belongs to the local step (B, L); quicker from what `block_normals` `kept` at the same point."""
    if not pose.free:
        return np.zeros((frames.count, 6))
    if not _kernels.AVAILABLE:
        return frame_steps_plain(frames, pose, loss, at, blocks, step)
    pose = _by_block(pose, blocks)
    observed, weights = observed_of(frames, at.placed), loosely_of(pose, loss)
    point, runs = _point(frames, at, blocks), _runs(blocks)
    rated, rolled, out = frames.pose_rate is not None, len(frames.by_readout) > 0, np.zeros((frames.count, 6))
    if kept is not None:
        _kernels.kept_steps(kept, rated, rolled, at.placed, pose.spread, runs, at.series, step, out, out)
        return out
    size = local_size(len(frames.targets), at.series.shape[-1] - 1, at.placed)
    for low, high in _chunks(blocks, size):
        part = Runs(runs.begin[low : high + 1], runs.camera[low:high], runs.u, runs.half_s[low:high])
        own = kept_room(frames, part.begin, at.placed, ANY)
        series = at.series[low:high]
        _kernels.block_normals(observed, weights, part, point._replace(series=series), own)
        _kernels.kept_steps(own, rated, rolled, at.placed, pose.spread, part, series, step[low:high], out, out)
    return out


def squared_lengths(frames: Frames, pose: PoseError, at: At, blocks: Blocks) -> Floats:
    """(F, N) squared residuals in sigmas, whatever the loss; zero where unseen. Compiled only."""
    out = np.empty(frames.seen.shape)
    point, spread = _point(frames, at, blocks), pose.spread[blocks.camera]
    _kernels.squared_lengths(observed_of(frames, at.placed), spread, _runs(blocks), point, out)
    return out


def observed_of(frames: Frames, placed: bool) -> Observed:
    """What is seen, as the compiled code wants it."""
    return Observed(
        frames.cam_from_enu, frames.position_m, NO_RATE if frames.pose_rate is None else frames.pose_rate, frames.ray,
        frames.gain, frames.focal_effect, frames.by_readout, frames.seen,
        frames.place_gain if placed else frames.place_gain[:0], frames.angular,
    )  # fmt: skip


def loosely_of(pose: PoseError, loss: Loss) -> Loosely:
    """Pose errors and loss, as the compiled code wants them."""
    return Loosely(pose.spread, pose.prior, float(pose.damping), loss.kind, float(loss.bend))


def _by_block(pose: PoseError, blocks: Blocks) -> PoseError:
    """To the compiled code every block is a camera of its own, since pose errors may differ from block to block."""
    return PoseError(spread=pose.spread[blocks.camera], prior=pose.prior[blocks.camera], damping=pose.damping)


def _runs(blocks: Blocks) -> Runs:
    return Runs(blocks.begin, np.arange(len(blocks.camera)), blocks.u, blocks.half_s)


def _point(frames: Frames, at: At, blocks: Blocks) -> Point:
    """Metric residuals are not shifted by place errors."""
    if not at.placed:
        shift = np.zeros((0, len(frames.targets), 2))
    elif frames.angular:
        shift = place_shift(frames, slice(None), at.camera) if at.shift is None else at.shift
    else:
        shift = np.zeros((frames.count, len(frames.targets), 2))
    return Point(at.series, at.bias, at.focal[blocks.camera], at.own, shift)
