"""The changes to a flight that could explain a misfit, one by one: what is left out, exchanged, or set free.

A change is applied to the records, never to the answer: what it would restore is reported, and the user decides.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeVar

import numpy as np
import numpy.typing as npt

from calibration.foundation.arrays import Bools, Floats
from pipeline.solver.adjustment.elimination import PoseError
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.methods.parameters import model_with_basis, with_basis
from pipeline.solver.observation.clocks import FOCAL, OFFSET, POS, READOUT, ROT, SCALE, START
from pipeline.solver.observation.motion_basis import build_basis
from pipeline.solver.observation.observations import Frames

Scalar = TypeVar("Scalar", bound=np.generic)
FREED: dict[str, tuple[list[int], float]] = {
    "attitude": ([*range(ROT.start, ROT.stop)], 1.0),
    "position": ([*range(POS.start, POS.stop)], 300.0),
    "focal": ([FOCAL], 0.7),
    "start": ([START], 5.0),
    "frame-rate": ([SCALE], 0.3),
    "offset": ([OFFSET], 60.0),
}
"""Columns of a camera's parameters, and the sigma (rad, m, log, s, relative, s) that stands for knowing nothing."""
Kind = Literal[
    "free",
    "motion",
    "without-target",
    "without-track",
    "without-part",
    "without-camera",
    "exchange",
    "step",
    "converted",
    "readout",
]


@dataclass(frozen=True, kw_only=True, eq=False)
class Change:
    """One hypothesis.

    kind, camera, targets, what   what is changed ("what": the block that is set free)
    since_frame, until_frame      the part of a track that is meant, or from where on targets are exchanged
    price      what it must take off chi-square beyond the sightings it leaves out
    apply      model -> model; moved  state -> the same point of the changed model
    renewable  whether poses from a log can be taken anew with it
    """

    kind: Kind
    camera: str = ""
    targets: tuple[str, ...] = ()
    what: str = ""
    since_frame: int | None = None
    until_frame: int | None = None
    price: float
    apply: Callable[[Model], Model] = field(repr=False)
    moved: Callable[[State], State] = field(default=lambda state: state, repr=False)
    renewable: bool = True

    @property
    def names(self) -> frozenset[str]:
        """Cameras and targets that it accuses."""
        return frozenset({self.camera, *self.targets} - {""})


def freed(model: Model, c: int, what: str) -> Change | None:
    """One block of a camera's parameters without its prior; None where it means nothing there."""
    columns, sigma = FREED[what]
    held = not model.priors.camera_free[c, columns].any()
    if what == "start" and model.frames.pose_rate is None:
        return None
    if what in ("offset", "frame-rate") and (held or not model.priors.camera_precision[c, columns].any()):
        return None

    def apply(model: Model) -> Model:
        precision, free = model.priors.camera_precision.copy(), model.priors.camera_free.copy()
        precision[c, columns], free[c, columns] = sigma**-2, True
        return model.changed(priors=replace(model.priors, camera_precision=precision, camera_free=free))

    return Change(kind="free", camera=model.frames.cameras[c], what=what, price=8.0 + 4.0 * len(columns), apply=apply)


READOUT_PRIOR_S = 0.1
"""What stands for knowing nothing of a readout."""


def read_out(model: Model) -> Change | None:
    """The readouts of all cameras whose rows are known, without their priors; None where all are refined already."""
    frames, rows = model.frames, model.frames.rows
    if rows is None:
        return None
    held = ~model.priors.camera_free[:, READOUT]
    cameras = [c for c in range(len(frames.cameras)) if held[c] and rows.fraction[frames.of(c)].any()]
    if not cameras:
        return None

    def apply(model: Model) -> Model:
        precision, free = model.priors.camera_precision.copy(), model.priors.camera_free.copy()
        precision[cameras, READOUT], free[cameras, READOUT] = READOUT_PRIOR_S**-2, True
        return model.changed(
            frames=replace(model.frames, by_readout=np.zeros((*model.frames.seen.shape, 2))),
            priors=replace(model.priors, camera_precision=precision, camera_free=free),
        )

    return Change(kind="readout", price=8.0 + 4.0 * len(cameras), apply=apply)


RICHER, RICHEST = 2, 7
"""Orders that a motion is given more, and the most it then has."""


def richer(model: Model, targets: Sequence[int]) -> Change:
    """Polynomials of `RICHER` more orders for `targets`."""
    basis = model.basis
    orders = [
        min(t.degree + RICHER, RICHEST) if n in targets and t.kind == "polynomial" else t.degree
        for n, t in enumerate(basis.targets)
    ]
    spacing_s = float(basis.grid_s[1] - basis.grid_s[0])
    ends_s = np.array([[t.knots_s[0], t.knots_s[-1]] for t in basis.targets])
    kinds = tuple(t.kind for t in basis.targets)
    other = build_basis(model.frames.targets, kinds, tuple(orders), ends_s, spacing_s)
    return Change(
        kind="motion", targets=tuple(model.frames.targets[n] for n in targets), price=16.0,
        apply=lambda model: model_with_basis(model, other), moved=lambda state: with_basis(model, state, other)[1],
    )  # fmt: skip


def _inverse(turn: Floats, place_m: Floats) -> tuple[Floats, Floats]:
    return np.swapaxes(turn, 1, 2), place_m


def _rolled(quarters: int) -> Callable[[Floats, Floats], tuple[Floats, Floats]]:
    cos, sin = ((1, 0), (0, 1), (-1, 0), (0, -1))[quarters]
    about_axis = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return lambda turn, place_m: (about_axis @ turn, place_m)


CONVENTIONS: dict[str, Callable[[Floats, Floats], tuple[Floats, Floats]]] = {
    "its attitudes were the inverse rotations": _inverse,
    "its picture were upside down": _rolled(2),
    "its picture were turned by a quarter to the left": _rolled(1),
    "its picture were turned by a quarter to the right": _rolled(3),
    "its east and north were exchanged": lambda turn, place_m: (turn, place_m[:, [1, 0, 2]]),
    "its positions were in feet": lambda turn, place_m: (turn, place_m * 0.3048),
    "its heights counted downwards": lambda turn, place_m: (turn, place_m * [1.0, 1.0, -1.0]),
}
"""What poses may have been meant as: cam_from_enu (n, 3, 3) and position (n, 3) -> the same, as meant."""


def converted(model: Model, c: int, convention: str) -> Change:
    """The poses of a camera in another convention."""

    def apply(model: Model) -> Model:
        part = model.frames.of(c)
        turn, place_m = model.frames.cam_from_enu.copy(), model.frames.position_m.copy()
        turn[part], place_m[part] = CONVENTIONS[convention](turn[part], place_m[part])
        return model.changed(frames=replace(model.frames, cam_from_enu=turn, position_m=place_m))

    return Change(
        kind="converted", camera=model.frames.cameras[c], what=convention, price=20.0, apply=apply, renewable=False
    )


def without(model: Model, hidden: Bools, kind: Kind, **named: object) -> Change:
    """Sightings `hidden` (F, N) left out."""

    def apply(model: Model) -> Model:
        return model.changed(frames=_hiding(model.frames, hidden))

    count = 2 * int((hidden & model.frames.seen).sum())
    price = 12.0 + 3.0 * float(np.sqrt(2 * count))
    return Change(kind=kind, price=price, apply=apply, **named)  # type: ignore[arg-type]


def _hiding(frames: Frames, hidden: Bools) -> Frames:
    shown = frames.seen & ~hidden
    return replace(
        frames, seen=shown, gain=frames.gain * shown[..., None, None],
        sigma_px=np.where(shown, frames.sigma_px, np.nan), place_gain=np.where(shown, frames.place_gain, 0.0),
        by_readout=frames.by_readout * shown[..., None] if len(frames.by_readout) else frames.by_readout,
    )  # fmt: skip


def exchanged(model: Model, c: int, a: int, b: int, since: int | None) -> Change:
    """Targets `a` and `b` exchanged in a camera, from frame number `since` on."""
    frames, (a, b) = model.frames, sorted((a, b))
    rows = np.zeros(frames.count, dtype=bool)
    rows[frames.of(c)] = True if since is None else frames.frame[frames.of(c)] >= since

    def apply(model: Model) -> Model:
        return model.changed(frames=_exchanging(model.frames, rows, a, b))

    return Change(
        kind="exchange", camera=frames.cameras[c], targets=(frames.targets[a], frames.targets[b]), since_frame=since,
        price=16.0 if since is None else 22.0, apply=apply,
    )  # fmt: skip


def _exchanging(frames: Frames, which: Bools, a: int, b: int) -> Frames:
    def turned(values: npt.NDArray[Scalar]) -> npt.NDArray[Scalar]:
        if len(values) == 0:
            return values
        out = values.copy()
        out[which, a], out[which, b] = values[which, b], values[which, a]
        return out

    rows = frames.rows

    return replace(
        frames, ray=turned(frames.ray), gain=turned(frames.gain), seen=turned(frames.seen),
        sigma_px=turned(frames.sigma_px), focal_effect=turned(frames.focal_effect),
        place_gain=turned(frames.place_gain), by_readout=turned(frames.by_readout),
        rows=None if rows is None else replace(rows, fraction=turned(rows.fraction), turn=turned(rows.turn)),
    )  # fmt: skip


def stepped(model: Model, c: int, since: int, what: str) -> Change:
    """A camera that is another one from frame number `since` on: `what` of it is free, its clock goes on.

    The part before and the part after each have the camera's priors; `what` "offset" is time that was lost.
    """
    frames = model.frames
    cut = int(np.searchsorted(frames.frame[frames.of(c)], since)) + int(frames.first[c])

    def twice(values: npt.NDArray[Scalar]) -> npt.NDArray[Scalar]:
        return np.concatenate([values[: c + 1], values[c:]])

    def apply(model: Model) -> Model:
        priors, drift = model.priors, model.drift
        free, precision = twice(priors.camera_free), twice(priors.camera_precision)
        free[c : c + 2, FOCAL:] = False
        columns, sigma = FREED[what]
        free[c + 1, columns], precision[c + 1, columns] = True, sigma**-2
        camera = frames.camera + (frames.camera > c)
        camera[cut : frames.first[c + 1]] = c + 1
        return model.changed(
            frames=replace(
                model.frames, cameras=(*frames.cameras[: c + 1], *frames.cameras[c:]), camera=camera,
                nominal_rate=twice(frames.nominal_rate), first=np.insert(frames.first, c + 1, cut),
            ),
            pose=PoseError(spread=twice(model.pose.spread), prior=twice(model.pose.prior), damping=model.pose.damping),
            drift=replace(drift, first=np.insert(drift.first, c + 1, drift.first[c + 1])),
            priors=replace(
                priors, camera_free=free, camera_precision=precision, camera_mean=twice(priors.camera_mean),
                drift_rate=twice(priors.drift_rate),
            ),
        )  # fmt: skip

    return Change(
        kind="step", camera=frames.cameras[c], what=what, since_frame=since, price=20.0 + 4.0 * len(FREED[what][0]),
        apply=apply, moved=lambda state: replace(state, camera=twice(state.camera)), renewable=False,
    )  # fmt: skip
