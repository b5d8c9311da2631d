"""What `check_fuzzing` fuzzes: for each kind of input some whole files, and what reads them."""

from __future__ import annotations

import contextlib
import json
import tempfile
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

LONGEST = 1 << 16
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
[landmarks.mast]
lat = 28.2001
lon = 112.9003
height = 61.5
points.uav1 = [ { frame = 0, x = 612.4, y = 340.2 } ]
[solve]
method = "map"
search_s = 5.0
"""
LABELLED = """[cameras.uav1]
calibration = "a.json"
video = "a.mp4"
[targets.car1]
boxes.uav1 = { frame = 0, box = [6, 4, 24, 18] }
[targets.car2]
boxes.uav1 = { frame = 1, box = [30, 14, 20, 18] }
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
FLIGHTS = "name,flight\none,a/flight.toml\ntwo,b/flight.toml\n"
SRT = (
    "{i}\n00:00:0{i},000 --> 00:00:0{i},900\n[iso: 100] [latitude: 41.5] [longitude: 2.25] [rel_alt: 5.4 abs_alt: "
    "117.0] [gb_yaw: 12.5 gb_pitch: -30.0 gb_roll: 0.0]\n\n",
    "{i}\n00:00:0{i},000 --> 00:00:0{i},900\n<font size=\"28\">FrameCnt: {i}\n2023-05-01 10:00:0{i}.123\nGPS (2.25, "
    "41.5, 117) BAROMETER:5.4</font>\n\n",
)  # fmt: skip
RECORD = (
    "time(millisecond),datetime(utc),latitude,longitude,height_above_takeoff(feet),altitude_above_seaLevel(feet),"
    " compass_heading(degrees), pitch(degrees), roll(degrees),isVideo,gimbal_heading(degrees),gimbal_pitch(degrees)\n"
    + "".join(
        f"{100 * i},2022-02-09 13:56:{8 + i // 10:02d},45.0,{7 + 1e-5 * i:.7f},66,620,90.0,-2.3,-0.4,{int(i > 20)},"
        "100.5,-30.0\n"
        for i in range(40)
    )
)
REQUESTS: tuple[dict[str, Any], ...] = (
    {"act": "set", "target": "car1", "camera": "uav1", "frame": 3, "box": [1, 2, 30, 40]},
    {"act": "delete", "target": "car1", "camera": "uav1"},
    {"act": "swap", "camera": "uav1", "target": "car1", "with": "car2"},
)
PAGES = ("/", "/state", "/tracks?camera=uav1", "/progress?after=-1", "/frame?camera=uav1&index=1")
TOKEN, PORT = "t0ken", 8000

Reader = Callable[[Path], object]


def seeds(kind: str) -> dict[str, bytes]:
    """Whole files of a kind, by the name under which each is read."""
    texts = {
        "flight": {"flight.toml": FLIGHT}, "detections": {"a.csv": DETECTIONS}, "tracks": {"a.csv": TRACKS},
        "poses": {"a.csv": POSES}, "flights": {"a.csv": FLIGHTS}, "records": {"a.csv": RECORD},
        "camera": {f"a{i}{'.yaml' if i else '.json'}": text for i, text in enumerate(CAMERAS)},
        "subtitles": {f"a{i}.srt": "".join(text.format(i=n) for n in range(9)) for i, text in enumerate(SRT)},
    }  # fmt: skip
    if kind in texts:
        return {name: text.encode() for name, text in texts[kind].items()}
    if kind == "label":
        return {f"{number}.http": request for number, request in enumerate(label_requests())}
    if kind == "video":
        return videos()
    if kind == "metadata":
        return {"a.ts": metadata()}
    from scripts.validation import check_log_corruption as logs

    wanted = (".csv", ".parquet") if kind == "pose-table" else (".tlog", ".bin", ".log", ".ulg", ".mavlink")
    return {name: content[: LONGEST // 4] for name, content in logs.seeds().items() if Path(name).suffix in wanted}


def label_requests() -> list[bytes]:
    """Whole requests, as the label page sends them."""
    host = f"Host: 127.0.0.1:{PORT}\r\n"
    found = [f"GET {page}{'&' if '?' in page else '?'}token={TOKEN} HTTP/1.1\r\n{host}\r\n" for page in PAGES]
    for request in REQUESTS:
        body = json.dumps(request)
        found.append(f"POST / HTTP/1.1\r\n{host}X-Runningfix: {TOKEN}\r\nContent-Length: {len(body)}\r\n\r\n{body}")
    return [request.encode() for request in found]


def videos() -> dict[str, bytes]:
    """Small videos in the usual containers, one of them with subtitles in it."""
    from tests.scenes.containers import muxed, numbered

    found = {}
    with tempfile.TemporaryDirectory() as folder:
        images = [image[:96, :128] for image in numbered(5)]
        for name, codec in (("a.mp4", "libx264"), ("a.mov", "mjpeg"), ("a.mkv", "libx264"), ("a.avi", "mpeg4"),
                            ("a.ts", "libx264")):  # fmt: skip
            path = muxed(Path(folder) / name, images, codec, pixel_format="yuvj420p" if codec == "mjpeg" else "yuv420p")
            found[name] = path.read_bytes()
        found["b.mkv"] = with_subtitles(Path(folder) / "a.mkv", Path(folder)).read_bytes()
    return found


def with_subtitles(video: Path, folder: Path) -> Path:
    """The video with a drone's subtitles as a track in it."""
    import av

    text, path = folder / "a.srt", folder / "with.mkv"
    text.write_text("".join(SRT[0].format(i=n) for n in range(5)))
    with av.open(str(video)) as source, av.open(str(text)) as said, av.open(str(path), "w") as out:
        copies = [(found, out.add_stream_from_template(found.streams[0])) for found in (source, said)]
        for found, copy in copies:
            for packet in found.demux():
                if packet.size:
                    packet.stream = copy
                    out.mux(packet)
    return path


def metadata() -> bytes:
    """A transport stream with ST 0601 beside the frames."""
    from tests.scenes.klv import at_place, flight, local_set, transport

    with tempfile.TemporaryDirectory() as folder:
        sets = [local_set(at_place(1_700_000_000.0 + i / 10, lon=112.9 + 1e-6 * i)) for i in range(20)]
        return transport(Path(folder) / "a.ts", flight(sets)).read_bytes()


def reader(kind: str, folder: Path) -> Reader:
    """What reads a file of a kind."""
    from calibration.camera_files import read_camera
    from pipeline.batch import find_flights
    from pipeline.export import read_detections_csv, read_poses_csv, read_tracks_csv
    from pipeline.flight import read_flight
    from pipeline.telemetry import inspect_log, read_log, read_pose_table

    if kind == "label":
        return label_reader(folder)
    known: dict[str, Reader] = {
        "flight": read_flight,
        "camera": read_camera,
        "detections": lambda path: read_detections_csv(path, camera="uav1", frame_rate=25.0, default_sigma_px=1.0),
        "tracks": read_tracks_csv,
        "poses": read_poses_csv,
        "pose-table": read_pose_table,
        "video": read_video,
        "flights": lambda path: find_flights([str(path)]),
    }
    return known.get(kind, lambda path: inspect_log(read_log(path)))


def read_video(path: Path) -> object:
    """Head, times, some frames, and the log that may lie in it; each may be refused."""
    from calibration.foundation.errors import RunningFixError
    from pipeline.telemetry import inspect_log, read_log
    from pipeline.tracking import FrameReader, video_times

    def pictures(path: Path) -> object:
        with contextlib.closing(FrameReader(path)) as frames:
            return [frames.read(number) for number in (0, 3)]

    found: list[object] = []
    for look in (video_times, pictures, lambda path: inspect_log(read_log(path))):
        try:
            found.append(look(path))
        except RunningFixError as error:
            found.append(error)
    return found


def label_reader(folder: Path) -> Reader:
    """Requests, as bytes on a connection, to the label page of a flight file; none may be a fault of ours."""
    from pipeline.label import server
    from pipeline.label.session import LabelSession

    flight = folder / "label" / "flight.toml"
    flight.parent.mkdir()
    flight.write_text(LABELLED)
    flight.with_name("a.mp4").write_bytes(videos()["a.mp4"])
    session = LabelSession(flight, folder / "label" / "out")
    session.start_tracking = lambda: None  # type: ignore[method-assign]  # it would go on in a thread of its own

    class Handler(server._Handler):
        work, document, token = session, b"page", TOKEN

    def ask(path: Path) -> object:
        flight.write_text(LABELLED)
        said = BytesIO()
        connection = SimpleNamespace(
            makefile=lambda *_: BytesIO(path.read_bytes()), sendall=said.write, settimeout=lambda _: None,
            getsockname=lambda: ("127.0.0.1", PORT),
        )  # fmt: skip
        Handler(connection, ("127.0.0.1", 1), SimpleNamespace())  # type: ignore[arg-type]
        if b"HTTP/1.1 500" in said.getvalue():
            raise AssertionError(said.getvalue().decode(errors="replace"))
        return said.getvalue()

    ask.close = session.close  # type: ignore[attr-defined]
    return ask
