"""What a grouping of tracks is worth, everything that is not known exactly integrated out.

With the pairs p of all groups, weights w ((k - 1) / n in a group of k cameras of which n pairs are seen at one time:
these, each a miss and a height, hold 2 (k - 1) independent facts), and the prior P0 of the unknowns b about b0:

    H = P0^-1 + sum w G' S^-1 G,   h = P0^-1 b0 + sum w G' S^-1 c
    J = sum w (log-likelihood at 0, less that of two targets, plus the prior odds) + h' H^-1 h / 2 - log det(P0 H) / 2
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints
from pipeline.matching.sampling import Sampled
from pipeline.matching.settings import MatchSettings
from pipeline.matching.terms import OWN, Terms, gaussian

ALONE = -1
"""Label of a track that is in no group."""
GROUND_M = 100.0
"""What is known of the ground's height about its first guess, one sigma."""
NEAR_S = 0.3
"""How far an offset may be from its hypothesis, one sigma: offsets a step apart are hypotheses of their own."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Prior:
    """Of the unknowns: mean (D,) and variance (D,); `here` (C,): log chance of each offset to be near this one."""

    mean: Floats
    variance: Floats
    here: Floats


def prior_of(
    views: Sequence[Sampled], offset_mean_s: Sequence[float], offset_sigma_s: Sequence[float], settings: MatchSettings
) -> Prior:
    """What is known before; offsets as departures from the hypothesis, up to where things are linear in them.

    The first camera's clock is held.
    """
    variance = np.zeros(OWN * len(views) + 3)
    mean, here = np.zeros_like(variance), np.zeros(len(views))
    for c, view in enumerate(views):
        own = variance[OWN * c : OWN * (c + 1)]
        own[:3], own[3:6] = view.sigma.attitude_bias_rad**2, view.sigma.position_bias_m**2
        sigma = offset_sigma_s[c]
        if sigma > NEAR_S:
            here[c] = np.log(NEAR_S / sigma) - 0.5 * (offset_mean_s[c] / sigma) ** 2
            own[6] = NEAR_S**2
        else:
            own[6], mean[OWN * c + 6] = sigma**2, offset_mean_s[c]
        own[7] = 0.0 if c == 0 else view.sigma.frame_rate**2
    variance[-3], variance[-2:] = GROUND_M**2, settings.slope**2
    return Prior(mean=mean, variance=np.maximum(variance, 1e-12), here=here)


class Joint:
    """The worth of groupings: labels (tracks,) name the group of each track, ALONE is in none."""

    def __init__(self, terms: Terms, prior: Prior, camera_of: Ints, settings: MatchSettings) -> None:
        self.terms, self.prior, self.camera_of, self.settings = terms, prior, camera_of, settings
        counts = np.bincount(camera_of)
        most = np.maximum(counts[camera_of[terms.first]], counts[camera_of[terms.second]]) if len(terms.first) else 1
        self.odds = -np.log(np.maximum(most, 1)) * np.ones(len(terms.first))
        p = settings.orders
        self.parts = (slice(0, p), slice(0, 2 * p))
        self.mode = np.array([np.log1p(-settings.on_ground), np.log(settings.on_ground)])
        self.information = [self._information(part) for part in self.parts]
        self.silent = np.zeros((len(camera_of), len(camera_of)), bool)
        for one, other in terms.never_both.tolist():
            self.silent[one, other] = self.silent[other, one] = True
        self.row = {(int(a), int(b)): k for k, (a, b) in enumerate(zip(terms.first, terms.second, strict=True))}

    def _information(self, part: slice) -> tuple[Floats, Floats, Floats]:
        """G' S^-1 G (S, D, D), G' S^-1 c (S, D), and the worth at b = 0 (S,)."""
        t = self.terms
        design, c, cov = t.design[:, part], t.coefficient[:, part], t.covariance[:, part, part]
        solved = np.linalg.solve(cov, design)
        other = t.other[:, 0 if part == self.parts[0] else 1]
        zero = gaussian(c, cov) - other + self.odds
        return np.swapaxes(design, 1, 2) @ solved, np.einsum("spd,sp->sd", solved, c), zero

    def predicted(self, mean: Floats, covariance: Floats) -> Floats:
        """Worth (S, 2) of every pair, off and on the ground, given what is known of the unknowns."""
        t = self.terms
        found = np.zeros((len(t.first), 2))
        for k, part in enumerate(self.parts):
            design = t.design[:, part]
            spread = design @ covariance @ np.swapaxes(design, 1, 2) + t.covariance[:, part, part]
            missed = t.coefficient[:, part] - design @ mean
            found[:, k] = gaussian(missed, spread) - t.other[:, k] + self.odds + self.mode[k]
        return found

    def start(self) -> tuple[Floats, Floats]:
        """Mean and covariance of the unknowns before any pair."""
        return self.prior.mean, np.diag(self.prior.variance)

    def active(self, label: Ints) -> tuple[Ints, Floats]:
        """Rows of the pairs of a grouping and their weights; empty and NaN where a pair has no row: it cannot be."""
        members: dict[int, list[int]] = {}
        for track, group in enumerate(label.tolist()):
            if group != ALONE:
                members.setdefault(group, []).append(track)
        rows, weights = [], []
        for group in members.values():
            found = self._rows(group)
            if found is None:
                return np.zeros(0, int), np.array([np.nan])
            rows += found
            weights += [(len(group) - 1) / len(found)] * len(found)
        return np.array(rows, int), np.array(weights)

    def _rows(self, group: Sequence[int]) -> list[int] | None:
        """Rows of the pairs of a group that were seen at one time; None where it cannot be, or they do not tie it."""
        rows, tied = [], [{track} for track in group]
        for i, one in enumerate(group):
            for other in group[i + 1 :]:
                row = self.row.get((one, other))
                if row is None and not self.silent[one, other]:
                    return None
                if row is not None:
                    rows.append(row)
                    both = [part for part in tied if one in part or other in part]
                    tied = [part for part in tied if part not in both] + [set().union(*both)]
        return rows if len(tied) == 1 else None

    def worth(self, label: Ints, on_ground: Bools) -> float:
        """J of a grouping; minus infinity where it cannot be."""
        rows, weight = self.active(label)
        if len(weight) != len(rows):
            return -np.inf
        cameras = np.unique(self.camera_of[label != ALONE])
        return self._worth(rows, weight, on_ground)[0] + float(self.prior.here[cameras].sum())

    def _worth(self, rows: Ints, weight: Floats, on_ground: Bools) -> tuple[float, Floats, Floats]:
        inverse = 1 / self.prior.variance
        normal, right, total = np.diag(inverse), inverse * self.prior.mean, 0.0
        for k in (0, 1):
            mine = on_ground[rows] if k else ~on_ground[rows]
            a, c, zero = self.information[k]
            normal = normal + np.einsum("s,sde->de", weight[mine], a[rows[mine]])
            right = right + weight[mine] @ c[rows[mine]]
            total += float(weight[mine] @ (zero[rows[mine]] + self.mode[k]))
        scale = np.sqrt(self.prior.variance)
        scaled = normal * scale[:, None] * scale
        factor = np.linalg.cholesky(scaled)
        solved = np.linalg.solve(factor, scale * right)
        mean_part = float(inverse @ self.prior.mean**2)
        worth = total + 0.5 * float(solved @ solved) - 0.5 * mean_part - float(np.log(np.diag(factor)).sum())
        return worth, np.asarray(factor, np.float64), np.asarray(scale, np.float64)

    def posterior(self, label: Ints, on_ground: Bools) -> tuple[Floats, Floats]:
        """Mean (D,) and covariance (D, D) of the unknowns given a grouping."""
        rows, weight = self.active(label)
        if len(weight) != len(rows):
            return self.start()
        _, factor, scale = self._worth(rows, weight, on_ground)
        inverse = 1 / self.prior.variance
        right = inverse * self.prior.mean
        for k in (0, 1):
            mine = on_ground[rows] if k else ~on_ground[rows]
            right = right + weight[mine] @ self.information[k][1][rows[mine]]
        half = np.linalg.solve(factor, np.diag(scale))
        covariance = half.T @ half
        return covariance @ right, covariance
