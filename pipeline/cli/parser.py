"""What the command line takes. Imports nothing heavy, so that help is quick."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TypeAlias

OUT_HELP = "folder for the results (made where it is missing)"


def build_parser() -> argparse.ArgumentParser:
    """The parser of every command."""
    parser = argparse.ArgumentParser(
        prog="runningfix",
        description="3D trajectories of moving targets from unsynchronised flight video, flight logs and board photos.",
        epilog="example:\n  runningfix demo -o demo/          renders a flight with its truth, then processes it",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    _calibrate(commands)
    for name, what in (
        ("track", "follow the targets in the videos -> tracks.csv"),
        ("poses", "read the flight logs -> poses.csv"),
        ("solve", "tracks and poses -> trajectories, timing, report"),
        ("run", "all of it; resumes where it was stopped"),
    ):
        _flight_command(commands, name, what)
    _inspect(commands)
    _demo(commands)
    _experiment(commands)
    return parser


Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"


def _command(commands: Commands, name: str, what: str, example: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        name,
        help=what,
        description=what[0].upper() + what[1:] + ".",
        epilog=f"example:\n  {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    loudness = parser.add_mutually_exclusive_group()
    loudness.add_argument("--quiet", "-q", action="store_true", help="only errors, no progress bar")
    loudness.add_argument("--verbose", "-v", action="store_true", help="say more on standard error")
    parser.add_argument("--json", action="store_true", help="print a machine-readable summary on standard output")
    return parser


def _calibrate(commands: Commands) -> None:
    parser = _command(
        commands,
        "calibrate",
        "photos or a video of a checkerboard -> camera.json",
        "runningfix calibrate board/*.jpg --board 9x6 --square-mm 25 -o camera.json",
    )
    parser.add_argument("sources", nargs="+", type=Path, metavar="PHOTOS|VIDEO", help="photos, folders, or a video")
    parser.add_argument("--board", required=True, metavar="COLSxROWS", help="inner corners of the board, such as 9x6")
    parser.add_argument("--square-mm", required=True, type=float, metavar="MM", help="side of one square")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="camera.json", help="file to write")


def _flight_command(commands: Commands, name: str, what: str) -> None:
    parser = _command(commands, name, what, f"runningfix {name} flight.toml -o out/")
    parser.add_argument("flight", type=Path, metavar="flight.toml", help="the flight file")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="out/", help=OUT_HELP)
    if name in ("solve", "run"):
        methods = ("triangulation", "intersection", "li", "algorithm-1", "algorithm-2", "map")
        parser.add_argument("--method", choices=methods, help="instead of [solve] method in the flight file")


def _inspect(commands: Commands) -> None:
    parser = _command(
        commands,
        "inspect",
        "what is in a flight log, and what it lacks for camera poses",
        "runningfix inspect uav1.tlog -o uav1.svg",
    )
    parser.add_argument("log", type=Path, metavar="LOG", help=".tlog .mavlink .bin .log .ulg .srt")
    parser.add_argument("--system", type=int, metavar="ID", help="of several vehicles on one MAVLink link, this one")
    parser.add_argument("-o", "--output", type=Path, metavar="picture.svg", help="draw the flight into this file")


def _demo(commands: Commands) -> None:
    parser = _command(commands, "demo", "render a flight with its truth, run it, compare", "runningfix demo -o demo/")
    parser.add_argument("-o", "--output", default=Path("demo"), type=Path, metavar="demo/", help=OUT_HELP)
    parser.add_argument("--seed", type=int, default=7, help="of the rendered flight (default 7)")


def _experiment(commands: Commands) -> None:
    parser = _command(
        commands, "experiment", "the paper's tables and figures, flown again with our methods beside the paper's",
        "runningfix experiment accuracy --runs 1000 --jobs 2 -o experiments/",
    )  # fmt: skip
    parser.add_argument("name", metavar="NAME", help="of the experiment; 'list' names them, 'all' flies them all")
    parser.add_argument("--runs", type=int, default=1000, help="flights for every cell (default 1000)")
    parser.add_argument("--seed", type=int, default=1, help="of the flights (default 1)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default 2); the numbers do not depend on it")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="fly on a Dask cluster instead (extra 'cluster')")
    parser.add_argument("-o", "--output", default=Path("experiments"), type=Path, metavar="experiments/", help=OUT_HELP)
