"""Tracks of several cameras -> targets common to them, each pair with its margin over the next best way to see it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Bools, Ints
from pipeline.matching.groups import Grouping, grouped
from pipeline.matching.hypotheses import Hypothesis, curves, hypotheses, offset_range
from pipeline.matching.joint import ALONE, NEAR_S, Joint, prior_of
from pipeline.matching.records import Doubtful, MatchedClock, MatchedPair, MatchedTarget, Matching, TrackName
from pipeline.matching.sampling import Sampled, sampled
from pipeline.matching.settings import MatchSettings
from pipeline.matching.terms import OWN, terms, typical_height
from pipeline.records import CameraInput

REFINED = 3
"""How often the clocks of a hypothesis are taken anew where its pairs put them."""
FAR = 15.0
"""Hypotheses that are worse than the best so far by more than this are not refined."""

STILL_S, STILL_M = 0.02, 1.0
"""Changes of clocks and of the ground's height that need not be taken up anew."""
BESIDE_S = 0.6
"""How far from the best offsets others are tried at last."""
HEADWAY_S = 1.0
"""Clocks that are known better than this, one sigma, tell a car from the one behind it."""
FOLLOWS = "one target alone ties these clocks: what another camera sees may be one that goes the same way, later"
OTHERWISE = "with other time offsets all fits nearly as well without this pair"
RIVALS = 3
"""Other pairs of two tracks from which a way without them is looked for."""

ShareDone = Callable[[float], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Solved:
    """A hypothesis with its best grouping."""

    offset_s: dict[str, float | None]
    ground_m: float
    joint: Joint
    grouping: Grouping


def match_tracks(
    cameras: Sequence[CameraInput], settings: MatchSettings | None = None, *, progress: ShareDone | None = None
) -> Matching:
    """The targets that tracks of several cameras are of; the first camera's clock is common time.

    Names of targets mean nothing here: each camera has its own. Clocks are looked for as far as `settings.search_s`
    where a camera's `offset_s` is None.
    """
    chosen = settings or MatchSettings()
    tell = progress or (lambda share: None)
    views = [sampled(camera, chosen) for camera in cameras]
    ranges = [offset_range(camera, k == 0, chosen) for k, camera in enumerate(cameras)]
    found = curves(views, ranges, chosen)
    tell(0.5)
    guesses = hypotheses(views, ranges, found, chosen)
    solved: list[_Solved] = []
    for k, guess in enumerate(guesses):
        most = max((one.grouping.worth for one in solved), default=0.0)
        solved.append(_solve(views, cameras, guess, ranges, chosen, most))
        tell(0.5 + 0.3 * (k + 1) / len(guesses))
    solved.sort(key=lambda one: -one.grouping.worth)
    solved += [_solve(views, cameras, near, ranges, chosen, solved[0].grouping.worth) for near in _beside(solved[0])]
    solved.sort(key=lambda one: -one.grouping.worth)
    return _judged(views, solved, chosen, tell)


def _solve(
    views: Sequence[Sampled], cameras: Sequence[CameraInput], guess: Hypothesis,
    ranges: Sequence[tuple[float, float]], settings: MatchSettings, most: float,
) -> _Solved:  # fmt: skip
    """The best grouping at a hypothesis, its clocks moved to where the pairs put them; `most`: of those before."""
    camera_of = np.repeat(np.arange(len(views)), [len(v.names) for v in views])
    offset = dict(guess.offset_s)
    ground = guess.ground_m if np.isfinite(guess.ground_m) else typical_height(terms(views, offset, 0.0, settings))
    best: _Solved | None = None
    for _ in range(1 + REFINED):
        joint = Joint(
            terms(views, offset, ground, settings), prior_of(views, *_known(cameras, offset, ranges), settings),
            camera_of, settings,
        )  # fmt: skip
        tried = [grouped(joint)] if best is None else [grouped(joint), grouped(joint, begin=best.grouping.label)]
        grouping = max(tried, key=lambda one: one.worth)
        best = _Solved(offset_s=offset, ground_m=ground, joint=joint, grouping=grouping)
        mean, _ = joint.posterior(grouping.label, grouping.on_ground)
        step = np.clip(mean[6 : OWN * len(views) : OWN], -0.5, 0.5)
        offset = {v.camera: _moved(offset[v.camera], float(s)) for v, s in zip(views, step, strict=True)}
        lifted = float(mean[-3]) if grouping.on_ground.any() else 0.0
        ground += lifted
        if (np.abs(step).max() < STILL_S and abs(lifted) < STILL_M) or grouping.worth < most - FAR:
            break
    assert best is not None
    return best


def _beside(best: _Solved) -> list[Hypothesis]:
    """Hypotheses half a second from the best one, a camera each."""
    tied = [name for name, offset in best.offset_s.items() if offset is not None][1:]
    return [
        Hypothesis(
            offset_s={c: _moved(offset, step if c == name else 0.0) for c, offset in best.offset_s.items()},
            score=best.grouping.worth,
            ground_m=best.ground_m,
        )
        for name in tied for step in (-BESIDE_S, BESIDE_S)
    ]  # fmt: skip


def _moved(offset_s: float | None, step_s: float) -> float | None:
    return None if offset_s is None else offset_s + step_s


def _known(
    cameras: Sequence[CameraInput], offset: dict[str, float | None], ranges: Sequence[tuple[float, float]]
) -> tuple[list[float], list[float]]:
    """Prior of each offset as mean and sigma of its departure from the hypothesis: flat over the range, or as given."""
    mean, sigma = [0.0], [0.0]
    for camera, (low, high) in list(zip(cameras, ranges, strict=True))[1:]:
        here = offset[camera.camera]
        if camera.offset_s is not None and camera.sigma.offset_s is not None and here is not None:
            mean.append(camera.offset_s - here)
            sigma.append(max(camera.sigma.offset_s, 1e-3))
        else:
            mean.append(0.0)
            sigma.append(max((high - low) / np.sqrt(2 * np.pi), 1e-3))
    return mean, sigma


def _judged(views: Sequence[Sampled], solved: Sequence[_Solved], settings: MatchSettings, tell: ShareDone) -> Matching:
    best = solved[0]
    names = [TrackName(camera=v.camera, target=name) for v in views for name in v.names]
    label = best.grouping.label
    pairs = [
        (i, j) for i in range(len(label)) for j in range(i + 1, len(label)) if best.grouping.together(i, j)
    ]  # fmt: skip
    margins, rivals = {}, {}
    still = np.concatenate([v.still for v in views])
    for k, (i, j) in enumerate(pairs):
        margins[i, j], rivals[i, j] = _margin(best, solved[1:], i, j)
        most = _most_known(best, views, still, pairs, (i, j), settings)
        if most < margins[i, j]:
            margins[i, j], rivals[i, j] = most, FOLLOWS
        tell(0.8 + 0.2 * (k + 1) / len(pairs))
    sure = {pair for pair, margin in margins.items() if margin >= settings.sure}
    kept = _kept(label, sure)
    told = {pair: MatchedPair(first=names[pair[0]], second=names[pair[1]], margin=margins[pair]) for pair in pairs}
    doubtful = tuple(
        Doubtful(pair=told[pair], why=_why(names, rivals[pair]))
        for pair in pairs
        if kept[pair[0]] == ALONE or kept[pair[0]] != kept[pair[1]]
    )
    return Matching(
        targets=_targets(names, kept, told),
        doubtful=doubtful,
        clocks=_clocks(views, solved, bool(sure), settings),
        score=best.grouping.worth,
    )


def _margin(best: _Solved, others: Sequence[_Solved], i: int, j: int) -> tuple[float, Grouping | str]:
    """By how much all is likelier with two tracks together than in any way found in which they are apart."""
    joint, label = best.joint, best.grouping.label
    begins = []
    for leaves in (i, j):
        alone = label.copy()
        alone[leaves] = ALONE
        begins.append(_no_singles(alone))
    tries = [grouped(joint, forbidden=(i, j), begin=begin) for begin in begins]
    tries += [grouped(joint, forbidden=(i, j), seed=pair) for pair in _rival_pairs(best, i, j)]
    rival: Grouping | str = max(tries, key=lambda one: one.worth)
    assert isinstance(rival, Grouping)
    most = rival.worth
    for other in others:
        if not other.grouping.together(i, j) and other.grouping.worth > most:
            most, rival = other.grouping.worth, OTHERWISE
    return float(best.grouping.worth - max(most, 0.0)), rival


def _most_known(
    best: _Solved, views: Sequence[Sampled], still: Bools, pairs: Sequence[tuple[int, int]], pair: tuple[int, int],
    settings: MatchSettings,
) -> float:  # fmt: skip
    """The most that a margin can be: what moves may be followed by its like, and a clock that is not known hides it."""
    camera_of = best.joint.camera_of
    between = camera_of[pair[0]], camera_of[pair[1]]
    known = [views[c].sigma.offset_s for c in between if c > 0]
    if still[list(pair)].all() or all(sigma is not None and sigma < HEADWAY_S for sigma in known):
        return float("inf")
    tie = sum((camera_of[i], camera_of[j]) == between and not still[[i, j]].all() for i, j in pairs)
    return float(-tie * np.log(settings.follower))


def _rival_pairs(best: _Solved, i: int, j: int) -> list[tuple[int, int]]:
    """The likeliest other pairs of either track in these two cameras, before anything else is known."""
    joint = best.joint
    told = np.logaddexp(*joint.predicted(*joint.start()).T)
    found = []
    for k in np.argsort(-told):
        pair = int(joint.terms.first[k]), int(joint.terms.second[k])
        cameras = {int(joint.camera_of[t]) for t in pair}
        if (
            pair != (i, j)
            and (i in pair or j in pair)
            and cameras == {int(joint.camera_of[i]), int(joint.camera_of[j])}
        ):
            found.append(pair)
    return found[:RIVALS]


def _no_singles(label: Ints) -> Ints:
    found = label.copy()
    for group in np.unique(label[label != ALONE]):
        if (label == group).sum() < 2:
            found[label == group] = ALONE
    return found


def _kept(label: Ints, sure: set[tuple[int, int]]) -> Ints:
    """Groups of what is sure: within each group, tracks that sure pairs tie; a track tied to none of them leaves."""
    found = np.full(len(label), ALONE)
    number = 0
    for group in np.unique(label[label != ALONE]):
        left = np.flatnonzero(label == group).tolist()
        while left:
            tied = {left[0]}
            grown = True
            while grown:
                more = {t for t in left if t not in tied and any((min(t, u), max(t, u)) in sure for u in tied)}
                tied |= more
                grown = bool(more)
            if len(tied) > 1:
                found[list(tied)] = number
                number += 1
            left = [t for t in left if t not in tied]
    return found


def _targets(
    names: Sequence[TrackName], kept: Ints, told: dict[tuple[int, int], MatchedPair]
) -> tuple[MatchedTarget, ...]:
    """Common targets first, then single tracks."""
    found = []
    for group in np.unique(kept[kept != ALONE]):
        members = np.flatnonzero(kept == group).tolist()
        pairs = tuple(told[i, j] for i in members for j in members if i < j)
        found.append(MatchedTarget(tracks=tuple(names[m] for m in members), pairs=pairs))
    return (*found, *(MatchedTarget(tracks=(names[k],)) for k in np.flatnonzero(kept == ALONE).tolist()))


def _why(names: Sequence[TrackName], rival: Grouping | str) -> str:
    if isinstance(rival, str):
        return rival
    groups = [
        " = ".join(str(names[k]) for k in np.flatnonzero(rival.label == g).tolist())
        for g in np.unique(rival.label[rival.label != ALONE])
    ]
    return "nearly as likely: " + ("; ".join(groups) if groups else "no pair at all")


def _clocks(
    views: Sequence[Sampled], solved: Sequence[_Solved], known: bool, settings: MatchSettings
) -> tuple[MatchedClock, ...]:
    """The clocks, at frame 0; unknown where no pair is sure, nothing ties a camera, or other offsets do as well."""
    best = solved[0]
    mean, covariance = best.joint.posterior(best.grouping.label, best.grouping.on_ground)
    found = [MatchedClock(camera=views[0].camera, offset_s=0.0, sigma_s=0.0)]
    rivals = [one for one in solved[1:] if one.grouping.worth > best.grouping.worth - settings.sure]
    for c, view in enumerate(views[1:], start=1):
        own = OWN * c + 6
        offset = best.offset_s[view.camera]
        sigma = float(np.sqrt(covariance[own, own]))
        others = [one.offset_s[view.camera] for one in rivals]
        apart = offset is not None and any(o is not None and abs(o - offset) > max(1.0, 4 * sigma) for o in others)
        if offset is None or not known or apart or sigma > 0.9 * NEAR_S:
            found.append(MatchedClock(camera=view.camera, offset_s=None, sigma_s=None))
        else:
            middle = 0.5 * sum(view.span_s)
            at_zero = offset + mean[own] - mean[own + 1] * middle
            found.append(MatchedClock(camera=view.camera, offset_s=float(at_zero), sigma_s=sigma))
    return tuple(found)
