"""The definitions of MAVLink that are kept are those of pymavlink, of the version that they name."""

from __future__ import annotations

import json

import pymavlink
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from pipeline.telemetry.mavlink.packets import definitions as kept


@pytest.fixture(autouse=True)
def _fresh():
    kept.definitions.cache_clear()
    yield
    kept.definitions.cache_clear()


@pytest.mark.skipif(
    json.loads(kept.FILE.read_bytes())["pymavlink"] != pymavlink.__version__,
    reason="another pymavlink is installed than the kept definitions are of: they are not used",
)
def test_kept_are_those_of_pymavlink():
    assert kept.FILE.read_text() == kept.kept_text()  # else: scripts/mavlink_definitions
    assert len(kept.definitions()) == len(mav.mavlink_map)
    for msgid, message in mav.mavlink_map.items():
        its = kept.definitions()[msgid]
        assert its.msgname == message.msgname
        assert its.crc_extra == message.crc_extra
        assert list(its.ordered_fieldnames) == message.ordered_fieldnames
        assert list(its.array_lengths) == message.array_lengths


def test_another_version_of_pymavlink_is_asked_itself(tmp_path, monkeypatch):
    other = json.loads(kept.FILE.read_bytes()) | {"pymavlink": "0.0"}
    other["messages"] = {}
    (tmp_path / "definitions.json").write_text(json.dumps(other))
    monkeypatch.setattr(kept, "FILE", tmp_path / "definitions.json")
    assert kept.definitions()[33].msgname == "GLOBAL_POSITION_INT"
