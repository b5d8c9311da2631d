"""What is around a box: how far it went beyond the plane that fits the picture."""

import cv2
import numpy as np
import pytest

from pipeline.tracking.detection.surroundings import surroundings_shift

HERE, SIZE = np.array([160.0, 120.0]), (30, 20)


def ground(seed=1):
    noise = np.random.default_rng(seed).integers(0, 255, (240, 320, 3), np.uint8)
    return cv2.GaussianBlur(noise, (0, 0), 2.0)


def shifted(picture, x, y):
    return cv2.warpAffine(
        picture, np.array([[1.0, 0, x], [0, 1, y]]), picture.shape[1::-1], borderMode=cv2.BORDER_REFLECT
    )


@pytest.mark.parametrize("shift", [(0.0, 0.0), (3.0, -2.0), (-5.0, 4.0)])
def test_surroundings_that_went_elsewhere_than_the_plane(shift):
    """A roof, or a slope: everything around the box moves by as much more."""
    plane = np.array([[1.0, 0, 6.0], [0, 1, 2.0], [0, 0, 1]])
    found = surroundings_shift(ground(), shifted(ground(), 6.0 + shift[0], 2.0 + shift[1]), HERE, SIZE, plane)
    assert np.allclose(found, shift, atol=0.3)


def test_what_is_in_the_box_does_not_count():
    before, now = ground(), ground()
    before[105:135, 140:180], now[105:135, 150:190] = ground(2)[:30, :40], ground(2)[:30, :40]
    assert np.allclose(surroundings_shift(before, now, HERE, SIZE, np.eye(3)), 0, atol=0.3)


def test_where_nothing_is_around_nothing_is_told():
    bare = np.full((240, 320, 3), 90, np.uint8)
    assert surroundings_shift(bare, bare, HERE, SIZE, np.eye(3)).tolist() == [0, 0]
    assert surroundings_shift(ground(), ground(), np.array([-400.0, 10.0]), SIZE, np.eye(3)).tolist() == [0, 0]
