"""`runningfix board`: a calibration board to print, at true scale."""

from __future__ import annotations

from argparse import Namespace

from calibration import Board, board_pdf, board_svg
from calibration.boards.printing import HOME_PAPERS, board_page, paper_in_words, papers
from calibration.foundation.errors import UsageError
from calibration.foundation.files import write_whole
from pipeline.cli.console import Console


def run(arguments: Namespace, console: Console) -> int:
    """Writes the board's page."""
    board = read_board(arguments)
    suffix = arguments.output.suffix.lower()
    if suffix not in (".pdf", ".svg"):
        raise UsageError(
            where="-o",
            seen=str(arguments.output),
            expected="a name that ends in .pdf or .svg",
            advice="board.pdf prints everywhere",
        )
    write_whole(arguments.output, board_pdf(board) if suffix == ".pdf" else board_svg(board))
    width_mm, height_mm = board_page(board)[:2]
    paper = paper_in_words(board)
    warnings = [] if any(name in HOME_PAPERS for name in papers(board)) else [paper]
    summary = {
        "status": "done", "command": "board", "board": board.name, "page_mm": [width_mm, height_mm],
        "papers": list(papers(board)), "warnings": warnings, "files": [str(arguments.output)],
    }  # fmt: skip
    for line in warnings:
        console.say(f"note: {line}")
    told = "" if warnings else f"{paper}. "
    console.result(
        summary,
        f"written {arguments.output}: {told}Print at 100 %, measure the bar, glue it onto something flat and stiff",
    )
    return 0


def read_board(arguments: Namespace) -> Board:
    """The board that the options of `board` and `calibrate` describe. Raises UsageError."""
    return Board.parse(
        arguments.board,
        square_mm=arguments.square_mm,
        marker_mm=arguments.marker_mm,
        dictionary=arguments.dictionary or "",
    )
