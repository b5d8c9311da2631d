"""Groups of tracks, one of each camera at most: assigned camera by camera, then improved move by move."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from calibration.foundation.arrays import Bools, Floats, Ints
from pipeline.matching.joint import ALONE, Joint

ROUNDS = 6
"""Of assigning anew with what the last assignment tells of the unknowns."""
WORTH_TRYING = -8.0
"""Predicted log-likelihood from which a pair is tried in a move."""
TRIED, SLACK = 8, 6.0
"""Moves that are reckoned exactly, of the most promising, and by how much the rough reckoning may be wrong."""
Forbidden = tuple[int, int] | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Grouping:
    """Labels of the tracks, which pairs are taken as on the ground, and the worth J."""

    label: Ints
    on_ground: Bools
    worth: float

    def together(self, one: int, other: int) -> bool:
        """Whether two tracks are in one group."""
        return bool(self.label[one] != ALONE and self.label[one] == self.label[other])


def grouped(
    joint: Joint, *, forbidden: Forbidden = None, begin: Ints | None = None, seed: tuple[int, int] | None = None
) -> Grouping:
    """The best grouping that is found from `begin`, else from one pair, else from the prior; two may be kept apart."""
    label = np.full(len(joint.camera_of), ALONE) if begin is None else begin.copy()
    mean, covariance = joint.start()
    if seed is not None:
        label[list(seed)] = 0
    best: Grouping | None = None
    for _ in range(ROUNDS if begin is None else 1):
        if (label != ALONE).any():
            mean, covariance = joint.posterior(label, _modes(joint, mean, covariance)[1])
        told, on_ground = _modes(joint, mean, covariance)
        if begin is None:
            label = _assigned(joint, told, label, forbidden)
        found = Grouping(label=label, on_ground=on_ground, worth=joint.worth(label, on_ground))
        if best is not None and found.worth <= best.worth + 1e-6:
            break
        best = found
    assert best is not None
    return _improved(joint, best, forbidden)


def _modes(joint: Joint, mean: Floats, covariance: Floats) -> tuple[Floats, Bools]:
    told = joint.predicted(mean, covariance)
    return np.logaddexp(told[:, 0], told[:, 1]), told[:, 1] > told[:, 0]


def _assigned(joint: Joint, told: Floats, label: Ints, forbidden: Forbidden) -> Ints:
    """Each camera's tracks assigned to the groups of the others, in turn, until nothing changes."""
    camera_of, table = joint.camera_of, _table(joint, told)
    cameras = range(int(camera_of.max()) + 1)
    for _ in range(ROUNDS):
        before = label
        for c in cameras:
            label = _one_camera(joint, table, label, c, forbidden)
        if len(cameras) == 2 or np.array_equal(_canonical(before), _canonical(label)):
            break
    return label


def _one_camera(joint: Joint, told: Floats, label: Ints, camera: int, forbidden: Forbidden) -> Ints:
    mine = np.flatnonzero(joint.camera_of == camera)
    groups = _groups_without(joint, label, camera)
    gain = np.full((len(mine), len(groups)), -np.inf)
    for k, members in enumerate(groups):
        gain[:, k] = _mean(told[mine][:, members])
        if forbidden is not None and any(m in forbidden for m in members):
            gain[np.isin(mine, forbidden), k] = -np.inf
    label = label.copy()
    label[mine] = ALONE
    for k, members in enumerate(groups):
        label[members] = k if len(members) > 1 else ALONE
    if not groups or not (gain > 0).any():
        return label
    for row, place in zip(*linear_sum_assignment(-np.maximum(gain, 0.0)), strict=True):
        if gain[row, place] > 0:
            label[[mine[row], *groups[int(place)]]] = place
    return label


def _mean(told: Floats) -> Floats:
    """Mean (m,) over what is told (m, k); minus infinity where nothing is."""
    some = ~np.isnan(told)
    total = np.where(some, told, 0.0).sum(axis=1)
    return np.where(some.any(axis=1), total / np.maximum(some.sum(axis=1), 1), -np.inf)


def _table(joint: Joint, told: Floats) -> Floats:
    """What pairs are worth, by both their tracks; minus infinity where they cannot be, NaN where nothing tells."""
    found = np.full((len(joint.camera_of), len(joint.camera_of)), -np.inf)
    found[joint.terms.first, joint.terms.second] = told
    found = np.maximum(found, found.T)
    return np.asarray(np.where(joint.silent & ~np.isfinite(found), np.nan, found))


def _groups_without(joint: Joint, label: Ints, camera: int) -> list[list[int]]:
    """Groups of the other cameras' tracks, single ones too."""
    found: dict[int, list[int]] = {}
    singles = []
    for track in np.flatnonzero(joint.camera_of != camera).tolist():
        if label[track] == ALONE:
            singles.append([track])
        else:
            found.setdefault(int(label[track]), []).append(track)
    return [*found.values(), *singles]


def _canonical(label: Ints) -> Ints:
    """The same groups with numbers in the order of their first track."""
    seen: dict[int, int] = {}
    return np.array([ALONE if g == ALONE else seen.setdefault(g, len(seen)) for g in label.tolist()])


def _improved(joint: Joint, start: Grouping, forbidden: Forbidden) -> Grouping:
    """The best move, again and again, while one helps; moves are ranked by what is known of the unknowns."""
    best = start
    for _ in range(4 * len(joint.camera_of)):
        mean, covariance = joint.posterior(best.label, best.on_ground)
        told, on_ground = _modes(joint, mean, covariance)
        refreshed = joint.worth(best.label, on_ground)
        if refreshed >= best.worth:
            best = Grouping(label=best.label, on_ground=on_ground, worth=refreshed)
        tries = [label for label in moves(joint, told, best.label) if not _breaks(label, forbidden)]
        better = _first_better(joint, told, best, tries)
        if better is None:
            return best
        best = better
    return best


def _first_better(joint: Joint, told: Floats, best: Grouping, tries: list[Ints]) -> Grouping | None:
    """The first of the most promising groupings that is worth more."""
    if not tries:
        return None
    rough = _rough_worth(joint, told, np.array([best.label, *tries]))
    order = np.argsort(-rough[1:], kind="stable")[:TRIED]
    for k in order:
        if rough[1 + k] < rough[0] - SLACK:
            break
        worth = joint.worth(tries[k], best.on_ground)
        if worth > best.worth + 1e-6:
            return Grouping(label=tries[k], on_ground=best.on_ground, worth=worth)
    return None


def _rough_worth(joint: Joint, told: Floats, labels: Ints) -> Floats:
    """Worth (k,) of groupings (k, tracks), what is known of the unknowns taken as it is."""
    one, other = joint.terms.first, joint.terms.second
    same = (labels[:, one] == labels[:, other]) & (labels[:, one] != ALONE)
    together = ((labels[:, :, None] == labels[:, None, :]) & (labels[:, :, None] != ALONE)).astype(float)
    size = together.sum(2)
    seen = 0.5 * (size * (size - 1) - ((together @ joint.silent) * together).sum(2))  # pairs of each track's group
    pairs = np.where(size > 0, seen / np.maximum(size, 1), 0.0).sum(1)
    weight = np.where(same, (size - 1)[:, one] / np.maximum(seen[:, one], 1), 0.0)
    return np.where(np.abs(same.sum(1) - pairs) < 0.5, (weight * told).sum(1), -np.inf)


def _breaks(label: Ints, forbidden: Forbidden) -> bool:
    return forbidden is not None and label[forbidden[0]] != ALONE and bool(label[forbidden[0]] == label[forbidden[1]])


def moves(joint: Joint, told: Floats, label: Ints) -> Iterator[Ints]:
    """Groupings one move away: a track leaves, joins another's group, or two of one camera change places."""
    for track in np.flatnonzero(label != ALONE).tolist():
        yield _tidy(_moved(label, track, ALONE))
    for row in np.flatnonzero(told > WORTH_TRYING).tolist():
        one, other = int(joint.terms.first[row]), int(joint.terms.second[row])
        if label[one] != ALONE and label[one] == label[other]:
            continue
        for track, to in ((one, other), (other, one)):
            yield _tidy(_joined(joint, label, track, to))
    for camera in range(int(joint.camera_of.max()) + 1):
        mine = np.flatnonzero(joint.camera_of == camera).tolist()
        for i, one in enumerate(mine):
            for other in mine[i + 1 :]:
                if label[one] != label[other]:
                    swapped = label.copy()
                    swapped[[one, other]] = label[[other, one]]
                    yield swapped


def _moved(label: Ints, track: int, group: int) -> Ints:
    found = label.copy()
    found[track] = group
    return found


def _joined(joint: Joint, label: Ints, track: int, to: int) -> Ints:
    """`track` in the group of `to`, in place of that camera's other track there."""
    found = label.copy()
    group = int(label[to])
    if group == ALONE:
        group = int(label.max()) + 1
        found[to] = group
    else:
        found[(label == group) & (joint.camera_of == joint.camera_of[track])] = ALONE
    found[track] = group
    return found


def _tidy(label: Ints) -> Ints:
    """Groups of one are none."""
    found = label.copy()
    groups, counts = np.unique(label[label != ALONE], return_counts=True)
    for group in groups[counts < 2]:
        found[found == group] = ALONE
    return found
