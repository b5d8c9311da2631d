"""Which vehicle and gimbal a camera is on, and what its heights count from: asked for, or a clear no."""

from __future__ import annotations

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from calibration import write_camera
from calibration.foundation.errors import UsageError
from pipeline.flight import read_flight
from pipeline.geometry import rotation
from pipeline.stages import measure_poses, open_sources
from pipeline.synthetic.demo_scenes import small_scene
from tests.scenes.logs import RECORD_EPOCH_S, Link, dataflash, fly, turned

SRT = "".join(
    f"{i + 1}\n00:00:{i // 10:02d},{i % 10}00 --> 00:00:{(i + 1) // 10:02d},{(i + 1) % 10}00\n"
    f"[latitude: 28.2] [longitude: {112.9 + i * 1e-5:.5f}] [rel_alt: 30.0] [gb_yaw: 90 gb_pitch: -30 gb_roll: 0]\n\n"
    for i in range(30)
)


def flight_of(folder, **cameras):
    write_camera(folder / "a.json", small_scene().cameras[1].lens)
    text = "".join(
        f'[cameras.{name}]\ncalibration = "a.json"\nframe_rate = 25\n{keys}\n' for name, keys in cameras.items()
    )
    (folder / "flight.toml").write_text(text)
    return read_flight(folder / "flight.toml")


def two_vehicles(folder):
    link = Link()
    fly(link, seconds=5, system=1)
    fly(link, seconds=4, system=2, heading_deg=lambda t: 0.0)
    link.save(folder / "two.tlog")


def log(name, *more):
    return "\n".join([f'telemetry = "{name}"', "start = 101.0", *more])


class TestVehicles:
    def test_each_camera_asks_for_its_own(self, tmp_path):
        two_vehicles(tmp_path)
        flight = flight_of(tmp_path, a=log("two.tlog", "system = 1"), b=log("two.tlog", "system = 2"))
        a, b = measure_poses(flight, open_sources(flight))
        headings = [np.degrees(rotation.camera_yaw_pitch_roll(p.poses.enu_from_cam)[0, 0]) for p in (a, b)]
        assert headings == pytest.approx([93.0, 0.0], abs=0.1)

    def test_the_one_that_nobody_asked_for_is_the_other_camera_s(self, tmp_path):
        two_vehicles(tmp_path)
        flight = flight_of(tmp_path, a=log("two.tlog"), b=log("two.tlog", "system = 1"))
        assert open_sources(flight).logs["a"].system == 2

    @pytest.mark.parametrize("cameras", [1, 2])
    def test_several_vehicles_unasked_are_refused(self, tmp_path, cameras):
        two_vehicles(tmp_path)
        flight = flight_of(tmp_path, **{f"c{i}": log("two.tlog") for i in range(cameras)})
        with pytest.raises(UsageError, match=r"carries several vehicles \(systems 1, 2\).*write system = 1"):
            open_sources(flight)

    @pytest.mark.parametrize("kind", ["tlog", "dataflash", "a copy"])
    def test_two_cameras_on_one_vehicle_unasked_are_refused(self, tmp_path, kind):
        link = Link()
        fly(link, seconds=5)
        names = {"tlog": ("a.tlog", "a.tlog"), "dataflash": ("a.bin", "a.bin"), "a copy": ("a.tlog", "b.tlog")}[kind]
        for name in names:
            dataflash(tmp_path / name) if name.endswith("bin") else link.save(tmp_path / name)
        flight = flight_of(tmp_path, a=log(names[0]), b=log(names[1]))
        with pytest.raises(UsageError, match="a and b both come to"):
            open_sources(flight)
        asked = flight_of(tmp_path, a=log(names[0], "system = 1"), b=log(names[1], "system = 1"))
        assert set(open_sources(asked).logs) == {"a", "b"}

    def test_a_vehicle_that_is_not_in_the_log_is_named(self, tmp_path):
        dataflash(tmp_path / "a.bin")  # no parameter says of which system it is
        flight = flight_of(tmp_path, a=log("a.bin", "system = 7"))
        assert open_sources(flight).logs["a"].system is None


class TestGimbals:
    def link(self, *, second=(0.0, -60.0)):
        link = Link()
        fly(link, seconds=5)
        for i in range(50):
            for device, (yaw, pitch) in ((1, (90.0, -30.0)), (2, second)):
                link.send(
                    mav.MAVLink_gimbal_device_attitude_status_message(
                        0, 0, 100_000 + 100 * i, 64 | 12, turned(yaw, pitch).tolist(), 0, 0, 0, 0, 0, 0, device
                    ),
                    record_s=RECORD_EPOCH_S + i / 10 + 0.03,
                )
        link.packets.sort(key=lambda p: p[:8])
        link.bytes = bytearray(b"".join(link.packets))
        return link

    def test_each_camera_asks_for_its_own(self, tmp_path):
        self.link().save(tmp_path / "a.tlog")
        ask = lambda n: log("a.tlog", 'mount = "gimbal"', f"gimbal = {n}")  # noqa: E731
        flight = flight_of(tmp_path, a=ask(1), b=ask(2))
        pitch = [
            np.degrees(rotation.camera_yaw_pitch_roll(p.poses.enu_from_cam)[0, 1])
            for p in measure_poses(flight, open_sources(flight))
        ]
        assert pitch == pytest.approx([-30, -60], abs=1e-3)

    def test_unasked_they_are_refused_and_a_fixed_camera_is_not(self, tmp_path):
        self.link().save(tmp_path / "a.tlog")
        with pytest.raises(UsageError, match=r"several gimbals that look different ways \(1, 2\)"):
            open_sources(flight_of(tmp_path, a=log("a.tlog", 'mount = "gimbal"')))
        assert open_sources(flight_of(tmp_path, a=log("a.tlog", "mount = { pitch_deg = -30 }"))).logs["a"].gimbals

    def test_a_fixed_camera_beside_a_gimbal_is_spoken_of(self, tmp_path):
        self.link().save(tmp_path / "a.tlog")
        flight = flight_of(tmp_path, a=log("a.tlog", "mount = { pitch_deg = -30 }"))
        (pose,) = measure_poses(flight, open_sources(flight))
        assert any("taken as fixed in the body" in note for note in pose.notes)

    def test_one_told_twice_is_one(self, tmp_path):
        self.link(second=(90.0, -30.0)).save(tmp_path / "a.tlog")
        assert open_sources(flight_of(tmp_path, a=log("a.tlog", 'mount = "gimbal"'))).logs["a"].gimbals == ()

    def test_one_that_is_not_there_is_named(self, tmp_path):
        self.link().save(tmp_path / "a.tlog")
        with pytest.raises(UsageError, match=r"gimbal = 5, and gimbals in the log: 1, 2"):
            open_sources(flight_of(tmp_path, a=log("a.tlog", 'mount = "gimbal"', "gimbal = 5")))

    def test_a_correction_turns_the_camera_in_its_gimbal(self, tmp_path):
        self.link().save(tmp_path / "a.tlog")
        keys = ('mount = "gimbal"', "gimbal = 1", "mount_correction = { pitch_deg = 4, yaw_deg = 0 }")
        flight = flight_of(tmp_path, a=log("a.tlog", *keys))
        (pose,) = measure_poses(flight, open_sources(flight))
        seen = np.degrees(rotation.camera_yaw_pitch_roll(pose.poses.enu_from_cam)[0])
        np.testing.assert_allclose(seen, [90, -26, 0], atol=1e-3)

    def test_a_correction_of_a_fixed_mount_comes_before_it(self, tmp_path):
        self.link().save(tmp_path / "a.tlog")
        keys = ("mount = { pitch_deg = -90 }", "mount_correction = { roll_deg = 5 }")
        whole = flight_of(tmp_path, a=log("a.tlog", *keys))
        (pose,) = measure_poses(whole, open_sources(whole))
        want = rotation.multiply(turned(0, -90, 0), turned(0, 0, 5))
        plain = flight_of(tmp_path, a=log("a.tlog"))
        (body,) = measure_poses(plain, open_sources(plain))
        cam = rotation.multiply(want, rotation.CAM_AS_FRD)
        expected = rotation.multiply(
            rotation.multiply(body.poses.enu_from_cam[0], rotation.conjugate(rotation.CAM_AS_FRD)), cam
        )
        assert abs(float(expected @ pose.poses.enu_from_cam[0])) == pytest.approx(1.0, abs=1e-9)


class TestDatums:
    def test_heights_above_home_do_not_meet_others(self, tmp_path):
        (tmp_path / "d.srt").write_text(SRT)
        fly(link := Link(), seconds=5)
        link.save(tmp_path / "a.tlog")
        srt = 'telemetry = "d.srt"\nstart = 0.5\nmount = "gimbal"'
        flight = flight_of(tmp_path, a=log("a.tlog"), d=srt)
        with pytest.raises(UsageError, match=r"d.srt gives heights above its take-off place only.*write takeoff"):
            open_sources(flight)
        origin = "[flight]\norigin = { lat = 28.2, lon = 112.9, height = 60.0 }\n"
        alone = flight_of(tmp_path, d=srt)
        (tmp_path / "flight.toml").write_text(origin + (tmp_path / "flight.toml").read_text())
        with pytest.raises(UsageError, match="the origin count from elsewhere"):
            open_sources(read_flight(tmp_path / "flight.toml"))
        assert any("take-off place" in note for note in open_sources(alone).logs["d"].notes)

    @pytest.mark.parametrize(("datum", "height_m"), [("ellipsoid", 91.0), ("msl", 91.0 - 16.9)])
    def test_a_take_off_height_brings_them_to_the_ellipsoid(self, tmp_path, datum, height_m):
        (tmp_path / "d.srt").write_text(SRT)
        take = f'telemetry = "d.srt"\nstart = 0.5\nmount = "gimbal"\ntakeoff = {{ height = 61.0, datum = "{datum}" }}'
        found = open_sources(flight_of(tmp_path, d=take)).logs["d"]
        assert found.position.datum == "ellipsoid"
        assert found.position.height_m[0] == pytest.approx(height_m, abs=0.5)
        assert not any("take-off place:" in note for note in found.notes)

    def test_a_log_without_heights_above_home_says_so(self, tmp_path):
        (tmp_path / "d.srt").write_text(SRT.replace("[rel_alt: 30.0]", "[abs_alt: 30.0]"))
        take = 'telemetry = "d.srt"\nstart = 0.5\nmount = "gimbal"\ntakeoff = { height = 61.0 }'
        with pytest.raises(UsageError, match="gives no heights above home"):
            open_sources(flight_of(tmp_path, d=take))
