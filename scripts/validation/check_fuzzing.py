"""Every kind of input, fuzzed as coverage leads (libFuzzer by Atheris, extra `fuzz`): read, or refused in words.

usage: python -m scripts.validation.check_fuzzing [--minutes 10] [--kinds flight camera ...] [--keep FOLDER]

Each kind is a process of its own, for so many minutes. A finding is an exception that is no RunningFixError, a crash,
an input that takes more than 30 s, or 3 GB of memory; its input is kept in FOLDER. Loops are not compiled here, as
compiled code tells nothing of its coverage; `log-fuzzing` reads mangled logs with the compiled readers.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from scripts.validation.figures import tell

HANG_S, MEMORY_MB, LONGEST = 30, 3072, 1 << 16
KINDS = (
    "flight",
    "camera",
    "detections",
    "tracks",
    "poses",
    "pose-table",
    "log",
    "subtitles",
    "video",
    "label",
    "flights",
)
FLIGHT = """[flight]
origin = { lat = 28.2, lon = 112.9, height = 60.0 }
[cameras.uav1]
calibration = "a.json"
video = "a.mp4"
telemetry = "a.tlog"
start = "auto"
frame_rate = 25.0
mount = { roll_deg = 0, pitch_deg = -30, yaw_deg = 0 }
sigma = { attitude_bias_deg = 0.5, pixel = 1.0 }
[targets.car1]
motion = "spline"
order = 1
boxes.uav1 = { frame = 0, box = [612, 340, 24, 18] }
[solve]
method = "map"
search_s = 5.0
"""
CAMERAS = (
    '{"model": "pinhole", "image_size": [640, 480], "K": [[500, 0, 320], [0, 500, 240], [0, 0, 1]], '
    '"distortion": [0.1]}',
    "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n"
    "   rows: 3\n   cols: 3\n   dt: d\n"
    "   data: [500., 0., 320., 0., 500., 240., 0., 0., 1.]\n"
    "distortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [0., 0., 0., 0., 0.]\n",
    "image_width: 640\nimage_height: 480\ncamera_name: a\ncamera_matrix: {rows: 3, cols: 3, data: [500, 0, 320, "
    "0, 500, 240, 0, 0, 1]}\ndistortion_model: plumb_bob\n"
    "distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}\n",
    "cam0:\n  camera_model: pinhole\n  distortion_model: radtan\n  distortion_coeffs: [0, 0, 0, 0]\n"
    "  intrinsics: [500, 500, 320, 240]\n  resolution: [640, 480]\n",
)  # fmt: skip
DETECTIONS = "frame,target,x_px,y_px,sigma_px\n" + "".join(f"{i},car,{100 + i}.5,200,1\n" for i in range(9))
TRACKS = "camera,target,frame,time_s,x_px,y_px,sigma_px,state,fix\n" + "".join(
    f"uav1,car,{i},{i / 25},{100 + i}.5,200.0,1.0,tracked,surface\n" for i in range(9)
)
POSES = "camera,frame,time_s,east_m,north_m,up_m,qw,qx,qy,qz\n" + "".join(
    f"uav1,{i},{i},0,0,0,1,0,0,0\n" for i in range(9)
)
POSE_TABLE = "time_s,east_m,north_m,up_m,qw,qx,qy,qz\n" + "".join(f"{i},0,0,0,1,0,0,0\n" for i in range(9))
FLIGHTS = "name,flight\none,a/flight.toml\ntwo,b/flight.toml\n"
REQUESTS = (
    {"act": "set", "target": "car1", "camera": "uav1", "frame": 3, "box": [1, 2, 30, 40]},
    {"act": "delete", "target": "car1", "camera": "uav1"},
    {"act": "swap", "camera": "uav1", "target": "car1", "with": "car2"},
)

Reader = Callable[[Path], object]


def seeds(kind: str) -> dict[str, bytes]:
    """Whole files of a kind, by the name under which each is read."""
    texts = {
        "flight": {"flight.toml": FLIGHT}, "detections": {"a.csv": DETECTIONS}, "tracks": {"a.csv": TRACKS},
        "poses": {"a.csv": POSES}, "flights": {"a.csv": FLIGHTS},
        "camera": {f"a{i}{'.yaml' if i else '.json'}": text for i, text in enumerate(CAMERAS)},
        "label": {f"{i}.json": json.dumps(request) for i, request in enumerate(REQUESTS)},
    }  # fmt: skip
    if kind in texts:
        return {name: text.encode() for name, text in texts[kind].items()}
    if kind == "video":
        return {"a.mp4": Path("data/flight/uav1.mp4").read_bytes()[: LONGEST // 2]}
    from scripts.validation import check_log_corruption as logs

    whole = logs.seeds()
    wanted = {"subtitles": (".srt",), "pose-table": (".csv", ".parquet")}.get(kind, (".tlog", ".bin", ".log", ".ulg"))
    return {name: content[: LONGEST // 4] for name, content in whole.items() if Path(name).suffix in wanted}


def reader(kind: str, folder: Path) -> Reader:
    """What reads a file of a kind."""
    from calibration.camera_files import read_camera
    from pipeline.batch import find_flights
    from pipeline.export import read_detections_csv, read_poses_csv, read_tracks_csv
    from pipeline.flight import read_flight
    from pipeline.telemetry import inspect_log, read_log, read_pose_table
    from pipeline.tracking import video_times

    if kind == "label":
        return label_requests(folder)
    known: dict[str, Reader] = {
        "flight": read_flight,
        "camera": read_camera,
        "detections": lambda path: read_detections_csv(path, camera="uav1", frame_rate=25.0, default_sigma_px=1.0),
        "tracks": read_tracks_csv,
        "poses": read_poses_csv,
        "pose-table": read_pose_table,
        "log": lambda path: (read_log(path), inspect_log(path)),
        "subtitles": read_log,
        "video": video_times,
        "flights": lambda path: find_flights([str(path)]),
    }
    return known[kind]


def label_requests(folder: Path) -> Reader:
    """Requests as the label page sends them, to a session on a flight file of its own."""
    from pipeline.label import server
    from pipeline.label.session import LabelSession

    flight = folder / "label" / "flight.toml"
    flight.parent.mkdir()
    flight.write_text(FLIGHT.replace('telemetry = "a.tlog"\nstart = "auto"\n', "").replace('video = "a.mp4"\n', ""))
    session = LabelSession(flight, folder / "label" / "out")
    handler = server._Handler.__new__(server._Handler)
    handler.server = type("Server", (), {"work": session})()  # type: ignore[assignment]
    original = flight.read_text()

    def ask(path: Path) -> object:
        body = path.read_bytes()
        if b"track" in body:  # what it starts goes on in a thread of its own
            return None
        flight.write_text(original)
        return handler._change(body)

    return ask


def fuzz_one(kind: str, minutes: float, corpus: Path, keep: Path) -> None:
    """Fuzzes one kind in this process; ends it."""
    sys.modules["numba"] = None  # type: ignore[assignment]
    import atheris

    with atheris.instrument_imports(include=["calibration", "pipeline"]):
        folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
        read = reader(kind, folder)
        from calibration.foundation.errors import RunningFixError
    names = list(seeds(kind))

    def one(data: bytes) -> None:
        if not data:
            return
        path = folder / names[data[0] % len(names)]  # the first byte says under which name it is read
        path.write_bytes(data[1:])
        with contextlib.suppress(RunningFixError):
            read(path)

    for number, content in enumerate(seeds(kind).values()):
        (corpus / str(number)).write_bytes(bytes([number]) + content)
    options = [
        f"-max_total_time={round(60 * minutes)}", f"-timeout={HANG_S}", f"-rss_limit_mb={MEMORY_MB}",
        f"-max_len={LONGEST}", f"-artifact_prefix={keep}/{kind}-", "-print_final_stats=1", str(corpus),
    ]  # fmt: skip
    atheris.Setup([sys.argv[0], *options], one)
    atheris.Fuzz()


def fuzz(kind: str, minutes: float, keep: Path) -> dict[str, object]:
    """Executions and whether something was found, with the end of what was said."""
    with tempfile.TemporaryDirectory() as corpus:
        command = [sys.executable, "-m", "scripts.validation.check_fuzzing", "--one", kind, "--minutes", str(minutes)]
        command += ["--corpus", corpus, "--keep", str(keep)]
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=60 * minutes + 600)
    said = done.stdout + done.stderr
    runs = re.search(r"number_of_executed_units:\s*(\d+)", said) or re.search(r"Done (\d+) runs", said)
    found = done.returncode != 0
    return {"runs": int(runs[1]) if runs else 0, "finding": found, "said": said[-3000:] if found else ""}


def main() -> int:
    """Prints a line for each kind; 0 where nothing was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--keep", type=Path, default=Path(tempfile.gettempdir()) / "runningfix-fuzz")
    parser.add_argument("--one", choices=KINDS, help=argparse.SUPPRESS)
    parser.add_argument("--corpus", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    given.keep.mkdir(parents=True, exist_ok=True)
    if given.one:
        fuzz_one(given.one, given.minutes, given.corpus, given.keep)
        return 0
    if sys.modules.get("atheris") is None and not _there():
        print("Atheris is not installed: pip install 'runningfix[fuzz]'")
        return 2
    results = {}
    for kind in given.kinds:
        results[kind] = fuzz(kind, given.minutes, given.keep)
        print(
            f"{kind:<12}{results[kind]['runs']:>10} inputs  {'FOUND' if results[kind]['finding'] else 'nothing'}",
            flush=True,
        )
        if results[kind]["finding"]:
            print(results[kind]["said"], flush=True)
    tell({f"{kind.replace('-', '_')}_inputs": r["runs"] for kind, r in results.items()})
    tell({"findings": sum(bool(r["finding"]) for r in results.values()), "minutes_each": given.minutes})
    return int(any(r["finding"] for r in results.values()))


def _there() -> bool:
    from importlib.util import find_spec

    return find_spec("atheris") is not None


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)
