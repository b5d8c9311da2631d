"""Detections made elsewhere: what is read, and one clear message for everything that cannot be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibration.foundation.errors import InputFileError
from pipeline.export import read_detections_csv, tracks_csv
from pipeline.records import TRACKED
from tests.scenes.export import BUS, VAN, tracks


def read(path: Path, content: str | bytes, **settings: object) -> tuple:
    path = path / "cam-tracks.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    told = {"camera": "cam", "frame_rate": 25.0, "default_sigma_px": 2.0} | settings
    return read_detections_csv(path, **told)  # type: ignore[arg-type]


def test_time_is_frame_over_rate_and_sigma_the_default(tmp_path: Path) -> None:
    (track,) = read(tmp_path, "frame,target,x_px,y_px\n1,drone,529.105,308.510\n26,drone,0,-3e-1\n")
    assert (track.camera, track.target) == ("cam", "drone")
    np.testing.assert_array_equal(track.frame, [1, 26])
    np.testing.assert_array_equal(track.time_s, [1 / 25, 26 / 25])
    np.testing.assert_array_equal(track.xy_px, [[529.105, 308.510], [0.0, -0.3]])
    np.testing.assert_array_equal(track.sigma_px, [2.0, 2.0])
    np.testing.assert_array_equal(track.state, [TRACKED, TRACKED])


def test_given_times_and_sigmas_win_and_an_empty_sigma_is_the_default(tmp_path: Path) -> None:
    text = "target,frame,time_s,y_px,x_px,sigma_px\nb,0,0.5,2,1,0.25\nb,3,0.75,4,3,\n"
    (track,) = read(tmp_path, text)
    np.testing.assert_array_equal(track.time_s, [0.5, 0.75])
    np.testing.assert_array_equal(track.sigma_px, [0.25, 2.0])
    np.testing.assert_array_equal(track.xy_px, [[1, 2], [3, 4]])


def test_rows_come_in_any_order(tmp_path: Path) -> None:
    text = "frame,target,x_px,y_px\n7,b,70,7\n2,a,20,2\n3,b,30,3\n1,a,10,1\n"
    second, first = read(tmp_path, text)
    assert (second.target, first.target) == ("b", "a")
    np.testing.assert_array_equal(second.frame, [3, 7])
    np.testing.assert_array_equal(first.xy_px[:, 0], [10, 20])


@pytest.mark.parametrize(
    "text",
    [
        "\ufeffframe,target,x_px,y_px\r\n0,a,1,2\r\n",
        "frame, target, x_px, y_px, confidence\n\n0.0, a, 1, 2, high\n\n",
        '"frame","target","x_px","y_px"\n"0","a","1","2"\n',
    ],
    ids=["byte order mark and CRLF", "spaces, blank lines, a foreign column", "quotes"],
)
def test_what_other_programs_write_is_read(tmp_path: Path, text: str) -> None:
    (track,) = read(tmp_path, text)
    assert track.target == "a"
    np.testing.assert_array_equal(track.xy_px, [[1, 2]])


def test_our_own_tracks_are_detections_too(tmp_path: Path) -> None:
    (track,) = read(tmp_path, tracks_csv(tracks()), camera="uav1")
    assert track.target == VAN
    assert track.seen.tolist() == [True, True, False, True]
    with pytest.raises(InputFileError, match=r"column camera: uav1, uav2; expected rows of cam"):
        read(tmp_path, tracks_csv(tracks()))
    assert read(tmp_path, tracks_csv(tracks()), camera="uav2")[0].target == BUS


HEAD = "frame,target,x_px,y_px\n"
WRONG = {
    "nan": (HEAD + "0,a,1,2\n1,a,nan,2\n", r"line 3, column x_px: 'nan'; expected a finite number"),
    "inf": (HEAD + "0,a,1,-inf\n", r"line 2, column y_px: '-inf'; expected a finite number"),
    "text": (HEAD + "0,a,1,left\n", r"line 2, column y_px: 'left'"),
    "empty cell": (HEAD + "0,a,,2\n", r"line 2, column x_px: an empty cell; expected a finite number"),
    "negative frame": (HEAD + "0,a,1,2\n\n-1,a,1,2\n", r"line 4, column frame: '-1'; expected a whole number from 0"),
    "half a frame": (HEAD + "0.5,a,1,2\n", r"line 2, column frame: '0.5'; expected a whole number"),
    "huge frame": (HEAD + "1e300,a,1,2\n", r"line 2, column frame"),
    "no target": (HEAD + "0, ,1,2\n", r"line 2, column target: an empty cell; expected a name"),
    "twice": (
        HEAD + "4,a,1,2\n4,b,1,2\n4,a,5,6\n",
        r"line 4, column frame: a a second time in frame 4 \(first on line 2",
    ),
    "missing column": (
        "frame,target,x,y_px\n0,a,1,2\n",
        r"header: the columns frame, target, x, y_px.*rename the column x",
    ),
    "misspelt option": (
        HEAD[:-1] + ",sigma\n0,a,1,2,3\n",
        r"unknown column sigma.*rename the column sigma to sigma_px",
    ),
    "doubled column": (HEAD[:-1] + ",x_px\n0,a,1,2,3\n", r"header: x_px twice"),
    "semicolons": (HEAD.replace(",", ";") + "0;a;1;2\n", r"separate the columns by commas"),
    "no header": ("0,a,1,2\n1,a,1,2\n", r"header: the columns 0, a, 1, 2; expected .*frame, target, x_px, y_px"),
    "empty file": ("", r"cam-tracks.csv: an empty file; expected a table of detections"),
    "blank file": ("\n \n", r"an empty file"),
    "header only": (HEAD, r"a header and no row; expected at least one detection"),
    "short row": (HEAD + "0,a,1,2\n1,a,1\n", r"line 3: 3 cells; expected 4"),
    "open quote": (HEAD + '0,"a,1,2\n', r"line 2: a row that cannot be split"),
    "not utf-8": (HEAD.encode() + b"0,caf\xe9,1,2\n", r"line 2: a byte that is not UTF-8 \(0xe9\)"),
    "utf-16": (HEAD.encode("utf-16"), r"line 1: a byte that is not UTF-8"),
    "zero sigma": (HEAD[:-1] + ",sigma_px\n0,a,1,2,0\n", r"line 2, column sigma_px: '0'; expected a number above 0"),
    "time missing": (HEAD[:-1] + ",time_s\n0,a,1,2,\n", r"line 2, column time_s: an empty cell"),
    "time back": (
        HEAD[:-1] + ",time_s\n0,a,1,2,5\n1,a,1,2,4\n",
        r"line 3, column time_s: time 4 s at frame 1; expected",
    ),
    "time split": (HEAD[:-1] + ",time_s\n9,a,1,2,5\n9,b,1,2,6\n", r"time 6 s at frame 9.*line 2: 5 s at frame 9"),
}


@pytest.mark.parametrize("case", WRONG)
def test_one_clear_message(tmp_path: Path, case: str) -> None:
    content, message = WRONG[case]
    with pytest.raises(InputFileError, match=message) as caught:
        read(tmp_path, content)
    assert str(tmp_path / "cam-tracks.csv") in caught.value.where
    assert caught.value.advice
    assert caught.value.exit_code == 3


def test_a_missing_file_says_where_it_was_looked_for(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="no such file"):
        read_detections_csv(tmp_path / "none.csv", camera="c", frame_rate=25.0, default_sigma_px=1.0)


REAL = Path(__file__).parents[4] / "shared/real/multicam"


@pytest.mark.real
@pytest.mark.skipif(not REAL.exists(), reason=f"the real flights are not at {REAL}")
def test_real_labels_are_read_as_another_reader_reads_them() -> None:
    pandas = pytest.importorskip("pandas")
    files = sorted(REAL.glob("*/cam*-tracks.csv"))
    assert len(files) == 9
    for path in files:
        (track,) = read_detections_csv(path, camera=path.stem, frame_rate=30.0, default_sigma_px=2.0)
        other = pandas.read_csv(path).sort_values("frame")
        np.testing.assert_array_equal(track.frame, other.frame)
        np.testing.assert_allclose(track.xy_px, other[["x_px", "y_px"]], rtol=1e-15)
