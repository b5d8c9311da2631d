"""What the command line takes. Imports nothing heavy, so that help is quick."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn, TypeAlias

from calibration.foundation.errors import UsageError

OUT_HELP = "folder for the results (made where it is missing)"


class Parser(argparse.ArgumentParser):
    """A parser whose mistakes are errors like all others."""

    def error(self, message: str) -> NoReturn:
        """Raises UsageError."""
        raise UsageError(
            where="command line",
            seen=message,
            expected=" ".join(self.format_usage().removeprefix("usage: ").split()),
            advice=f"`{self.prog} --help` shows an example",
        )


def build_parser() -> argparse.ArgumentParser:
    """The parser of every command."""
    parser = Parser(
        prog="runningfix",
        description="3D trajectories of moving targets from unsynchronised flight video, flight logs and board photos.",
        epilog="example:\n  runningfix demo -o demo/          renders a flight with its truth, then processes it",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    _board(commands)
    _calibrate(commands)
    _camera(commands)
    _detect(commands)
    _label(commands)
    _landmarks(commands)
    _match(commands)
    _new(commands)
    check = _command(
        commands, "check", "what is wrong or doubtful in a flight, before tracking", "runningfix check flight.toml"
    )
    check.add_argument("flight", type=Path, metavar="flight.toml", help="the flight file")
    for name, what in (
        ("track", "follow the targets in the videos -> tracks.csv"),
        ("poses", "read the flight logs -> poses.csv"),
        ("solve", "tracks and poses -> trajectories, timing, report"),
        ("run", "all of it; resumes where it was stopped"),
    ):
        _flight_command(commands, name, what)
    _export(commands)
    _batch(commands)
    _boresight(commands)
    _inspect(commands)
    doctor = _command(
        commands, "doctor", "is this installation whole: packages, folders, a self-test", "runningfix doctor"
    )
    doctor.add_argument("--warm", action="store_true", help="compile ahead what would be compiled on first use")
    doctor.add_argument("--quick", action="store_true", help="only look at what is installed, without the self-test")
    _demo(commands)
    _experiment(commands)
    return parser


Commands: TypeAlias = "argparse._SubParsersAction[Parser]"


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


def _board(commands: Commands) -> None:
    parser = _command(
        commands, "board", "a calibration board to print, PDF or SVG at true scale",
        "runningfix board --board 9x6 --square-mm 25 -o board.pdf",
    )  # fmt: skip
    _pattern(parser)
    parser.add_argument(
        "-o", "--output", required=True, type=Path, metavar="board.pdf", help="file to write (.pdf .svg)"
    )


def _pattern(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--board", required=True, metavar="COLSxROWS", help="inner corners of the board, such as 9x6")
    parser.add_argument("--square-mm", required=True, type=float, metavar="MM", help="side of one square")
    parser.add_argument(
        "--marker-mm", type=float, metavar="MM", help="side of the markers: the board is a ChArUco board"
    )
    parser.add_argument("--dictionary", metavar="NAME", help="of the markers (default DICT_5X5_1000)")


FORMATS = ("json", "opencv-yaml", "opencv-xml", "ros", "kalibr", "aniposelib", "caliscope")


def _calibrate(commands: Commands) -> None:
    parser = _command(
        commands,
        "calibrate",
        "photos or a video of a board -> camera.json",
        "runningfix calibrate board/*.jpg --board 9x6 --square-mm 25 -o camera.json",
    )
    parser.add_argument("sources", nargs="+", type=Path, metavar="PHOTOS|VIDEO", help="photos, folders, or a video")
    _pattern(parser)
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="camera.json", help="file to write")
    terms = ("auto", "focal", "1", "2", "4", "5", "8", "fisheye")
    parser.add_argument("--terms", choices=terms, default="auto", help="distortion terms (default: by held-out error)")
    parser.add_argument("--report", action="store_true", help="also write a page with pictures beside it (.html)")
    parser.add_argument("--format", choices=FORMATS, default="json", help="of the camera file (default json)")
    parser.add_argument(
        "--each", action="store_true", help="every source is a camera of its own; -o is a folder for NAME.json"
    )
    parser.add_argument(
        "--for", dest="video", type=Path, metavar="VIDEO",
        help="write the camera of this video's pictures: the photos' scaled, where both have one shape; else --crop",
    )  # fmt: skip
    parser.add_argument("--crop", **CROP)
    parser.add_argument(
        "--at-least", choices=("usable", "good"), help="exit code 5 where the verdict is worse (the file is written)"
    )


CROP: Mapping[str, Any] = {
    "nargs": 4, "type": float, "metavar": ("X", "Y", "WIDTH", "HEIGHT"),
    "help": "part of the calibrated picture that is meant, in its pixels from the top left",
}  # fmt: skip


def _camera(commands: Commands) -> None:
    parser = _command(
        commands, "camera", "a camera file for other pictures of its camera: scaled, cropped, turned, converted",
        "runningfix camera scale uav1.json --to 1920x1080 -o uav1-1080.json",
    )  # fmt: skip
    parser.add_argument("action", choices=("scale",), help="what to do")
    parser.add_argument("file", type=Path, metavar="camera.json", help="the camera file, of any format that is read")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="new.json", help="file to write")
    parser.add_argument("--for", dest="video", type=Path, metavar="VIDEO", help="the video whose pictures it is to fit")
    parser.add_argument("--to", metavar="WIDTHxHEIGHT", help="size of the pictures it is to fit")
    parser.add_argument("--crop", **CROP)
    parser.add_argument(
        "--turn", type=int, choices=(90, 180, 270), default=0, help="degrees clockwise by which the pictures are turned"
    )
    parser.add_argument("--camera", metavar="NAME", help="which one, where the file holds several")
    parser.add_argument("--format", choices=FORMATS, default="json", help="of the new file (default json)")


def _boresight(commands: Commands) -> None:
    parser = _command(
        commands, "boresight", "mount angles and start of the video from a flight",
        "runningfix boresight flight.toml --still mast --at 28.2001 112.9003 61.5 -o out/",
    )  # fmt: skip
    parser.add_argument("flight", type=Path, metavar="flight.toml", help="the flight file")
    parser.add_argument(
        "--still", metavar="TARGET", help="a tracked target that stood still at a known place; without it, the "
        "trajectories of the flight solved in -o",
    )  # fmt: skip
    parser.add_argument(
        "--at", nargs=3, type=float, metavar=("LAT", "LON", "HEIGHT"),
        help="its place: degrees, and metres above the ellipsoid",
    )  # fmt: skip
    parser.add_argument("--at-sigma-m", type=float, default=0.05, metavar="M", help="of the place (default 0.05)")
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        type=Path,
        metavar="out/",
        help="folder with tracks.csv; boresight.json goes there",
    )


def _detect(commands: Commands) -> None:
    parser = _command(
        commands, "detect", "propose moving targets in a video: pictures, and boxes for the flight file",
        "runningfix detect uav1.mp4 --camera uav1 -o detect/",
    )  # fmt: skip
    parser.add_argument("video", type=Path, metavar="VIDEO", help="the video")
    parser.add_argument("--camera", metavar="NAME", help="of the camera in the flight file (default: the file's name)")
    parser.add_argument("--most", type=int, default=12, help="how many targets to propose (default 12)")
    parser.add_argument("-o", "--output", default=Path("detect"), type=Path, metavar="detect/", help=OUT_HELP)


def _label(commands: Commands) -> None:
    parser = _command(
        commands, "label", "draw and correct boxes in a web page of this machine, into the flight file",
        "runningfix label flight.toml -o out/",
    )  # fmt: skip
    parser.add_argument("flight", type=Path, metavar="flight.toml", help="the flight file; it is edited in place")
    parser.add_argument(
        "-o", "--output", default=Path("out"), type=Path, metavar="out/", help="where tracks.csv is, or goes"
    )
    parser.add_argument("--port", type=int, default=0, help="of the page (default: a free one)")
    parser.add_argument("--no-browser", action="store_true", help="only say the address")


def _landmarks(commands: Commands) -> None:
    parser = _command(
        commands, "landmarks", "surveyed points of OpenDroneMap or Pix4D, with their marks, into a new flight file",
        "runningfix landmarks flight.toml gcp_list.txt --datum msl",
    )  # fmt: skip
    parser.add_argument("flight", type=Path, metavar="flight.toml", help="the flight file; it is left as it is")
    parser.add_argument("list", type=Path, metavar="LIST", help="gcp_list.txt, or Pix4D's marks (picture, label, x, y)")
    parser.add_argument("--coordinates", type=Path, metavar="FILE", help="Pix4D's other file (label, coordinates)")
    parser.add_argument("--crs", metavar="EPSG:32616", help="coordinate system, where the list names none")
    parser.add_argument("--datum", choices=("ellipsoid", "msl"), help="what heights count from, where that is not said")
    parser.add_argument(
        "--order", choices=("east-first", "north-first"),
        help="of two coordinates (default: east for OpenDroneMap, as the system's axes for Pix4D)",
    )  # fmt: skip
    parser.add_argument(
        "--pixel-origin", choices=("centre", "corner"),
        help="where pixel (0, 0) is on the top-left pixel (default: centre for OpenDroneMap, corner for Pix4D)",
    )  # fmt: skip
    parser.add_argument(
        "--first-frame", type=int, default=0, metavar="N", help="number in the name of a video's frame 0"
    )
    parser.add_argument("--sigma-m", type=_positive, default=0.05, metavar="M", help="of the places (default: 0.05)")
    parser.add_argument("--sigma-up-m", type=_positive, metavar="M", help="of their heights (default: as --sigma-m)")
    parser.add_argument("--sigma-px", type=_positive, default=1.0, metavar="PX", help="of the marks (default: 1)")
    parser.add_argument("--check", action="append", metavar="NAME", help="a point that is only held against the answer")
    parser.add_argument(
        "--write", type=Path, metavar="NAME.toml", help="the new flight file (default: flight-landmarks.toml beside it)"
    )


def _match(commands: Commands) -> None:
    parser = _command(
        commands, "match", "which target of one camera is which of another: boxes and tracks under common names",
        "runningfix match flight.toml -o out/",
    )  # fmt: skip
    parser.add_argument("flight", type=Path, metavar="flight.toml", help="the flight file; it is left as it is")
    parser.add_argument("-o", "--output", default=Path("out"), type=Path, metavar="out/", help="where the tracks go")
    parser.add_argument(
        "--write", type=Path, metavar="NAME.toml", help="the new flight file (default: flight-matched.toml beside it)"
    )


def _new(commands: Commands) -> None:
    parser = _command(
        commands, "new", "a folder of videos, logs and camera files -> a commented flight file, guesses marked",
        "runningfix new flight-folder/",
    )  # fmt: skip
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="what lies there is looked at, and left as it is")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="flight.toml", help="file to write (default: flight.toml in the folder)"
    )
    parser.add_argument("--no-detect", action="store_true", help="propose no boxes: quick, no video is looked into")


def _flight_command(commands: Commands, name: str, what: str) -> None:
    parser = _command(commands, name, what, f"runningfix {name} flight.toml -o out/")
    parser.add_argument("flight", type=Path, metavar="flight.toml", help="the flight file")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="out/", help=OUT_HELP)
    if name == "track":
        words = "also write each video with its tracks, predictions and uncertainties drawn on it"
        parser.add_argument("--overlay", action="store_true", help=words)
    if name in ("track", "run"):
        words = "coarse tracker, instead of each camera's in the flight file (csrt takes six times as long)"
        parser.add_argument("--tracker", choices=("kcf", "csrt"), help=words)
    if name in ("solve", "run"):
        methods = ("triangulation", "intersection", "li", "algorithm-1", "algorithm-2", "map")
        parser.add_argument("--method", choices=methods, help="instead of [solve] method in the flight file")


def _export(commands: Commands) -> None:
    parser = _command(
        commands, "export", "a finished run as a recording of the Rerun viewer: trajectories, cameras, videos (.rrd)",
        "runningfix export flight.toml -o out/\n  runningfix export flight.toml -o out/ --to show.rrd --no-video",
    )  # fmt: skip
    parser.add_argument("flight", type=Path, metavar="flight.toml", help="the flight file")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="out/", help="folder of the finished run")
    parser.add_argument("--to", type=Path, metavar="FILE", help="file to write (default: flight.rrd in that folder)")
    parser.add_argument("--no-video", action="store_true", help="leave the videos out: as large as they are otherwise")


def _inspect(commands: Commands) -> None:
    parser = _command(
        commands,
        "inspect",
        "what is in a flight log, and what it lacks for camera poses",
        "runningfix inspect uav1.tlog -o uav1.svg",
    )
    parser.add_argument(
        "log",
        type=Path,
        metavar="LOG",
        help=".tlog .mavlink .bin .log .ulg .srt, .ts with metadata, .csv of AirData or DJI",
    )
    parser.add_argument("--system", type=int, metavar="ID", help="of several vehicles on one MAVLink link, this one")
    parser.add_argument(
        "--dialect", default="", metavar="NAME|XML", help="a pymavlink dialect, or your message definitions"
    )
    parser.add_argument("-o", "--output", type=Path, metavar="picture.svg", help="draw the flight into this file")


def _batch(commands: Commands) -> None:
    parser = _command(
        commands, "batch", "many flights, each within limits, into one data set with a catalogue",
        "runningfix batch 'flights/*/flight.toml' -o batch/\n  runningfix batch flights.csv -o s3://bucket/batch "
        "--timeout 900 --memory 2G",
    )  # fmt: skip
    parser.add_argument(
        "flights", nargs="+", metavar="FLIGHTS",
        help="flight files, folders with a flight.toml, patterns, or tables (.csv .parquet) with a column `flight`; "
        "paths or URLs",
    )  # fmt: skip
    parser.add_argument("-o", "--output", required=True, metavar="batch/", help="folder or URL of the data set")
    parser.add_argument("--jobs", type=int, help="processes (default: one for each core)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask cluster instead (extra 'cluster')")
    parser.add_argument(
        "--timeout", type=float, default=3600.0, metavar="SECONDS", help="that one flight may take (default 3600)"
    )
    parser.add_argument(
        "--memory", metavar="SIZE", help="that one flight may take, such as 2G (default: its share of the machine's)"
    )
    parser.add_argument("--again", action="store_true", help="flights that failed before, too, though nothing changed")


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


def _positive(text: str) -> float:
    """A finite number above zero."""
    value = float(text)
    if not 0 < value < 1e6:
        raise argparse.ArgumentTypeError(f"{text} is not a number above zero")
    return value
