"""Our camera file, and the choice among those of other programs.

A file of ours holds `model`, `image_size`, `K`, `distortion` (OpenCV's order), and where known `rms_px`,
`covariance` of (fx, fy, cx, cy, distortion) and `made`. Numbers are written so that reading gives the same doubles.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from calibration.camera import CameraModel
from calibration.camera_files.export import EXPORTS
from calibration.foundation.errors import UsageError
from calibration.foundation.files import write_whole

FORMATS = ("json", *EXPORTS)


def write_camera(path: Path, camera: CameraModel, *, format_name: str | None = None) -> None:
    """Write `camera`, whole or not at all.

    The format is ours unless `format_name` (one of `FORMATS`) asks for another. Raises UsageError for a format that
    is unknown or cannot hold this lens, WriteError where the file cannot be written.
    """
    name = format_name or "json"
    if name not in FORMATS:
        raise UsageError(
            where="camera format", seen=repr(name), expected=f"one of {', '.join(FORMATS)}", advice="choose one of them"
        )
    write_whole(path, camera_json(camera) if name == "json" else EXPORTS[name](camera))


def camera_json(camera: CameraModel) -> str:
    """The text of our camera file."""
    fields: dict[str, Any] = {
        "model": camera.model,
        "image_size": list(camera.image_size),
        "K": camera.K.tolist(),
        "distortion": camera.distortion.tolist(),
    }
    if camera.rms_px is not None:
        fields["rms_px"] = camera.rms_px
    if camera.covariance is not None:
        fields["covariance"] = camera.covariance.tolist()
    if camera.made:
        fields["made"] = _plain(camera.made)
    lines = [f"  {json.dumps(key)}: {_compact(value)}" for key, value in fields.items()]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _compact(value: Any) -> str:
    """Matrices a row per line, mappings an entry per line, everything else on one."""
    if isinstance(value, list) and value and isinstance(value[0], list):
        return "[\n" + ",\n".join(f"    {json.dumps(row, allow_nan=False)}" for row in value) + "\n  ]"
    if isinstance(value, dict) and value:
        rows = (f"    {json.dumps(k)}: {json.dumps(v, allow_nan=False, ensure_ascii=False)}" for k, v in value.items())
        return "{\n" + ",\n".join(rows) + "\n  }"
    return json.dumps(value, allow_nan=False)


def _plain(value: Any) -> Any:
    """Plain JSON values of what `made` may hold: mappings, tuples, arrays, numpy numbers, NaN as null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and (value != value or abs(value) == float("inf")):
        return None
    return value if isinstance(value, str | int | float | bool | None) else str(value)
