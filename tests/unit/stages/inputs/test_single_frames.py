"""Single frames are those that decoding everything gives, and cost what is decoded from their key frame on."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.foundation.capture import Capture, FrameIndex
from pipeline.stages.inputs.single_frames import affordable, frames_of
from pipeline.tracking import indexed_times
from tests.scenes.video import encoded, panning, written


def index_of(entry: list[int], *, seekable: bool = True) -> FrameIndex:
    return FrameIndex(stamp_s=np.arange(len(entry)) / 25, entry=np.array(entry), hidden=0, seekable=seekable)


@pytest.mark.parametrize(
    ("frames", "most", "chosen", "cost"),
    [
        ([0, 10], 0, {0, 10}, 0),
        ([7, 17], 13, {7}, 7),
        ([7, 17], 14, {7, 17}, 14),
        ([7, 5, 9], 9, {5, 7, 9}, 9),
        ([19, 3], 5, {3}, 3),
        ([25, -1], 100, set(), 0),
    ],
)
def test_a_frame_costs_what_is_decoded_from_its_key_frame_on(frames, most, chosen, cost):
    index = index_of([0] * 10 + [400] * 10)
    assert affordable(frames, index, most) == (chosen, cost)


def test_without_seeking_a_frame_costs_all_before_it():
    assert affordable([12], index_of([0] * 10 + [400] * 10, seekable=False), 100) == ({12}, 12)


@pytest.mark.parametrize("wanted", [[0], [3, 4, 29], [0, 9, 10, 11, 28], [29]])
def test_sought_frames_are_those_that_decoding_everything_gives(tmp_path, wanted):
    path = encoded(written(tmp_path / "all.avi", panning(30)), tmp_path / "group.mp4", "-g", "10", "-bf", "2")
    _, index = indexed_times(path)
    capture = Capture(path)
    whole = {shot.number: capture.pixels(shot) for shot in capture.shots()}
    capture.close()
    capture = Capture(path)
    found = dict(frames_of(capture, wanted, index))
    capture.close()
    assert list(found) == wanted
    assert all(np.array_equal(found[n], whole[n]) for n in wanted)
