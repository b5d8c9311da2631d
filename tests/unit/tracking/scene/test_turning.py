"""How the camera turned, by its picture: against homographies made by hand and a rendered flight's truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.geometry import rotation
from pipeline.synthetic.demo_scenes import small_scene
from pipeline.synthetic.landscape import paint
from pipeline.synthetic.render import frames
from pipeline.synthetic.scene import camera_pose
from pipeline.synthetic.video import write_video
from pipeline.tracking import image_turning
from pipeline.tracking.scene.turning import turn_of


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.02), (0.01, 0.0, 0.0), (0.0, -0.03, 0.0), (0.02, 0.03, -0.1)])
def test_a_pure_rotation_is_its_own_homography(turn):
    found = turn_of(3.7 * rotation.matrix(rotation.exp(np.array(turn))))
    np.testing.assert_allclose(found, turn, atol=2e-4 * np.linalg.norm(turn))


def test_a_rendered_flight_shows_its_turns_and_the_ground_passing(tmp_path):
    scene = small_scene()
    camera = replace(scene.cameras[1], frames=40)
    assert scene.landscape is not None
    images = frames(scene, camera, paint(scene.landscape), seed=1)
    write_video(tmp_path / "a.mp4", images, size=camera.lens.image_size, rate_hz=25.0, crf=18)
    seen = image_turning(tmp_path / "a.mp4", camera.lens)
    place, attitude = camera_pose(camera.platform, camera.frame_time_s(np.arange(40)))
    turn = rotation.log(rotation.multiply(rotation.conjugate(attitude[1:]), attitude[:-1]))
    moved = rotation.rotate(rotation.conjugate(attitude[:-1]), np.diff(place, axis=0))
    shift = np.stack([moved[:, 1], -moved[:, 0]], axis=1)
    apart = seen.turn_rad[:, :2] - turn[:, :2]
    near = float((apart * shift).sum() / (shift**2).sum())
    assert 1 / near == pytest.approx(np.linalg.norm(place[20] - [0.0, 4.0, 0.0]), rel=0.1)
    assert np.abs(apart - near * shift).std() < 1e-4  # a fifteenth of a pixel
    np.testing.assert_allclose(seen.frame_time_s, np.arange(40) / 25, atol=1e-3)
