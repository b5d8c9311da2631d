"""Clusters are as long as errors last, and no longer."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.solver.adjustment.elimination import Loss
from pipeline.solver.uncertainty.clusters import clusters, memory_frames

FRAMES = 1200


def faded(rng, frames, lasting):
    """Noise (frames, 2) of unit power whose correlation falls to 1/e over `lasting` frames."""
    keep = np.exp(-1 / lasting)
    out = rng.normal(size=(frames, 2))
    for i in range(1, frames):
        out[i] = keep * out[i - 1] + np.sqrt(1 - keep**2) * out[i]
    return out


def numbers(residual):
    """The clusters of one camera that saw one spline in all its frames, 25 a second."""
    frames = SimpleNamespace(
        cameras=("uav1",), count=FRAMES, seen=np.ones((FRAMES, 1), bool), video_s=np.arange(FRAMES) / 25,
        of=lambda _: slice(0, FRAMES),
    )  # fmt: skip
    model = SimpleNamespace(
        frames=frames, loss=Loss(), basis=SimpleNamespace(targets=(SimpleNamespace(kind="spline"),)),
        pose=SimpleNamespace(spread=np.zeros((1, 6))),
    )  # fmt: skip
    return clusters(model, SimpleNamespace(own=np.zeros((FRAMES, 6))), residual[:, None])


def test_the_memory_is_the_lag_at_which_the_correlation_has_gone():
    rng = np.random.default_rng(1)
    known = np.ones(4 * FRAMES)
    assert memory_frames(rng.normal(size=(4 * FRAMES, 2)), known) == 0
    assert memory_frames(faded(rng, 4 * FRAMES, 4.0), known) in (8, 16)  # a tenth is left after 9.2, in powers of two


def test_a_cluster_is_four_times_as_long_as_the_memory():
    residual = faded(np.random.default_rng(2), FRAMES, 3.0)
    lag = memory_frames(residual, np.ones(FRAMES))
    assert lag > 1
    assert np.bincount(numbers(residual))[0] == 4 * lag


def test_errors_that_do_not_last_are_clusters_of_one_frame():
    assert np.bincount(numbers(np.random.default_rng(2).normal(size=(FRAMES, 2)))).max() == 1


def test_sums_of_clusters_spread_as_much_as_the_errors_do():
    """What clusters are for: the power of their sums is that of the whole sum, were it drawn often."""
    rng = np.random.default_rng(3)
    whole, claimed = [], []
    for _ in range(40):
        residual = faded(rng, FRAMES, 5.0)
        number = numbers(residual)
        whole.append(residual.sum(axis=0) ** 2)
        claimed.append(sum(np.bincount(number, residual[:, i]) ** 2 @ np.ones(number.max() + 1) for i in range(2)) / 2)
    assert 0.75 < np.mean(claimed) / np.mean(whole) < 1.35


@pytest.mark.parametrize("gap_s", [0.0, 60.0])
def test_a_long_gap_begins_another_cluster(gap_s):
    from pipeline.solver.uncertainty.clusters import _numbered

    video = np.arange(40) / 25 + np.where(np.arange(40) >= 10, gap_s, 0.0)
    found = _numbered(video, 16)
    assert (found[9] == found[10]) == (gap_s == 0.0)
