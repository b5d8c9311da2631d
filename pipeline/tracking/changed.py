"""`dataclasses.replace` for records that are changed thousands of times a second."""

from __future__ import annotations

from typing import Any, TypeVar

Record = TypeVar("Record")


def changed(record: Record, **values: object) -> Record:
    """The dataclass `record` (frozen, without slots or `__post_init__`) with other values; nothing cached is kept.

    Raises TypeError where it has no such field.
    """
    kind: Any = type(record)
    fields = kind.__dataclass_fields__
    if not fields.keys() >= values.keys():
        raise TypeError(f"{kind.__name__} has no field {', '.join(values.keys() - fields.keys())}")
    out: Record = object.__new__(kind)
    before = record.__dict__
    out.__dict__.update({name: before[name] for name in fields} | values)
    return out
