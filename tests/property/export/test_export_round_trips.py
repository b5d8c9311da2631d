"""What is written is read back bit for bit; order of rows does not matter; a cut line is the same line."""

from __future__ import annotations

import tempfile
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.export import poses_csv, read_detections_csv, read_poses_csv, read_tracks_csv, tracks_csv
from pipeline.export.maps.as_geojson import cut_at_antimeridian
from pipeline.export.text.cells import fixed, utc_texts
from pipeline.records import LOST, REACQUIRED, TRACKED, ImageTrack, PoseTrack

names = st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1, max_size=8)
numbers = st.floats(allow_nan=False, allow_infinity=False, width=64)
frames = st.lists(st.integers(0, 2**31 - 1), min_size=1, max_size=6, unique=True).map(sorted)
quick = settings(max_examples=60, deadline=None)


@st.composite
def image_tracks(draw: st.DrawFn, camera: str, target: str) -> ImageTrack:
    frame = draw(frames)
    n = len(frame)
    state = draw(st.lists(st.sampled_from([TRACKED, REACQUIRED, LOST]), min_size=n, max_size=n))
    value = np.array(draw(st.lists(st.tuples(numbers, numbers, numbers), min_size=n, max_size=n)), float).reshape(n, 3)
    value[np.array(state) == LOST] = np.nan
    time = draw(st.lists(numbers, min_size=n, max_size=n))
    return ImageTrack(
        camera=camera, target=target, frame=frame, time_s=time, xy_px=value[:, :2], sigma_px=value[:, 2], state=state
    )


@st.composite
def track_sets(draw: st.DrawFn) -> list[ImageTrack]:
    keys = draw(st.lists(st.tuples(names, names), max_size=4, unique=True))
    return [draw(image_tracks(*key)) for key in keys]


def saved(text: str) -> Path:
    with tempfile.NamedTemporaryFile(suffix=".csv", delete=False) as file:
        file.write(text.encode())
    return Path(file.name)


def bits(values: np.ndarray) -> bytes:
    """The bytes of float64 values; every NaN the same."""
    return np.where(np.isnan(values), np.nan, values).tobytes()


@quick
@given(track_sets())
def test_tracks_round_trip_is_exact(tracks: list[ImageTrack]) -> None:
    path = saved(tracks_csv(tracks))
    try:
        again = read_tracks_csv(path)
    finally:
        path.unlink()
    assert [(t.camera, t.target) for t in again] == [(t.camera, t.target) for t in tracks]
    for one, other in zip(again, tracks, strict=True):
        np.testing.assert_array_equal(one.frame, other.frame)
        np.testing.assert_array_equal(one.state, other.state)
        for name in ("time_s", "xy_px", "sigma_px"):
            assert bits(getattr(one, name)) == bits(getattr(other, name))
    assert tracks_csv(again) == tracks_csv(tracks)


@quick
@given(names, frames, st.integers(0, 2**32 - 1))
def test_poses_round_trip_is_exact(camera: str, frame: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = len(frame)
    attitude = rng.normal(size=(n, 4))
    poses = PoseTrack(
        camera=camera,
        frame=np.array(frame),
        time_s=rng.normal(size=n) * 1e9,
        position_enu_m=rng.normal(size=(n, 3)) * 10.0 ** rng.integers(-9, 9, (n, 3)),
        enu_from_cam=attitude / np.linalg.norm(attitude, axis=1, keepdims=True),
    )
    path = saved(poses_csv([poses], [poses]))
    try:
        found = (*read_poses_csv(path), *read_poses_csv(path, refined=True))
    finally:
        path.unlink()
    assert len(found) == 2
    for again in found:
        assert again.camera == camera
        for name in ("frame", "time_s", "position_enu_m", "enu_from_cam"):
            assert getattr(again, name).tobytes() == getattr(poses, name).tobytes()


@quick
@given(st.integers(0, 2**32 - 1), st.integers(1, 30))
def test_order_of_detections_does_not_matter(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    rows = [f"{frame},t{frame % 3},{x!r},{-x!r}" for frame, x in enumerate(rng.normal(size=count).tolist())]
    texts = ["frame,target,x_px,y_px\n" + "\n".join(r) + "\n" for r in (rows, rng.permutation(rows).tolist())]
    found = []
    for text in texts:
        path = saved(text)
        try:
            tracks = read_detections_csv(path, camera="c", frame_rate=30.0, default_sigma_px=1.0)
        finally:
            path.unlink()
        found.append({t.target: (bits(t.time_s), bits(t.xy_px)) for t in tracks})
    assert found[0] == found[1]


@quick
@given(st.integers(-(2**40), 2**45), st.lists(st.integers(-(10**12), 10**12), min_size=1, max_size=4))
def test_utc_is_that_of_datetime(base_us: int, later_us: list[int]) -> None:
    texts = utc_texts(base_us / 1e6, np.array(later_us) / 1e6)
    for text, later in zip(texts, later_us, strict=True):
        want = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=base_us + later)
        assert datetime.fromisoformat(text) == want


@quick
@given(st.floats(-1e9, 1e9), st.integers(0, 9))
def test_fixed_is_a_decimal_without_exponent_or_minus_zero(value: float, decimals: int) -> None:
    text = fixed(value, decimals)
    assert "e" not in text
    assert abs(float(text) - value) <= 0.5 * 10.0**-decimals + 1e-6 * abs(value)
    assert not (text.startswith("-") and float(text) == 0)


@quick
@given(st.integers(0, 2**32 - 1), st.integers(2, 12))
def test_a_cut_line_is_the_same_line(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    unwrapped = np.column_stack([180 + rng.normal(0, 2, count), rng.uniform(-80, 80, count), rng.normal(size=count)])
    line = unwrapped.copy()
    line[:, 0] = (line[:, 0] + 180) % 360 - 180
    parts = cut_at_antimeridian(line)
    joined = np.vstack(parts)
    joined[:, 0] %= 360
    assert all(np.abs(np.diff(part[:, 0])).max() < 180 for part in parts)
    kept = joined[np.abs(joined[:, 0] - 180) > 1e-12]
    np.testing.assert_allclose(kept, unwrapped, atol=1e-9)
    length = np.linalg.norm(np.diff(joined, axis=0), axis=1).sum()
    np.testing.assert_allclose(length, np.linalg.norm(np.diff(unwrapped, axis=0), axis=1).sum(), rtol=1e-9)
