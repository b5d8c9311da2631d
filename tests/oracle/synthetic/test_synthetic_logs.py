"""Written logs against pymavlink's own readers, and poses rebuilt from their messages against the truth."""

from __future__ import annotations

import collections

import numpy as np
import pytest
from pymavlink import DFReader, mavutil
from pyproj import Transformer
from scipy.spatial.transform import Rotation, Slerp

from pipeline.geometry import rotation
from pipeline.synthetic.dataflash_log import FORMATS, dataflash_bytes
from pipeline.synthetic.demo_scenes import small_scene
from pipeline.synthetic.instruments import UNDULATION_M, LogClock, record, wandering
from pipeline.synthetic.mavlink_log import tlog_bytes
from pipeline.synthetic.scene import camera_pose
from pipeline.synthetic.simulate import DEMO, Noise

EXACT = Noise(pixel_px=0.0)
CLOCKS = (
    LogClock(boot_zero_s=412.345, utc_zero_s=1748770200.0, recorder_zero_s=1748770200.0),
    LogClock(boot_zero_s=187.62 - 1.6137, utc_zero_s=None, recorder_zero_s=1748765812.781),
)
SCENE = small_scene()


def recording(index, noise=EXACT):
    rng = np.random.default_rng([3, index])
    return record(SCENE.cameras[index], SCENE.origin, CLOCKS[index], noise=noise, rng=rng)


def messages_of(path):
    reader = mavutil.mavlogfile(str(path), robust_parsing=True)
    found = []
    while (message := reader.recv_msg()) is not None:
        found.append(message)
    reader.close()
    return found


@pytest.fixture(scope="module", params=[0, 1])
def tlog(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "a.tlog"
    path.write_bytes(tlog_bytes(recording(request.param), system=request.param + 1, seed=1))
    return request.param, messages_of(path)


def series(messages, name, *fields):
    return np.array([[getattr(m, f) for f in fields] for m in messages if m.get_type() == name], float)


def test_pymavlink_reads_every_packet(tlog):
    index, messages = tlog
    names = collections.Counter(m.get_type() for m in messages)
    assert names["BAD_DATA"] == 0
    needed = {"HEARTBEAT", "SYSTEM_TIME", "GLOBAL_POSITION_INT", "GPS_RAW_INT", "ATTITUDE", "CAMERA_IMAGE_CAPTURED"}
    chatter = {"VFR_HUD", "SYS_STATUS", "RC_CHANNELS", "STATUSTEXT", "PARAM_VALUE", "RADIO_STATUS", "TIMESYNC"}
    assert needed | chatter <= set(names)
    assert ("GIMBAL_DEVICE_ATTITUDE_STATUS" in names) == (index == 0)
    span = 8.0 + 7.0
    assert names["GLOBAL_POSITION_INT"] == pytest.approx(10 * span, abs=3)
    assert names["ATTITUDE"] == pytest.approx(50 * span, abs=6)
    systems = {(m.get_srcSystem(), m.get_type()) for m in messages}
    assert (255, "HEARTBEAT") in systems
    assert (index + 1, "HEARTBEAT") in systems


def test_sequence_numbers_run_and_stamps_never_go_back(tlog):
    _, messages = tlog
    by_sender = collections.defaultdict(list)
    for message in messages:
        by_sender[message.get_srcSystem(), message.get_srcComponent()].append(message.get_seq())
    for numbers in by_sender.values():
        assert np.all(np.diff(numbers) % 256 == 1)
    stamps = np.array([m._timestamp for m in messages])
    assert np.all(np.diff(stamps) >= 0)
    boot = np.array([(m._timestamp, m.time_boot_ms / 1000) for m in messages if m.get_type() == "ATTITUDE"])
    delay = boot[:, 0] - boot[:, 1]
    assert 0.001 < np.ptp(delay) < 0.2


def test_only_the_first_uav_knows_utc(tlog):
    index, messages = tlog
    told = series(messages, "SYSTEM_TIME", "time_unix_usec", "time_boot_ms")
    if index == 1:
        assert not told[:, 0].any()
        wrong = messages[0]._timestamp - (1748770200.0 - 4.0)
        assert abs(wrong) > 1000
    else:
        zero = told[:, 0] / 1e6 - (told[:, 1] / 1000 - 412.345)
        assert zero == pytest.approx(np.full(len(told), 1748770200.0), abs=1e-3)


def test_heights_are_above_mean_sea_level_and_the_receiver_tells_both(tlog):
    _, messages = tlog
    gps = series(messages, "GPS_RAW_INT", "alt", "alt_ellipsoid", "fix_type", "h_acc")
    assert (gps[:, 1] - gps[:, 0]) / 1000 == pytest.approx(np.full(len(gps), UNDULATION_M), abs=2e-3)
    assert (gps[:, 2] == 3).all()
    assert (gps[:, 3] > 0).all()


def test_the_camera_event_is_frame_0(tlog):
    index, messages = tlog
    events = [m for m in messages if m.get_type() == "CAMERA_IMAGE_CAPTURED"]
    assert len(events) == 1
    first = SCENE.cameras[index].offset_s + CLOCKS[index].boot_zero_s
    assert events[0].time_boot_ms / 1000 == pytest.approx(first, abs=1e-9)
    assert (events[0].capture_result, events[0].image_index) == (1, 0)


def slerped(stamp, q, at):
    w_last = Rotation.from_quat(q[:, [1, 2, 3, 0]])
    return Slerp(stamp, w_last)(at)


def local_enu(lat_deg, lon_deg, height_m):
    """By PROJ's topocentric conversion, which shares nothing with ours."""
    lat, lon = np.degrees([SCENE.origin.lat_rad, SCENE.origin.lon_rad])
    pipeline = (
        "+proj=pipeline +step +proj=cart +ellps=WGS84"
        f" +step +proj=topocentric +ellps=WGS84 +lat_0={lat} +lon_0={lon} +h_0={SCENE.origin.height_m}"
    )
    return np.stack(Transformer.from_pipeline(pipeline).transform(lon_deg, lat_deg, height_m), axis=1)


def test_poses_rebuilt_from_the_messages_are_the_true_ones(tlog):
    """By hand, with SciPy and PROJ: position, attitude, gimbal or mount, lever arm at the frames' times."""
    index, messages = tlog
    camera = SCENE.cameras[index]
    frame = np.arange(0, camera.frames, 13)
    true_position, true_attitude = camera_pose(camera.platform, camera.frame_time_s(frame))
    boot = camera.frame_time_s(frame) + CLOCKS[index].boot_zero_s
    fix = series(messages, "GLOBAL_POSITION_INT", "time_boot_ms", "lat", "lon", "alt")
    enu = local_enu(fix[:, 1] / 1e7, fix[:, 2] / 1e7, fix[:, 3] / 1000 + UNDULATION_M)
    place = np.stack([np.interp(boot, fix[:, 0] / 1000, enu[:, k]) for k in range(3)], axis=1)
    euler = series(messages, "ATTITUDE", "time_boot_ms", "yaw", "pitch", "roll")
    body_q = Rotation.from_euler("ZYX", euler[:, 1:]).as_quat()[:, [3, 0, 1, 2]]
    body = slerped(euler[:, 0] / 1000, body_q, boot)
    if index == 0:
        told = [m for m in messages if m.get_type() == "GIMBAL_DEVICE_ATTITUDE_STATUS"]
        assert all(m.flags & 32 and not m.flags & 64 for m in told)
        earth = [Rotation.from_rotvec([0, 0, m.delta_yaw]) * Rotation.from_quat([*m.q[1:], m.q[0]]) for m in told]
        stamp = np.array([m.time_boot_ms / 1000 for m in told])
        mount = Slerp(stamp, Rotation.concatenate(earth))(boot)
    else:
        mount = body * Rotation.from_euler("ZYX", camera.platform.mount_rad)
    swap = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
    place = place + body.apply(camera.platform.lever_arm_m) @ swap
    assert np.abs(place - true_position).max() < 0.03
    cam = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    found = swap @ mount.as_matrix() @ cam
    wrong = np.einsum("nij,nik->njk", rotation.matrix(true_attitude), found)
    angle = np.degrees(Rotation.from_matrix(wrong).magnitude())
    assert angle.max() < 0.02


def test_biases_of_the_log_are_those_of_the_setting():
    """The constant errors of the camera's attitude, in camera axes, and of the position, over 40 flights."""
    shift, turn = [], []
    for seed in range(40):
        log, clean = (
            record(SCENE.cameras[1], SCENE.origin, CLOCKS[1], noise=n, rng=np.random.default_rng([seed, 77]))
            for n in (DEMO, EXACT)
        )
        turn.append(
            rotation.log(rotation.multiply(rotation.conjugate(clean.ned_from_body), log.ned_from_body)).mean(axis=0)
        )
        metres = (log.lat_lon_height - clean.lat_lon_height) * [6.35e6, 6.37e6 * np.cos(0.492), 1.0]
        shift.append(metres.mean(axis=0))
    assert np.sqrt(np.mean(np.square(turn))) == pytest.approx(DEMO.attitude_bias_rad, rel=0.2)
    assert np.sqrt(np.mean(np.square(shift))) == pytest.approx(DEMO.position_bias_m, rel=0.2)


def test_noise_wanders_and_averages_like_independent_noise():
    """Averages over 4 s at 25 frames per second have the variance 1 / 100; neighbours are alike."""
    noise = wandering(400_000, rate_hz=50, memory_s=0.15, frame_hz=25.0, rng=np.random.default_rng(2))
    assert noise.std() == pytest.approx((2 * np.sqrt(np.pi) * 0.15 * 25) ** -0.5, rel=0.02)
    scaled = noise / noise.std()
    for lag, want in ((1, np.exp(-((1 / 15) ** 2))), (15, np.exp(-1.0)), (45, 0.0)):
        assert (scaled[lag:] * scaled[:-lag]).mean() == pytest.approx(want, abs=0.03)
    assert noise.reshape(-1, 200, 3).mean(axis=1).std() == pytest.approx(0.1, rel=0.06)


def test_same_seed_same_log_bytes():
    log = recording(0, DEMO)
    assert tlog_bytes(log, system=1, seed=4) == tlog_bytes(log, system=1, seed=4)
    assert tlog_bytes(log, system=1, seed=4) != tlog_bytes(log, system=1, seed=5)


def test_dataflash_is_read_by_pymavlink(tmp_path):
    log = recording(0, DEMO)
    path = tmp_path / "a.bin"
    path.write_bytes(dataflash_bytes(log))
    reader = DFReader.DFReader_binary(str(path))
    found = collections.defaultdict(list)
    while (message := reader.recv_msg()) is not None:
        found[message.get_type()].append(message)
    reader.close()
    assert len(found["ATT"]) == len(log.attitude_boot_s) == len(found["MNT"])
    assert len(found["POS"]) == len(log.position_boot_s)
    yaw = rotation.yaw_pitch_roll(log.ned_from_body)[:, 0]
    assert np.cos([np.radians(m.Yaw) for m in found["ATT"]] - yaw).min() > 1 - 1e-9
    assert [m.TimeUS * 1e-6 for m in found["ATT"]] == pytest.approx(log.attitude_boot_s, abs=1e-6)
    height = np.array([m.Alt for m in found["POS"]]) + UNDULATION_M
    assert height == pytest.approx(log.lat_lon_height[:, 2], abs=1e-3)
    assert [m.Und for m in found["GPA"]] == pytest.approx([-UNDULATION_M] * len(found["GPA"]))
    assert [m.TimeUS * 1e-6 for m in found["CAM"]] == pytest.approx([412.345])
    first = found["GPS"][0]
    utc = 315964800 + first.GWk * 604800 + first.GMS / 1000 - 18
    assert utc == pytest.approx(1748770200.0 + first.TimeUS * 1e-6 - 412.345, abs=2e-3)


def test_every_dataflash_format_fits_its_description():
    for form in FORMATS.values():
        assert len(form.labels) <= 64
        assert len(form.labels.split(",")) == len(form.letters) <= 16
        assert form.packer.size + 3 < 256
