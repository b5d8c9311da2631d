"""A camera for other pictures of the same sensor, checked on pixels of directions; and its refusals."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration import CameraModel, read_camera, write_camera
from calibration.camera import project
from calibration.foundation.errors import UsageError
from calibration.picture import Area, Picture, fitted, for_pictures, scaled, turned

TERMS = [-0.2, 0.05, 0.003, -0.002, 0.01, 0.1, 0.02, 0.01, 0.001, 0.002, -0.003, 0.004]
CAMERA = CameraModel(image_size=(800, 500), K=[[600, 0, 410], [0, 605, 240], [0, 0, 1]], distortion=TERMS)
POINTS = np.column_stack([np.random.default_rng(0).uniform(-0.5, 0.5, (40, 2)), np.ones(40)])
NAMES = {"file": Path("c.json"), "video": Path("v.mp4"), "where": "f.toml: cameras.a.calibration"}


@pytest.mark.parametrize("lens", ["pinhole", "fisheye"])
def test_turned_pictures_show_turned_directions(lens):
    camera = CAMERA if lens == "pinhole" else replace(CAMERA, model="fisheye", distortion=TERMS[:4])
    x, y = project(camera, POINTS).T
    quarter = POINTS @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(project(turned(camera, 90), quarter), np.stack([499 - y, x], 1), atol=1e-9)
    np.testing.assert_allclose(project(turned(camera, 180), POINTS * [-1, -1, 1]), [799, 499] - np.stack([x, y], 1))
    back = turned(turned(camera, 90), 270)
    np.testing.assert_allclose(back.K, camera.K)
    np.testing.assert_allclose(back.distortion, camera.distortion)
    assert turned(camera, 270).image_size == (500, 800)


def test_a_turn_takes_the_covariance_with_it():
    spread = np.diag(np.arange(1.0, 17.0))
    made = turned(replace(CAMERA, covariance=spread), 90)
    assert np.diag(made.covariance)[:4].tolist() == [2, 1, 4, 3]
    assert np.diag(made.covariance)[[6, 7]].tolist() == [8, 7]


def test_a_crop_scaled_keeps_the_edges_of_pixels():
    made = scaled(CAMERA, Area(crop=(80, 50, 640, 400), of=(800, 500)), (1280, 800))
    before, after = project(CAMERA, POINTS), project(made, POINTS)
    np.testing.assert_allclose(after, (before + 0.5 - [80, 50]) * 2 - 0.5)
    assert made.image_size == (1280, 800)
    assert made.made["area"] == "640 x 400 from 80, 50 of 800x500, scaled to 1280x800"
    spread = scaled(replace(CAMERA, covariance=np.eye(16)), Area(crop=(0, 0, 800, 500), of=(800, 500)), (1600, 1000))
    assert np.diag(spread.covariance).tolist() == [4] * 4 + [1] * 12


@pytest.mark.parametrize(
    ("crop", "of", "size", "words"),
    [
        ((0, 0, 800, 500), (1600, 1000), (400, 250), "a part of 800x500"),
        ((100, 0, 800, 500), (800, 500), (800, 500), "from 100, 0"),
        ((0, 0, 800, 500), (800, 500), (800, 450), "0.9000 down"),
        ((-1, 0, 80, 50), (800, 500), (80, 50), "from -1, 0"),
    ],
)
def test_areas_that_cannot_be(crop, of, size, words):
    with pytest.raises(UsageError, match=words):
        scaled(CAMERA, Area(crop=crop, of=of), size)


@pytest.mark.parametrize(
    ("picture", "words"),
    [
        (
            Picture(size=(400, 250)),
            (
                "c.json is of 800x500 pictures, v.mp4 of 400x250",
                "camera scale c.json --to 400x250",
                "crop = [0, 0, 800, 500]",
            ),
        ),
        (Picture(size=(1200, 750)), ("800x500", "1200x750")),
        (Picture(size=(500, 800)), ("--turn 90",)),
        (Picture(size=(800, 450)), ("crop = [0, 25, 800, 450], of = [800, 500]", "whole width")),
        (Picture(size=(600, 500)), ("crop = [100, 0, 600, 500], of = [800, 500]", "whole height")),
        (Picture(size=(800, 500), turned_deg=180), ("turned by 180 degrees", "--turn 180")),
        (Picture(size=(500, 800), turned_deg=270), ("turned by 270 degrees", "--turn 270")),
        (Picture(size=(800, 500), sample_aspect=4 / 3), ("1.333 times as wide", "fx / fy = 0.7500", "setsar=1")),
    ],
)
def test_a_camera_of_other_pictures_is_refused_with_the_line_that_makes_it_right(picture, words):
    camera = replace(CAMERA, made={"turned_deg": 0})
    with pytest.raises(UsageError) as caught:
        fitted(camera, picture, **NAMES)
    assert [word for word in words if word not in str(caught.value)] == []
    assert caught.value.where == NAMES["where"]


def test_what_fits_is_left_as_it_is_and_an_area_is_taken():
    assert fitted(CAMERA, Picture(size=(800, 500)), **NAMES) is CAMERA
    whole = Area(crop=(0, 0, 800, 500), of=(800, 500))
    np.testing.assert_array_equal(fitted(CAMERA, Picture(size=(800, 500)), area=whole, **NAMES).K, CAMERA.K)
    part = Area(crop=(0, 25, 800, 450), of=(800, 500))
    assert fitted(CAMERA, Picture(size=(1600, 900)), area=part, **NAMES).image_size == (1600, 900)
    with pytest.raises(UsageError, match=r"f.toml.*of = \[800, 500\]"):
        fitted(CAMERA, Picture(size=(1600, 900)), area=replace(part, of=(900, 500)), **NAMES)


def test_wide_pixels_fit_a_camera_of_wide_pixels():
    wide = replace(CAMERA, K=[[450, 0, 410], [0, 600, 240], [0, 0, 1]])
    assert fitted(wide, Picture(size=(800, 500), sample_aspect=4 / 3), **NAMES) is wide


def test_a_file_without_a_size_is_held_by_its_middle():
    camera = replace(CAMERA, image_size=(0, 0))
    assert fitted(camera, Picture(size=(800, 500)), **NAMES).image_size == (800, 500)
    with pytest.raises(UsageError, match=r"that of 821 x 481 pictures; v\.mp4 is 1600x1000"):
        fitted(camera, Picture(size=(1600, 1000)), **NAMES)


def test_for_a_video_of_the_same_shape_it_is_scaled_and_turned_by_the_tag():
    camera = replace(CAMERA, made={"turned_deg": 0})
    made = for_pictures(camera, Picture(size=(250, 400), turned_deg=90), **NAMES)
    assert made.image_size == (250, 400)
    assert made.made["turned_deg"] == 90
    np.testing.assert_allclose(made.K[0, 2], (499 - 240 + 0.5) / 2 - 0.5)
    with pytest.raises(UsageError, match="whole width"):
        for_pictures(camera, Picture(size=(1920, 1080)), **NAMES)
    part = Area(crop=(0, 25, 800, 450), of=(800, 500))
    assert for_pictures(camera, Picture(size=(1920, 1080)), crop=part, **NAMES).image_size == (1920, 1080)


def test_the_file_of_a_corner_of_the_picture_is_read_again(tmp_path):
    corner = scaled(CAMERA, Area(crop=(0, 0, 400, 250), of=(800, 500)), (400, 250))
    write_camera(tmp_path / "corner.json", corner)
    assert read_camera(tmp_path / "corner.json").K[0, 2] == 410
