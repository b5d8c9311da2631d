"""Files of other programs, told by their own keys: read right, or refused by the program's name."""

import json

import numpy as np
import pytest

from calibration import read_camera
from calibration.foundation.errors import InputFileError

K = [[560.5, 0, 640.25], [0, 561.5, 360.75], [0, 0, 1]]
FLAT = [560.5, 561.5, 640.25, 360.75]
BENT = [0.05, -0.01, 0.002, -0.0005]


def read(tmp_path, content, name="camera.json", **options):
    path = tmp_path / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return read_camera(path, **options)


GYROFLOW = {
    "camera_model": "HERO9",
    "calib_dimension": {"w": 1280, "h": 720},
    "orig_dimension": {"w": 3840, "h": 2160},
    "fisheye_params": {"camera_matrix": K, "distortion_coeffs": BENT},
}
NERF = {"fl_x": 560.5, "fl_y": 561.5, "cx": 640.75, "cy": 361.25, "w": 1280, "h": 720, "frames": []}
MRCAL = (
    "# by hand\n"
    "{'lensmodel': 'LENSMODEL_OPENCV4', 'intrinsics': [560.5, 561.5, 640.25, 360.75, .05, -.01, .002, -5e-4],\n"
    " 'imagersize': [1280, 720]}"
)
KB = (
    "%YAML:1.0\n"
    "---\n"
    "model_type: KANNALA_BRANDT\n"
    "camera_name: c\n"
    "image_width: 1280\n"
    "image_height: 720\n"
    "projection_parameters:\n"
    "   k2: 0.05\n"
    "   k3: -0.01\n"
    "   k4: 0.002\n"
    "   k5: -0.0005\n"
    "   mu: 560.5\n"
    "   mv: 561.5\n"
    "   u0: 640.25\n"
    "   v0: 360.75\n"
)
VINS = (
    "model_type: PINHOLE\n"
    "image_width: 1280\n"
    "image_height: 720\n"
    "distortion_parameters: {k1: 0.05, k2: -0.01, p1: 0.002, p2: -0.0005}\n"
    "projection_parameters: {fx: 560.5, fy: 561.5, cx: 640.25, cy: 360.75}\n"
)
ORB = (
    "%YAML:1.0\n"
    'Camera.type: "KannalaBrandt8"\n'
    "Camera1.fx: 560.5\nCamera1.fy: 561.5\nCamera1.cx: 640.25\nCamera1.cy: 360.75\n"
    "Camera1.k1: 0.05\nCamera1.k2: -0.01\nCamera1.k3: 0.002\nCamera1.k4: -0.0005\n"
    "Camera.width: 1280\nCamera.height: 720\n"
)
OKVIS = (
    "cameras:\n"
    "  - {T_SC: [1, 0], image_dimension: [1280, 720], distortion_coefficients: [0.05, -0.01, 0.002, -0.0005], "
    "distortion_type: radialtangential, focal_length: [560.5, 561.5], principal_point: [640.25, 360.75]}\n"
)
BASALT = {
    "value0": {
        "intrinsics": [
            {
                "camera_type": "kb4",
                "intrinsics": {
                    "fx": 560.5,
                    "fy": 561.5,
                    "cx": 640.25,
                    "cy": 360.75,
                    "k1": 0.05,
                    "k2": -0.01,
                    "k3": 0.002,
                    "k4": -0.0005,
                },
            }
        ],
        "resolution": [[1280, 720]],
    }
}


@pytest.mark.parametrize(
    ("content", "lens"),
    [
        (GYROFLOW, "fisheye"),
        (MRCAL, "pinhole"),
        (KB, "fisheye"),
        (VINS, "pinhole"),
        (ORB, "fisheye"),
        (OKVIS, "pinhole"),
        (BASALT, "fisheye"),
        ("# Camera list\n1 OPENCV 1280 720 560.5 561.5 640.75 361.25 0.05 -0.01 0.002 -0.0005\n", "pinhole"),
        ("1 OPENCV_FISHEYE 1280 720 560.5 561.5 640.75 361.25 0.05 -0.01 0.002 -0.0005\n", "fisheye"),
        ({**NERF, "camera_model": "OPENCV", "k1": 0.05, "k2": -0.01, "p1": 0.002, "p2": -0.0005}, "pinhole"),
        ({**NERF, "is_fisheye": True, "k1": 0.05, "k2": -0.01, "k3": 0.002, "k4": -0.0005}, "fisheye"),
        (
            {"fisheye_model": 1, "camera_matrix": K, "distortion_coefficients": BENT, "image_size": [1280, 720]},
            "fisheye",
        ),
        ({"distortion_model": "kannala_brandt", "K": K, "D": BENT, "width": 1280, "height": 720}, "fisheye"),
    ],
)
def test_read_right(tmp_path, content, lens):
    found = read(tmp_path, content, "camera.txt")
    assert found.model == lens
    assert found.image_size == (1280, 720)
    np.testing.assert_allclose(found.K[[0, 1, 0, 1], [0, 1, 2, 2]], FLAT)
    np.testing.assert_allclose(found.distortion[:4], BENT)
    assert not found.distortion[4:].any()


@pytest.mark.parametrize(
    ("content", "named"),
    [
        ("<?xml version='1.0'?><calibration><projection>frame</projection><f>3676</f></calibration>", "Agisoft"),
        ("<x:xmpmeta xmlns:x='adobe:ns:meta/'><a/></x:xmpmeta>", "RealityCapture"),
        ("<camera><f>1</f></camera>", "<camera>"),
        ("IDENT Camera_0\nFOCAL 8.8\nXPOFF 0.01\nYPOFF -0.01\n", "Pix4D"),
        ({"v2 dji": {"projection_type": "brown", "width": 5472, "height": 3648, "focal_x": 0.67}}, "OpenSfM"),
        ({"IntrinsicMatrix": K, "RadialDistortion": [0, 0]}, "MATLAB"),
        (
            {"intrinsic": {"width": 1280, "height": 720, "intrinsic_matrix": [560.5, 0, 0, 0, 561.5, 0, 640, 360, 1]}},
            "Open3D",
        ),
        ({"camera_angle_x": 0.7, "frames": []}, "NeRF"),
        ({"intrinsics": [{"intrinsicId": "1", "type": "radial3"}]}, "Meshroom"),
        ({**GYROFLOW, "distortion_model": "sony"}, "gyroflow's sony"),
        ({**GYROFLOW, "digital_lens": "gopro_superview"}, "gopro"),
        ("1 SIMPLE_RADIAL_FISHEYE 10 10 1 2 3 4\n", "COLMAP's SIMPLE_RADIAL_FISHEYE"),
        (MRCAL.replace("OPENCV4", "CAHVOR"), "mrcal's LENSMODEL_CAHVOR"),
        (KB.replace("KANNALA_BRANDT", "MEI"), "MEI"),
        ({"K": K, "D": BENT, "xi": 1.2, "image_size": [1280, 720]}, "omnidirectional"),
        ({"camera_model": "omni", "distortion_model": "radtan", "intrinsics": FLAT, "resolution": [1280, 720]}, "omni"),
        ({"camera_model": "ds", "distortion_model": "none", "intrinsics": FLAT, "resolution": [1280, 720]}, "ds"),
        ({"fisheye": True, "distortion_model": "plumb_bob", "K": K, "D": BENT}, "a fisheye, while distortion_model"),
        ({"value0": {"intrinsics": [{"camera_type": "ds", "intrinsics": {}}]}}, "Basalt's 'ds'"),
        ({**NERF, "frames": [{"fl_x": 1.0}]}, "for each frame"),
        ('{"K": [1], "K": [2]}', "'K' twice"),
        ("<opencv_storage><a>1</a><a>2</a></opencv_storage>", "'a' twice"),
    ],
)
def test_refused_by_name(tmp_path, content, named):
    with pytest.raises(InputFileError) as caught:
        read(tmp_path, content, "camera.txt")
    assert named in str(caught.value)


@pytest.mark.parametrize(
    "keys",
    [
        ("M1", "D1", "M2", "D2"),
        ("cameraMatrix1", "distCoeffs1", "cameraMatrix2", "distCoeffs2"),
        ("left_camera_matrix", "left_distortion_coefficients", "right_camera_matrix", "right_distortion_coefficients"),
    ],
)
def test_of_a_stereo_pair_one_must_be_named(tmp_path, keys):
    other = [[999, 0, 640], [0, 999, 360], [0, 0, 1]]
    pair = dict(zip(keys, (K, BENT, other, [0, 0, 0, 0]), strict=True))
    with pytest.raises(InputFileError, match=f"2 cameras: {keys[0]}, {keys[2]}.*--camera {keys[0]}"):
        read(tmp_path, pair)
    assert read(tmp_path, pair, camera=keys[2]).K[0, 0] == 999
    np.testing.assert_allclose(read(tmp_path, pair, camera=keys[0]).distortion, BENT)


def test_ros_sends_a_region_of_the_sensor_in_bins(tmp_path):
    info = {
        "K": [1000, 0, 800, 0, 1000, 600, 0, 0, 1],
        "D": [0, 0, 0, 0, 0],
        "width": 1600,
        "height": 1200,
        "distortion_model": "plumb_bob",
    }
    plain = read(tmp_path, {**info, "binning_x": 1, "roi": {"x_offset": 0, "y_offset": 0, "width": 0, "height": 0}})
    assert plain.image_size == (1600, 1200)
    sent = read(
        tmp_path,
        {
            **info,
            "binning_x": 2,
            "binning_y": 2,
            "roi": {"x_offset": 200, "y_offset": 100, "width": 1200, "height": 1000},
        },
    )
    assert sent.image_size == (600, 500)
    np.testing.assert_allclose(
        sent.K, [[500, 0, (800.5 - 200) / 2 - 0.5], [0, 500, (600.5 - 100) / 2 - 0.5], [0, 0, 1]]
    )
    with pytest.raises(InputFileError, match="roi"):
        read(tmp_path, {**info, "roi": {"x_offset": 1000, "y_offset": 0, "width": 1200, "height": 1000}})


@pytest.mark.parametrize(
    ("matrix", "size", "words"),
    [
        ([[0.8, 0, 0.5], [0, 0.8, 0.5], [0, 0, 1]], [4000, 3000], "shares of the image"),
        ([[8.8, 0, 6.6], [0, 8.8, 4.4], [0, 0, 1]], [5472, 3648], "millimetres"),
        ([[8.8, 0, 6.6], [0, 8.8, 4.4], [0, 0, 1]], None, "above 60"),
        ([[560, 0, 0], [0, 560, 0], [640, 360, 1]], [1280, 720], "transposed"),
        ([[0] * 3] * 3, [1280, 720], "not calibrated"),
        ([[3000, 0, 2000], [0, 3000, 1500], [0, 0, 1]], [1920, 1080], "about 4001 x 3001"),
        (K, [720, 1280], "exchanged"),
        ([[560, 0, 1300], [0, 560, 360], [0, 0, 1]], [1280, 720], "principal point"),
        ([[560, 0, 640], [0, 300, 360], [0, 0, 1]], [1280, 720], "nearly equal"),
        ([[2e5, 0, 640], [0, 2e5, 360], [0, 0, 1]], [1280, 720], "below 128000"),
    ],
)
def test_values_that_no_camera_has(tmp_path, matrix, size, words):
    with pytest.raises(InputFileError) as caught:
        read(tmp_path, {"K": matrix, "distortion": [0, 0, 0, 0], **({"image_size": size} if size else {})})
    assert words in str(caught.value)
