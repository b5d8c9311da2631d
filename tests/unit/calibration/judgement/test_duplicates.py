"""The same picture twice counts once, whatever its name."""

from dataclasses import replace

import numpy as np
import pytest

from calibration import CameraModel, calibrate
from calibration.judgement.duplicates import without_copies
from tests.scenes.calibration import BOARD, computed_views

LENS = CameraModel(image_size=(640, 480), K=[[520, 0, 322], [0, 521, 238], [0, 0, 1]], distortion=[-0.2, 0.05, 0, 0, 0])


@pytest.mark.parametrize("copies", [1, 4])
def test_copies_change_neither_sigma_nor_verdict(copies):
    views, random = computed_views(LENS, 9, seed=3), np.random.default_rng(1)
    again = [
        replace(v, name=f"{i}{v.name}", corners=v.corners + random.normal(0, 0.02, v.corners.shape))
        for i in range(copies)
        for v in views
    ]
    once, more = calibrate(views, BOARD), calibrate([*views, *again], BOARD)
    np.testing.assert_array_equal(more.sigma, once.sigma)
    assert (more.verdict, more.warnings) == (once.verdict, once.warnings)
    assert [r.reason for r in more.rejected] == [
        f"the same picture as {v.name}, which counts once" for v in views
    ] * copies


def test_photos_that_a_hand_took_one_after_the_other_are_two():
    first = computed_views(LENS, 1, seed=3)[0]
    moved = replace(first, name="next", corners=first.corners + 0.6)
    other_size = replace(first, name="large", image_size=(1280, 960))
    half = replace(first, name="half", corners=first.corners[:27], index=first.index[:27])
    assert without_copies([first, moved, other_size, half])[1] == []
