"""Real footage with boxes drawn by people: a pedestrian that KCF as it comes loses."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.records import Box
from pipeline.tracking import track_video

CROSSING = Path(__file__).parents[4] / "shared" / "real" / "video" / "otb-crossing"


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    """Area in common over area covered, of boxes (left, top, right, bottom)."""
    low, high = np.maximum(a[:2], b[:2]), np.minimum(a[2:], b[2:])
    common = np.prod(np.maximum(high - low, 0))
    return float(common / (np.prod(a[2:] - a[:2]) + np.prod(b[2:] - b[:2]) - common))


@pytest.mark.real
def test_pedestrian_is_followed_across_the_road(tmp_path: Path) -> None:
    if not CROSSING.is_dir():
        pytest.skip(f"the OTB sequence is not at {CROSSING}")
    pictures = [cv2.imread(str(p)) for p in sorted((CROSSING / "img").glob("*.jpg"))]
    path = tmp_path / "crossing.avi"
    size = pictures[0].shape[1], pictures[0].shape[0]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 25.0, size)
    for picture in pictures:
        writer.write(picture)
    writer.release()
    drawn = np.loadtxt(CROSSING / "groundtruth_rect.txt")[:, :4] - np.array([1, 1, 0, 0])  # MATLAB counts from 1
    x, y, width, height = drawn[0]
    found = track_video(path, camera="c", boxes={"who": Box(frame=0, x=x, y=y, width=width, height=height)})
    track, outline = found.tracks[0], found.outlines_px[0]
    assert track.seen.mean() >= 0.95
    edges = [np.concatenate([o.min(axis=0), o.max(axis=0)]) + 0.5 for o in outline[track.seen]]
    true = np.column_stack([drawn[:, :2], drawn[:, :2] + drawn[:, 2:]])[track.seen]
    assert np.mean([overlap(a, b) for a, b in zip(edges, true, strict=True)]) >= 0.7
