"""Tables of poses: what they say comes back, and every mistake in one names its line."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.foundation.errors import InputFileError
from pipeline.telemetry import read_pose_table, table_poses

HEADER = "time_s,east_m,north_m,up_m,qw,qx,qy,qz"
GOOD = ["0.0,0,0,10,1,0,0,0", "1.0,10,0,10,0.7071068,0,0,0.7071068", "2.0,20,0,10,1,0,0,0"]


def table(tmp_path, *rows, header=HEADER):
    path = tmp_path / "poses.csv"
    path.write_text("\n".join([header, *rows]) + "\n")
    return read_pose_table(path)


def at(found, time, frame=None):
    frame = np.arange(len(time)) if frame is None else np.asarray(frame)
    return table_poses(found, camera="c", frame=frame, log_time_s=np.asarray(time, float), where="cameras.c.telemetry")


def test_poses_are_interpolated_by_time(tmp_path):
    track = at(table(tmp_path, *GOOD), [0.5, 1.0, 2.0])
    np.testing.assert_allclose(track.position_enu_m[:, 0], [5.0, 10.0, 20.0])
    eighth = np.radians(22.5)
    np.testing.assert_allclose(track.enu_from_cam[0], [np.cos(eighth), 0, 0, np.sin(eighth)], atol=1e-7)
    np.testing.assert_array_equal(track.time_s, [0.5, 1.0, 2.0])


def test_poses_are_looked_up_by_frame(tmp_path):
    rows = [f"{frame},{frame},0,0,2e0,0,0,0".replace("2e0", "1") for frame in (3, 5, 9)]
    found = table(tmp_path, *rows, header=HEADER.replace("time_s", "frame"))
    np.testing.assert_allclose(at(found, [0.0, 0.1], [3, 9]).position_enu_m[:, 0], [3.0, 9.0])
    with pytest.raises(InputFileError, match=r"no pose for 1 of 2 frames \(first: frame 4; it has 3 to 9\)"):
        at(found, [0.0, 0.1], [3, 4])


def test_comments_spaces_and_more_columns_are_no_trouble(tmp_path):
    found = table(tmp_path, *(row + ", note" for row in GOOD), header="time_s, east_m,north_m,up_m,qw,qx,qy,qz,remark")
    assert len(found.position_enu_m) == 3


def test_nothing_is_extrapolated_or_bridged(tmp_path):
    found = table(tmp_path, *GOOD, "9.0,0,0,0,1,0,0,0")
    with pytest.raises(InputFileError, match=r"frame 1 at 9\.100 s"):
        at(found, [1.0, 9.1])
    with pytest.raises(InputFileError, match=r"no sample between 2\.000 and 9\.000"):
        at(found, [1.0, 5.0])


MISTAKES = [
    ({"rows": GOOD, "header": HEADER + ",more" * 1000}, "1,008 columns"),
    ({"rows": ["0,0,0,nan,1,0,0,0"]}, "up_m = nan in line 2"),
    ({"rows": [GOOD[0], "1.0,east,0,0,1,0,0,0"]}, "east_m = east in line 3"),
    ({"rows": [GOOD[0], "1.0,,0,0,1,0,0,0"]}, "east_m = nan in line 3"),
    ({"rows": [GOOD[0], "1.0,0,0,0,2,0,0,0"]}, "quaternion in line 3 has length 2"),
    ({"rows": [GOOD[0], "1.0,0,0,0,0,0,0,0"]}, "quaternion in line 3 has length 0"),
    ({"rows": [GOOD[0], "1.0,0,0,0,1e308,0,0,0"]}, "quaternion in line 3 has length inf"),
    ({"rows": [GOOD[1], GOOD[0]]}, "time_s = 0 in line 3 after 1"),
    ({"rows": [GOOD[0], GOOD[0]]}, "expected increasing time_s"),
    ({"rows": ["0,0,0,0,1,0,0"], "header": "time_s,east_m,north_m,up_m,qw,qx,qy"}, "no column qz"),
    ({"rows": ["0,0,0,1,0,0,0"], "header": "east_m,north_m,up_m,qw,qx,qy,qz"}, "no column frame or time_s"),
    ({"rows": ["0.5,0,0,0,1,0,0,0"], "header": HEADER.replace("time_s", "frame")}, "frame = 0.5 in line 2"),
    ({"rows": []}, "no rows"),
]


@pytest.mark.parametrize(("content", "message"), MISTAKES)
def test_a_mistake_is_named_with_its_line(tmp_path, content, message):
    with pytest.raises(InputFileError, match=message) as error:
        table(tmp_path, *content["rows"], header=content.get("header", HEADER))
    assert "poses.csv" in str(error.value)


def test_files_that_are_no_tables(tmp_path):
    path = tmp_path / "poses.csv"
    with pytest.raises(InputFileError, match="no such file"):
        read_pose_table(path)
    for content in (b"", b"\xff\xfe\x00\x01" * 50, b"\x00" * 100, b"a,b\n1,2,3,4\n1,2,3,4,5\n"):
        path.write_bytes(content)
        with pytest.raises(InputFileError):
            read_pose_table(path)


def test_a_parquet_table_is_the_same_as_text(tmp_path):
    pytest.importorskip("pyarrow", reason="the extra `parquet` is not installed")
    import pandas as pd

    text = table(tmp_path, *GOOD)
    pd.read_csv(tmp_path / "poses.csv").to_parquet(tmp_path / "poses.parquet")
    found = read_pose_table(tmp_path / "poses.parquet")
    np.testing.assert_array_equal(found.position_enu_m, text.position_enu_m)
    np.testing.assert_array_equal(found.enu_from_cam, text.enu_from_cam)
    np.testing.assert_array_equal(found.time_s, text.time_s)


def test_a_broken_parquet_table_is_refused_in_words(tmp_path):
    pytest.importorskip("pyarrow", reason="the extra `parquet` is not installed")
    (tmp_path / "poses.parquet").write_bytes(b"PAR1 and nothing more")
    with pytest.raises(InputFileError, match="cannot be read as parquet"):
        read_pose_table(tmp_path / "poses.parquet")


def test_rows_longer_than_the_header_are_refused(tmp_path):
    """Found by fuzzing: pandas would take the first columns as an index and shift the others."""
    for more in (",9", ",9,9"):
        with pytest.raises(InputFileError, match="not a table"):
            table(tmp_path, *(row + more for row in GOOD))
