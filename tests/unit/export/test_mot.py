"""Detections as multiple-object trackers write them."""

import numpy as np
import pytest

from calibration.foundation.errors import InputFileError
from pipeline.export import read_detections_csv


def read(path, sigma=1.0):
    return read_detections_csv(path, camera="a", frame_rate=10.0, default_sigma_px=sigma)


def test_boxes_become_tracks(tmp_path):
    path = tmp_path / "mot.txt"
    path.write_text("2,7,11,21,40,10,1,-1,-1,-1\n1,7,10,20,40,10,0.9,-1,-1,-1\n1,8,0,0,8,8,-1,-1,-1,-1\n")
    car, other = sorted(read(path), key=lambda track: track.target)
    assert (car.target, other.target) == ("7", "8")
    assert car.frame.tolist() == [0, 1]
    assert car.time_s.tolist() == [0.0, 0.1]
    assert car.xy_px.tolist() == [[29.5, 24.5], [30.5, 25.5]]
    assert np.allclose(car.sigma_px, 2.0)
    assert other.sigma_px.tolist() == [1.0]
    assert car.by_box.all()


def test_rows_that_are_there_to_be_ignored(tmp_path):
    path = tmp_path / "mot.txt"
    path.write_text("1,7,10,20,40,10,1,-1,-1,-1\n2,7,10,20,40,10,0,-1,-1,-1\n")
    assert read(path)[0].frame.tolist() == [0]


@pytest.mark.parametrize("row", ["0,7,1,1,4,4,1", "2,7,1,1,0,4,1", "2,7,1,1,4", "2,7,a,1,4,4", "1,7,1,1,4,4,1"])
def test_rows_that_cannot_be(tmp_path, row):
    path = tmp_path / "mot.txt"
    path.write_text(f"1,7,10,20,40,10,1\n{row}\n")
    with pytest.raises(InputFileError, match="MOTChallenge"):
        read(path)
