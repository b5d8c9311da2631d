"""Does a camera's pose step where all targets bend at once? Free motions follow a pose that jumps, and hide it.

A step of a camera's attitude or position from a frame on is three more unknowns s beside all others x. At the optimum
the gradient by x is zero, so that with g the gradient of the cost by s, and N the normal matrix,

    g' V^-1 g,   V = N_ss - N_sx N_xx^-1 N_xs

is what chi-square would fall by to first order (Rao's score test, 1948), and -V^-1 g the step. Everything that motions
take up is projected out, unlike in `pose_sequences`. One target that bends alone moves no other, so it is not taken for
a camera's step; with a single target the two cannot be told apart, and nothing is looked for.
"""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.solver.adjustment.assembly import blocks_at
from pipeline.solver.adjustment.banded_system import Factor
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.adjustment.seen_targets import Seen, seen_targets
from pipeline.solver.judgement.pose_sequences import Part, Sequence
from pipeline.solver.judgement.prior_tests import log10_chance

PLACES = 40
"""Places at which a step is looked for, in each camera; twice as many find better what splines follow at once."""
CHUNK_BLOCKS = 1024
HALVES: dict[Part, slice] = {"attitude": slice(0, 3), "position": slice(3, 6)}


def common_steps(model: Model, state: State, factor: Factor) -> tuple[Sequence, ...]:
    """The likeliest step of every camera; none without splines, or with a single target."""
    if len(model.basis.targets) < 2 or not any(t.kind == "spline" for t in model.basis.targets):
        return ()
    seen = seen_targets(model, *blocks_at(model, state))
    found = (_of_camera(model, factor, seen, c) for c in range(len(model.frames.cameras)))
    return tuple(one for one in found if one is not None)


def _of_camera(model: Model, factor: Factor, seen: Seen, c: int) -> Sequence | None:
    frames, mine, blocks = model.frames, model.frames.of(c), seen.blocks
    rows = np.flatnonzero(blocks.camera == c)
    begin = blocks.begin[:-1][rows]
    margin = 0.04 * (mine.stop - mine.start)
    inside = np.flatnonzero((begin > mine.start + margin) & (begin < mine.stop - margin))
    places = inside[np.unique(np.linspace(0, len(inside) - 1, min(PLACES, len(inside))).round().astype(np.int64))]
    if not len(places):
        return None
    gradient, normal, coupling = _from_the_end(model, seen, rows, places)
    size = coupling.shape[2]
    taken = factor.solve(coupling.transpose(2, 0, 1).reshape(size, -1)).reshape(size, len(places), 6)
    rest = normal - np.einsum("pin,npj->pij", coupling, taken)
    best: tuple[float, Part, int] | None = None
    for part, half in HALVES.items():
        square = [
            _square(g[half], v[half, half], n[half, half]) for g, v, n in zip(gradient, rest, normal, strict=True)
        ]
        likeliest = int(np.argmax(square))
        if best is None or square[likeliest] > best[0]:
            best = square[likeliest], part, likeliest
    assert best is not None
    statistic, part, k = best
    half, frame = HALVES[part], int(begin[places[k]])
    step = -np.linalg.pinv(rest[k][half, half], rcond=1e-9, hermitian=True) @ gradient[k][half]
    many = float(np.log10(2 * len(places)))
    return Sequence(
        camera=frames.cameras[c], kind="step", part=part, frame=int(frames.frame[frame]),
        time_s=float(frames.video_s[frame]), size=step, statistic=statistic,
        log10_p=min(0.0, log10_chance(statistic, 3) + many),
    )  # fmt: skip


def _square(gradient: Floats, rest: Floats, whole: Floats) -> float:
    """g' V^-1 g over the directions of which the other unknowns leave something."""
    scale = 1 / np.sqrt(np.maximum(np.diagonal(whole), 1e-300))
    value, vector = np.linalg.eigh(rest * scale[:, None] * scale)
    seen = value > 1e-6
    return float(((vector[:, seen].T @ (gradient * scale)) ** 2 / value[seen]).sum())


def _from_the_end(model: Model, seen: Seen, rows: Ints, places: Ints) -> tuple[Floats, Floats, Floats]:
    """From each of `places` among a camera's blocks `rows` on to the camera's end: gradient (k, 6), normal matrix
    (k, 6, 6) and coupling with all unknowns (k, 6, n + q) of a change of pose; memory does not grow with the blocks."""
    first = 3 * (model.basis.degree + 1) * len(seen.degree)
    pose = slice(first, first + 6)
    size = model.order.n_band + model.order.n_border
    sums = np.zeros(6), np.zeros((6, 6)), np.zeros((6, size))
    out = tuple(np.zeros((len(places), *each.shape)) for each in sums)
    chunk = seen.at_once(CHUNK_BLOCKS)
    for low in reversed(range(0, len(rows), chunk)):
        high = min(low + chunk, len(rows))
        part = seen.part(int(rows[low]), int(rows[high - 1]) + 1)
        normals, where = part.normals(model), part.places
        chained = normals.normal[:, pose] @ part.chain()
        for k in reversed(range(high - low)):
            there = where[k] >= 0
            sums[0][:] += normals.gradient[k, pose]
            sums[1][:] += normals.normal[k, pose, pose]
            sums[2][:, where[k][there]] += chained[k][:, there]
            for kept, each in zip(out, sums, strict=True):
                kept[places == low + k] = each
    return out  # type: ignore[return-value]
