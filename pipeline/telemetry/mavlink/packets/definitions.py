"""What the ids of MAVLink mean: names, fields in the order they are sent, and the last byte of each checksum.

They are pymavlink's (dialect ardupilotmega, with the common messages). To import them takes longer than to read a
small log, so those of one version of pymavlink are kept in `definitions.json` (`scripts/mavlink_definitions` writes
it); another version is asked itself.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

FILE = Path(__file__).with_name("definitions.json")


class Definition(NamedTuple):
    """One message, under the names of pymavlink's classes: `ordered_fieldnames` and `array_lengths` as it is sent."""

    msgname: str
    crc_extra: int
    fieldnames: tuple[str, ...]
    fieldtypes: tuple[str, ...]
    ordered_fieldnames: tuple[str, ...]
    array_lengths: tuple[int, ...]


@cache
def definitions() -> Mapping[int, Definition]:
    """Every known id."""
    from pymavlink import __version__

    kept = json.loads(FILE.read_bytes())
    if kept["pymavlink"] != __version__:
        return pymavlink_definitions()
    return MappingProxyType({int(msgid): _definition(rest) for msgid, rest in kept["messages"].items()})


def pymavlink_definitions() -> Mapping[int, Definition]:
    """As the installed pymavlink has them."""
    from pymavlink.dialects.v20 import ardupilotmega

    return MappingProxyType({msgid: _definition([getattr(message, name) for name in Definition._fields])
                             for msgid, message in sorted(ardupilotmega.mavlink_map.items())})  # fmt: skip


def kept_text() -> str:
    """What `definitions.json` holds for the installed pymavlink."""
    from pymavlink import __version__

    rows = [f'"{msgid}": {json.dumps(list(its))}' for msgid, its in pymavlink_definitions().items()]
    return f'{{"pymavlink": "{__version__}", "messages": {{\n' + ",\n".join(rows) + "\n}}\n"


def _definition(values: list[Any]) -> Definition:
    msgname, crc_extra, names, types, ordered, lengths = values
    return Definition(msgname, crc_extra, tuple(names), tuple(types), tuple(ordered), tuple(lengths))
