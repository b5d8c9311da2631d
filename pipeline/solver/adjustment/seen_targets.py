"""Blocks with the targets that they see, and no others: what a flight of many targets costs is what is seen at once.

A target that no frame of a block sees adds nothing to it, but takes its place in every matrix: the elimination costs
the square of the targets. Where most are out of sight most of the time, each block's targets are moved together.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints
from pipeline.solver.adjustment.elimination import At, BlockNormals, block_normals, blocks_within, local_size
from pipeline.solver.adjustment.model import Model, Order
from pipeline.solver.observation.clocks import CAMERA_PARAMETERS, PLACE_PARAMETERS
from pipeline.solver.observation.frame_blocks import Blocks, with_places
from pipeline.solver.observation.motion_basis import MotionBasis
from pipeline.solver.observation.observations import Frames
from pipeline.solver.observation.residuals import place_shift

MANY, SHARE = 8, 0.5
"""Targets from which on those that are seen are moved together, where no block sees more than this share of them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """B blocks with W targets each, perhaps others in each.

    target     (B, W) which of the model's; None: all of them in every block
    transform  (R, W, K + 1, A) from the targets' acting coefficients to power series; `row` (B,) a block's
    degree     (W,) how many of a target's columns there are its own, less one
    local_from_camera  (B, ., .) of the blocks, with the place errors of the targets
    places     (B, G) where its targets' acting coefficients (target, axis, coefficient) and its parameters sit
    """

    frames: Frames
    blocks: Blocks
    at: At
    target: Ints | None
    transform: Floats
    row: Ints
    degree: Ints
    local_from_camera: Floats
    places: Ints

    def part(self, low: int, high: int) -> Seen:
        """Blocks `low` to `high` alone; frames keep their numbers."""
        own = slice(low, high)
        blocks, at = part_of(self.blocks, self.at, low, high)
        target = None if self.target is None else self.target[own]
        return replace(
            self, blocks=blocks, at=at, target=target, row=self.row[own], places=self.places[own],
            local_from_camera=self.local_from_camera[own],
        )  # fmt: skip

    def parts(self, most: int) -> Iterator[Seen]:
        """All blocks, as many at a time as their matrices may be held at once, `most` at most."""
        chunk, count = self.at_once(most), len(self.blocks.camera)
        if chunk >= count:
            yield self
            return
        for low in range(0, count, chunk):
            yield self.part(low, min(low + chunk, count))

    def at_once(self, most: int) -> int:
        """How many blocks' matrices may be held at once, `most` at most."""
        return min(most, blocks_within(local_size(len(self.degree), self.transform.shape[2] - 1, self.at.placed)))

    def normals(self, model: Model, *, keep: bool = False) -> BlockNormals:
        """Normal equations of every block."""
        return block_normals(self.frames, model.pose, model.loss, self.at, self.blocks, keep=keep)

    def chain(self) -> Floats:
        """(B, L, G): the chain rule from the unknowns of `places` to the local ones."""
        targets, powers = self.transform.shape[1:3]
        _, columns, parameters = self.local_from_camera.shape
        width = 3 * int((self.degree + 1).sum())
        out = np.zeros((len(self.row), 3 * powers * targets + columns, width + parameters))
        row = column = 0
        for n, degree in enumerate(self.degree.tolist()):
            own = self.transform[self.row, n, :, : degree + 1]
            for _ in range(3):
                out[:, row : row + powers, column : column + degree + 1] = own
                row, column = row + powers, column + degree + 1
        out[:, row:, column:] = self.local_from_camera
        return out


def part_of(blocks: Blocks, at: At, low: int, high: int) -> tuple[Blocks, At]:
    """Blocks `low` to `high` alone; frames keep their numbers."""
    own = slice(low, high)
    part = replace(
        blocks, begin=blocks.begin[low : high + 1], camera=blocks.camera[own], span=blocks.span[own],
        segment=blocks.segment[own], cluster=blocks.cluster[own], half_s=blocks.half_s[own],
        local_from_camera=blocks.local_from_camera[own],
        wander=None if blocks.wander is None else blocks.wander[own],
        place=None if blocks.place is None else blocks.place[own],
    )  # fmt: skip
    return part, replace(at, series=at.series[own], bias=at.bias[own])


def sights(frames: Frames, blocks: Blocks) -> Bools:
    """(B, N) whether a frame of a block sees a target."""
    begin = blocks.begin - blocks.begin[0]
    counted = np.cumsum(frames.seen[blocks.begin[0] : blocks.begin[-1]], axis=0)
    counted = np.concatenate([np.zeros_like(counted[:1]), counted])
    return np.asarray(counted[begin[1:]] > counted[begin[:-1]])


def global_places(model: Model, blocks: Blocks) -> Ints:
    """(B, G) where the block's targets' acting coefficients (target, axis, coefficient) and 13 parameters sit.

    -1 where they are held, and for targets that no frame of the block sees.
    """
    parts, seen = [], sights(model.frames, blocks)
    for n, t in enumerate(model.basis.targets):
        acting = model.order.coefficient[t.active[blocks.span][:, None] + np.arange(t.degree + 1)]
        acting = np.where(seen[:, n, None, None], acting, -1)
        parts.append(np.swapaxes(acting, 1, 2).reshape(len(blocks.camera), -1))
    parts.append(model.order.camera[blocks.camera])
    return np.concatenate([*parts, *_knots(model.order, blocks)], axis=1)


def _knots(order: Order, blocks: Blocks) -> list[Ints]:
    """Where the knots left and right of every block sit: of its clock (B, 2), of its wandering poses (B, 12)."""
    knots = np.full((len(blocks.camera), 2), -1, dtype=np.int64)
    drifting = blocks.segment >= 0
    if drifting.any():
        knots[drifting] = order.drift[blocks.segment[drifting][:, None] + np.arange(2)]
    if blocks.wander is None:
        return [knots]
    wander = np.full((len(blocks.camera), 12), -1, dtype=np.int64)
    inside = blocks.wander >= 0
    wander[inside] = order.wander[blocks.wander[inside][:, None] + np.arange(2)].reshape(-1, 12)
    return [knots, wander]


def seen_targets(model: Model, blocks: Blocks, at: At) -> Seen:
    """All `blocks` of the model, with all targets in each, or with those that it sees where that is much less."""
    count = len(model.basis.targets)
    if count >= MANY and blocks.begin[0] == 0 and blocks.begin[-1] == model.frames.count:
        seen = sights(model.frames, blocks)
        width = max(1, int(seen.sum(axis=1).max()))
        if width <= SHARE * count:
            return _together(model, blocks, at, seen, np.argsort(~seen, axis=1, kind="stable")[:, :width])
    return every_target(model, blocks, at)


def every_target(model: Model, blocks: Blocks, at: At) -> Seen:
    """`blocks` with all targets of the model in each."""
    return Seen(
        frames=model.frames, blocks=blocks, at=at, target=None, transform=model.basis.transforms, row=blocks.span,
        degree=model.basis.degrees, local_from_camera=with_places(blocks, len(model.basis.targets)),
        places=global_places(model, blocks),
    )  # fmt: skip


def _together(model: Model, blocks: Blocks, at: At, seen: Bools, target: Ints) -> Seen:
    """The blocks with the targets (B, W) alone; what else fills the width is seen by none of the block's frames."""
    width, order = target.shape[1], model.order
    by_frame = np.repeat(target, np.diff(blocks.begin), axis=0)
    shift = None
    if at.placed and model.frames.angular:
        shift = _of(place_shift(model.frames, slice(None), at.camera), by_frame)
    acting, knots = _acting(model.basis, order, blocks, seen, target), _knots(order, blocks)
    return Seen(
        frames=_frames(model.frames, by_frame),
        blocks=blocks,
        at=replace(at, series=_of(at.series, target), shift=shift),
        target=target,
        transform=model.basis.transforms[blocks.span[:, None], target],
        row=np.arange(len(target)),
        degree=np.full(width, model.basis.most_acting - 1),
        local_from_camera=with_places(blocks, width),
        places=np.concatenate([acting, order.camera[blocks.camera[:, None], _mine(at, target)], *knots], axis=1),
    )


def _of(values: Floats, target: Ints) -> Floats:
    """(n, W, ...) of the targets (n, W), from all targets' values (n, N, ...)."""
    return np.asarray(values[np.arange(len(target))[:, None], target])


def _frames(frames: Frames, target: Ints) -> Frames:
    """The frames with the targets (F, W) alone."""

    def own(values: Floats) -> Floats:
        return _of(values, target) if len(values) else values[:, : target.shape[1]]

    return replace(
        frames, targets=frames.targets[: target.shape[1]], ray=own(frames.ray), gain=own(frames.gain),
        seen=np.asarray(frames.seen[np.arange(len(target))[:, None], target]), sigma_px=own(frames.sigma_px),
        focal_effect=own(frames.focal_effect), place_gain=own(frames.place_gain), by_readout=own(frames.by_readout),
        rows=None,
    )  # fmt: skip


def _mine(at: At, target: Ints) -> Ints:
    """(B, .) the cameras' parameters that the targets (B, W) need: place errors are by target."""
    first = np.broadcast_to(np.arange(CAMERA_PARAMETERS), (len(target), CAMERA_PARAMETERS))
    if not at.placed:
        return first
    places = CAMERA_PARAMETERS + PLACE_PARAMETERS * target[..., None] + np.arange(PLACE_PARAMETERS)
    return np.concatenate([first, places.reshape(len(target), -1)], axis=1)


def _acting(basis: MotionBasis, order: Order, blocks: Blocks, seen: Bools, target: Ints) -> Ints:
    """(B, 3 W A) where the acting coefficients of the targets (B, W) sit; -1 where unseen, held or too many."""
    every = np.arange(len(target))[:, None]
    active = np.stack([t.active for t in basis.targets], axis=1)[blocks.span[:, None], target]
    power = np.arange(basis.most_acting)
    own = (power <= basis.degrees[target][..., None]) & seen[every, target][..., None]
    acting = order.coefficient[np.where(own, active[..., None] + power, 0)]
    return np.swapaxes(np.where(own[..., None], acting, -1), 2, 3).reshape(len(target), -1)
