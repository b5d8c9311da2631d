"""What a solution was made of is told apart to the last bit."""

from dataclasses import replace

import numpy as np

from pipeline.records import ImageTrack
from pipeline.stages.running.provenance import tracks_hash

TRACK = ImageTrack(
    camera="a", target="t", frame=np.arange(3), time_s=np.arange(3.0), xy_px=np.ones((3, 2)), sigma_px=np.ones(3),
    state=np.zeros(3, int),
)  # fmt: skip


def test_tracks_that_differ_in_anything_have_another_hash():
    others = [
        replace(TRACK, camera="b"), replace(TRACK, target="u"), replace(TRACK, frame=np.arange(3) + 1),
        replace(TRACK, time_s=np.arange(3.0) + 1e-12), replace(TRACK, xy_px=np.nextafter(TRACK.xy_px, 2)),
        replace(TRACK, sigma_px=2 * TRACK.sigma_px), replace(TRACK, state=np.ones(3, int)),
        replace(TRACK, box=np.ones(3, bool)),
    ]  # fmt: skip
    assert len({tracks_hash([track]) for track in [TRACK, *others]}) == 9
    assert tracks_hash([TRACK, others[0]]) != tracks_hash([others[0], TRACK])
    assert tracks_hash([replace(TRACK)]) == tracks_hash([TRACK])
