"""The calibration board: what is printed on it, counted in inner corners.

A checkerboard of cols x rows inner corners has (cols + 1) x (rows + 1) squares. Corner i sits at column i % cols
and row i // cols, at (column, row, 0) * square_m: the board's own axes, x right, y down, z away from the viewer.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import UsageError

DEFAULT_DICTIONARY = "DICT_5X5_1000"


@dataclass(frozen=True, kw_only=True)
class Board:
    """A flat board.

    cols, rows   inner corners: where four squares meet
    square_m     side of a square
    marker_m     side of a ChArUco marker; None for a plain checkerboard
    dictionary   name of the ArUco dictionary the markers are from
    """

    cols: int
    rows: int
    square_m: float
    marker_m: float | None = None
    dictionary: str = DEFAULT_DICTIONARY

    def __post_init__(self) -> None:
        if self.cols < 3 or self.rows < 3:
            raise UsageError(
                where="board",
                seen=f"{self.cols}x{self.rows} inner corners",
                expected="at least 3x3 inner corners",
                advice="count the points where four squares meet, not the squares",
            )
        if not (np.isfinite(self.square_m) and self.square_m > 0):
            raise UsageError(
                where="square size",
                seen=f"{self.square_m * 1000:g} mm",
                expected="a length above 0",
                advice="measure a square with a ruler and give it in millimetres",
            )
        if self.marker_m is not None and not 0 < self.marker_m < self.square_m:
            raise UsageError(
                where="marker size",
                seen=f"{self.marker_m * 1000:g} mm",
                expected=f"more than 0 and less than the square's {self.square_m * 1000:g} mm",
                advice="measure the black border of a marker, side to side",
            )

    @property
    def name(self) -> str:
        """The way users write it, for example "9x6"."""
        return f"{self.cols}x{self.rows}"

    @property
    def points_m(self) -> Floats:
        """Inner corners (cols * rows, 3) in the board's axes, row by row."""
        row, col = np.mgrid[: self.rows, : self.cols]
        return np.stack([col.ravel(), row.ravel(), np.zeros(col.size)], axis=1) * self.square_m

    @classmethod
    def parse(cls, text: str, *, square_mm: float, marker_mm: float | None = None, dictionary: str = "") -> Board:
        """A Board from "9x6" (inner corners) and the side of a square in millimetres.

        Raises UsageError where the text is not two whole numbers or a size is impossible.
        """
        found = re.fullmatch(r"\s*(\d{1,3})\s*[xX*,]\s*(\d{1,3})\s*", text)
        if not found:
            raise UsageError(
                where="--board",
                seen=repr(text),
                expected="columns x rows of inner corners, for example 9x6",
                advice="count the points where four squares meet along the long and the short side",
            )
        return cls(
            cols=int(found[1]),
            rows=int(found[2]),
            square_m=square_mm / 1000,
            marker_m=None if marker_mm is None else marker_mm / 1000,
            dictionary=dictionary or DEFAULT_DICTIONARY,
        )
