from functools import cache

import cv2
import numpy as np
import pytest

from calibration.boards.board import Board
from calibration.detection.find import find_board, looks_like
from calibration.detection.squares import edge_blur_px
from calibration.detection.subpixel import refined
from pipeline.synthetic.board_views import camera, poses, render, true_corners
from tests.scenes.calibration import BOARD, rendered_photos


@cache
def photos(blur_px=0.7, noise=2.0):
    return rendered_photos(camera(), 4, seed=3, blur_px=blur_px, noise=noise)


def errors(view, pose):
    """Found minus true corners; a checkerboard looks the same turned by half a turn up to colour, so either way."""
    true = true_corners(camera(), BOARD, pose)
    return min((view.corners - t[view.index] for t in (true, true[::-1])), key=lambda e: float(np.abs(e).max()))


def test_corners_are_right_to_a_hundredth_of_a_pixel():
    shots, placed = photos()
    found = [find_board(shot, BOARD, "x") for shot in shots]
    off = np.concatenate([errors(view, pose) for view, pose in zip(found, placed, strict=True)])
    assert len(off) == 4 * 54
    assert np.sqrt(np.mean(off**2)) < 0.012
    assert np.abs(off.mean(axis=0)).max() < 0.004


def test_edges_give_twice_the_accuracy_of_corner_sub_pix():
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-3)
    ours, theirs = [], []
    for noise in (2.0, 6.0):
        for shot, pose in zip(*photos(1.0, noise), strict=True):
            true = true_corners(camera(), BOARD, pose)
            start = true.astype(np.float32).reshape(-1, 1, 2)
            fine = cv2.cornerSubPix(cv2.GaussianBlur(shot, (3, 3), 0.8), start, (7, 7), (-1, -1), stop)
            theirs.append(fine.reshape(-1, 2) - true)
            ours.append(refined(shot, true.reshape(6, 9, 2), 1.0).grid.reshape(-1, 2) - true)
    assert np.sqrt(np.mean(np.square(ours))) < 0.5 * np.sqrt(np.mean(np.square(theirs)))


def test_bent_edges_are_no_bias():
    lens = camera(focal=330.0, distortion=(-0.32, 0.12, 0.0, 0.0, -0.02))
    (pose,) = poses(1, 8, lens, BOARD, fill=0.9)
    clean = render(lens, BOARD, pose, noise=0.0, supersample=4)
    true = true_corners(lens, BOARD, pose).reshape(6, 9, 2)
    off = refined(clean, true + 0.4, 1.0).grid - true
    assert np.sqrt(np.mean(off**2)) < 0.01


def test_a_corner_with_a_covered_edge_is_not_whole():
    (shot, *_), (pose, *_) = photos()
    grid = true_corners(camera(), BOARD, pose).reshape(6, 9, 2)
    assert refined(shot, grid, 0.5).whole.all()
    down = (grid[3, 4] - grid[2, 4]) / np.linalg.norm(grid[3, 4] - grid[2, 4])
    good = []
    for side in (-4, 4):  # one of the two squares along the edge is bright: there a dark thing moves the edge
        middle = (0.65 * grid[2, 4] + 0.35 * grid[2, 5] + side * down).round().astype(int)
        found = refined(cv2.circle(shot.copy(), middle.tolist(), 4, 30, -1), grid, 0.5)
        good.append((found.whole & found.seen)[2, 4])
    assert not all(good)
    assert (found.whole & found.seen)[4:, :3].all()


def test_blur_is_measured():
    (shot, *_), (pose, *_) = photos()
    grid = true_corners(camera(), BOARD, pose).reshape(6, 9, 2)
    low, high = edge_blur_px(cv2.GaussianBlur(shot, (0, 0), 1.5), grid)
    assert low == pytest.approx(high, rel=0.15)
    assert low == pytest.approx(np.hypot(1.5, 0.75), rel=0.15)


def test_a_hidden_corner_is_dropped_and_a_hidden_board_is_not_found():
    (shot, *_), (pose, *_) = photos()
    corner = true_corners(camera(), BOARD, pose)[0].round().astype(int)
    covered = cv2.circle(shot.copy(), corner.tolist(), 9, 120, -1)
    view = find_board(covered, BOARD, "x")
    if view is not None:
        assert len(view.index) < 54
        assert np.abs(errors(view, pose)).max() < 0.2
    middle = true_corners(camera(), BOARD, pose).mean(axis=0).round().astype(int)
    assert find_board(cv2.circle(shot.copy(), middle.tolist(), 70, 120, -1), BOARD, "x") is None


def test_no_board_no_view():
    noise = np.random.default_rng(0).integers(0, 255, (240, 320), dtype=np.uint8)
    assert find_board(noise, BOARD, "x") is None
    assert find_board(np.full((240, 320), 90, np.uint8), BOARD, "x") is None
    assert looks_like([noise]) is None


def test_the_true_size_is_named():
    assert looks_like(photos()[0]) == ((9, 6), 4, 4)


def test_charuco_is_found_when_half_of_it_is_hidden():
    board = Board(cols=7, rows=5, square_m=0.03, marker_m=0.021, dictionary="DICT_5X5_100")
    from calibration.boards.charuco import charuco_board

    sheet = charuco_board(board).generateImage((960, 720), marginSize=0)
    place = np.array([[0.9, 0.08, 40], [-0.05, 0.85, 70], [5e-5, 1e-5, 1]])
    shot = cv2.warpPerspective(sheet, place, (960, 720), borderValue=200, flags=cv2.INTER_AREA)
    shot = cv2.GaussianBlur(shot, (0, 0), 0.8)
    true = cv2.perspectiveTransform(board.points_m[None, :, :2] / 0.03 * 120 + 119.5, place)[0]
    whole = find_board(shot, board, "x")
    assert whole is not None
    assert len(whole.index) == 35
    assert np.sqrt(np.mean((whole.corners - true[whole.index]) ** 2)) < 0.1
    shot[:, 480:] = 128
    half = find_board(shot, board, "x")
    assert half is not None
    assert 8 <= len(half.index) < 35
    assert np.abs(half.corners - true[half.index]).max() < 0.5


def test_the_wrong_way_up_costs_nothing():
    lens = camera()
    (shot, *_), _ = photos()
    turned = np.ascontiguousarray(shot[::-1, ::-1])
    view, back = find_board(shot, BOARD, "x"), find_board(turned, BOARD, "x")
    mirrored = np.array(lens.image_size) - 1 - back.corners
    off = min((view.corners - m for m in (mirrored, mirrored[::-1])), key=lambda e: float(np.abs(e).max()))
    assert np.sqrt(np.mean(off**2)) < 0.02


@pytest.mark.parametrize(("cols", "rows"), [(9, 6), (6, 9), (11, 8)])
def test_a_board_with_an_odd_and_an_even_side_is_counted_from_its_own_end(cols, rows):
    board, lens = Board(cols=cols, rows=rows, square_m=0.02), camera()
    shots, placed = rendered_photos(lens, 3, seed=3, board=board)
    for shot, pose in zip(shots, placed, strict=True):
        view = find_board(shot, board, "x")
        back = find_board(np.ascontiguousarray(shot[::-1, ::-1]), board, "x")
        assert np.abs(view.corners - true_corners(lens, board, pose)[view.index]).max() < 0.2
        assert np.abs(np.array(lens.image_size) - 1 - back.corners - view.corners).max() < 0.05


def test_large_photos_are_searched_small_and_refined_large():
    lens = camera(1920, 1440, 1620.0)
    (pose,) = poses(1, 5, lens, BOARD)
    view = find_board(render(lens, BOARD, pose, supersample=1), BOARD, "x")
    true = true_corners(lens, BOARD, pose)
    off = min((view.corners - t for t in (true, true[::-1])), key=lambda e: float(np.abs(e).max()))
    assert np.sqrt(np.mean(off**2)) < 0.01
