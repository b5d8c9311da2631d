"""Frames backwards, in any order, out of broken, woven and unevenly timed videos; work done ahead."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.tracking import FrameReader, track_video
from pipeline.tracking.video.backwards import frames_back
from pipeline.tracking.video.frames import frames_of
from pipeline.tracking.video.interlace import is_woven, upper_field
from pipeline.tracking.video.prefetch import prefetched
from tests.scenes.containers import muxed, numbered, overwritten
from tests.scenes.video import BOX, SIZE, UNEVEN, encoded, panning, written


@pytest.fixture(scope="module", params=["plain", "uneven"])
def video(request, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("order")
    source = written(folder / "a.avi", panning(110))
    if request.param == "plain":
        return source
    return encoded(source, folder / "a.mp4", *UNEVEN, "-g", "30", "-bf", "2")


@pytest.mark.parametrize("last", [109, 60, 0])
def test_backwards_is_forwards_turned_round(video, last) -> None:
    forwards = list(frames_of(video))
    back = list(frames_back(video, last))
    assert [f.index for f in back] == list(range(last, -1, -1))
    for frame in back:
        assert np.array_equal(frame.pixels, forwards[frame.index].pixels), frame.index
        assert frame.time_s == pytest.approx(forwards[frame.index].time_s, abs=1e-9)


def test_any_frame_in_any_order(video) -> None:
    forwards, reader = list(frames_of(video)), FrameReader(video)
    for index in (100, 3, 4, 50, 109, 0):
        assert np.array_equal(reader.read(index), forwards[index].pixels), index
    assert reader.read(110) is None
    assert reader.read(-1) is None
    reader.close()


def test_broken_middle_is_stepped_over(tmp_path: Path) -> None:
    whole = muxed(tmp_path / "a.mp4", numbered(60), gop=15, options={"bf": "0", "x264-params": "scenecut=0"})
    broken = overwritten(whole, tmp_path / "broken.mp4", 24)
    found = track_video(broken, camera="c", boxes={"t": BOX})
    track = found.tracks[0]
    assert any("frames (24 to 29) are damaged" in note or "could not be decoded" in note for note in found.notes)
    assert len(track.frame) == 60
    assert not track.seen[24:30].any()  # the next key frame is 30
    late = track.seen & (track.frame > 34)
    assert late.sum() > 20
    true_x = BOX.centre_px[0] + np.rint(1.5 * track.frame)
    assert np.abs(track.xy_px[track.seen, 0] - true_x[track.seen]).max() < 1.0


def test_woven_video_is_seen_by_its_upper_field(tmp_path: Path) -> None:
    moments = panning(40)
    woven = []
    for upper, lower in zip(moments[::2], moments[1::2], strict=True):
        frame = upper.copy()
        frame[1::2] = lower[1::2]
        woven.append(frame)
    assert is_woven(woven)
    assert not is_woven(moments)
    assert not is_woven([moments[0]] * 5)
    assert np.array_equal(upper_field(woven[3])[::2], moments[6][::2])
    found = track_video(written(tmp_path / "a.mkv", woven, "FFV1"), camera="c", boxes={"t": BOX})
    assert any("interlaced" in note for note in found.notes)
    track = found.tracks[0]
    true_x = BOX.centre_px[0] + np.array([round(1.5 * f) for f in range(0, 40, 2)])
    assert track.seen.all()
    assert np.abs(track.xy_px[:, 0] - true_x).max() < 0.5


def test_interlaced_h264_is_seen_by_its_upper_field(tmp_path: Path) -> None:
    moments = panning(40)
    woven = [upper.copy() for upper in moments[::2]]
    for frame, lower in zip(woven, moments[1::2], strict=True):
        frame[1::2] = lower[1::2]
    path = muxed(tmp_path / "a.mp4", woven, options={"flags": "+ilme+ildct", "x264-params": "tff=1:crf=12"})
    found = track_video(path, camera="c", boxes={"t": BOX})
    assert any("interlaced" in note for note in found.notes)
    true_x = BOX.centre_px[0] + np.array([round(1.5 * f) for f in range(0, 40, 2)])
    assert found.tracks[0].seen.all()
    assert np.abs(found.tracks[0].xy_px[:, 0] - true_x).max() < 0.7


def test_a_still_beginning_is_no_fault(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mkv", [panning(1)[0]] * 10 + panning(20), "FFV1")
    assert track_video(path, camera="c", boxes={"t": BOX}).tracks[0].seen.all()


def test_frames_of_another_size_end_the_tracking(tmp_path: Path) -> None:
    first, second = written(tmp_path / "a.avi", panning(20)), tmp_path / "b.avi"
    writer = cv2.VideoWriter(str(second), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (SIZE[0] * 2, SIZE[1] * 2))
    for frame in panning(20):
        writer.write(cv2.resize(frame, None, fx=2, fy=2))
    writer.release()
    streams = [encoded(p, p.with_suffix(".ts"), "-bf", "0").read_bytes() for p in (first, second)]
    path = tmp_path / "both.ts"
    path.write_bytes(b"".join(streams))
    found = track_video(path, camera="c", boxes={"t": BOX})
    assert found.image_size == SIZE
    assert 18 <= found.tracks[0].seen.sum() <= 41


def test_work_ahead_hands_on_items_errors_and_the_end() -> None:
    closed = []

    def source():
        try:
            yield from range(1000)
        finally:
            closed.append(True)

    assert list(prefetched(iter(range(50)), 3)) == list(range(50))
    some = prefetched(source(), 3)
    assert [next(some), next(some)] == [0, 1]
    some.close()
    assert closed == [True]

    def failing():
        yield 1
        raise ValueError("broken")

    got = prefetched(failing(), 2)
    assert next(got) == 1
    with pytest.raises(ValueError, match="broken"):
        next(got)
