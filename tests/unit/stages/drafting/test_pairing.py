"""Files are paired by what their names say of whose they are."""

from pathlib import Path

import pytest

from pipeline.stages.drafting.folder import Found
from pipeline.stages.drafting.pairing import draft_cameras, related


@pytest.mark.parametrize(
    ("one", "other"), [("uav1.mp4", "uav1.tlog"), ("uav1.mp4", "uav1-cam.json"), ("north.mp4", "log_north.bin")]
)
def test_names_that_belong_together(one, other):
    assert related(Path(one), Path(other))


@pytest.mark.parametrize(
    ("one", "other"), [("uav1.mp4", "uav10.tlog"), ("video_a.mp4", "log_b.tlog"), ("cam1.mp4", "cam2.json")]
)
def test_names_that_do_not(one, other):
    assert not related(Path(one), Path(other))


def found(videos, logs):
    return Found(
        folder=Path(), videos=dict.fromkeys(map(Path, videos)), logs=dict.fromkeys(map(Path, logs)), cameras={},
        detections=(), notes=(),
    )  # fmt: skip


def logs_of(videos, logs):
    return [(c.log.path.name if c.log.path else None, c.log.guess) for c in draft_cameras(found(videos, logs))]


def test_the_one_that_is_left_is_a_guess():
    assert logs_of(["uav1.mp4", "uav2.mp4"], ["uav1.csv", "zebra.csv"]) == [
        ("uav1.csv", ""), ("zebra.csv", "it is the one that is left"),
    ]  # fmt: skip


def test_two_that_could_be_are_not_guessed():
    assert logs_of(["a1.mp4", "b2.mp4"], ["x.csv", "y.csv"]) == [(None, ""), (None, "")]


def test_cameras_of_one_name_get_names_of_their_own():
    names = [c.name for c in draft_cameras(found(["a/GX 1.mp4", "b/GX 1.mp4"], []))]
    assert names == ["GX-1", "GX-1-2"]
