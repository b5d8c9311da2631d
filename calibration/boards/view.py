"""What was found in one photo: corners of the board, in pixels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from calibration.foundation.arrays import Floats, Ints, frozen, settle


@dataclass(frozen=True, kw_only=True, eq=False)
class BoardView:
    """One photo of the board.

    name         file name, or file name and time of a video's frame
    image_size   (width, height) in pixels
    corners      (n, 2) pixels of the inner corners that were seen
    index        (n,) which corners of the board they are, increasing (boards/board.py)
    blur_px      width (sigma) of the edges between squares, the sharpest direction and the most blurred; NaN unknown
    taken        what the photo says about its camera (EXIF), where it says anything
    """

    name: str
    image_size: tuple[int, int]
    corners: Floats
    index: Ints
    blur_px: tuple[float, float] = (float("nan"), float("nan"))
    taken: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n = len(self.index)
        settle(
            self,
            corners=frozen(self.corners, (n, 2), "corners"),
            index=frozen(self.index, (n,), "index", int),
            taken=MappingProxyType(dict(self.taken)),
        )
