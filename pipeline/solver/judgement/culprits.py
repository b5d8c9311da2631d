"""Which single change restores the fit: each is applied, the flight adjusted again from where it stands, and compared.

Every change leaves a chi-square T' with an expectation E'. It restores

    gain = (T - T') - (E - E')          E - E' = two for each sighting left out, less the unknowns that go with it

less a price: what pure chance would restore among so many changes, and, where sightings are left out, their share of
the whole misfit. The greatest gain after its price is the likeliest culprit. Adjusting again is cheap: at most `FRAMES`
frames of a camera, the motions as they are, few iterations, and only `TRIALS` changes, the most promising first; both
are counts, so that the same flight has the same answer on any machine.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints
from calibration.foundation.errors import RunningFixError
from pipeline.records import Problem
from pipeline.solver.adjustment.compiled_descent import is_dense
from pipeline.solver.adjustment.levenberg_marquardt import Descent, Fit, levenberg_marquardt
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.adjustment.renewal import renewing, rolling_too
from pipeline.solver.judgement.changes import (
    CONVENTIONS,
    FREED,
    Change,
    converted,
    exchanged,
    freed,
    read_out,
    richer,
    stepped,
    without,
)
from pipeline.solver.judgement.misfit import Misfit, Misfits
from pipeline.solver.judgement.pose_sequences import Sequence as PoseSequence
from pipeline.solver.methods.initialisation import graduated
from pipeline.solver.methods.intersection import intersect, intersect_weighted
from pipeline.solver.observation.clocks import OFFSET, READOUT, SCALE
from pipeline.solver.observation.observations import Frames, Rows
from pipeline.solver.observation.rolling_shutter import add_rows, with_row_numbers

FRAMES = 200
"""Frames of a camera that take part in the search; twice as many take twice the time."""
TRIALS, SLOW_TRIALS = 130, 40
"""Changes that are tried, and where splines or many unknowns make each slow."""
ITERATIONS = 25
RESTORED, EVIDENT = 4.0, 12.0
"""z of unit weight below which a change counts as restoring the fit, and the z before from which on that is evidence:
no more complicated changes are tried then."""
GROSS = 30.0
"""z of unit weight from which on poses in another convention are tried; small errors are no conventions."""
WORST, PAIRED = 4, 3
"""Tracks and targets that are suspected, the worst first; and those that are tried as exchanged half way."""
FROM_HERE = ("free", "motion", "step", "without-target", "without-camera", "readout")
"""Kinds of change after which the answer as it stands is a start."""
LONGEST_SHARE = 1.2
"""Of the time from frame to frame: what a readout may last."""
Clocks = tuple[Floats, Floats]
"""Offsets (C,) and relative scales (C,) to start from."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Explained:
    """One change and what it restores.

    gain   what it takes off chi-square beyond expectation
    net    gain less the change's price
    z      of unit weight with it, as that of `Misfit`
    fit    the adjustment with it
    """

    change: Change
    gain: float
    net: float
    z: float
    fit: Fit


@dataclass(frozen=True, kw_only=True, eq=False)
class Searched:
    """What was tried on `base`, the flight as it stands: the changes that restore anything, the best first; `cut`: more
    could have been tried."""

    base: Fit
    found: tuple[Explained, ...]
    tried: int
    cut: bool


def search_culprits(
    problem: Problem, model: Model, state: State, misfits: Misfits, sequences: Sequence[PoseSequence] = (),
    clocks: Sequence[Clocks] = (),
) -> Searched:  # fmt: skip
    """Tries the changes on the adjusted flight; `clocks` are further clocks to start from."""
    fewer, point = thinned(with_known_rows(problem, model), state)
    descent = Descent(
        max_iterations=ITERATIONS, renew=renewing(problem) if fewer.frames.count == model.frames.count else None
    )
    base = levenberg_marquardt(fewer, point, descent)
    lost = 2.0 * float(model.frames.seen.sum() - fewer.frames.seen.sum())
    expected = max(misfits.whole.redundancy - lost, 1.0)
    most = TRIALS if is_dense(base.model) else SLOW_TRIALS
    found: list[Explained] = []
    tried, cut = 0, False
    for stage in suspected(base.model, misfits, sequences, ordered(problem)):
        tries = [_explained(change, base, expected, descent, clocks) for change in stage[: most - tried]]
        found += [e for e in tries if e is not None]
        tried, cut = tried + len(tries), cut or len(stage) > most - tried
        if misfits.whole.z > EVIDENT and any(e.z < RESTORED for e in found):
            break
    best = max(found, key=lambda e: e.net, default=None)
    for change in _finer(best.change, base.model) if best is not None else ():
        nearby = _explained(change, base, expected, descent, clocks)
        if nearby is not None:
            found.append(nearby)
    worthy = sorted((e for e in found if e.net > 0), key=lambda e: -e.net)
    return Searched(base=base, found=tuple(worthy), tried=tried, cut=cut)


def _explained(
    change: Change, base: Fit, expected: float, descent: Descent, clocks: Sequence[Clocks]
) -> Explained | None:
    """A change and what it restores; None where the flight cannot be adjusted with it."""
    best = _tried(change, base, descent, clocks)
    if best is None:
        return None
    removed = _removed(base.model, best.model)
    gain = 2 * (base.cost - best.cost) - removed
    left = expected - removed
    z = (2 * best.cost - left) / float(np.sqrt(2 * max(left, 1.0)))
    share = 1 - float(best.model.frames.seen.sum()) / max(float(base.model.frames.seen.sum()), 1.0)
    price = change.price + share * max(2 * base.cost - expected, 0.0)
    return Explained(change=change, gain=gain, net=gain - price, z=z, fit=best)


def with_known_rows(problem: Problem, model: Model) -> Model:
    """The model with the rows of its sightings where they are known; where no readout is given they change nothing."""
    cameras = with_row_numbers(problem)
    return replace(model, frames=add_rows(problem, model.frames, cameras)) if cameras else model


def thinned(model: Model, state: State) -> tuple[Model, State]:
    """The same adjustment with at most `FRAMES` frames of each camera, evenly spread."""
    frames = model.frames
    rows = [_spread(frames, c) for c in range(len(frames.cameras))]
    if all(len(own) == frames.of(c).stop - frames.of(c).start for c, own in enumerate(rows)):
        return model, state
    chosen = np.concatenate(rows)
    fewer = _chosen(frames, chosen, np.array([len(own) for own in rows]))
    drift = replace(model.drift, segment=model.drift.segment[chosen])
    wander = model.wander
    if wander is not None:
        rows_of = {name: getattr(wander, name)[chosen] for name in ("left", "share", "piece")}
        wander = replace(wander, **rows_of)
    return model.changed(frames=fewer, drift=drift, wander=wander), replace(state, own=state.own[chosen])


def _spread(frames: Frames, c: int) -> Ints:
    part = frames.of(c)
    count = part.stop - part.start
    return np.asarray(part.start + np.unique(np.linspace(0, count - 1, min(count, FRAMES)).round().astype(np.int64)))


def _chosen(frames: Frames, rows: Ints, count: Ints) -> Frames:
    """The frames `rows`, `count` (C,) of each camera."""
    by_frame = (
        "camera", "frame", "video_s", "cam_from_enu", "position_m", "pose_shift_s", "pose_taken_s", "ray", "gain",
        "seen", "sigma_px", "place_gain", "place_share",
    )  # fmt: skip
    cut: dict[str, Any] = {name: np.ascontiguousarray(getattr(frames, name)[rows]) for name in by_frame}
    return replace(
        frames, **cut, first=np.concatenate([[0], np.cumsum(count)]).astype(np.int64),
        pose_rate=None if frames.pose_rate is None else frames.pose_rate[rows],
        focal_effect=frames.focal_effect[rows] if len(frames.focal_effect) else frames.focal_effect,
        by_readout=frames.by_readout[rows] if len(frames.by_readout) else frames.by_readout,
        rows=None if frames.rows is None else _chosen_rows(frames.rows, rows),
    )  # fmt: skip


def _chosen_rows(rows: Rows, which: Ints) -> Rows:
    return Rows(fraction=rows.fraction[which], rate=rows.rate[which], turn=rows.turn[which])


def ordered(problem: Problem) -> tuple[str, ...]:
    """Targets whose motion's order was given, not found."""
    return tuple(t.target for t in problem.targets if t.motion != "spline" and not t.is_asked)


def suspected(
    model: Model, misfits: Misfits, sequences: Sequence[PoseSequence], given: Sequence[str] = ()
) -> Iterator[list[Change]]:
    """The changes in stages, the simplest first; `given` are targets whose motion's order was given.

    First what is set free, then what is exchanged, meant otherwise or left out as a whole, then what is wrong in part.
    """
    ranked = [model.frames.targets.index(m.target) for m in misfits.targets]
    yield [*_freed(model), *_richer(model, [n for n in ranked if model.frames.targets[n] in given])]
    cameras = range(len(model.frames.cameras))
    converting = CONVENTIONS if misfits.whole.z > GROSS else ()
    yield [
        *_exchanges(model, ranked[:WORST]),
        *_without_targets(model, ranked[:WORST]),
        *(converted(model, c, convention) for convention in converting for c in cameras),
        *_steps(model, sequences, ("position", "attitude", "offset")),
        *(change for track in misfits.tracks[: 2 * WORST] for change in _without_track(model, track)),
        *(_without_cameras(model) if len(cameras) > 2 else ()),
    ]
    yield [
        *(change for track in misfits.tracks[:WORST] for change in _parts_of_track(model, track, quarters=True)),
        *(change for track in misfits.tracks[WORST : 2 * WORST] for change in _parts_of_track(model, track)),
        *_exchanges_half_way(model, ranked[:PAIRED]),
    ]


def _freed(model: Model) -> Iterator[Change]:
    """Every block of every camera, and all readouts."""
    rows = read_out(model)
    if rows is not None:
        yield rows
    for what in FREED:
        for c in range(len(model.frames.cameras)):
            change = freed(model, c, what)
            if change is not None:
                yield change


def _richer(model: Model, given: Sequence[int]) -> Iterator[Change]:
    """Motions whose order was given, all and each."""
    plain = [n for n in given if model.basis.targets[n].kind == "polynomial"]
    if plain:
        yield richer(model, sorted(plain))
    yield from (richer(model, [n]) for n in plain[:WORST] if len(plain) > 1)


def _without_targets(model: Model, ranked: Sequence[int]) -> Iterator[Change]:
    for n in ranked if len(model.frames.targets) > 1 else ():
        hidden = np.zeros(model.frames.seen.shape, dtype=bool)
        hidden[:, n] = True
        yield without(model, hidden, "without-target", targets=(model.frames.targets[n],))


def _without_cameras(model: Model) -> Iterator[Change]:
    """Cameras without which every target is still seen by two, or by none."""
    frames = model.frames
    for c, name in enumerate(frames.cameras):
        hidden = np.zeros(frames.seen.shape, dtype=bool)
        hidden[frames.of(c)] = True
        if all(_seen_by(model, n) > 1 or not frames.seen[frames.of(c), n].any() for n in range(len(frames.targets))):
            yield without(model, hidden, "without-camera", camera=name)


def _steps(model: Model, sequences: Sequence[PoseSequence], blocks: Sequence[str]) -> Iterator[Change]:
    """A camera that changes where its pose errors step most, or in its middle."""
    if model.drift.count or (model.wander is not None and model.wander.count):
        return
    for c, name in enumerate(model.frames.cameras):
        own = model.frames.frame[model.frames.of(c)]
        found = {s.frame for s in sequences if s.camera == name and s.kind == "step"}
        for since in sorted(found | {int(own[len(own) // 2])}):
            if own[0] < since <= own[-1]:
                for what in blocks:
                    yield stepped(model, c, since, what)


def _track(model: Model, track: Misfit) -> tuple[int, int, Bools]:
    """Camera, target and sightings (F, N) of a track."""
    frames = model.frames
    c, n = frames.cameras.index(track.camera), frames.targets.index(track.target)
    hidden = np.zeros(frames.seen.shape, dtype=bool)
    hidden[frames.of(c), n] = True
    return c, n, hidden


def _without_track(model: Model, track: Misfit) -> Iterator[Change]:
    _, n, hidden = _track(model, track)
    if _seen_by(model, n) > 2:
        yield without(model, hidden, "without-track", camera=track.camera, targets=(track.target,))


def _parts_of_track(model: Model, track: Misfit, *, quarters: bool = False) -> Iterator[Change]:
    """A track left out from where its misfit began, or by quarters and before its middle."""
    frames, (c, n, hidden) = model.frames, _track(model, track)
    own = frames.frame[frames.of(c)][frames.seen[frames.of(c), n]]
    places = {track.since_frame} if track.since_frame is not None else set()
    quarters = quarters and len(own) > 12
    if quarters:
        places |= {int(own[len(own) * k // 4]) for k in (1, 2, 3)}
    for since in sorted(places):
        after = hidden & (frames.frame[:, None] >= since)
        yield without(model, after, "without-part", since_frame=since, camera=track.camera, targets=(track.target,))
    if quarters:
        middle = int(own[len(own) // 2])
        before = hidden & (frames.frame[:, None] < middle)
        yield without(model, before, "without-part", until_frame=middle, camera=track.camera, targets=(track.target,))


def _seen_by(model: Model, n: int) -> int:
    return len(np.unique(model.frames.camera[model.frames.seen[:, n]]))


def _watching(model: Model, a: int, b: int) -> list[int]:
    """Cameras that see both targets."""
    frames = model.frames
    return [
        c
        for c in range(len(frames.cameras))
        if frames.seen[frames.of(c), a].any() and frames.seen[frames.of(c), b].any()
    ]


def _exchanges(model: Model, ranked: Sequence[int]) -> Iterator[Change]:
    """Targets two by two in every camera that sees both; of two cameras one is enough, the other says the same."""
    for a, b in combinations(ranked, 2):
        watching = _watching(model, a, b)
        for c in watching if len(watching) > 2 else watching[-1:]:
            yield exchanged(model, c, a, b, None)


def _exchanges_half_way(model: Model, ranked: Sequence[int]) -> Iterator[Change]:
    for a, b in combinations(ranked, 2):
        for c in _watching(model, a, b):
            own = model.frames.frame[model.frames.of(c)]
            for k in range(1, 4):
                yield exchanged(model, c, a, b, int(own[len(own) * k // 4]))


def _finer(change: Change, model: Model) -> Iterator[Change]:
    """The same change at frames nearby."""
    if change.since_frame is None or change.kind not in ("exchange", "step", "without-part"):
        return
    c = model.frames.cameras.index(change.camera)
    own = model.frames.frame[model.frames.of(c)]
    place = int(np.searchsorted(own, change.since_frame))
    targets = [model.frames.targets.index(t) for t in change.targets]
    for part in (-8, 8, -16, 16, -32, 32):
        at = place + len(own) // part
        if not 0 < at < len(own) or own[at] == change.since_frame:
            continue
        if change.kind == "exchange":
            yield exchanged(model, c, targets[0], targets[1], int(own[at]))
        elif change.kind == "step":
            yield stepped(model, c, int(own[at]), change.what)
        else:
            after = np.zeros(model.frames.seen.shape, dtype=bool)
            after[model.frames.of(c), targets[0]] = own >= own[at]
            yield without(
                model, after, "without-part", since_frame=int(own[at]), camera=change.camera, targets=change.targets
            )


def _tried(change: Change, base: Fit, descent: Descent, clocks: Sequence[Clocks]) -> Fit | None:
    """The best adjustment with a change: from the answer as it stands, and from motions found anew."""
    try:
        model = change.apply(base.model)
    except (ValueError, np.linalg.LinAlgError):
        return None
    fits = []
    own = descent if change.renewable else replace(descent, renew=None)
    if change.kind == "readout":
        own = replace(own, renew=rolling_too(own.renew))
    for start in _starts(model, change.moved(base.state), change, clocks):
        try:
            fits.append(graduated(model, start, own))
        except (RunningFixError, ValueError, np.linalg.LinAlgError):
            continue
    fits = [fit for fit in fits if np.isfinite(fit.cost) and is_possible(fit)]
    return min(fits, key=lambda fit: fit.cost, default=None)


def is_possible(fit: Fit) -> bool:
    """Whether no readout lasts longer than the time from frame to frame."""
    return bool((np.abs(fit.state.camera[:, READOUT]) * fit.model.frames.nominal_rate < LONGEST_SHARE).all())


def _starts(model: Model, state: State, change: Change, clocks: Sequence[Clocks]) -> list[State]:
    out = [state] if change.kind in FROM_HERE else []
    if change.kind == "step":
        return out
    plain = np.where(model.priors.camera_free, model.priors.camera_mean, state.camera)
    here = state.camera[:, OFFSET], state.camera[:, SCALE]
    spline = any(t.kind == "spline" for t in model.basis.targets)
    for offset, scale in (here, *clocks):
        camera = plain.copy()
        camera[:, OFFSET], camera[:, SCALE] = offset, scale
        fresh = replace(state, camera=camera, own=np.zeros_like(state.own), wander=np.zeros_like(state.wander))
        try:
            out.append((intersect_weighted if spline else intersect)(model, fresh))
        except (RunningFixError, np.linalg.LinAlgError):
            continue
    return out or [state]


def _removed(base: Model, changed: Model) -> float:
    """What the expectation of chi-square falls by: two for each sighting less, less idle unknowns; new ones."""
    less = 2.0 * float(base.frames.seen.sum() - changed.frames.seen.sum())
    gone = [
        3.0 * t.count
        for n, t in enumerate(changed.basis.targets)
        if t.kind == "polynomial" and base.frames.seen[:, n].any() and not changed.frames.seen[:, n].any()
    ]
    more = [3.0 * (other.count - t.count) for t, other in zip(base.basis.targets, changed.basis.targets, strict=True)]
    return less - sum(gone) + sum(more)
