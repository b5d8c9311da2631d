"""What tracking hands on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeVar

from calibration.foundation.arrays import Floats, frozen, settle
from pipeline.records import ImageTrack

Record = TypeVar("Record")


@dataclass(frozen=True, kw_only=True, eq=False)
class VideoTimes:
    """When the frames of a video were shown.

    frame_time_s  (n,) the container's timestamps, counted from frame 0
    frame_rate    nominal, as the container states it (frames per second)
    image_size    (width, height) of a frame as it is shown, rotation applied
    """

    frame_time_s: Floats
    frame_rate: float
    image_size: tuple[int, int]

    def __post_init__(self) -> None:
        settle(self, frame_time_s=frozen(self.frame_time_s, (None,), "frame_time_s"))

    @property
    def frames(self) -> int:
        """How many frames there are."""
        return len(self.frame_time_s)


@dataclass(frozen=True, kw_only=True, eq=False)
class VideoTracks:
    """Every target followed through one video.

    tracks        one for each target, in the order of the boxes; rows from the box's frame to the video's last
    frame_time_s, frame_rate, image_size  as in `VideoTimes`, of the frames that could be decoded
    outlines_px   one for each track: (n, 4, 2) corners of its first box, carried along; NaN while lost
    predicted_px  one for each track: (n, 3) where it was looked for while lost (x, y) and one sigma; NaN elsewhere
    notes         what a person should know: frames missing, targets never found again
    """

    tracks: tuple[ImageTrack, ...]
    frame_time_s: Floats
    frame_rate: float
    image_size: tuple[int, int]
    notes: tuple[str, ...] = ()
    outlines_px: tuple[Floats, ...] = ()
    predicted_px: tuple[Floats, ...] = ()

    def __post_init__(self) -> None:
        outlines = tuple(frozen(o, (None, 4, 2), "outlines_px") for o in self.outlines_px)
        predicted = tuple(frozen(p, (None, 3), "predicted_px") for p in self.predicted_px)
        times = frozen(self.frame_time_s, (None,), "frame_time_s")
        settle(self, frame_time_s=times, outlines_px=outlines, predicted_px=predicted)


def changed(record: Record, **values: object) -> Record:
    """The dataclass `record` (frozen, without slots or `__post_init__`) with other values; nothing cached is kept.

    Raises TypeError where it has no such field.
    """
    kind: Any = type(record)
    fields = kind.__dataclass_fields__
    if not fields.keys() >= values.keys():
        raise TypeError(f"{kind.__name__} has no field {', '.join(values.keys() - fields.keys())}")
    out: Record = object.__new__(kind)
    before = record.__dict__
    out.__dict__.update({name: before[name] for name in fields} | values)
    return out
