"""Rendered pixels lie where the camera model says, to a few hundredths of a pixel, and survive the encoder."""

from __future__ import annotations

import builtins
from dataclasses import replace

import cv2
import numpy as np
import pytest

from calibration.foundation.errors import UsageError, WriteError
from pipeline.synthetic.demo_scenes import demo_scene, small_scene
from pipeline.synthetic.landscape import Country, paint
from pipeline.synthetic.render import Optics, draw_vehicle, frames, ground_seen, ray_table, view_at
from pipeline.synthetic.vehicles import Body, axes_of
from pipeline.synthetic.video import write_video

SMALL = small_scene()


def centroid(image, near, reach):
    x, y = (round(float(v)) for v in near)
    part = image[y - reach : y + reach + 1, x - reach : x + reach + 1].astype(float)
    rows, columns = np.mgrid[y - reach : y + reach + 1, x - reach : x + reach + 1]
    return np.array([(part * columns).sum(), (part * rows).sum()]) / part.sum()


def middle_of(corners):
    """The centroid of a polygon's area: perspective puts it a little off the projected centre."""
    ahead = np.roll(corners, -1, axis=0)
    cross = corners[:, 0] * ahead[:, 1] - ahead[:, 0] * corners[:, 1]
    return ((corners + ahead) * cross[:, None]).sum(axis=0) / (3 * cross.sum())


def flat_body(half_length, half_width):
    """A white roof and nothing else."""
    a, b = half_length, half_width
    roof = np.array([[a, b, 0.0], [-a, b, 0.0], [-a, -b, 0.0], [a, -b, 0.0]])
    return Body(shadow=roof * 0.01, walls=(), facing=(), wall_colour=(), roof=(roof,), roof_colour=((255, 255, 255),))


def test_a_vehicle_moves_by_fractions_of_a_pixel():
    scene = demo_scene()
    target, body = scene.targets[0], flat_body(2.3, 1.1)
    for camera in scene.cameras:
        errors = []
        for frame in range(200, 230):
            time = float(camera.frame_time_s(np.array([frame]))[0])
            view = view_at(camera, time)
            centre, turn = axes_of(target, time)
            image = np.zeros((720, 1280, 3), np.uint8)
            draw_vehicle(image, view, body, centre, turn)
            corners = view.pixels(centre + body.roof[0] @ turn.T)
            where = middle_of(corners)
            errors.append(centroid(image[:, :, 1], where, 16) - where)
            assert np.abs(where - view.pixels(centre[None])[0]).max() < 0.06
        assert np.abs(errors).max() < 0.02
        assert np.abs(np.mean(errors, axis=0)).max() < 0.005


def test_the_ground_is_where_the_lens_puts_it():
    camera = SMALL.cameras[0]
    view, rays = view_at(camera, 2.0), ray_table(camera.lens)
    texel, size = 0.05, 1400
    for east, north in ((-20.0, 10.0), (3.0, -14.0), (22.0, 20.0)):
        half = size * texel / 2
        column, row = (east + half) / texel - 0.5, (half - north) / texel - 0.5
        rows, columns = np.ogrid[0:size, 0:size]
        spot = 250 * np.exp(-((columns - column) ** 2 + (rows - row) ** 2) / (2 * 12.0**2))
        ground = np.repeat(np.round(spot).astype(np.uint8)[:, :, None], 3, axis=2)
        to_texel = np.array([[1 / texel, 0, half / texel - 0.5], [0, -1 / texel, half / texel - 0.5], [0, 0, 1.0]])
        country = Country(ground=ground, texel_from_plane=to_texel, solids=(), bridge=None)
        where = view.pixels(np.array([[east, north, 0.0]]))[0]
        seen = ground_seen(view, country, rays)[:, :, 1]
        assert np.abs(centroid(seen, where, 12) - where).max() < 0.03


@pytest.fixture(scope="module")
def country():
    return paint(replace(SMALL.landscape, half_size_m=160.0, texel_m=0.5))


def test_same_seed_same_frames_and_the_vehicles_are_in_them(country):
    camera = replace(SMALL.cameras[0], frames=2)
    one, two = list(frames(SMALL, camera, country, seed=4)), list(frames(SMALL, camera, country, seed=4))
    assert all(np.array_equal(a, b) for a, b in zip(one, two, strict=True))
    other = next(frames(SMALL, camera, country, seed=5))
    assert not np.array_equal(one[0], other)
    bare = replace(SMALL, targets=())
    clean = Optics(blur_px=0.0, noise=0.0)
    with_, without = (next(frames(s, camera, country, seed=4, optics=clean)) for s in (SMALL, bare))
    touched = (with_ != without).any(axis=2)
    assert 300 < touched.sum() < 3000


def test_noise_and_blur_are_those_asked_for(country):
    camera = replace(SMALL.cameras[0], frames=1)
    quiet, loud = (
        next(frames(SMALL, camera, country, seed=4, optics=Optics(blur_px=0.6, noise=n))) for n in (0.0, 3.0)
    )
    assert np.std(loud.astype(float) - quiet) == pytest.approx(3.0, rel=0.03)


def test_landscape_is_reproducible(country):
    again = paint(replace(SMALL.landscape, half_size_m=160.0, texel_m=0.5))
    assert np.array_equal(again.ground, country.ground)
    assert again.ground.std() > 10


def spots(count, size=(320, 192)):
    """Soft spots that wander by fractions of a pixel: images and where the spots are."""
    width, height = size
    rows, columns = np.mgrid[0:height, 0:width]
    for k in range(count):
        image, places = np.full((height, width), 90.0), []
        for i in range(3):
            for j in range(5):
                x, y = 35 + 61.3 * j + 0.17 * k, 33 + 60.7 * i + 0.23 * k
                image += 120 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / 50)
                places.append((x, y))
        grey = np.round(image).astype(np.uint8)
        yield cv2.merge([grey, grey, grey]), places


def decoded(path):
    video = cv2.VideoCapture(str(path))
    while True:
        ok, image = video.read()
        if not ok:
            return
        yield video.get(cv2.CAP_PROP_POS_MSEC), image


def test_the_encoder_moves_nothing_and_its_times_are_exact(tmp_path):
    made = list(spots(6))
    path = tmp_path / "a.mp4"
    assert write_video(path, (image for image, _ in made), size=(320, 192), rate_hz=25.0) == 6
    errors = []
    for k, (ms, image) in enumerate(decoded(path)):
        assert ms == pytest.approx(40.0 * k, abs=1e-6)
        raw, places = made[k]
        for place in places:
            errors.append(
                centroid(image[:, :, 1].astype(float) - 88, place, 15)
                - centroid(raw[:, :, 1].astype(float) - 88, place, 15)
            )
    assert len(errors) == 6 * 15
    assert np.abs(np.mean(errors, axis=0)).max() < 0.02
    assert np.std(errors) < 0.12


def test_same_frames_same_bytes(tmp_path):
    for name in ("a.mp4", "b.mp4"):
        write_video(tmp_path / name, (image for image, _ in spots(4)), size=(320, 192), rate_hz=25.0)
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()


def test_a_video_appears_whole_or_not_at_all(tmp_path):
    def broken():
        for k, (image, _) in enumerate(spots(5)):
            if k == 3:
                raise RuntimeError("the camera fell off")
            yield image

    with pytest.raises(RuntimeError, match="fell off"):
        write_video(tmp_path / "a.mp4", broken(), size=(320, 192), rate_hz=25.0)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_a_file_is_one_clear_error(tmp_path):
    (tmp_path / "out").write_text("not a folder")
    with pytest.raises(WriteError, match="cannot be written"):
        write_video(tmp_path / "out" / "a.mp4", [], size=(320, 192), rate_hz=25.0)


def test_an_encoder_that_fails_is_one_clear_error(tmp_path):
    with pytest.raises(WriteError):
        write_video(tmp_path / "a.mp4", (image for image, _ in spots(2)), size=(321, 193), rate_hz=25.0)
    assert list(tmp_path.iterdir()) == []


def test_without_an_encoder_the_message_says_what_to_install(tmp_path, monkeypatch):
    real = builtins.__import__

    def no_ffmpeg(name, *args, **kwargs):
        if name == "imageio_ffmpeg":
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", no_ffmpeg)
    with pytest.raises(UsageError, match=r"runningfix\[demo\]"):
        write_video(tmp_path / "a.mp4", [], size=(320, 192), rate_hz=25.0)
