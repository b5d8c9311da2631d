"""A board to print, at true scale: SVG or PDF, one page of exactly the board's size and a white margin.

Print at 100 % ("actual size"), then measure: the scale bar under the board is 100 mm, or what fits.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from calibration.boards.board import Board
from calibration.boards.charuco import charuco_board

Rectangle = tuple[float, float, float, float]
POINTS_PER_MM = 72 / 25.4


def black_squares_mm(board: Board) -> Iterator[Rectangle]:
    """Black rectangles (x, y, width, height) in millimetres from the board's top left, y down."""
    square = board.square_m * 1000
    for row in range(board.rows + 1):
        for column in range(board.cols + 1):
            if (row + column) % 2 == 0:
                yield column * square, row * square, square, square
    if board.marker_m is not None:
        yield from _markers_mm(board)


def _markers_mm(board: Board) -> Iterator[Rectangle]:
    """The black cells of the markers, runs of a row joined."""
    made = charuco_board(board)
    assert board.marker_m is not None
    dictionary, side = made.getDictionary(), board.marker_m * 1000
    cells = dictionary.markerSize + 2
    for number, corners in zip(np.ravel(made.getIds()), made.getObjPoints(), strict=True):
        left, top = np.asarray(corners, float)[:, :2].min(axis=0) * 1000
        picture = cv2.aruco.generateImageMarker(dictionary, int(number), cells)
        cell = side / cells
        for row, line in enumerate(np.asarray(picture) < 128):
            edges = np.flatnonzero(np.diff(np.concatenate([[False], line, [False]]).astype(int)))
            for first, last in edges.reshape(-1, 2):
                yield left + first * cell, top + row * cell, (last - first) * cell, cell


def board_page(board: Board) -> tuple[float, float, float, tuple[Rectangle, ...]]:
    """(width, height, margin) of the page in mm and all black rectangles on it, the scale bar last."""
    square = board.square_m * 1000
    margin = max(10.0, square)
    width, height = (board.cols + 1) * square, (board.rows + 1) * square
    bar = min(100.0, width // 10 * 10) or width
    shapes = tuple((x + margin, y + margin, w, h) for x, y, w, h in black_squares_mm(board))
    return width + 2 * margin, height + 2 * margin, margin, (*shapes, (margin, height + 1.6 * margin, bar, 0.5))


PAPERS_MM = {
    "A4": (210.0, 297.0), "US Letter": (215.9, 279.4), "A3": (297.0, 420.0), "US Tabloid": (279.4, 431.8),
    "A2": (420.0, 594.0), "A1": (594.0, 841.0), "A0": (841.0, 1189.0),
}  # fmt: skip
HOME_PAPERS = ("A4", "US Letter")
PAPER_BORDER_MM = 5.0
"""What most printers leave white on every side."""


def papers(board: Board) -> tuple[str, ...]:
    """Names of the papers onto which the board and its scale bar print at 100 %, the smallest first."""
    least, most = sorted(_printed_mm(board))
    return tuple(
        name
        for name, (short, long) in PAPERS_MM.items()
        if least <= short - 2 * PAPER_BORDER_MM and most <= long - 2 * PAPER_BORDER_MM
    )


def _printed_mm(board: Board) -> tuple[float, float]:
    """Width and height of what is printed; the margin around it is the paper's own white."""
    width, _, margin, shapes = board_page(board)
    return width - 2 * margin, max(y + h for _, y, _, h in shapes) - margin


def paper_in_words(board: Board) -> str:
    """On which paper the board prints, and where that is none that people have, what to do."""
    width, height, _, _ = board_page(board)
    fit = papers(board)
    page = f"the page is {width:.0f} x {height:.0f} mm"
    if any(name in HOME_PAPERS for name in fit):
        return f"{page}; it prints on {fit[0]} or larger"
    least, most = sorted(_printed_mm(board))
    short, long = (side - 2 * PAPER_BORDER_MM for side in PAPERS_MM["A4"])
    square = int(board.square_m * 1000 * min(short / least, long / most))
    smaller = f"squares of {square} mm would print on A4" if square >= 5 else "fewer squares would print on A4"
    needs = f"it needs {fit[0]} ({_by(fit[0])})" if fit else f"it prints on no paper up to A0 ({_by('A0')})"
    return f"{page}: it does not fit A4 ({_by('A4')}) or US Letter; {needs}. At a print shop, or: {smaller}"


def _by(paper: str) -> str:
    return f"{PAPERS_MM[paper][0]:g} x {PAPERS_MM[paper][1]:g} mm"


def caption(board: Board) -> str:
    """What is printed under the board, so that nobody has to guess later."""
    kind = (
        "checkerboard" if board.marker_m is None else f"ChArUco {board.dictionary}, marker {board.marker_m * 1000:g} mm"
    )
    bar = board_page(board)[3][-1][2]
    size = f"{board.name} inner corners, square {board.square_m * 1000:g} mm"
    return f"{size}, {kind}; the bar is {bar:g} mm: print at 100 %"


def board_svg(board: Board) -> str:
    """The page as SVG, its size given in millimetres."""
    width, height, margin, shapes = board_page(board)
    path = "".join(f"M{x:.4f} {y:.4f}h{w:.4f}v{h:.4f}h{-w:.4f}z" for x, y, w, h in shapes)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}mm" height="{height:g}mm" '
        f'viewBox="0 0 {width:g} {height:g}"><rect width="100%" height="100%" fill="#fff"/>'
        f'<path d="{path}" fill="#000" shape-rendering="crispEdges"/>'
        f'<text x="{margin:g}" y="{height - 0.15 * margin:.2f}" font-family="sans-serif" font-size="3">'
        f"{caption(board)}</text></svg>\n"
    )


def board_pdf(board: Board) -> bytes:
    """The page as PDF 1.4."""
    width, height, margin, shapes = board_page(board)
    s = POINTS_PER_MM
    drawing = "0 g\n" + "".join(
        f"{x * s:.4f} {(height - y - h) * s:.4f} {w * s:.4f} {h * s:.4f} re\n" for x, y, w, h in shapes
    )
    drawing += f"f\nBT /F1 8 Tf {margin * s:.2f} {0.15 * margin * s:.2f} Td ({caption(board)}) Tj ET\n"
    stream = drawing.encode("latin-1")
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width * s:.4f} {height * s:.4f}] /Contents 4 0 R "
        "/Resources << /Font << /F1 5 0 R >> >> /ViewerPreferences << /PrintScaling /None >> >>".encode(),
        b"<< /Length %d >>\nstream\n%sendstream" % (len(stream), stream),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
    ]
    out, places = bytearray(b"%PDF-1.4\n"), []
    for number, body in enumerate(objects, 1):
        places.append(len(out))
        out += b"%d 0 obj\n%s\nendobj\n" % (number, body)
    table = b"".join(b"%010d 00000 n \n" % place for place in places)
    tail = b"trailer << /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (len(objects) + 1, len(out))
    return bytes(out) + b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1) + table + tail
