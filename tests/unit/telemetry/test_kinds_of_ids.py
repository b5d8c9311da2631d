"""Whose row it is, by ids that only one firmware has: receivers and cores of DataFlash before 4.1, instances of PX4.

[AP] AP_Logger/LogStructure.h of ArduPilot 4.0: GPS2, GPA2, GPSB with U; NKF1 and NKQ1 of the first core, NKF6 and NKQ2
of the second, PI of NKF4 the one that flies. [PX4] sensor_gps, estimator_selector_status, camera_capture by instance.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.geometry import rotation
from pipeline.telemetry import read_log
from tests.scenes import logs as written
from tests.scenes.logs import PLACE, definitions, record, ulog

LAT, LON = np.degrees(PLACE.lat_rad), np.degrees(PLACE.lon_rad)
GPS = ("QBIHBcLLeffffB", "TimeUS,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U")
GPA = ("QCCCCBI", "TimeUS,VDop,HAcc,VAcc,SAcc,VV,SMS")
QUATERNION = ("Qffff", "TimeUS,Q1,Q2,Q3,Q4")
LOCAL = ("Qffffff", "TimeUS,VN,VE,VD,PN,PE,PD")
OF_4_0 = {
    "GPS": (130, *GPS), "GPS2": (151, *GPS), "GPSB": (152, *GPS), "GPA": (153, *GPA), "GPA2": (154, *GPA),
    "NKF1": (155, *LOCAL), "NKF6": (156, *LOCAL), "NKQ1": (157, *QUATERNION), "NKQ2": (158, *QUATERNION),
    "NKF4": (159, "Qb", "TimeUS,PI"), "ORGN": (160, "QBLLe", "TimeUS,Type,Lat,Lng,Alt"),
}  # fmt: skip


@pytest.fixture
def of_4_0(monkeypatch):
    monkeypatch.setattr(written, "KINDS", {**written.KINDS, **OF_4_0})


def dataflash(path, records):
    path.write_bytes(b"".join([*definitions(), *records]))
    return read_log(path)


def fix(name, us, *, east_deg=0.0, status=3, used=0, alt_m=100.0):
    return record(
        name, us, status, 1000, 2300, 14, 80, LAT * 1e7, (LON + east_deg) * 1e7, 100 * alt_m, 10, 90, 0, 0, used
    )


@pytest.mark.usefixtures("of_4_0")
class TestReceivers:
    @pytest.mark.parametrize("used", ["GPS", "GPS2", "GPSB"])
    def test_the_one_in_use(self, tmp_path, used):
        """A second receiver, or both blended, is a message of its own, and so is its accuracy."""
        places, accuracy = {"GPS": 0.0, "GPS2": 0.01, "GPSB": 0.02}, {"GPA": 9.0, "GPA2": 0.5}
        records = []
        for us in range(100_000_000, 110_000_000, 200_000):
            records += [fix(name, us, east_deg=east + 1e-11 * us, used=name == used) for name, east in places.items()]
            records += [record(name, us, 100, 100 * worth, 100 * worth, 0, 1, 0) for name, worth in accuracy.items()]
        log = dataflash(tmp_path / "a.bin", records)
        assert np.degrees(log.position.lon_rad[0]) == pytest.approx(LON + places[used] + 1e-3, abs=1e-6)
        assert len(log.position.time_s) == 50
        assert log.accuracy.horizontal_m == {"GPS": 9.0, "GPS2": 0.5, "GPSB": 9.0}[used]

    def test_one_that_takes_over_on_the_way(self, tmp_path):
        records = []
        for i in range(50):
            us = 100_000_000 + 200_000 * i
            records += [fix("GPS", us, east_deg=1e-6 * i, used=i < 20, status=3 if i < 20 else 1),
                        fix("GPS2", us, east_deg=1e-6 * i + 1e-5, used=i >= 20)]  # fmt: skip
        log = dataflash(tmp_path / "a.bin", records)
        assert int(log.position.valid.sum()) == 50
        step = np.diff(np.degrees(log.position.lon_rad)) * 1e6
        assert (round(step.max()), int(step.argmax())) == (11, 19)

    def test_only_the_second_has_a_fix(self, tmp_path):
        """No U tells, as in 3.2: the first receiver without a fix is none."""
        records = []
        for i in range(50):
            us = 100_000_000 + 200_000 * i
            records += [fix("GPS", us, status=1), fix("GPS2", us, east_deg=1e-6 * i)]
        log = dataflash(tmp_path / "a.bin", records)
        assert (log.position.source, int(log.position.valid.sum())) == ("GPS", 50)


@pytest.mark.usefixtures("of_4_0")
class TestCores:
    def log(self, path, primary):
        """Two cores: the first looks north from 100 m, the second east from 200 m."""
        records = [record("ORGN", 99_000_000, 0, LAT * 1e7, LON * 1e7, 10000)]
        for i in range(50):
            us = 100_000_000 + 100_000 * i
            for number, (local, turn) in enumerate((("NKF1", "NKQ1"), ("NKF6", "NKQ2"))):
                q = rotation.ned_from_frd(np.array(np.radians(90.0 * number)), np.array(0.0), np.array(0.0))
                records.append(record(turn, us, *q))
                records.append(record(local, us, 0, 0, 0, 1.0 * i, 0, -100.0 * number))
            records.append(record("NKF4", us, primary(i)))
            records.append(record("ATT", us, 0, 0, 0, 0, 0, 4500, 0, 0))
        return dataflash(path, records)

    @pytest.mark.parametrize("core", [0, 1])
    def test_the_one_that_flew(self, tmp_path, core):
        log = self.log(tmp_path / "a.bin", lambda i: core if i else -1)
        assert (log.position.source, log.attitude.source) == (("NKF1", "NKF6")[core], ("NKQ1", "NKQ2")[core])
        assert np.degrees(rotation.yaw_pitch_roll(log.attitude.ned_from_body))[0, 0] == pytest.approx(90.0 * core)

    def test_none_of_them_where_it_changed(self, tmp_path):
        """ATT is that of whichever core flies, and there are no other positions."""
        log = self.log(tmp_path / "a.bin", lambda i: i // 25)
        assert (log.position, log.attitude.source) == (None, "ATT")


def test_one_camera_of_several_in_dataflash(tmp_path):
    """[AP] CAM.I."""
    records = []
    for i in range(20):
        records.append(record("POS", 100_000_000 + 100_000 * i, LAT * 1e7, LON * 1e7 + 100 * i, 100, 0, 0))
        records += [record("CAM", 100_000_000 + 100_000 * i + 1000 * camera, camera, i) for camera in (0, 1)]
    log = dataflash(tmp_path / "a.bin", records)
    np.testing.assert_allclose(log.camera_event_s, 100 + np.arange(20) / 10, atol=1e-6)
    assert any("2 cameras speak in CAM; instance 0 is used" in note for note in log.notes)


class TestPx4Instances:
    at = tuple(100 + i / 10 for i in range(30))

    def test_a_receiver_with_a_fix(self, tmp_path):
        """[PX4] sensor_gps: two receivers, of which only the second has a fix."""
        fields = {"latitude_deg": "f8", "longitude_deg": "f8", "altitude_msl_m": "f8", "fix_type": "u1"}
        topics = {}
        for name, lat, kind in (("sensor_gps", 0.0, 0), ("sensor_gps.1", LAT, 3)):
            rows = [(t, (lat, LON + 1e-6 * i, 100.0, kind)) for i, t in enumerate(self.at)]
            topics[name] = (fields, [{"t": t, **dict(zip(fields, row, strict=True))} for t, row in rows])
        log = read_log(ulog(tmp_path / "a.ulg", topics))
        assert int(log.position.valid.sum()) == 30
        assert np.degrees(log.position.lat_rad[0]) == pytest.approx(LAT)

    def test_the_estimator_that_was_selected(self, tmp_path):
        """[PX4] estimator_selector_status.primary_instance."""
        fields = {"pos_horiz_accuracy": "f4", "pos_vert_accuracy": "f4"}
        topics = {"estimator_selector_status": ({"primary_instance": "u1"},
                                                [{"t": t, "primary_instance": 1} for t in self.at])}  # fmt: skip
        for name, worth in (("estimator_status", 9.0), ("estimator_status.1", 0.5)):
            topics[name] = (
                fields,
                [{"t": t, "pos_horiz_accuracy": worth, "pos_vert_accuracy": worth} for t in self.at],
            )
        assert read_log(ulog(tmp_path / "a.ulg", topics)).accuracy.horizontal_m == pytest.approx(0.5)

    def test_one_camera_of_several(self, tmp_path):
        """[PX4] camera_capture by instance."""
        fields = {"timestamp_utc": "u64", "seq": "u4", "result": "i1"}
        topics = {
            name: (fields, [{"t": t + late, "timestamp_utc": 0, "seq": i, "result": 1} for i, t in enumerate(self.at)])
            for name, late in (("camera_capture", 0.0), ("camera_capture.1", 0.05))
        }
        log = read_log(ulog(tmp_path / "a.ulg", topics))
        np.testing.assert_allclose(log.camera_event_s, self.at, atol=1e-6)
        assert any("2 cameras speak in camera_capture" in note for note in log.notes)

    def test_dead_reckoning_is_said(self, tmp_path):
        """[PX4] vehicle_global_position.dead_reckoning: a position that no receiver holds."""
        fields = {"lat": "f8", "lon": "f8", "alt": "f4", "dead_reckoning": "b"}
        rows = [{"t": t, "lat": LAT, "lon": LON + 1e-6 * i, "alt": 100.0, "dead_reckoning": 10 <= i < 20}
                for i, t in enumerate(self.at)]  # fmt: skip
        log = read_log(ulog(tmp_path / "a.ulg", {"vehicle_global_position": (fields, rows)}))
        assert any(
            "10 of 30 positions" in n and "first at log time 101.0 s, the last at 101.9 s" in n for n in log.notes
        )
