import tempfile
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration import FORMATS, CameraModel, read_camera, write_camera

focal, stretch = st.floats(120.0, 4e4), st.floats(0.7, 1.45)
middle = st.tuples(st.floats(260, 470), st.floats(130, 350))  # at 240, 320 it passes for one of 480 x 640
term = st.floats(-10, 10)


@settings(max_examples=40, deadline=None)
@given(
    focal,
    stretch,
    middle,
    st.lists(term, min_size=4, max_size=4),
    st.sampled_from(FORMATS),
)
def test_any_camera_survives_any_format(fx, ratio, centre, terms, name):
    cx, cy = centre
    lens = CameraModel(
        image_size=(640, 480), K=np.array([[fx, 0, cx], [0, fx * ratio, cy], [0, 0, 1]]), distortion=np.array(terms)
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / ("cam.toml" if name in ("caliscope", "aniposelib") else "cam.yaml")
        write_camera(path, lens, format_name=name)
        again = read_camera(path)
    assert np.array_equal(again.K, lens.K)
    assert np.array_equal(again.distortion[:4], lens.distortion)
