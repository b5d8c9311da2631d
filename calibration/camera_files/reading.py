"""The camera in a file: the text becomes a document, the document is recognised, its fields become a camera."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from calibration.camera import CameraModel
from calibration.camera_files.binary import arrays_in, refuse_binary
from calibration.camera_files.dialects import camera_from
from calibration.camera_files.documents import document_in
from calibration.camera_files.named_numbers import refuse_bare_numbers
from calibration.camera_files.plausibility import NotACamera
from calibration.camera_files.recognition import OWN_FORM, cameras_in
from calibration.foundation.errors import InputFileError
from calibration.foundation.files import read_bytes

EXPECTED = (
    "a camera file: JSON of `runningfix calibrate`, OpenCV YAML/XML, ROS camera_info, Kalibr or another one listed"
)


def read_camera(path: Path, *, camera: str | None = None) -> CameraModel:
    """The camera in `path`, in whatever of the known formats it is; the content decides, not the name.

    `camera` names one where the file holds several (a Kalibr camchain, an aniposelib or caliscope array). Where the
    file gives no image size, `image_size` is (0, 0) and `made["note"]` says what cannot be checked.
    Raises InputFileError where the file is missing, cut off, or holds no sensible camera.
    """
    raw = read_bytes(path, expected=EXPECTED)
    try:
        format_name, document = _document(path, raw)
        fields = _one_camera(path, document, camera)
        made = fields.get("made") if isinstance(fields.get("made"), Mapping) else None
        return camera_from(fields, made if made is not None else {"from": f"{path.name} ({format_name})"})
    except NotACamera as reason:
        raise InputFileError(
            where=f"{path}, {reason.key}" if reason.key else str(path),
            seen=reason.seen,
            expected=reason.expected,
            advice=reason.advice or "correct the file, or calibrate again with `runningfix calibrate`",
        ) from None


def _document(path: Path, raw: bytes) -> tuple[str, Any]:
    """The name of the format and the document. Raises NotACamera or InputFileError where there is none."""
    arrays = arrays_in(raw)
    if arrays is not None:
        return "NumPy", arrays
    refuse_binary(raw)
    return _parsed(path, _text(path, raw))


def _text(path: Path, raw: bytes) -> str:
    if not raw.strip():
        raise InputFileError(
            where=str(path), seen="an empty file", expected=EXPECTED, advice="calibrate again, or copy the file anew"
        )
    try:
        return raw.decode("utf-16" if raw[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    except UnicodeDecodeError:
        raise InputFileError(
            where=str(path), seen="not a text file", expected=EXPECTED, advice="check that this is the right file"
        ) from None


def _parsed(path: Path, text: str) -> tuple[str, Any]:
    """The name of the format and the document."""
    try:
        return document_in(text, path.suffix.lower())
    except ValueError as error:
        raise InputFileError(
            where=str(path),
            seen=f"a file that cannot be read ({error})",
            expected=EXPECTED,
            advice="check that the file is whole and of one of these formats",
        ) from None


def _one_camera(path: Path, document: Any, camera: str | None) -> Mapping[str, Any]:
    cameras = cameras_in(document)
    if not cameras:
        refuse_bare_numbers(document, OWN_FORM)
        keys = ", ".join(map(str, list(document)[:6])) if isinstance(document, Mapping) else type(document).__name__
        raise InputFileError(
            where=str(path),
            seen=f"no camera matrix (found: {keys or 'nothing'})",
            expected=EXPECTED,
            advice="check that this is a camera file; ours has the keys model, image_size, K, distortion",
        )
    if camera is not None:
        chosen = [name for name in cameras if name == camera or name.split(".")[-1] == camera]
    else:
        chosen = list(cameras)
    if len(chosen) != 1:
        raise InputFileError(
            where=str(path),
            seen=f"{len(cameras)} cameras: {', '.join(cameras)}" + (f", none named {camera!r}" if camera else ""),
            expected="one camera, or the name of one of them",
            advice=f"`runningfix camera scale {path.name} --camera {next(iter(cameras))} -o one.json` writes it",
        )
    return cameras[chosen[0]]
