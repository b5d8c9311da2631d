"""Two proposals on one vehicle are one; two cars in a row are two."""

import numpy as np

from pipeline.matching import TrackName
from pipeline.records import TRACKED, Box, ImageTrack
from pipeline.stages.matching.duplicates import duplicates

BOX = Box(frame=0, x=0, y=0, width=20, height=10)


def track(target, x0, frames=40, camera="a", speed=3.0):
    frame = np.arange(frames)
    xy = np.column_stack([x0 + speed * frame, np.full(frames, 50.0)])
    return ImageTrack(
        camera=camera, target=target, frame=frame, time_s=frame / 10, xy_px=xy, sigma_px=np.ones(frames),
        state=np.full(frames, TRACKED),
    )  # fmt: skip


def found(*tracks, proposed=("p1", "p2")):
    boxes = {TrackName(camera=t.camera, target=t.target): BOX for t in tracks}
    return {str(k): str(v) for k, v in duplicates(tracks, boxes, proposed).items()}


def test_the_shorter_of_two_on_one_vehicle_goes():
    assert found(track("p1", 0, 30), track("p2", 15, 40)) == {"a:p1": "a:p2"}


def test_cars_in_a_row_stay():
    assert found(track("p1", 0), track("p2", 30)) == {}


def test_one_that_is_overtaken_stays():
    assert found(track("p1", 0), track("p2", 5, speed=6.0)) == {}


def test_other_cameras_and_what_a_person_drew_stay():
    assert found(track("p1", 0), track("p2", 0, camera="b")) == {}
    assert found(track("mine", 0, 20), track("p1", 3, 40)) == {"a:p1": "a:mine"}
    assert found(track("mine", 0, 20), track("yours", 3, 40)) == {}
