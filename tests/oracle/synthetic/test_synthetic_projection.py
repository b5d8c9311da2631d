"""The scene's pixels against OpenCV's own projection with rotation matrices (paper eq. 1)."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.synthetic.scene import pixels_of
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import true_poses


def test_pixels_are_those_of_opencv():
    scene = paper_scene(order=2, targets=4)
    for camera in scene.cameras:
        pose = true_poses(camera)
        for target in scene.targets:
            points = target.motion.position_enu_m(pose.time_s)
            pixels, _ = pixels_of(camera, pose.frame, points)
            for f in range(0, camera.frames, 7):
                w, x, y, z = pose.enu_from_cam[f]
                R = Rotation.from_quat([x, y, z, w]).as_matrix().T
                want, _ = cv2.projectPoints(
                    points[f].reshape(1, 1, 3),
                    cv2.Rodrigues(R)[0],
                    -R @ pose.position_enu_m[f],
                    camera.lens.K,
                    camera.lens.distortion,
                )
                assert np.abs(want.ravel() - pixels[f]).max() < 1e-6


def test_right_of_the_sight_ray_is_right_and_up_is_above():
    scene = paper_scene(targets=1)
    camera = scene.cameras[0]
    centre = true_poses(camera).position_enu_m[0]
    middle = np.array([0.0, 0.0, 8.0])
    right = np.cross(middle - centre, [0.0, 0.0, 1.0])
    points = np.stack([middle, middle + 0.05 * right, middle + np.array([0.0, 0.0, 10.0])])
    pixels = np.concatenate([pixels_of(camera, np.array([0]), p[None])[0] for p in points])
    assert pixels[1, 0] > pixels[0, 0] + 5
    assert pixels[2, 1] < pixels[0, 1] - 5
