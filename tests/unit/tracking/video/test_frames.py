"""Reading videos: times, and every way in which a video or a box can be wrong."""

from __future__ import annotations

import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration.foundation.errors import InputFileError, TrackingError, UsageError
from pipeline.records import Box
from pipeline.tracking import track_video, video_times
from pipeline.tracking.video.frames import frames_of
from tests.scenes.video import BOX, SIZE, panning, textured, written


@pytest.mark.parametrize(
    ("name", "codec", "rate"), [("a.avi", "MJPG", 25.0), ("a.mp4", "mp4v", 29.97), ("a.mkv", "FFV1", 10.0)]
)
def test_packet_times_are_those_of_the_decoded_frames(tmp_path: Path, name: str, codec: str, rate: float) -> None:
    path = written(tmp_path / name, panning(12), codec, rate)
    times = video_times(path)
    decoded = [frame.time_s for frame in frames_of(path)]
    np.testing.assert_allclose(times.frame_time_s, decoded, atol=1e-9)
    np.testing.assert_allclose(times.frame_time_s, np.arange(12) / rate, atol=1.1e-3)
    assert times.frames == 12
    assert times.image_size == SIZE
    assert times.frame_rate == pytest.approx(rate, rel=1e-3)


def test_variable_frame_rate_keeps_the_true_times(tmp_path: Path) -> None:
    ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="needs an encoder that keeps uneven times")
    source = written(tmp_path / "even.avi", panning(20))
    path = tmp_path / "uneven.mp4"
    command = [
        ffmpeg.get_ffmpeg_exe(),
        "-loglevel",
        "error",
        "-i",
        str(source),
        "-vf",
        "settb=1/1000,setpts='(N+N*N/40)/25/TB'",
    ]
    subprocess.run(
        [*command, "-fps_mode", "passthrough", "-enc_time_base", "1/1000", "-c:v", "libx264", "-bf", "2", str(path)],
        check=True,
    )
    n = np.arange(20)
    true_s = (n + n * n / 40) / 25
    np.testing.assert_allclose(video_times(path).frame_time_s, true_s, atol=2e-3)
    found = track_video(path, camera="c", boxes={"t": BOX})
    np.testing.assert_allclose(found.frame_time_s, true_s, atol=2e-3)
    np.testing.assert_array_equal(found.frame_time_s, video_times(path).frame_time_s)


def test_rotated_video_is_shown_upright(tmp_path: Path) -> None:
    ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="needs a program that writes a rotation")
    source, path = written(tmp_path / "flat.mp4", panning(6), "mp4v"), tmp_path / "turned.mp4"
    command = [ffmpeg.get_ffmpeg_exe(), "-loglevel", "error", "-display_rotation", "90", "-i", str(source)]
    subprocess.run([*command, "-c", "copy", str(path)], check=True)
    assert video_times(path).image_size == (SIZE[1], SIZE[0])
    assert next(iter(frames_of(path))).pixels.shape[:2] == SIZE


def test_target_of_a_panning_video(tmp_path: Path) -> None:
    path = written(tmp_path / "a.avi", panning(30))
    track = track_video(path, camera="c", boxes={"t": BOX}).tracks[0]
    true_x = BOX.centre_px[0] + np.array([round(1.5 * f) for f in range(30)])
    assert track.seen.all()
    assert np.abs(track.xy_px[:, 0] - true_x).max() < 0.3
    assert np.abs(track.xy_px[:, 1] - BOX.centre_px[1]).max() < 0.3


@pytest.mark.parametrize("name", ["wrong.mp4", "wrong.txt", "none"])
def test_a_wrong_extension_changes_nothing(tmp_path: Path, name: str) -> None:
    right = written(tmp_path / "a.avi", panning(20))
    wrong = tmp_path / name
    wrong.write_bytes(right.read_bytes())
    one, other = (track_video(path, camera="c", boxes={"t": BOX}).tracks[0] for path in (right, wrong))
    np.testing.assert_array_equal(one.xy_px, other.xy_px)


def test_target_in_4k(tmp_path: Path) -> None:
    large = [cv2.resize(f, (3840, 2880), interpolation=cv2.INTER_CUBIC)[360:2520] for f in panning(5)]
    path = tmp_path / "large.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (3840, 2160))
    for picture in large:
        writer.write(picture)
    writer.release()
    box = Box(frame=0, x=24 * 30, y=24 * 50 - 360, width=24 * 24, height=24 * 16)
    found = track_video(path, camera="c", boxes={"t": box})
    true_x = box.centre_px[0] + 24 * np.array([round(1.5 * f) for f in range(5)])
    assert found.image_size == (3840, 2160)
    assert found.tracks[0].seen.all()
    assert np.abs(found.tracks[0].xy_px[:, 0] - true_x).max() < 2.0


def test_truncated_video_gives_its_frames_and_a_note(tmp_path: Path) -> None:
    path = written(tmp_path / "a.avi", panning(40))
    cut = tmp_path / "cut.avi"
    cut.write_bytes(path.read_bytes()[: int(path.stat().st_size * 0.5)])
    found = track_video(cut, camera="c", boxes={"t": BOX})
    assert 10 < len(found.frame_time_s) < 30
    assert found.tracks[0].seen[:-1].all()  # the last is cut in two
    assert any("cut off" in note for note in found.notes)


@pytest.mark.parametrize("content", [b"", b"not a video at all" * 50, b"\x00" * 4096])
def test_what_is_not_a_video_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "wrong.mp4"
    path.write_bytes(content)
    for attempt in (lambda: video_times(path), lambda: track_video(path, camera="c", boxes={"t": BOX})):
        with pytest.raises(InputFileError, match=r"wrong\.mp4"):
            attempt()


def test_missing_video_and_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="no such file"):
        video_times(tmp_path / "none.mp4")
    with pytest.raises(InputFileError, match="not a file"):
        track_video(tmp_path, camera="c", boxes={"t": BOX})


def test_mp4_cut_before_its_index_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mp4", panning(20), "mp4v")
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(InputFileError, match="cut off before its index"):
        track_video(cut, camera="c", boxes={"t": BOX})


def test_video_without_frames_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "empty.avi", panning(1))
    raw = path.read_bytes()
    path.write_bytes(raw[: raw.index(b"movi") + 4])
    with pytest.raises(InputFileError):
        track_video(path, camera="c", boxes={"t": BOX})


@pytest.mark.parametrize(
    ("box", "said"),
    [
        (Box(frame=0, x=150, y=50, width=24, height=16), "inside the image of 160 x 120"),
        (Box(frame=0, x=-5, y=50, width=24, height=16), "inside the image"),
        (Box(frame=0, x=50, y=50, width=1, height=1), "at least 4 x 4"),
        (Box(frame=0, x=50, y=50, width=float("nan"), height=9), "at least 4 x 4"),
        (Box(frame=12, x=50, y=50, width=24, height=16), "0 to 11"),
        (Box(frame=-1, x=50, y=50, width=24, height=16), "0 or more"),
    ],
)
def test_impossible_boxes_name_their_key(tmp_path: Path, box: Box, said: str) -> None:
    path = written(tmp_path / "a.avi", panning(12))
    with pytest.raises(UsageError, match=said) as caught:
        track_video(path, camera="uav1", boxes={"car1": box})
    assert caught.value.where == "targets.car1.boxes.uav1"
    assert caught.value.exit_code == 2


def test_target_that_vanishes_at_once_is_an_error(tmp_path: Path) -> None:
    frames = panning(20)
    empty = [np.clip(textured(9)[: SIZE[1], : SIZE[0]], 0, 255).astype(np.uint8)] * 19
    path = written(tmp_path / "a.avi", [frames[0], *empty])
    with pytest.raises(TrackingError, match=r"target t .*lost right after its box") as caught:
        track_video(path, camera="c", boxes={"t": BOX})
    assert caught.value.exit_code == 4


def test_target_never_found_again_is_a_note(tmp_path: Path) -> None:
    frames = panning(20)
    without = [f.copy() for f in panning(40)[20:]]
    for f in without:
        f[45:70] = textured()[45:70, : SIZE[0]].astype(np.uint8)
    found = track_video(written(tmp_path / "a.avi", [*frames, *without]), camera="c", boxes={"t": BOX})
    assert 18 <= found.tracks[0].seen.sum() <= 21
    assert any("t was last seen on frame" in note for note in found.notes)
