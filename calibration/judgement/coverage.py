"""What a set of views can and cannot tell, in figures and in words.

Coverage: the image in 5 x 5 tiles, a tile is seen when a corner of some view falls in it.
Tilt: angle between the board's normal and the optical axis; without tilt, focal length and distance cannot be told
apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from calibration.boards.view import BoardView
from calibration.foundation.arrays import Bools, Floats, Ints, frozen, settle

TILES = 5
ROW_NAMES = ("upper", "upper", "middle", "lower", "lower")
COLUMN_NAMES = ("left", "left", "middle", "right", "right")


@dataclass(frozen=True, kw_only=True, eq=False)
class Coverage:
    """Where in the image the corners were, and how the boards stood.

    boards          (5, 5) tiles of the image, row by row: views of which some corner was seen there
    area            share of the image inside the hull of all corners
    tilt_deg        (v,) of each view
    distance_m      (v,) of the board's middle
    roll_spread_deg how far the boards were turned about the optical axis (0 to 90)
    """

    boards: Ints
    area: float
    tilt_deg: Floats
    distance_m: Floats
    roll_spread_deg: float

    def __post_init__(self) -> None:
        settle(
            self,
            boards=frozen(self.boards, (TILES, TILES), "boards", int),
            tilt_deg=frozen(self.tilt_deg, (None,), "tilt_deg"),
            distance_m=frozen(self.distance_m, (None,), "distance_m"),
        )

    @property
    def seen(self) -> Bools:
        """(5, 5) tiles in which some corner was seen."""
        return np.asarray(self.boards > 0)


def coverage(views: Sequence[BoardView], rotation: Floats, translation_m: Floats) -> Coverage:
    """Coverage by `views` whose boards stand at (rotation, translation), the board's middle at its origin."""
    size = np.array(views[0].image_size)
    every = np.concatenate([v.corners for v in views])
    boards = np.zeros((TILES, TILES), int)
    for view in views:
        tile = np.clip(((view.corners + 0.5) / size * TILES).astype(int), 0, TILES - 1)
        boards[tuple(np.unique(tile[:, ::-1], axis=0).T)] += 1
    hull = cv2.convexHull(every.astype(np.float32))
    cosine = np.abs(rotation[:, 2, 2])
    roll = np.degrees(np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0])) % 90
    around = np.abs(np.exp(4j * np.radians(roll)).mean())
    return Coverage(
        boards=boards,
        area=float(cv2.contourArea(hull) / size.prod()),
        tilt_deg=np.degrees(np.arccos(np.clip(cosine, 0, 1))),
        distance_m=np.linalg.norm(translation_m, axis=1),
        roll_spread_deg=float(np.degrees(np.sqrt(max(0.0, -2 * np.log(max(around, 1e-9)))) / 4)),
    )


LATTICE_COLUMNS, LATTICE_ROWS = 21, 17


def lattice(image_size: tuple[int, int], columns: int = LATTICE_COLUMNS, rows: int = LATTICE_ROWS) -> Floats:
    """(n, 2) pixels spread evenly over the image, its edges among them."""
    x, y = np.meshgrid(np.linspace(0, image_size[0] - 1, columns), np.linspace(0, image_size[1] - 1, rows))
    return np.stack([x.ravel(), y.ravel()], axis=1)


def reached(views: Sequence[BoardView], pixels: Floats) -> Bools:
    """(n,) which pixels lie inside the hull of all corners."""
    hull = cv2.convexHull(np.concatenate([v.corners for v in views]).astype(np.float32))
    return np.array([cv2.pointPolygonTest(hull, (float(x), float(y)), False) >= 0 for x, y in pixels])


def missing_regions(seen: Bools) -> tuple[str, ...]:
    """Names of the image's regions (corners, edges) that no view reached."""
    blocks = {
        f"{row} {column}": seen[i, j]
        for row, i in (("upper", slice(0, 2)), ("lower", slice(3, 5)))
        for column, j in (("left", slice(0, 2)), ("right", slice(3, 5)))
    }
    corners = [name + " corner" for name, block in blocks.items() if not block.any()]
    sides = {"left edge": seen[:, 0], "right edge": seen[:, -1], "upper edge": seen[0], "lower edge": seen[-1]}
    return tuple(corners + [name for name, line in sides.items() if not line.any()])


FEW_BOARDS = 3
"""Boards in a region from which what one of them got wrong shows. Doubled, most sets are asked for more."""


def thin_regions(boards: Ints) -> tuple[tuple[str, int], ...]:
    """The image's corners in which boards were, but fewer than 3, and how many."""
    blocks = {
        f"{row} {column} corner": int(boards[i, j].max())
        for row, i in (("upper", slice(0, 2)), ("lower", slice(3, 5)))
        for column, j in (("left", slice(0, 2)), ("right", slice(3, 5)))
    }
    return tuple((name, count) for name, count in blocks.items() if 0 < count < FEW_BOARDS)


def corner_named(pixel: Floats, image_size: tuple[int, int]) -> str:
    """The name of the corner of the image that a pixel (2,) is nearest to."""
    row = "upper" if pixel[1] < image_size[1] / 2 else "lower"
    return f"{row} {'left' if pixel[0] < image_size[0] / 2 else 'right'}"


def map_in_words(boards: Ints) -> tuple[str, ...]:
    """The tiles row by row, each with how many boards were in it; a point: none."""
    return tuple(" ".join(f"{n or '.':>3}" for n in row) for row in boards.tolist())


def grid_of(view: BoardView, cols: int, rows: int) -> Floats:
    """Corners (rows, cols, 2) of a view, NaN where not seen."""
    grid = np.full((cols * rows, 2), np.nan)
    grid[view.index] = view.corners
    return grid.reshape(rows, cols, 2)
