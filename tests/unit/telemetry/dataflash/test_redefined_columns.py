"""A log defines its own messages: whatever a definition says of a column, the log is read or refused in words."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest

from calibration.foundation.errors import RunningFixError
from pipeline.telemetry import inspect_log, read_log
from pipeline.telemetry.dataflash.messages.layout import LETTERS
from tests.scenes import logs

MORE = {
    "PARM": (152, "QNf", "TimeUS,Name,Value"),
    "MNT": (153, "QBffffffff", "TimeUS,I,DesRoll,Roll,DesPitch,Pitch,DesYawB,YawB,DesYawE,YawE"),
    "GPA": (154, "QBCCCCfBIHf", "TimeUS,I,VDop,HAcc,VAcc,SAcc,YAcc,VV,SMS,Delta,Und"),
}
KINDS = {name: kind for name, kind in {**logs.KINDS, **MORE}.items() if name not in ("FMT", "IMU", "ARR", "MSG")}


def written(path, kinds):
    """A flight of a second, each value put into whatever column its definition has for it, where it fits."""

    def record(name, *values):
        kind, letters, _ = kinds[name]
        row = np.zeros(1, np.dtype([(str(i), LETTERS[letter]) for i, letter in enumerate(letters)]))
        for i, value in enumerate(values):
            with contextlib.suppress(ValueError, TypeError, OverflowError, IndexError), np.errstate(all="ignore"):
                row[str(i)] = value
        return b"\xa3\x95" + bytes([kind]) + row.tobytes()

    out = b""
    for name, (kind, letters, columns) in {"FMT": logs.KINDS["FMT"], **kinds}.items():
        length = 3 + sum(np.dtype(LETTERS[letter]).itemsize for letter in letters)
        out += logs.record("FMT", kind, length, name.encode(), letters.encode(), columns.encode())
    out += record("PARM", 0, b"GPS_DRV_OPTIONS", 0.0) + record("PARM", 0, b"SYSID_THISMAV", 3.0)
    for i in range(21):
        us = 100_000_000 + 50_000 * i
        out += record("ATT", us, 0, 57, 0, -115, 0, 9000, 0, 0) + record(
            "POS", us, 282000000, 1129000000 + i, 100, 0, 0
        )
        out += record("MNT", us, 0, 0.0, 1.0, 0.0, -30.0, 0.0, 5.0, np.nan, np.nan)
        if i % 4 == 0:
            gps = (us, 0, 4, 100_000 + 50 * i, 2300, 14, 80, 282000000, 1129000000 + i, 10000, 1, 90, 0, 0, 1)
            out += record("GPS", *gps) + record("GPA", us, 0, 150, 120, 200, 30, 0.0, 1, i, 200, -20.0)
            out += record("CAM", us, 0, i)
    path.write_bytes(out)
    return path


def redefinitions():
    for name, (kind, letters, columns) in KINDS.items():
        names = columns.split(",")
        for i in range(len(letters)):
            for letter in "aZnd":
                yield f"{name}.{names[i]}-{letter}", name, (kind, letters[:i] + letter + letters[i + 1 :], columns)
            missing = ",".join([*names[:i], "Other", *names[i + 1 :]])
            yield f"{name}.{names[i]}-missing", name, (kind, letters, missing)


def test_as_it_should_be(tmp_path):
    told = inspect_log(read_log(written(tmp_path / "a.bin", KINDS)))
    assert [facts.what for facts in told.series] == ["position", "attitude", "gimbal"]


@pytest.mark.parametrize("name", KINDS)
def test_a_column_of_another_kind(name, tmp_path):
    read = 0
    for what, message, kind in redefinitions():
        if message == name:
            path = written(tmp_path / f"{what}.bin", {**KINDS, name: kind})
            with contextlib.suppress(RunningFixError):
                inspect_log(read_log(path))
                read += 1
    assert read


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_parameters_that_are_no_numbers(value, tmp_path):
    path = written(tmp_path / "a.bin", KINDS)
    odd = path.read_bytes().replace(np.float32(3.0).tobytes(), np.float32(value).tobytes(), 1)
    path.write_bytes(odd.replace(b"GPS_DRV_OPTIONS\0" + bytes(4), b"GPS_DRV_OPTIONS\0" + np.float32(value).tobytes()))
    assert read_log(path).position is not None
