"""Where the camera looks, in cases worked by hand from the written definitions; each names its source.

Sources: [MAV] MAVLink message definitions; [NED] north-east-down and forward-right-down, intrinsic Z-Y-X: ATTITUDE in
[MAV]; [CV] OpenCV's camera axes: x right, y down, z forward; [design] the project's own mount angles.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.geometry import rotation
from pipeline.geometry.geodesy import Geodetic, enu_from_geodetic
from pipeline.telemetry import Mount, camera_poses
from pipeline.telemetry.gimbals.frames import frame_of_flags
from pipeline.telemetry.log.flight_log import BODY, EARTH, HEADING
from tests.scenes.logs import PLACE, log_of, turned

E, N, U = np.eye(3)
HALF = np.sqrt(0.5)


def pose(log, mount=Mount(), lever=(0.0, 0.0, 0.0), at=1.0, origin=PLACE):  # noqa: B008
    return camera_poses(
        log, camera="c", frame=np.array([0]), log_time_s=np.array([at]), mount=mount,
        lever_arm_m=np.array(lever), origin=origin, where="test",
    )  # fmt: skip


def axes(track):
    """Right, down and forward axes of the camera in ENU."""
    return rotation.matrix(track.enu_from_cam[0]).T


FIXED = [
    # body yaw, pitch, roll; mount yaw, pitch, roll; forward axis and down axis of the image in ENU; source
    ((0, 0, 0), (0, 0, 0), N, -U, "[NED][CV] level, heading north: looks north, image down is down"),
    ((90, 0, 0), (0, 0, 0), E, -U, "[NED] yaw is clockwise from north: 90 is east"),
    ((-90, 0, 0), (0, 0, 0), -E, -U, "[NED] west"),
    ((0, 30, 0), (0, 0, 0), N * np.cos(np.pi / 6) + U / 2, N / 2 - U * np.cos(np.pi / 6), "[NED] pitch up is positive"),
    ((0, 0, 90), (0, 0, 0), N, -E, "[NED] roll right wing down: the image's down points to the left wing, west"),
    ((0, 0, 0), (0, -90, 0), -U, -N, "[design] pitched down 90: looks at the ground, image down is backwards"),
    ((90, 0, 0), (0, -90, 0), -U, -E, "[design] the same heading east: the image's up is the heading"),
    ((0, 0, 0), (90, 0, 0), E, -U, "[design] mount yaw to the right of the nose"),
    ((90, 0, 0), (90, 0, 0), -N, -U, "[design] and with the vehicle heading east: south"),
    ((0, 0, 0), (0, 0, 180), N, U, "[design] camera mounted upside down: image down is up"),
    ((0, -30, 0), (0, -30, 0), N / 2 - U * np.cos(np.pi / 6), -N * np.cos(np.pi / 6) - U / 2, "body and mount add up"),
    ((0, 0, 90), (0, -90, 0), -E, -N, "rolled right wing down, looking down the body: the left wing's side, west"),
]


@pytest.mark.parametrize(("body", "mount", "forward", "down", "source"), FIXED)
def test_a_fixed_mount_looks_where_it_should(body, mount, forward, down, source):
    yaw, pitch, roll = np.radians(mount)
    seen = axes(pose(log_of(ned_from_body=turned(*body)), Mount(yaw_rad=yaw, pitch_rad=pitch, roll_rad=roll)))
    np.testing.assert_allclose(seen[2], forward, atol=1e-12, err_msg=source)
    np.testing.assert_allclose(seen[1], down, atol=1e-12, err_msg=source)


GIMBAL = [
    # body yaw, pitch, roll; gimbal yaw, pitch, roll; its frame; mount; forward; down; source
    ((90, 20, 30), (0, 0, 0), EARTH, (0, 0, 0), N, -U, "[MAV] earth frame: the vehicle's attitude does not matter"),
    ((90, 20, 30), (0, 0, 0), HEADING, (0, 0, 0), E, -U, "[MAV] vehicle frame: its heading does, its tilt does not"),
    ((90, 0, 0), (90, 0, 0), HEADING, (0, 0, 0), -N, -U, "[MAV] vehicle frame: yaw adds to the heading"),
    ((179, 0, 0), (2, 0, 0), HEADING, (0, 0, 0), (np.sin(np.radians(181)), np.cos(np.radians(181)), 0), -U,
     "[MAV] over 180 degrees"),
    ((90, 0, 30), (0, -90, 0), EARTH, (0, 0, 0), -U, -N, "[MAV] straight down, image up to the north"),
    ((90, 0, 30), (0, -90, 0), HEADING, (0, 0, 0), -U, -E, "[MAV] straight down, image up along the heading"),
    ((0, 30, 0), (0, -30, 0), BODY, (0, 0, 0), N, -U, "servo angles against the body: they undo its pitch"),
    ((90, 0, 0), (0, 0, 0), EARTH, (0, 0, 180), N, U, "[design] camera upside down in its gimbal"),
]  # fmt: skip


@pytest.mark.parametrize(("body", "gimbal", "frame", "mount", "forward", "down", "source"), GIMBAL)
def test_a_gimbal_looks_where_its_frame_says(body, gimbal, frame, mount, forward, down, source):
    log = log_of(ned_from_body=turned(*body), gimbal=turned(*gimbal), frame=frame)
    yaw, pitch, roll = np.radians(mount)
    seen = axes(pose(log, Mount(yaw_rad=yaw, pitch_rad=pitch, roll_rad=roll, gimbal=True)))
    np.testing.assert_allclose(seen[2], forward, atol=1e-12, err_msg=source)
    np.testing.assert_allclose(seen[1], down, atol=1e-12, err_msg=source)


FLAGS = [
    (32, HEADING, "YAW_IN_VEHICLE_FRAME"),
    (64, EARTH, "YAW_IN_EARTH_FRAME"),
    (32 | 16, HEADING, "a stated frame outweighs yaw lock"),
    (64 | 4 | 8, EARTH, "roll and pitch lock say nothing of yaw"),
    (16, EARTH, "older: yaw lock alone means north"),
    (4 | 8, HEADING, "older: no yaw lock means the vehicle's heading"),
    (0, HEADING, "older: nothing set"),
]


@pytest.mark.parametrize(("flags", "frame", "source"), FLAGS)
def test_gimbal_flags_name_the_frame(flags, frame, source):
    assert frame_of_flags(np.array([flags]))[0] == frame, source


LEVERS = [
    ((0, 0, 0), (1, 0, 0), N, "[NED] forward of the vehicle, heading north"),
    ((90, 0, 0), (1, 0, 0), E, "heading east"),
    ((0, 0, 0), (0, 1, 0), E, "right of it"),
    ((0, 0, 0), (0, 0, 1), -U, "under it"),
    ((0, 90, 0), (1, 0, 0), U, "nose up"),
    ((0, 0, 90), (0, 1, 0), -U, "right wing down"),
]


@pytest.mark.parametrize(("body", "lever", "moved", "source"), LEVERS)
def test_the_lever_arm_is_in_body_axes(body, lever, moved, source):
    log = log_of(ned_from_body=turned(*body))
    seen = pose(log, lever=lever).position_enu_m[0] - pose(log).position_enu_m[0]
    np.testing.assert_allclose(seen, moved, atol=1e-9, err_msg=source)


def test_headings_turn_the_short_way_over_180_degrees():
    q = np.stack([turned(179), turned(179), turned(-179)])
    seen = axes(pose(log_of(ned_from_body=q), at=1.5))
    np.testing.assert_allclose(seen[2], -N, atol=1e-12)


@pytest.mark.parametrize(("lat", "lon"), [(0.0, 10.0), (28.2, 179.99999), (-45.0, -180.0), (89.9999, 30.0)])
def test_positions_are_straight_through_equator_date_line_and_near_the_pole(lat, lon):
    """100 m in a second along a straight ENU line, given as latitude and longitude."""
    origin = Geodetic.from_degrees(lat, lon, 0.0)
    from pipeline.geometry.geodesy import geodetic_from_enu

    track = np.array([[-50.0, -50.0, 10.0], [0.0, 0.0, 10.0], [50.0, 50.0, 10.0]])
    places = [Geodetic(lat_rad=p[0], lon_rad=p[1], height_m=p[2]) for p in geodetic_from_enu(track, origin)]
    log = log_of(places=places)
    seen = pose(log, at=1.5, origin=origin).position_enu_m[0]
    np.testing.assert_allclose(seen, [25.0, 25.0, 10.0], atol=1e-6)


def test_the_vertical_turns_with_the_earth():
    """100 km north of the origin the local vertical leans by s / R = 0.9 degrees away from the origin's."""
    away = Geodetic.from_degrees(28.2 + 0.9, 112.9, 0.0)
    log = log_of(places=(away,) * 3, ned_from_body=turned(0, -90, 0))
    forward = axes(pose(log, origin=Geodetic.from_degrees(28.2, 112.9, 0.0)))[2]
    np.testing.assert_allclose(forward, [0.0, -np.sin(np.radians(0.9)), -np.cos(np.radians(0.9))], atol=1e-12)


def test_places_are_where_a_degree_puts_them():
    """[WGS84] one second of arc of latitude at the equator is 30.715 m, of longitude 30.922 m."""
    second = np.radians(1 / 3600)
    origin = Geodetic(lat_rad=0.0, lon_rad=0.0, height_m=0.0)
    enu = enu_from_geodetic(np.array([second, 0.0]), np.array([0.0, second]), np.zeros(2), origin)
    np.testing.assert_allclose(enu[:, :2], [[0.0, 30.715], [30.922, 0.0]], atol=1e-3)
