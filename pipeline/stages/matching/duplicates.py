"""Boxes that were proposed on one vehicle twice: where they could be followed, they stay on each other."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from pipeline.matching import TrackName
from pipeline.records import Box, ImageTrack

LEAST_COMMON = 10
"""Frames in which both are seen: fewer tell nothing."""
TOUCHING, SHARE = 1.25, 0.9
"""Boxes so many times as large touch in this share of those frames. Larger: cars of a queue become one."""


def duplicates(
    tracks: Sequence[ImageTrack], boxes: Mapping[TrackName, Box], proposed: Collection[str]
) -> dict[TrackName, TrackName]:
    """Tracks of `proposed` targets that are of one vehicle with a track that is followed longer: which, of which."""
    found: dict[TrackName, TrackName] = {}
    kept: list[ImageTrack] = []
    order = sorted(tracks, key=lambda t: (t.target in proposed, -int(t.seen.sum()), t.camera, t.target))
    for track in order:
        name = TrackName(camera=track.camera, target=track.target)
        if track.target in proposed and name in boxes:
            for other in kept:
                longer = TrackName(camera=other.camera, target=other.target)
                if (
                    other.camera == track.camera
                    and longer in boxes
                    and _together(track, other, boxes[name], boxes[longer])
                ):
                    found[name] = longer
                    break
        if name not in found:
            kept.append(track)
    return found


def _together(one: ImageTrack, other: ImageTrack, box: Box, other_box: Box) -> bool:
    _, mine, its = np.intersect1d(one.frame[one.seen], other.frame[other.seen], return_indices=True)
    if len(mine) < LEAST_COMMON:
        return False
    apart = np.abs(one.xy_px[one.seen][mine] - other.xy_px[other.seen][its])
    reach = TOUCHING * 0.5 * np.array([box.width + other_box.width, box.height + other_box.height])
    return bool((apart < reach).all(axis=1).mean() > SHARE)
