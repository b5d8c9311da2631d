"""A video that carries its own subtitles is a log; one that carries nothing says so."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from calibration.foundation.errors import InputFileError
from pipeline.telemetry import inspect_log, log_span, read_log
from pipeline.telemetry.subtitles.in_video import text_of


def video(path, cues):
    """A Matroska of small pictures at 10 Hz with DJI's cues beside them."""
    source = path.with_suffix(".srt")
    source.write_text("".join(f"{i + 1}\n00:00:{i:02d},000 --> 00:00:{i:02d},900\n{c}\n\n" for i, c in enumerate(cues)))
    with av.open(str(source)) as text, av.open(str(path), "w") as out:
        picture = out.add_stream("mpeg4", rate=10)
        picture.width, picture.height, picture.pix_fmt = 64, 48, "yuv420p"
        track = out.add_stream_from_template(text.streams.subtitles[0])
        for i in range(10 * len(cues)):
            frame = av.VideoFrame.from_ndarray(np.zeros((48, 64, 3), np.uint8), format="rgb24")
            frame.pts, frame.time_base = i, Fraction(1, 10)
            out.mux(picture.encode(frame))
        out.mux(picture.encode())
        for packet in text.demux():
            if packet.dts is not None:
                packet.stream = track
                out.mux(packet)
    source.unlink()
    return path


CUES = [f"[latitude: 41.5{i:02d}1] [longitude: 2.2] [rel_alt: 5.0 abs_alt: 120.0]" for i in range(8)]


def test_subtitles_in_the_video(tmp_path):
    log = read_log(video(tmp_path / "a.mkv", CUES))
    assert (log.format, dict(log.counts)) == ("dji srt", {"subtitle": 8})
    assert np.degrees(log.position.lat_rad) == pytest.approx([41.5001 + 0.01 * i / 10 for i in range(8)], abs=1e-6)
    assert log_span(log) == pytest.approx((0.0, 7.0), abs=0.01)
    assert (log.video_start_s, log.video_start_sigma_s) == (0.0, 0.02)
    assert 'telemetry = "video"' in inspect_log(log).flight_file


def test_subtitles_that_ffmpeg_does_not_know(tmp_path):
    path = video(tmp_path / "a.mkv", CUES)
    path.write_bytes(path.read_bytes().replace(b"S_TEXT/UTF8", b"S_TEXT/UTF9"))
    with pytest.raises(InputFileError, match="carries no log"):
        read_log(path)


def test_a_video_that_carries_nothing(tmp_path):
    with av.open(str(tmp_path / "a.mkv"), "w") as out:
        picture = out.add_stream("mpeg4", rate=10)
        picture.width, picture.height, picture.pix_fmt = 64, 48, "yuv420p"
        frame = av.VideoFrame.from_ndarray(np.zeros((48, 64, 3), np.uint8), format="rgb24")
        out.mux(picture.encode(frame))
        out.mux(picture.encode())
    with pytest.raises(InputFileError, match="carries no log"):
        read_log(tmp_path / "a.mkv")


def test_a_name_is_never_taken_for_a_protocol(tmp_path, monkeypatch):
    video(tmp_path / "a.mkv", CUES).rename(tmp_path / "concat:a.mkv")
    monkeypatch.chdir(tmp_path)
    assert dict(read_log(Path("concat:a.mkv")).counts) == {"subtitle": 8}


def test_what_is_no_video(tmp_path):
    (tmp_path / "a.mp4").write_text("words")
    with pytest.raises(InputFileError, match="cannot be opened"):
        read_log(tmp_path / "a.mp4")


def test_quicktimes_text_has_its_length_before_it():
    assert text_of(b"\x00\x05Hello\x00\x00\x00\x0cstyl", "mov_text") == "Hello"
    assert text_of(b"Hello\n", "subrip") == "Hello"
