"""What a change of focal length does to sight rays, against OpenCV with the changed camera matrix."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.camera import CameraModel, focal_effect, unproject

K = np.array([[900.0, 0, 960], [0, 905, 540], [0, 0, 1]])
BARREL = np.array([-0.26, 0.075, 0.0, 0.0, -0.009])
TANGENTIAL = BARREL + np.array([0.0, 0.0, 1e-3, -2e-3, 0.0])
LENSES = {
    "plain": CameraModel(image_size=(1920, 1080), K=K, distortion=np.zeros(0)),
    "barrel": CameraModel(image_size=(1920, 1080), K=K, distortion=BARREL),
    "tangential": CameraModel(image_size=(1920, 1080), K=K, distortion=TANGENTIAL),
    "fisheye": CameraModel(model="fisheye", image_size=(1920, 1080), K=K, distortion=np.array([0.02, -0.01, 0, 0])),
}
PIXELS = np.stack(np.meshgrid([250.0, 500, 960, 1300, 1700], [60.0, 300, 540, 1020]), axis=-1).reshape(-1, 2)


def tangent(rays):
    return np.hypot(rays[:, 0], rays[:, 1]) / rays[:, 2]


@pytest.mark.parametrize("name", LENSES)
@pytest.mark.parametrize("phi", [-0.02, -0.007, 0.013, 0.02])
def test_against_the_scaled_camera_matrix(name, phi):
    lens = LENSES[name]
    rays = unproject(lens, PIXELS)
    a, b = focal_effect(lens, rays).T
    longer = np.array([[np.exp(phi), 0, -960 * np.expm1(phi)], [0, np.exp(phi), -540 * np.expm1(phi)], [0, 0, 1]])
    other = replace(lens, K=longer @ K)
    foretold = tangent(rays) * np.exp(-(a * phi + 0.5 * b * phi**2))
    wanted = tangent(unproject(other, PIXELS))
    away_px = 900 * np.abs(foretold - wanted)
    assert away_px.max() < (0.05 if name in ("plain", "barrel") else 0.3)
    if name == "plain":
        np.testing.assert_allclose(a, 1, atol=1e-6)
        np.testing.assert_allclose(b, 0, atol=1e-4)
    else:  # to take every lens as plain would be wrong by pixels
        assert 900 * np.abs(tangent(rays) * np.exp(-phi) - wanted).max() > 40 * abs(phi)


def test_at_the_edge_of_what_the_distortion_reaches():
    """Beyond this pixel nothing is mapped, so the effect is told from the inside; on the axis there is none."""
    lens = CameraModel(image_size=(1920, 1080), K=K, distortion=np.array([-0.35, 0.0, 0, 0]))
    out = 960 + np.arange(0.0, 900)
    pixels = np.stack([out, np.full(900, 540.0)], axis=1)
    rays = unproject(lens, pixels)
    reached = np.isfinite(rays[:, 0])
    assert 100 < reached.sum() < 900
    effect = focal_effect(lens, rays[reached])
    assert np.isfinite(effect).all()
    np.testing.assert_array_equal(effect[0], [1, 0])
    assert (effect[1:, 0] > 0.999).all()
