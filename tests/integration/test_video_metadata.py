"""A rendered flight whose videos carry ST 0601 metadata: the same trajectories as from its `.tlog` files."""

from __future__ import annotations

import shutil
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pandas as pd
import pytest

from calibration import write_camera
from pipeline.cli.main import main
from pipeline.geometry import rotation
from pipeline.geometry.geodesy import geodetic_from_enu
from pipeline.synthetic import read_truth
from pipeline.synthetic.demo_scenes import small_scene
from pipeline.telemetry import FlightLog, first_position, read_log, resolve_start, utc_at
from pipeline.telemetry.camera_pose.from_log import body_attitude, gimbal_attitude
from pipeline.telemetry.camera_pose.interpolate import interpolate_position, spans
from tests.scenes.klv import local_set

DATA = Path(__file__).parents[2] / "data" / "flight"
CAMERAS = ("uav1", "uav2")
TARGETS = ("car", "truck")
EVENT_UTC_S, OFFSET_S = 1_748_770_200.0, 1.6
"""UTC of the first vehicle's frame 0, and how much later the second one's is."""
SIGMA = (
    "sigma = { attitude_bias_deg = 0.4, attitude_deg = 0.1, position_bias_m = 1.5, position_m = 0.2, pixel = 0.5,"
    " frame_rate = 0.002, offset_s = 1.0, start_s = 0.0 }\n"
)
HELD = {
    "uav1": 'mount = "gimbal"\nlever_arm_m = [0.12, 0, 0.1]\n',
    "uav2": f"offset_s = {OFFSET_S}\nlever_arm_m = [0.18, -0.03, 0.07]\n"
    "mount = { roll_deg = 1, pitch_deg = -38, yaw_deg = 3 }\n",
}


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    """Two flight files that differ in where the logs are, solved."""
    folder = tmp_path_factory.mktemp("metadata")
    rng = np.random.default_rng(5)
    truth, scene = read_truth(DATA), small_scene()
    for camera, name in zip(scene.cameras, CAMERAS, strict=True):
        write_camera(folder / f"{name}.json", camera.lens)
        for kind in ("mp4", "tlog"):
            shutil.copy(DATA / f"{name}.{kind}", folder / f"{name}.{kind}")
        rows = [
            (frame, track.target, *(xy + rng.normal(0, 0.4, 2)), 0.5)
            for track in truth.tracks
            if track.camera == name and track.target in TARGETS
            for frame, xy in zip(track.frame[track.seen].tolist(), track.xy_px[track.seen], strict=True)
        ]
        table = pd.DataFrame(rows, columns=["frame", "target", "x_px", "y_px", "sigma_px"])
        table.to_csv(folder / f"{name}.csv", index=False)
        with_metadata(folder / f"{name}.mp4", folder / f"{name}.ts", metadata(folder / f"{name}.tlog"))
    logs = {"tlog": ("{name}.mp4", "{name}.tlog", 'start = "camera-event"\n'), "klv": ("{name}.ts", "video", "")}
    for which, (video, telemetry, start) in logs.items():
        text = "[flight]\norigin = { lat = 28.2, lon = 112.9, height = 60 }\n"
        for name in CAMERAS:
            text += (
                f'[cameras.{name}]\ncalibration = "{name}.json"\nvideo = "{video.format(name=name)}"\n'
                f'tracks = "{name}.csv"\ntelemetry = "{telemetry.format(name=name)}"\n{start}frame_rate = 25.0\n'
                f"{HELD[name]}{SIGMA}"
            )
        text += "".join(f'[targets.{name}]\nmotion = "polynomial"\norder = 2\n' for name in TARGETS)
        (folder / f"{which}.toml").write_text(text)
        assert main(["run", str(folder / f"{which}.toml"), "-o", str(folder / which), "--quiet"]) == 0
    return folder


def metadata(tlog: Path) -> list[bytes]:
    """A set for every frame, of what the log says of that moment."""
    log = read_log(tlog)
    event = resolve_start(log, "camera-event", where="w")
    time, frame = event + np.arange(200) / 25, np.arange(200)
    position, origin = log.position, first_position(log)
    from pipeline.telemetry.camera_pose.from_log import _local

    enu, velocity = _local(position, origin)
    stamp = position.time_s[position.valid]
    place = interpolate_position(stamp, enu, velocity, time, spans(stamp, time, frame, source="", where=""))
    geodetic = geodetic_from_enu(place, origin)
    body = body_attitude(log, frame, time, "w")
    mount = body if log.gimbal is None else gimbal_attitude(log, frame, time, body, "w")
    found = []
    for i in frame.tolist():
        yaw, pitch, roll = np.degrees(rotation.yaw_pitch_roll(body[i]))
        azimuth, elevation, turn = np.degrees(
            rotation.yaw_pitch_roll(rotation.multiply(rotation.conjugate(body[i]), mount[i]))
        )
        lat, lon, height = *np.degrees(geodetic[i, :2]), geodetic[i, 2]
        values = {2: utc_of(log, float(time[i])), 5: yaw % 360, 13: lat, 14: lon, 18: azimuth % 360, 19: elevation,
                  20: turn % 360, 90: pitch, 91: roll, 104: height}  # fmt: skip
        found.append(local_set(values))
    return found


def utc_of(log: FlightLog, log_time_s: float) -> float:
    """UTC; the log of the second vehicle does not know it, its metadata does."""
    event = float(log.camera_event_s[0])
    return utc_at(log, log_time_s) or EVENT_UTC_S + OFFSET_S + log_time_s - event


def with_metadata(video: Path, path: Path, sets: list[bytes]) -> None:
    """The video as a transport stream with metadata beside each frame, by another's muxer (libavformat)."""
    with av.open(str(video)) as source, av.open(str(path), "w", format="mpegts") as out:
        picture = source.streams.video[0]
        copy, data = out.add_stream_from_template(picture), out.add_data_stream("klv")
        ticks = Fraction(1, 90_000)
        for i, content in enumerate(sets):
            packet = av.Packet(content)
            packet.stream, packet.time_base = data, ticks
            packet.pts = packet.dts = 3600 * i
            sets[i] = packet
        for packet in source.demux(picture):
            if packet.dts is None:
                continue
            while sets and sets[0].pts * ticks <= packet.dts * packet.time_base:
                out.mux(sets.pop(0))
            packet.stream = copy
            out.mux(packet)
        for packet in sets:
            out.mux(packet)


def test_the_log_in_the_video_is_whole(flights):
    """What another's muxer wrote is read to the last set; the video begins where the log's camera event is."""
    for name in CAMERAS:
        log, tlog = read_log(flights / f"{name}.ts"), read_log(flights / f"{name}.tlog")
        assert (dict(log.counts), log.corrupt_packets) == ({"ST 0601": 200}, 0)
        event = utc_of(tlog, resolve_start(tlog, "camera-event", where="w"))
        assert log.video_start_s == pytest.approx(event, abs=2e-5)


def test_trajectories_are_those_of_the_tlog(flights):
    """Within a tenth of a sigma, everywhere."""
    tlog, klv = (pd.read_csv(flights / which / "trajectory.csv") for which in ("tlog", "klv"))
    assert len(tlog) == len(klv)
    for axis, variance in (("east_m", "cov_ee"), ("north_m", "cov_nn"), ("up_m", "cov_uu")):
        apart = (klv[axis] - tlog[axis]).abs() / np.sqrt(tlog[variance])
        assert apart.max() < 0.1
