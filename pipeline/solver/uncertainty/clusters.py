"""Which sightings' errors belong together: runs of frames of one camera, as long as its residuals remember.

A tracker that is off by a pixel is off by about as much in the next frame, and an attitude error fades over seconds.
The memory is the lag at which the autocorrelation of a camera's residuals (and of its frames' own pose errors) has
fallen below a tenth; a cluster is four times that long, but never so long that fewer than `FEWEST` would be left.

Residuals are less alike than the errors they come from, since what is adjusted follows the slow ones, and a short
flight has room for few clusters. Where errors last for a tenth of a flight, robust sigmas of clocks are too small
(`scripts/validation/check_correlated_errors.py`); what lasts for all of it has to be a parameter, as place errors are.
"""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.solver.adjustment.model import Model, State

FADED, LONGER, FEWEST = 0.1, 4, 12
MOST = 120
"""Clusters of one camera where every unknown touches all of its frames (no splines): more would only cost time."""


def memory_frames(series: Floats, known: Floats) -> int:
    """Frames until the autocorrelation of `series` (n, k) falls below FADED; rows not `known` (n,) are out."""
    masked = series * known[:, None]
    power = float((masked**2).sum()) / max(float(known.sum()), 1.0)
    lag = 1
    while power > 0 and lag < len(series) // (2 * FEWEST):
        both = known[:-lag] * known[lag:]
        if both.sum() < FEWEST:
            break
        correlation = float((masked[:-lag] * masked[lag:]).sum()) / float(both.sum()) / power
        if correlation < max(FADED, 2 / np.sqrt(float(both.sum()))):
            break
        lag *= 2
    return lag if lag > 1 else 0


def clusters(model: Model, state: State, residual: Floats) -> Ints:
    """(F,) number of every frame's cluster, from 0; `residual` (F, N, 2) in sigmas."""
    frames = model.frames
    weight = np.sqrt(model.loss.weight((residual**2).sum(-1))) * frames.seen
    flat = (residual * weight[..., None]).reshape(frames.count, -1)
    out = np.empty(frames.count, dtype=np.int64)
    local = any(t.kind == "spline" for t in model.basis.targets)
    first = 0
    for c in range(len(frames.cameras)):
        part = frames.of(c)
        known = frames.seen[part].any(axis=1).astype(float)
        lag = memory_frames(flat[part], known)
        if model.pose.spread[c].any():
            lag = max(lag, memory_frames(state.own[part], known))
        count = part.stop - part.start
        length = min(max(1, LONGER * lag, 1 if local else -(-count // MOST)), max(1, count // FEWEST))
        number = _numbered(frames.video_s[part], length)
        out[part] = first + number
        first += int(number[-1]) + 1
    return out


def _numbered(video_s: Floats, length: int) -> Ints:
    """(n,) clusters of `length` frames, from 0; a gap in which as many would have fitted begins another one."""
    step = np.diff(video_s, prepend=video_s[:1])
    gaps = np.cumsum(step > length * float(np.median(step)))
    both: Ints = np.arange(len(video_s)) // length + gaps
    return np.asarray(np.unique(both, return_inverse=True)[1], dtype=np.int64)
