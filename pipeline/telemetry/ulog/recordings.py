"""The recordings in a `.ulg` file, by pyulog: one, unless logs were joined.

A log begins with a magic of eight bytes. pyulog reads only the first of several, and of logs joined without their heads
the last of each topic: so each is read by itself.
"""

from __future__ import annotations

import io
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calibration.foundation.errors import InputFileError
from pipeline.telemetry.log.mapped_file import Bytes, mapped
from pipeline.telemetry.ulog.columns import Topic

MAGIC = b"ULog\x01\x12\x35"
HEAD_BYTES = 16
ROUNDS = 8
"""pyulog reads a whole log once, in pieces of three bytes and more."""
Instances = dict[str, dict[int, Topic]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """What one recording holds: topics by name and instance, and what its head says of vehicle and settings.

    dropouts    how often the card was too slow
    complaints  what pyulog printed
    """

    instances: Instances
    info: dict[str, Any]
    parameters: dict[str, float]
    dropouts: int
    complaints: tuple[str, ...]


class _Onwards(io.BufferedReader):
    """A log that is read through once or a few times, not for ever: a wrong length sends pyulog back in circles."""

    def __init__(self, raw: io.RawIOBase, size: int) -> None:
        super().__init__(raw)
        self._left = 1000 + ROUNDS * size

    def read(self, size: int | None = -1, /) -> bytes:
        """As of any file; raises ValueError where more was asked for than the file holds ROUNDS times."""
        found = super().read(size)
        self._left -= 1 + len(found)
        if self._left < 0:
            raise ValueError("a wrong length leads back to where it was read before")
        return found


def recordings_of(path: Path) -> list[Recording]:
    """Every recording of a file, in its order.

    Raises InputFileError where pyulog is not installed or cannot read it.
    """
    begins = _begins(mapped(path, expected="a PX4 log"))
    if len(begins) < 2:
        return _read(path, _Onwards(io.FileIO(path), path.stat().st_size))
    content, found = path.read_bytes(), []
    for begin, end in zip(begins, [*begins[1:], len(content)], strict=True):
        part = content[begin:end] if content.startswith(MAGIC, begin) else content[:HEAD_BYTES] + content[begin:end]
        found += _read(path, _Onwards(io.BytesIO(part), len(part)))  # type: ignore[arg-type]
    return found


def _begins(data: Bytes) -> list[int]:
    found = [0]
    while (at := data.find(MAGIC, found[-1] + len(MAGIC))) >= 0:
        found.append(at)
    return sorted([*found, *_without_heads(data, [*found[1:], len(data)][0])])


def _without_heads(data: Bytes, end: int) -> list[int]:
    """Where, up to `end`, formats are defined once more: logs joined without their heads."""
    at, found = HEAD_BYTES, []
    while at + 3 <= end and (kind := data[at + 2]) not in b"AD":
        message = bytes(data[at : at + 3 + int.from_bytes(data[at : at + 2], "little")])
        if kind == ord("F"):
            again, places = at, []
            while (again := data.find(message, again + 1, end)) >= 0:
                places.append(again)
            found.append(places)
        at += len(message)
    logs = min(map(len, found), default=0)
    return [min(places[i] for places in found) for i in range(logs)]


def _read(path: Path, file: _Onwards) -> list[Recording]:
    try:
        import pyulog
    except ImportError:
        raise InputFileError(
            where=str(path),
            seen="a PX4 log, and pyulog is not installed",
            expected="the extra `ulog`",
            advice="pip install 'runningfix[ulog]'",
        ) from None
    said = io.StringIO()
    try:
        with file, redirect_stdout(said):  # pyulog prints; standard output is for results
            log = pyulog.ULog(file)
    except Exception as error:  # whatever pyulog trips over in a broken file
        raise InputFileError(
            where=str(path),
            seen=f"cannot be read as a PX4 log ({type(error).__name__}: {error})",
            expected="a whole .ulg file",
            advice="download the log again",
        ) from None
    parts: list[Instances] = [{}]
    whole = (d for d in log.data_list if "timestamp" in d.data)  # a topic without times is a broken one
    for data in sorted(whole, key=lambda d: d.multi_id):
        free = next((p for p in parts if data.multi_id not in p.get(data.name, {})), None)
        if free is None:  # subscribed to once more: a log without its head
            parts.append(free := {})
        free.setdefault(data.name, {})[data.multi_id] = data.data
    info, parameters = dict(log.msg_info_dict), dict(log.initial_parameters)
    return [
        Recording(
            instances=part, info=info, parameters=parameters, dropouts=0 if i else len(log.dropouts),
            complaints=() if i else tuple(said.getvalue().splitlines()),
        )
        for i, part in enumerate(parts)
    ]  # fmt: skip
