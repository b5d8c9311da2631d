"""What is seen before tracking: each doubt where its mistake is, and none in a flight without one."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.camera import CameraModel
from calibration.foundation.errors import InputFileError
from pipeline.flight import read_flight
from pipeline.geometry import rotation
from pipeline.records import InstrumentSigma, PoseTrack
from pipeline.stages.checks.meeting import expected_sigmas, sight_doubts
from pipeline.stages.checks.outlook import look_ahead, outlook
from pipeline.stages.checks.settings import setting_doubts
from pipeline.stages.checks.videos import video_doubts
from pipeline.stages.checks.views import time_doubts, view_doubts
from pipeline.stages.inputs.sources import Sources
from pipeline.stages.poses.measured import MeasuredPoses
from pipeline.telemetry import GimbalSeries, read_log, read_pose_table
from pipeline.tracking import VideoTimes
from tests.scenes.logs import tlog

LENS = CameraModel(
    image_size=(640, 360), K=np.array([[600.0, 0, 320], [0, 600, 180], [0, 0, 1]]), distortion=np.zeros(0)
)
MODELS = {"a": LENS, "b": LENS}
TIMES = VideoTimes(frame_time_s=np.arange(100) / 25, frame_rate=25.0, image_size=(640, 360))
NOTHING = Sources(logs={}, tables={}, origin=None)
TARGET = """[targets.car]
boxes.a = { frame = 0, box = [309.5, 172.5, 20, 14] }
boxes.b = { frame = 0, box = [309.5, 172.5, 20, 14] }
"""


def flight(folder, a="", b="", target=TARGET, head=""):
    for name in ("a.mp4", "b.mp4"):
        if not (folder / name).exists():
            (folder / name).write_bytes(name.encode() * 1000)
    text = head
    for name, more in (("a", a), ("b", b)):
        text += f'[cameras.{name}]\ncalibration = "{name}.json"\nvideo = "{name}.mp4"\n{more}\n'
    path = folder / "flight.toml"
    path.write_text(text + target)
    return read_flight(path)


def poses(camera, at, yaw_deg, pitch_deg, utc_s=0.0, frames=100):
    """A camera that hovers and looks one way."""
    turn = rotation.enu_from_cam(rotation.ned_from_frd(*(np.radians(v) for v in (yaw_deg, pitch_deg, 0.0))))
    track = PoseTrack(
        camera=camera, frame=np.arange(frames), time_s=np.arange(frames) / 25,
        position_enu_m=np.tile(np.asarray(at, float), (frames, 1)), enu_from_cam=np.tile(turn, (frames, 1)),
    )  # fmt: skip
    sigma = InstrumentSigma()
    return MeasuredPoses(
        camera=camera, poses=track, frame_rate=25.0, sigma=sigma, still=False, utc_s=utc_s, utc_sigma_s=0.2
    )


def pair(**second):
    """Two cameras 60 m up that look down at the origin by 45 degrees, from west and from south."""
    b = {"at": (0, -60, 60), "yaw_deg": 0.0, "pitch_deg": -45.0} | second
    return (poses("a", (-60, 0, 60), 90.0, -45.0), poses("b", **b))


def kinds(doubts):
    return [doubt.kind for doubt in doubts]


def test_a_flight_without_a_mistake_is_not_doubted(tmp_path):
    found = outlook(flight(tmp_path), MODELS, {"a": TIMES, "b": TIMES}, NOTHING, pair())
    assert found.doubts == ()
    (car,) = found.expected
    assert 2.0 < car.sigma_m < 3.5, "3.2 m of position, half a degree at 85 m: 3.3 m a sight, two sights"
    assert car.angle_rad == pytest.approx(np.radians(60), abs=0.01)


@pytest.mark.parametrize(
    ("given", "doubted"), [(30, True), (24, True), (25.01, False), (24.975, False), (25, False), (240, True)]
)
def test_a_frame_rate_against_the_containers(tmp_path, given, doubted):
    found = video_doubts(flight(tmp_path, a=f"frame_rate = {given}"), {"a": TIMES})
    assert kinds(found) == ["frame-rate"] * doubted
    if doubted:
        assert not found[0].certain, "slow motion is meant"
        assert f"{given:g}, but a.mp4 says 25" in found[0].words


@pytest.mark.parametrize(
    ("box", "words"),
    [
        ("{ frame = 0, box = [630, 100, 20, 20] }", "640 x 360"),
        ("{ frame = 0, box = [-1, 100, 20, 20] }", "640 x 360"),
        ("{ frame = 0, box = [100, 345, 20, 20] }", "640 x 360"),
        ("{ frame = 100, box = [100, 100, 20, 20] }", "frames 0 to 99"),
    ],
)
def test_a_box_that_is_not_in_the_picture(tmp_path, box, words):
    found = video_doubts(flight(tmp_path, target=f"[targets.car]\nboxes.b = {box}\n"), {"a": TIMES, "b": TIMES})
    assert kinds(found) == ["box-outside"]
    assert found[0].certain
    assert found[0].subject == ("car", "b")
    assert words in found[0].error().expected
    assert found[0].error().exit_code == 2


def test_one_recording_in_two_cameras(tmp_path):
    given = flight(tmp_path)
    assert video_doubts(given, {"a": TIMES, "b": TIMES}) == []
    (tmp_path / "b.mp4").write_bytes((tmp_path / "a.mp4").read_bytes())
    found = video_doubts(given, {"a": TIMES, "b": TIMES})
    assert kinds(found) == ["one-video-twice"]
    assert found[0].subject == ("a", "b")


@pytest.mark.parametrize(
    ("mount", "doubted"),
    [
        ("roll_deg = 0.01745, pitch_deg = -0.6632, yaw_deg = 0.0524", True),
        ("pitch_deg = -1.5708", True),
        ("roll_deg = 1, pitch_deg = -38, yaw_deg = 3", False),
        ("roll_deg = 1, pitch_deg = -3, yaw_deg = 2", False),
        ("roll_deg = 0.31, pitch_deg = -0.4, yaw_deg = 1.12", False),
        ("pitch_deg = 0", False),
    ],
)
def test_a_mount_in_radians(tmp_path, mount, doubted):
    found = setting_doubts(flight(tmp_path, b=f"mount = {{ {mount} }}"), NOTHING)
    assert kinds(found) == ["radians"] * doubted


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "a.tlog"
    tlog(path, seconds=20.0)
    return read_log(path)


def with_log(log, **logs):
    return Sources(logs=logs or {"a": log}, tables={}, origin=None)


def test_a_gimbal_in_the_log_and_no_mount(tmp_path, log):
    assert setting_doubts(flight(tmp_path), with_log(replace(log, gimbal=None))) == []
    gimbal = GimbalSeries(
        source="MOUNT", time_s=np.zeros(1), attitude=np.array([[1.0, 0, 0, 0]]), frame=np.zeros(1, int)
    )
    log = replace(log, gimbal=gimbal)
    assert kinds(setting_doubts(flight(tmp_path), with_log(log))) == ["mount-missing"]
    for mount in ('mount = "gimbal"', "mount = { pitch_deg = 0 }"):
        assert setting_doubts(flight(tmp_path, a=mount), with_log(log)) == []


@pytest.mark.parametrize(
    ("start", "events", "doubted"),
    [
        ("start = 106.0", [105.0], True),
        ("start = 104.0", [105.0], True),
        ("start = 105.1", [105.0], False),
        ("start = 106.0\nsigma.start_s = 0.5", [105.0], False),
        ("start = 125.0", [105.0], False),
        ('start = "camera-event"', [105.0], False),
        ("start = 106.0", [], False),
        ("start = 106.0", [104.0, 105.0, 106.0, 107.0], False),
        ("start = 103.0", [104.0, 105.0, 106.0, 107.0], True),
    ],
    ids=("late", "early", "as meant", "told", "another", "the event", "none", "each frame", "before each frame"),
)
def test_a_start_beside_the_logs_camera_event(tmp_path, log, start, events, doubted):
    log = replace(log, camera_event_s=np.array(events), camera_event_source="CAMERA_TRIGGER")
    found = setting_doubts(flight(tmp_path, a=f'mount = "gimbal"\n{start}'), with_log(log))
    assert kinds(found) == ["start-beside-event"] * doubted
    if doubted:
        assert f"1.00 s {'before' if '4.0' in start or '3.0' in start else 'after'} the camera event" in found[0].seen


def test_an_origin_elsewhere_and_one_exchanged(tmp_path, log):
    position = log.position
    lat, lon = (float(np.degrees(v[position.valid][0])) for v in (position.lat_rad, position.lon_rad))
    mount = 'mount = "gimbal"'

    def asked(lat, lon):
        head = f"[flight]\norigin = {{ lat = {lat}, lon = {lon} }}\n"
        return setting_doubts(flight(tmp_path, a=mount, head=head), with_log(log))

    assert asked(lat + 0.1, lon) == []
    (far,) = asked(lat + 2, lon)
    assert (far.kind, far.certain) == ("far-origin", False)
    if abs(lon) <= 90:
        (swapped,) = asked(lon, lat)
        assert (swapped.kind, swapped.certain) == ("latitude-longitude", True)
        assert "exchange lat and lon" in swapped.advice


def test_heights_of_two_datums(tmp_path, log):
    other = replace(log, position=replace(log.position, datum="mean sea level"))
    given = flight(tmp_path, a='mount = "gimbal"', b='mount = "gimbal"')
    assert kinds(setting_doubts(given, with_log(log, a=log, b=other))) == ["height-datums"]
    assert setting_doubts(given, with_log(log, a=log, b=log)) == []


def test_one_table_of_poses_in_two_cameras(tmp_path):
    rows = "frame,east_m,north_m,up_m,qw,qx,qy,qz\n0,0,0,50,1,0,0,0\n1,0,0,50,1,0,0,0\n"
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text(rows)
    given = flight(tmp_path, a='telemetry = "a.csv"', b='telemetry = "b.csv"')
    tables = {name: read_pose_table(tmp_path / f"{name}.csv") for name in "ab"}
    found = setting_doubts(given, Sources(logs={}, tables=tables, origin=None))
    assert kinds(found) == ["one-table-twice"]
    assert found[0].certain


@pytest.mark.parametrize(
    ("later_s", "kind", "certain"),
    [
        (0.0, None, False),
        (3.9, None, False),
        (7.0, "no-overlap", False),
        (-7.0, "no-overlap", False),
        (3600.5, "no-overlap", True),
    ],
)
def test_videos_of_different_times(tmp_path, later_s, kind, certain):
    found = time_doubts(flight(tmp_path), pair(utc_s=later_s))
    assert kinds(found) == ([kind] if kind else [])
    if kind:
        assert found[0].certain is certain
        assert ("local time" in found[0].advice) == (later_s > 3000)


def test_views_that_never_meet(tmp_path):
    given = flight(tmp_path)
    assert view_doubts(given, pair(), MODELS) == []
    turned = pair(yaw_deg=180.0, pitch_deg=45.0)
    assert kinds(view_doubts(given, turned, MODELS)) == ["views-never-meet"] * 2


def test_sights_that_pass_each_other(tmp_path):
    """A camera that looks the other way is noticed, two degrees are not: they are within what attitudes are worth."""
    given = flight(tmp_path)
    assert sight_doubts(given, pair(), MODELS) == []
    assert sight_doubts(given, pair(pitch_deg=-43.0), MODELS) == []
    (found,) = sight_doubts(given, pair(yaw_deg=180.0), MODELS)
    assert found.kind == "sights-miss"
    assert found.subject == ("a", "b", "car")
    assert "no mount" in found.advice


def test_a_camera_without_a_mount_that_sees_its_targets_along_the_horizon(tmp_path):
    given = flight(tmp_path, b='telemetry = "b.tlog"')
    one, other = pair(pitch_deg=-2.0)
    unknown = (replace(one, utc_s=None), replace(other, utc_s=None))
    assert kinds(sight_doubts(given, unknown, MODELS)) == ["mount-missing"]
    told = flight(tmp_path, b='telemetry = "b.tlog"\nmount = { pitch_deg = 0 }')
    assert sight_doubts(told, unknown, MODELS) == []


def test_targets_above_the_horizon_that_others_see_below_it(tmp_path):
    one, other = pair(pitch_deg=30.0)
    unknown = (replace(one, utc_s=None), replace(other, utc_s=None))
    assert kinds(sight_doubts(flight(tmp_path), unknown, MODELS)) == ["above-horizon"]


def test_cameras_side_by_side_cannot_know_the_distance(tmp_path):
    beside = pair(at=(-60, 1, 60), yaw_deg=90.0)
    given = flight(tmp_path)
    assert kinds(sight_doubts(given, beside, MODELS)) == ["narrow"]
    (alone,) = expected_sigmas(given, beside, MODELS)
    assert alone.sigma_m > 50


def test_errors_are_gathered_and_what_they_hide_is_left_out(tmp_path):
    def missing():
        raise InputFileError(where="a.json", seen="none", expected="one", advice="make it")

    given = flight(tmp_path, a="mount = { pitch_deg = -0.6632 }")
    found = look_ahead(given, missing, lambda: (NOTHING, pair()))
    assert [type(e) for e in found.errors] == [InputFileError] * 3, "the camera file and two videos that are none"
    assert kinds(found.doubts) == ["radians"]
