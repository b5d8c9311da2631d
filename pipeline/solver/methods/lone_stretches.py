"""Stretches in which one camera alone sees a target whose motion is free: how far away it is then nobody can know.

There a spline's distance is held by its prior alone. The adjustment then draws it towards the camera, where the prior
costs least, by a hundred metres and more, and the sigma of what is linearised there is small. So a spline is adjusted
to the sightings that another camera's are near to, its trajectory ends where these end, and that is said. The same goes
for a polynomial whose order was found, above the first. What stands still or goes straight is known there by what it
does elsewhere and takes all sightings, and so does what was given an order.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Bools, Floats
from pipeline.records import Finding
from pipeline.solver.adjustment.levenberg_marquardt import Fit
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.methods.initialisation import without
from pipeline.solver.methods.parameters import MotionChoice, basis_at, with_basis
from pipeline.solver.observation.clocks import common_time_s
from pipeline.solver.observation.observations import Frames

REACH_S = 1.0
"""How far from another camera's sighting a spline is still known. Twice as far, and the ends of tracks of turning cars
were two and more of their claims off; half as far costs half a second of every such track."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Lone:
    """The frames before anything was hidden, and their sightings (F, N) that no other camera's is near to."""

    frames: Frames
    sighting: Bools

    def without(self, frames: Frames, unsure: Collection[int]) -> Frames:
        """`frames` with the lone sightings of targets `unsure` hidden, and those of the others back."""
        own = np.isin(np.arange(self.sighting.shape[1]), list(unsure))
        return without(frames, self.frames, self.sighting & own)

    @property
    def any(self) -> bool:
        """Whether there are any."""
        return bool(self.sighting.any())


def _on_ground(model: Model) -> frozenset[int]:
    """Targets whose distance the ground tells, by however many cameras they are seen."""
    return frozenset() if model.known is None else frozenset(model.known.target[model.known.axis < 0].tolist())


def lone(frames: Frames, time_s: Floats, held: Collection[int] = ()) -> Lone:
    """Of every target that two cameras see and that is not `held`, the sightings far from any other camera's.

    Far: `REACH_S` and more.
    """
    out = np.zeros(frames.seen.shape, dtype=bool)
    for n in set(range(len(frames.targets))) - set(held):
        rows = np.flatnonzero(frames.seen[:, n])
        cameras = frames.camera[rows]
        for c in np.unique(cameras):
            other = np.sort(time_s[rows[cameras != c]])
            if len(other):
                own = rows[cameras == c]
                place = np.searchsorted(other, time_s[own])
                gap_s = np.minimum(
                    np.abs(other[np.minimum(place, len(other) - 1)] - time_s[own]),
                    np.abs(time_s[own] - other[np.maximum(place - 1, 0)]),
                )
                out[own, n] = gap_s > REACH_S
    out[:, (frames.seen & ~out).sum(axis=0) == 0] = False
    return Lone(frames=frames, sighting=out)


def none_alone(frames: Frames) -> Lone:
    """Nothing is left out, which is so where every motion is a polynomial of a given order."""
    return Lone(frames=frames, sighting=np.zeros(frames.seen.shape, dtype=bool))


def confined(model: Model, state: State, choice: MotionChoice) -> tuple[Model, State, Lone]:
    """The same without lone sightings of splines, each over the time that is left to it."""
    time = common_time_s(model.frames, model.drift, state.camera, state.deviation)
    found = lone(model.frames, time, _on_ground(model))
    splines = [n for n, kind in enumerate(choice.kinds) if kind == "spline"]
    shown = found.without(model.frames, splines)
    if (shown.seen == model.frames.seen).all():
        return model, state, found
    return *with_basis(model.changed(frames=shown), state, basis_at(shown, choice, time)), found


def told(found: Lone, fit: Fit) -> tuple[Finding, ...]:
    """What is not used of which targets, in one finding; none where all is used."""
    frames = fit.model.frames
    hidden = found.sighting & ~frames.seen
    targets = np.flatnonzero(hidden.any(axis=0))
    if not len(targets):
        return ()
    time = common_time_s(frames, fit.model.drift, fit.state.camera, fit.state.deviation)
    shorter = 0.0
    for n in targets:
        shown, lost = time[frames.seen[:, n]], time[hidden[:, n]]
        shorter = max(shorter, float(shown.min() - lost.min()), float(lost.max() - shown.max()))
    names = ", ".join(frames.targets[n] for n in targets)
    ends = f"; trajectories end up to {shorter:.1f} s before the tracks" if shorter > 0 else ""
    words = (
        f"{int(hidden.sum())} sightings of {names} are not used: one camera alone sees them then; how far away they "
        f"are cannot be known where they move freely{ends}"
    )
    return (Finding(kind="seen-by-one", subject=names, words=words),)
