"""What a calibration says to people: where boards were, what to photograph next, whose fault a bad photo is."""

from dataclasses import replace

import numpy as np
import pytest

from calibration import CameraModel, calibrate
from calibration.judgement.coverage import coverage, map_in_words, thin_regions
from calibration.stages.from_views import RESIZED_KEY
from pipeline.synthetic.board_views import camera
from tests.scenes.calibration import BOARD, computed_views


def zoomed(lens, factor):
    K = lens.K * [[factor], [factor], [1]]
    K[:2, 2] = lens.K[:2, 2]
    return replace(lens, K=K)


def moved(lens, dx, dy):
    return replace(lens, K=np.add(lens.K, [[0, 0, dx], [0, 0, dy], [0, 0, 0]]))


def odd_one(lens, other, noise_px=0.02):
    """The reason for which the one view of `other` among those of `lens` is left out."""
    views = computed_views(lens, 15, seed=3, noise_px=noise_px)
    stranger = replace(computed_views(other, 15, seed=3, noise_px=noise_px)[4], name="odd.png")
    found = calibrate([*views[:4], stranger, *views[5:]], BOARD)
    return next((view.reason for view in found.rejected if view.name == "odd.png"), "")


def test_a_photo_of_another_zoom_is_accused_of_it():
    assert "another zoom or focus" in odd_one(camera(), zoomed(camera(), 1.02))


def test_a_photo_of_another_crop_is_not_accused_of_another_zoom():
    reason = odd_one(camera(), moved(camera(), 9.0, -6.0))
    assert "principal point" in reason
    assert "zoom" not in reason


def test_a_photo_whose_board_moved_is_not_accused_of_another_zoom():
    views = computed_views(camera(), 15, seed=3, noise_px=0.02)
    rolled = views[4].corners + (views[4].corners[:, 1:] / 480 - 0.5) * [1.5, 0.0]
    found = calibrate([*views[:4], replace(views[4], corners=rolled, name="odd.png"), *views[5:]], BOARD)
    reasons = [view.reason for view in found.rejected if view.name == "odd.png"]
    assert reasons
    assert "another zoom" not in reasons[0]


def test_boards_are_counted_in_each_part_of_the_picture():
    views = computed_views(camera(), 4, seed=2)
    boards = coverage(views, np.tile(np.eye(3), (4, 1, 1)), np.ones((4, 3))).boards
    assert boards.max() <= 4
    low = [(v.corners[:, 0] < 127.5) & (v.corners[:, 1] < 95.5) for v in views]
    assert boards[0, 0] == sum(inside.any() for inside in low)
    assert len(map_in_words(boards)) == 5


def test_thinly_covered_corners_are_named():
    boards = np.full((5, 5), 6)
    boards[3:, :2] = [[1, 0], [0, 0]]
    assert thin_regions(boards) == (("lower left corner", 1),)


def test_photos_resized_to_another_shape_are_named():
    lens = CameraModel(
        image_size=(640, 360), K=[[540, 0, 322], [0, 405, 178], [0, 0, 1]], distortion=[-0.2, 0.05, 0, 0, 0]
    )
    found = calibrate(computed_views(lens, 12, seed=4), BOARD)
    assert any("resized to another shape" in words for words in found.warnings)


def test_photos_that_say_they_were_larger_are_named():
    views = [replace(v, taken={RESIZED_KEY: "4000x3000"}) for v in computed_views(camera(), 12, seed=4)]
    found = calibrate(views, BOARD)
    assert any("the camera wrote 4000x3000" in words for words in found.warnings)
    assert found.verdict == "usable"
    assert found.camera.made[RESIZED_KEY] == "4000x3000"


def test_the_verdict_says_over_which_part_of_the_picture():
    found = calibrate(computed_views(camera(), 12, seed=5), BOARD)
    assert (
        found.part == f"over the {found.coverage.area:.0%} of the picture that boards reached" or "not at" in found.part
    )


@pytest.mark.parametrize("corner", [0, 4])
def test_what_to_photograph_next_names_the_corner_without_boards(corner):
    size = np.array([640, 480])
    views = [
        v
        for v in computed_views(camera(), 40, seed=6)
        if not ((v.corners[:, 1] < 0.4 * size[1]) & (np.abs(v.corners[:, 0] / size[0] - corner / 4) < 0.4)).any()
    ]
    found = calibrate(views[:12], BOARD)
    assert any(f"upper {'left' if corner == 0 else 'right'} corner" in words for words in found.advice)
