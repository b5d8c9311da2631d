"""What people hand over as a camera file, by the dozen: each is read right, or refused in words that are true."""

import json
import pickle
import struct
from io import BytesIO

import numpy as np
import pytest

from calibration import read_camera
from calibration.camera_files import doubts
from calibration.foundation.errors import InputFileError

K = [[560.5, 0, 640.25], [0, 561.5, 360.75], [0, 0, 1]]
FIVE = [-0.25, 0.08, 0.001, -0.0005, -0.01]
FOUR = [0.05, -0.01, 0.002, -0.0005]
BY_NAME = {"k1": -0.25, "k2": 0.08, "p1": 0.001, "p2": -0.0005, "k3": -0.01}
FLAT = {"fx": 560.5, "fy": 561.5, "cx": 640.25, "cy": 360.75}
SIDES = {"width": 1280, "height": 720}
SIZE = {"image_size": [1280, 720]}


def read(tmp_path, content, name="camera.json"):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode()
                     if isinstance(content, str) else json.dumps(content).encode())  # fmt: skip
    return read_camera(path)


def npz(**arrays):
    made = BytesIO()
    np.savez(made, **{name: np.array(value) for name, value in arrays.items()})
    return made.getvalue()


def npy(array):
    made = BytesIO()
    np.save(made, np.array(array))
    return made.getvalue()


READ = {
    "npz of a script": (npz(K=K, dist=[FIVE], image_size=[1280, 720]), "pinhole", FIVE),
    "npz of the tutorial, no size": (npz(mtx=K, dist=[FIVE], rvecs=np.zeros((3, 3, 1))), "pinhole", FIVE),
    "flat numbers": ({**FLAT, **BY_NAME, **SIDES}, "pinhole", FIVE),
    "flat numbers of a fisheye": (
        {**FLAT, "k1": 0.05, "k2": -0.01, "k3": 0.002, "k4": -0.0005, **SIDES, "model": "fisheye"}, "fisheye", FOUR,
    ),
    "flat, k3 before p1": (
        {**FLAT, "k1": -0.25, "k2": 0.08, "k3": -0.01, "p1": 0.001, "p2": -0.0005, **SIDES}, "pinhole", FIVE,
    ),
    "librealsense": (
        {"width": 1280, "height": 720, "ppx": 640.25, "ppy": 360.75, "fx": 560.5, "fy": 561.5,
         "model": "brown_conrady", "coeffs": FIVE}, "pinhole", FIVE,
    ),
    "coefficients by name": ({**SIZE, "K": K, "distortion": BY_NAME}, "pinhole", FIVE),
    "size as text": ({"resolution": "1280x720", "K": K, "dist": FIVE}, "pinhole", FIVE),
    "size as a mapping": ({"image_size": SIDES, "K": K, "dist": FIVE}, "pinhole", FIVE),
    "Autoware": (
        {"CameraMat": {"rows": 3, "cols": 3, "dt": "d", "data": np.ravel(K).tolist()},
         "DistCoeff": {"rows": 1, "cols": 5, "dt": "d", "data": FIVE}, "ImageSize": [1280, 720]}, "pinhole", FIVE,
    ),
    "Panoptic": ({"K": K, "distCoef": FIVE, "resolution": [1280, 720], "name": "00_00"}, "pinhole", FIVE),
    "multical": (
        {"cameras": {"c": {"model": "standard", **SIZE, "K": K, "dist": [FIVE]}}}, "pinhole", FIVE,
    ),
    "ORB-SLAM2": (
        "%YAML:1.0\n\nCamera.fx: 560.5\nCamera.fy: 561.5\nCamera.cx: 640.25\nCamera.cy: 360.75\n\nCamera.k1: -0.25\n"
        "Camera.k2: 0.08\nCamera.p1: 0.001\nCamera.p2: -0.0005\nCamera.k3: -0.01\nCamera.width: 1280\n"
        "Camera.height: 720\nCamera.fps: 30.0\n", "pinhole", FIVE,
    ),
    "stella_vslam": (
        "Camera:\n  name: c\n  setup: monocular\n  model: perspective\n  fx: 560.5\n  fy: 561.5\n  cx: 640.25\n"
        "  cy: 360.75\n  k1: -0.25\n  k2: 0.08\n  p1: 0.001\n  p2: -0.0005\n  k3: -0.01\n  fps: 30\n  cols: 1280\n"
        "  rows: 720\n", "pinhole", FIVE,
    ),
    "Bouguet's toolbox": (
        "% Intrinsic and Extrinsic Camera Parameters\nfc = [ 560.5 ; 561.5 ];\ncc = [ 640.25 ; 360.75 ];\n"
        "alpha_c = 0.000;\nkc = [ -0.25 ; 0.08 ; 0.001 ; -0.0005 ; -0.01 ];\nfc_error = [ 1.1 ; 1.2 ];\nnx = 1280;\n"
        "ny = 720;\n", "pinhole", FIVE,
    ),
    "UTF-16 with a mark": (json.dumps({**SIZE, "K": K, "dist": FIVE}).encode("utf-16"), "pinhole", FIVE),
    "gyroflow, opencv_standard": (
        {"calib_dimension": {"w": 1280, "h": 720}, "distortion_model": "opencv_standard", "lens_model": "x",
         "fisheye_params": {"camera_matrix": K, "distortion_coeffs": FIVE, "RMS_error": 0.4}}, "pinhole", FIVE,
    ),
    "OpenCV XML of two names": (
        '<?xml version="1.0"?>\n<opencv_storage>\n<Camera_Matrix type_id="opencv-matrix">\n  <rows>3</rows>\n'
        "  <cols>3</cols>\n  <dt>d</dt>\n  <data>\n    560.5 0. 640.25 0.\n    561.5 360.75 0. 0. 1.</data>"
        '</Camera_Matrix>\n<Distortion_Coefficients type_id="opencv-matrix">\n  <rows>5</rows>\n  <cols>1</cols>\n'
        "  <dt>d</dt>\n  <data>\n    -0.25 0.08 0.001 -0.0005 -0.01</data></Distortion_Coefficients>\n"
        "<image_Width>1280</image_Width>\n<image_Height>720</image_Height>\n</opencv_storage>\n", "pinhole", FIVE,
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", READ)
def test_is_read_right(tmp_path, kind):
    content, model, terms = READ[kind]
    camera = read(
        tmp_path, content, "camera" + (".npz" if kind.startswith("npz") else ".m" if "Bouguet" in kind else "")
    )
    np.testing.assert_allclose(camera.K, K, rtol=1e-12)
    np.testing.assert_allclose(camera.distortion[: len(terms)], terms, rtol=1e-12)
    assert not camera.distortion[len(terms) :].any()
    assert (camera.model, camera.image_size) == (model, (0, 0) if "no size" in kind else (1280, 720))


DJI = (
    '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    '<rdf:Description xmlns:d="http://www.dji.com/drone-dji/1.0/" '
    'd:DewarpData="2021-01-01;3700,3700,-10,5,-0.1,0.02,0,0,0"/></rdf:RDF></x:xmpmeta>'
)
REFUSED = {
    "bare npy": (npy(K), "a 3 x 3 matrix alone"),
    "bare csv": ("560.5,0,640.25\n0,561.5,360.75\n0,0,1\n", "a 3 x 3 matrix alone"),
    "bare savetxt": ("5.6e+02 0e+00 6.4e+02\n0e+00 5.6e+02 3.6e+02\n0e+00 0e+00 1e+00\n", "3 x 3 matrix alone"),
    "bare JSON list": (K, "a 3 x 3 matrix alone"),
    "pickle": (pickle.dumps({"K": K, "dist": FIVE}), "pickle, which is never opened"),
    "npz of objects": (npz(K=K, dist=np.array([{"k1": 1}], dtype=object)), "never opened"),
    "cut npz": (npz(K=K, dist=FIVE)[:300], "cut or damaged"),
    "MATLAB .mat": (b"MATLAB 5.0 MAT-file, Platform: GLNXA64" + b"\0" * 90, "MATLAB .mat"),
    "HDF5": (b"\x89HDF\r\n\x1a\n" + b"\0" * 50, "HDF5"),
    "COLMAP binary": (struct.pack("<QIiQQ4d", 1, 1, 1, 1280, 720, 560.5, 561.5, 640.5, 360.5), "COLMAP's binary"),
    "a JPEG": (b"\xff\xd8\xff\xe1" + bytes(40), "a photo"),
    "MATLAB cameraIntrinsics": (
        {"FocalLength": [560.5, 561.5], "PrincipalPoint": [641.25, 361.75], "ImageSize": [720, 1280]}, "MATLAB",
    ),
    "DJI XMP": (DJI, "DJI"),
    "Metashape project": (
        "<document><chunk><sensors><sensor><calibration type='frame'><f>3000</f></calibration></sensor></sensors>"
        "</chunk></document>", "Agisoft",
    ),
    "MicMac": ("<ExportAPERO><CalibrationInternConique /></ExportAPERO>", "ExportAPERO"),
    "Azure Kinect": ({"CalibrationInformation": {"Cameras": [{"Intrinsics": {"ModelParameters": [0.5]}}]}}, "Azure"),
    "DIM, K, D of a fisheye script": ({"DIM": [1280, 720], "K": K, "D": [[v] for v in FOUR]}, "which lens model"),
    "inverse Brown": ({**FLAT, **SIDES, "model": "inverse_brown_conrady", "coeffs": FIVE}, "inverse_brown_conrady"),
    "Polycam, no distortion": ({**FLAT, **SIDES}, "no distortion coefficients"),
    "column by column": ({**SIZE, "K": np.transpose(K).ravel().tolist(), "dist": FIVE}, "transposed"),
    "rows and cols lie": ({**SIZE, "K": {"rows": 3, "cols": 3, "data": [1] * 8}, "dist": []}, "8 numbers"),
    "six coefficients": ({**SIZE, "K": K, "dist": [*FIVE, 0.1]}, "6 coefficients"),
    "three coefficients": ({**SIZE, "K": K, "dist": FIVE[:3]}, "3 coefficients"),
    "eight of a fisheye": ({**SIZE, "K": K, "dist": FOUR * 2, "model": "fisheye"}, "8 coefficients"),
    "a fourth radial term by name": ({**SIZE, "K": K, "distortion": {"k1": 0.1, "q4": 2}}, "q4"),
    "width and height exchanged, 4:3": (
        {"image_size": [480, 640], "K": [[540, 0, 322], [0, 541, 236], [0, 0, 1]], "dist": FIVE}, "exchanged",
    ),
    "two sizes": ({**SIZE, "width": 640, "height": 360, "K": K, "dist": FIVE}, "640 and 360"),
    "two matrices": ({**SIZE, "K": K, "camera_matrix": (0.5 * np.array(K)).tolist(), "dist": FIVE}, "other numbers"),
    "two lens models": ({**SIZE, "K": K, "D": FOUR, "fisheye": False, "model": "equidistant"}, "says it is none"),
    "35 mm without a size": ({"K": [[35, 0, 18], [0, 35, 12], [0, 0, 1]], "dist": []}, "millimetres"),
    "centre from the middle": ({"K": [[900, 0, -3.5], [0, 900, 2.5], [0, 0, 1]], "dist": []}, "principal point"),
    "infinite": ('{"image_size": [1280, 720], "K": [[Infinity,0,640],[0,560,360],[0,0,1]], "dist": []}', "infinite"),
    "gyroflow of a zoom": (
        {"calib_dimension": {"w": 1280, "h": 720}, "interpolations": {"24": {}},
         "fisheye_params": {"camera_matrix": K, "distortion_coeffs": FOUR}}, "zoom",
    ),
    "Pix4D, a text for people": ("Pix4D camera calibration file 0\n\n#mm\nF 15.0\nPx 8.65\n", "Pix4D"),
    "nerfstudio, a camera for each frame": (
        {"camera_model": "OPENCV", "frames": [{"fl_x": 560, "cx": 640, "cy": 360, "w": 1280, "h": 720}]},
        "a camera of its own for each frame",
    ),
    "VisualSFM": ("NVM_V3\n\n2\nimg1.jpg\t560.5 1 0 0 0 0 0 0 -0.1 0\n", "cannot be read"),
    "JSON cut off": ('{"image_size": [1280, 720], "K": [[560.5, 0, 64', "cannot be read"),
}  # fmt: skip


@pytest.mark.parametrize("kind", REFUSED)
def test_is_refused_in_true_words(tmp_path, kind):
    content, words = REFUSED[kind]
    suffix = {"bare csv": ".csv", "bare savetxt": ".txt", "bare npy": ".npy", "DJI XMP": ".xmp"}.get(kind, ".json")
    with pytest.raises(InputFileError) as refusal:
        read(tmp_path, content, f"camera{suffix}")
    assert words in str(refusal.value)
    assert refusal.value.advice


def test_tangential_terms_that_few_lenses_have_are_told(tmp_path):
    assert "tangential" in doubts(read(tmp_path, {**SIZE, "K": K, "dist": [-0.1, 0.02, -0.04, 0.001, 0]}))[0]
    assert doubts(read(tmp_path, {**SIZE, "K": K, "dist": [-0.1, 0.02, 0.004, 0.001, 0]})) == ()
