"""The same flight written as MAVLink and as DataFlash gives the same camera, where the truth is."""

import numpy as np
import pytest

from pipeline.synthetic.dataflash_log import dataflash_bytes
from pipeline.synthetic.demo_scenes import small_scene
from pipeline.synthetic.instruments import LogClock, record
from pipeline.synthetic.mavlink_log import tlog_bytes
from pipeline.synthetic.scene import camera_pose
from pipeline.synthetic.simulate import Noise
from pipeline.telemetry import Mount, camera_poses, read_log, resolve_start

SCENE = small_scene()
CLOCK = LogClock(boot_zero_s=412.345, utc_zero_s=1748770200.0, recorder_zero_s=1748770200.0)


@pytest.fixture(scope="module", params=["tlog", "bin"])
def log(request, tmp_path_factory):
    camera, rng = SCENE.cameras[0], np.random.default_rng(3)
    recording = record(camera, SCENE.origin, CLOCK, noise=Noise(pixel_px=0.0), rng=rng)
    path = tmp_path_factory.mktemp("log") / f"flight.{request.param}"
    content = tlog_bytes(recording, system=1, seed=1) if request.param == "tlog" else dataflash_bytes(recording)
    path.write_bytes(content)
    return read_log(path)


def test_gimbal_camera_is_where_it_was(log):
    start = resolve_start(log, "camera-event", where="here")
    assert start == pytest.approx(412.345, abs=1e-3)
    frame = np.arange(0, 200, 7)
    time = SCENE.cameras[0].frame_time_s(frame)
    lever = np.array([0.12, 0.0, 0.1])
    poses = camera_poses(
        log, camera="uav1", frame=frame, log_time_s=start + time, mount=Mount(gimbal=True), lever_arm_m=lever,
        origin=SCENE.origin, where="here",
    )  # fmt: skip
    place, attitude = camera_pose(SCENE.cameras[0].platform, time)
    assert np.abs(poses.position_enu_m - place).max() < 0.1
    assert np.abs((poses.enu_from_cam * attitude).sum(axis=1)).min() > np.cos(np.radians(0.05) / 2)
