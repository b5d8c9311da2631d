"""Every container gives the same frames, numbers and times: forwards, backwards and one by one."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from calibration.foundation.capture import Capture
from calibration.foundation.errors import UsageError
from pipeline.tracking import FrameReader, track_video, video_head, video_times
from pipeline.tracking.video.backwards import frames_back
from pipeline.tracking.video.frames import frames_of
from tests.scenes.containers import muxed, number_in, numbered, overwritten, packets_of
from tests.scenes.video import BOX, SIZE

FRAMES = 40
PICTURES = numbered(FRAMES)
UNEVEN_S = [(k + k * k / 40) / 25 for k in range(FRAMES)]
NTSC = Fraction(60000, 1001)
QUIET = {"x265-params": "log-level=none:pools=1"}

WRITTEN: dict[str, dict[str, object]] = {
    "five-b-frames.mp4": {"options": {"bf": "5", "b_strategy": "0"}},
    "hevc-10-bit-59.94.mp4": {"codec": "libx265", "pixel_format": "yuv420p10le", "rate": NTSC, "options": QUIET},
    "from-5-s.mkv": {"from_s": 5.0, "options": {"bf": "3"}},
    "at-an-hour.ts": {"from_s": 3600.0, "options": {"bf": "3"}},
    "begins-late.mp4": {"from_s": 2.0},
    "uneven.mp4": {"times_s": UNEVEN_S, "options": {"bf": "2"}},
    "uneven.mkv": {"times_s": UNEVEN_S, "options": {"bf": "2"}},
    "h264-b-frames.avi": {"options": {"bf": "2"}},
    "mpeg4.avi": {"codec": "mpeg4", "options": {"bf": "2"}},
    "mpeg4.mp4": {"codec": "mpeg4", "options": {"bf": "2"}},
    "mpeg2.ts": {"codec": "mpeg2video", "options": {"bf": "2"}},
    "mpeg2.mpg": {"codec": "mpeg2video", "options": {"bf": "2"}},
    "vp9.webm": {"codec": "libvpx-vp9", "options": {"deadline": "realtime", "cpu-used": "8"}},
    "prores.mov": {"codec": "prores_ks", "pixel_format": "yuv422p10le"},
    "ffv1.mkv": {"codec": "ffv1"},
    "grey.mkv": {"codec": "ffv1", "pixel_format": "gray"},
    "mjpeg.avi": {"codec": "mjpeg", "pixel_format": "yuvj420p"},
    "fragments.mp4": {"container": {"movflags": "frag_keyframe+empty_moov"}},
    "without-times.h264": {"options": {"bf": "2"}},
    "open-groups.mp4": {"options": {"x264-params": "open-gop=1:bframes=3:keyint=12:min-keyint=12:scenecut=0"}},
    "refreshed-bit-by-bit.ts": {"options": {"x264-params": "intra-refresh=1:keyint=12:bframes=0"}},
    "declared-interlaced.mp4": {"options": {"flags": "+ilme+ildct", "x264-params": "tff=1"}},
    "444.mp4": {"pixel_format": "yuv444p"},
    "flash.flv": {"options": {"bf": "2"}},
    "with-a-cover.mp4": {"more": [("mjpeg", PICTURES[:1])], "more_first": True},
    "with-a-preview.mkv": {"more": [("mjpeg", [p[:60, :80] for p in PICTURES])], "more_first": True},
    "turned.mp4": {"rotation_deg": 90},
}


@pytest.fixture(scope="module", params=WRITTEN)
def case(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, object]]:
    settings = WRITTEN[request.param]
    return muxed(tmp_path_factory.mktemp("video") / request.param, PICTURES, **settings), settings  # type: ignore[arg-type]


def shown(path: Path) -> Callable[[np.ndarray], int]:
    """What reads a frame's number, whichever way up it was stored."""
    turns = video_head(path).turned_deg // 90
    return lambda picture: number_in(np.rot90(picture, turns))


def test_frames_keep_their_numbers_and_times(case: tuple[Path, dict[str, object]]) -> None:
    path, settings = case
    number, frames, times = shown(path), list(frames_of(path)), video_times(path)
    assert [f.index for f in frames] == list(range(FRAMES))
    assert [number(f.pixels) for f in frames] == list(range(FRAMES))
    rate = float(settings.get("rate", 25))  # type: ignore[arg-type]
    true_s = UNEVEN_S if "times_s" in settings else np.arange(FRAMES) / rate
    np.testing.assert_allclose([f.time_s for f in frames], true_s, atol=2e-3)
    np.testing.assert_allclose(times.frame_time_s, [f.time_s for f in frames], atol=1e-9)
    assert times.image_size == frames[0].pixels.shape[1::-1]
    assert "times_s" in settings or times.frame_rate == pytest.approx(rate, rel=2e-3)


def test_frames_are_found_backwards_and_one_by_one(case: tuple[Path, dict[str, object]]) -> None:
    path, _ = case
    number = shown(path)
    back = list(frames_back(path, FRAMES - 1))
    assert [f.index for f in back] == list(range(FRAMES - 1, -1, -1))
    assert [number(f.pixels) for f in back] == [f.index for f in back]
    reader = FrameReader(path)
    for index in (30, 3, 4, 19, FRAMES - 1, 0):
        picture = reader.read(index)
        assert picture is not None
        assert number(picture) == index
    reader.close()


@pytest.mark.parametrize(
    "name", ["five-b-frames.mp4", "hevc-10-bit-59.94.mp4", "from-5-s.mkv", "at-an-hour.ts", "begins-late.mp4"]
)
def test_tracks_reach_the_last_frame_and_nothing_is_called_broken(tmp_path: Path, name: str) -> None:
    path = muxed(tmp_path / name, PICTURES, **WRITTEN[name])  # type: ignore[arg-type]
    found = track_video(path, camera="c", boxes={"t": BOX})
    assert found.tracks[0].seen.all()
    assert len(found.tracks[0].frame) == FRAMES
    assert not any("broken" in note or "damaged" in note or "decoded" in note for note in found.notes)


def test_what_an_edit_list_cuts_away_is_no_frame(tmp_path: Path) -> None:
    path = muxed(tmp_path / "a.mp4", PICTURES, from_s=-0.4)
    assert [number_in(f.pixels) for f in frames_of(path)] == list(range(10, FRAMES))
    assert [f.index for f in frames_of(path)] == list(range(FRAMES - 10))
    assert video_times(path).frames == FRAMES - 10
    box = BOX.__class__(frame=5, x=30 + round(1.5 * 15), y=50, width=24, height=16)
    found = track_video(path, camera="c", boxes={"t": box})
    assert found.tracks[0].seen.all()
    assert not any("broken" in note for note in found.notes)


@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_rotation_is_that_of_an_upright_picture(tmp_path: Path, degrees: int) -> None:
    path = muxed(tmp_path / "a.mp4", PICTURES[:3], rotation_deg=degrees, options={"crf": "10"})
    head = video_head(path)
    picture = next(iter(frames_of(path))).pixels
    upright = np.rot90(PICTURES[0], degrees // 90)
    assert head.image_size == picture.shape[1::-1] == upright.shape[1::-1]
    assert head.turned_deg == 360 - degrees
    assert np.abs(picture.astype(int) - upright).mean() < 12


def test_sample_aspect_is_told_for_the_upright_picture(tmp_path: Path) -> None:
    flat = muxed(tmp_path / "a.mp4", PICTURES[:3], sample_aspect=Fraction(4, 3))
    turned = muxed(tmp_path / "b.mp4", PICTURES[:3], sample_aspect=Fraction(4, 3), rotation_deg=90)
    assert video_head(flat).sample_aspect == pytest.approx(4 / 3)
    assert video_head(turned).sample_aspect == pytest.approx(3 / 4)


def test_a_stream_is_asked_for_by_its_number(tmp_path: Path) -> None:
    small = [p[:60, :80] for p in PICTURES]
    path = muxed(tmp_path / "a.mkv", PICTURES, more=[("mjpeg", small)], more_first=True)
    assert video_head(path).image_size == SIZE
    assert video_head(path).moving == 2
    assert video_head(path, stream=0).image_size == (80, 60)
    with pytest.raises(UsageError, match="0 or 1"):
        video_head(path, stream=7)
    found = track_video(path, camera="c", boxes={"t": BOX})
    assert any("2 moving pictures; stream 1 (160 x 120)" in note for note in found.notes)


@pytest.mark.parametrize("threads", [1, 2, 8])
@pytest.mark.parametrize("name", ["a.mp4", "a.ts"])
def test_damage_goes_on_to_the_next_key_frame(tmp_path: Path, name: str, threads: int) -> None:
    settings = {"bf": "0", "x264-params": "scenecut=0"}
    whole = muxed(tmp_path / name, PICTURES, gop=10, options=settings)
    if name.endswith("mp4"):
        broken = overwritten(whole, tmp_path / "b.mp4", 13)
    else:  # one packet of 188 bytes, as a radio loses them; it is the last of a large frame
        raw, inside = bytearray(whole.read_bytes()), packets_of(whole)[11][0] - 188
        assert raw[inside] == raw[inside + 188] == 0x47
        broken = tmp_path / "b.ts"
        broken.write_bytes(raw[:inside] + raw[inside + 188 :])
    capture = Capture(broken, threads=threads)
    sound = {number_in(capture.pixels(shot)) for shot in capture.shots() if not shot.damaged}
    first = 13 if name.endswith("mp4") else 10
    assert not sound & {*range(first, 20)}
    assert sound >= {*range(first - 1), *range(20, FRAMES)}  # what is lost between two packets may be of the one before
    capture.close()


def test_no_frame_before_a_broken_one_is_trusted_that_was_predicted_from_it(tmp_path: Path) -> None:
    whole = muxed(tmp_path / "a.mp4", PICTURES, gop=20, options={"x264-params": "bframes=2:b-adapt=0:b-pyramid=0"})
    with av.open(str(whole)) as container:
        times = [p.pts * 25 * p.time_base for p in container.demux(video=0) if p.size and p.pts is not None]
    late = next(k for k in range(3, 20) if times[k] > times[k + 1])  # decoded before two that are shown before it
    broken = overwritten(whole, tmp_path / "b.mp4", late)
    sound = {f.index for f in frames_of(broken)}
    assert sound == {*range(int(times[late]) - 2), *range(20, FRAMES)}


def test_damaged_frames_have_no_fix_and_are_named(tmp_path: Path) -> None:
    whole = muxed(tmp_path / "a.mp4", PICTURES, gop=10, options={"bf": "0", "x264-params": "scenecut=0"})
    found = track_video(overwritten(whole, tmp_path / "b.mp4", 15), camera="c", boxes={"t": BOX})
    track = found.tracks[0]
    assert not track.seen[15:20].any()
    assert track.seen[:15].all()
    assert track.seen[26:].all()
    named = [n for n in found.notes if "5 of 40 frames (15 to 19)" in n or "1 of 40 frames (15)" in n]
    assert named


@pytest.mark.parametrize("kind", ["black", "repeated"])
def test_black_and_repeated_frames_cost_what_they_cost(tmp_path: Path, kind: str) -> None:
    pictures = [p.copy() for p in PICTURES]
    for k in (15, 16):
        pictures[k] = np.zeros_like(pictures[k]) if kind == "black" else pictures[14].copy()
    found = track_video(muxed(tmp_path / "a.mp4", pictures), camera="c", boxes={"t": BOX})
    track = found.tracks[0]
    assert track.seen[:15].all()
    assert track.seen[22:].all()
    true_x = BOX.centre_px[0] + np.rint(1.5 * track.frame)
    right = np.abs(track.xy_px[:, 0] - true_x) < 1.0
    assert right[track.seen & ~np.isin(track.frame, (15, 16))].all()
    assert not (kind == "black" and track.seen[15:17].any())


@pytest.mark.parametrize("name", ["a.mp4", "a.mkv"])
def test_what_is_cut_off_is_said(tmp_path: Path, name: str) -> None:
    container = {"movflags": "faststart"} if name.endswith("mp4") else {}
    whole = muxed(tmp_path / name, numbered(60), container=container)
    cut = tmp_path / f"cut-{name}"
    cut.write_bytes(whole.read_bytes()[: int(whole.stat().st_size * 0.6)])
    found = track_video(cut, camera="c", boxes={"t": BOX})
    assert 20 < len(found.frame_time_s) < 50
    assert any("cut off or broken" in note for note in found.notes)


def test_a_recording_that_begins_within_a_group_counts_from_what_decodes(tmp_path: Path) -> None:
    whole = muxed(tmp_path / "a.ts", PICTURES, gop=10, options={"bf": "0", "x264-params": "scenecut=0"})
    cut = tmp_path / "b.ts"
    cut.write_bytes(whole.read_bytes()[packets_of(whole)[3][0] :])
    frames = list(frames_of(cut))
    assert [f.index for f in frames] == list(range(30))
    assert [number_in(f.pixels) for f in frames] == list(range(10, FRAMES))
    assert video_times(cut).frames == 30
