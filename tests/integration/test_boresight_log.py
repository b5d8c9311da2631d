"""`runningfix boresight --still` on an autopilot log: a mount that nobody measured, a video that began a little off."""

import json

import numpy as np
import pytest

from calibration import write_camera
from pipeline.cli.main import main
from pipeline.export import tracks_csv
from pipeline.geometry import rotation
from pipeline.geometry.geodesy import geodetic_from_enu
from pipeline.records import ImageTrack
from pipeline.synthetic.dataflash_log import dataflash_bytes
from pipeline.synthetic.demo_scenes import small_scene
from pipeline.synthetic.instruments import LogClock, record
from pipeline.synthetic.mavlink_log import tlog_bytes
from pipeline.synthetic.scene import Path, Platform, SceneCamera, pixels_of
from pipeline.synthetic.simulate import Noise

ORIGIN, LENS = small_scene().origin, small_scene().cameras[1].lens
CLOCK = LogClock(boot_zero_s=187.62, utc_zero_s=1748770200.0, recorder_zero_s=1748770200.0)
NOISE = Noise(pixel_px=0.5, attitude_rad=float(np.radians(0.1)), position_bias_m=0.3, position_m=0.1)
MOUNT_DEG = (3.0, -38.0, 1.0)
MAST = np.array([4.0, -7.0, 2.0])
START_OFF_S = 0.06
FLIGHT = """
[flight]
origin = {{ lat = {lat:.9f}, lon = {lon:.9f}, height = {height:.4f} }}
[cameras.uav]
calibration = "uav.json"
tracks = "tracks.csv"
telemetry = "{log}"
start = {start:.6f}
frame_rate = 10.0
mount = {{ roll_deg = 0, pitch_deg = -36, yaw_deg = 0 }}
lever_arm_m = [0.18, -0.03, 0.07]
sigma = {{ attitude_deg = 0.1, position_bias_m = 0.3, position_m = 0.1, pixel = 0.5, start_s = 0.3 }}
"""


def circling() -> SceneCamera:
    """A camera that circles the mast at 70 m and swings, so that the mast wanders over the image."""
    time = np.linspace(-6.0, 40.0, 461)
    heading = 0.12 * time
    around = MAST + 70 * np.stack([np.sin(heading), np.cos(heading), np.full_like(time, 0.72)], axis=1)
    yaw = heading + np.pi + np.radians(9) * np.sin(0.7 * time) - np.radians(MOUNT_DEG[0])
    pitch = np.radians(6) * np.cos(0.9 * time)
    roll = np.radians(8) * np.sin(0.5 * time)
    platform = Platform(
        position_enu_m=Path(time_s=time, value=around),
        yaw_pitch_roll_rad=Path(time_s=time, value=np.stack([yaw, pitch, roll], axis=1)),
        mount_rad=tuple(float(a) for a in np.radians(MOUNT_DEG)),
        lever_arm_m=(0.18, -0.03, 0.07),
    )
    return SceneCamera(
        name="uav", lens=LENS, platform=platform, frame_rate=10.0, nominal_rate=10.0, offset_s=0.0, frames=300
    )


def written(folder, seed, kind="tlog"):
    """Log, tracks, camera and flight file of one flight; returns the flight file's path and the mast's place."""
    camera, rng = circling(), np.random.default_rng([seed, 3])
    recording = record(camera, ORIGIN, CLOCK, noise=NOISE, rng=rng)
    log = folder / f"uav.{kind}"
    log.write_bytes(tlog_bytes(recording, system=1, seed=seed) if kind == "tlog" else dataflash_bytes(recording))
    frame = np.arange(camera.frames)
    pixel, _ = pixels_of(camera, frame, np.tile(MAST, (len(frame), 1)))
    inside = (pixel > 8).all(axis=1) & (pixel < np.array(LENS.image_size) - 8).all(axis=1)
    frame, pixel = frame[inside], pixel[inside] + rng.normal(0, NOISE.pixel_px, (inside.sum(), 2))
    track = ImageTrack(
        camera="uav", target="mast", frame=frame, time_s=frame / 10.0, xy_px=pixel,
        sigma_px=np.full(len(frame), NOISE.pixel_px), state=np.zeros(len(frame), int),
    )  # fmt: skip
    (folder / "tracks.csv").write_text(tracks_csv([track]))
    write_camera(folder / "uav.json", LENS)
    lat, lon, height = (float(v) for v in geodetic_from_enu(MAST, ORIGIN))
    text = FLIGHT.format(
        lat=np.degrees(ORIGIN.lat_rad), lon=np.degrees(ORIGIN.lon_rad), height=ORIGIN.height_m, log=log.name,
        start=recording.first_frame_s - START_OFF_S,
    )  # fmt: skip
    (folder / "flight.toml").write_text(text)
    return folder / "flight.toml", (np.degrees(lat), np.degrees(lon), height), recording.first_frame_s


def found_by_command(folder, seed, capsys, kind="tlog"):
    folder.mkdir()
    flight, place, first = written(folder, seed, kind)
    command = ["boresight", str(flight), "-o", str(folder / "out"), "--still", "mast", "--json"]
    assert main([*command, "--at", *(f"{v:.9f}" for v in place)]) == 0
    camera = json.loads(capsys.readouterr().out)["cameras"]["uav"]
    angles = [camera["mount"][f"{axis}_deg"] for axis in ("roll", "pitch", "yaw")]
    error = np.array([*(np.array(angles) - MOUNT_DEG[::-1]), camera["start"] - first])
    return error, np.array([*camera["sigma_deg"], camera["start_shift_sigma_s"]]), camera


def test_mount_and_start_from_a_log_are_true_within_their_sigmas(tmp_path, capsys):
    pulls, sigmas = [], []
    for seed in range(8):
        error, sigma, camera = found_by_command(tmp_path / f"f{seed}", seed, capsys)
        pulls.append(error / sigma)
        sigmas.append(sigma)
        assert camera["misfit"] < 1.2  # the log's noise wanders: less in each frame, as much over seconds
    rms = np.sqrt(np.mean(np.square(pulls), axis=0))
    assert (rms > 0.5).all()
    assert (rms < 1.6).all()
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1.0, abs=0.25)
    assert (np.mean(sigmas, axis=0) < [0.15, 0.15, 0.05, 0.005]).all()


def test_what_it_prints_as_correction_adds_to_the_one_that_was_there(tmp_path, capsys):
    flight, place, _ = written(tmp_path, 5)
    flight.write_text(flight.read_text().replace("lever_arm_m", "mount_correction = { yaw_deg = 1.5 }\nlever_arm_m"))

    def corrected():
        command = ["boresight", str(flight), "-o", str(tmp_path / "out"), "--still", "mast", "--json"]
        assert main([*command, "--at", *(f"{v:.9f}" for v in place)]) == 0
        camera = json.loads(capsys.readouterr().out)["cameras"]["uav"]
        assert "mount" not in camera
        return camera, [camera["mount_correction"][f"{axis}_deg"] for axis in ("roll", "pitch", "yaw")]

    camera, (roll, pitch, yaw) = corrected()
    mount, correction = (
        rotation.ned_from_frd(*np.radians(angles)) for angles in ((0.0, -36.0, 0.0), (yaw, pitch, roll))
    )
    whole = np.degrees(rotation.yaw_pitch_roll(rotation.multiply(mount, correction)))
    assert np.abs(whole - MOUNT_DEG).max() < 4 * max(camera["sigma_deg"])
    pasted = f"mount_correction = {{ roll_deg = {roll}, pitch_deg = {pitch}, yaw_deg = {yaw} }}"
    flight.write_text(flight.read_text().replace("mount_correction = { yaw_deg = 1.5 }", pasted))
    np.testing.assert_allclose(corrected()[1], [roll, pitch, yaw], atol=0.002)


def test_a_dataflash_log_says_the_same(tmp_path, capsys):
    error, sigma, _ = found_by_command(tmp_path / "bin", 4, capsys, kind="bin")
    assert (np.abs(error) < 3.5 * sigma).all()
