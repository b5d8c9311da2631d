"""The text of a camera file as nested mappings and lists: JSON, YAML, XML, TOML, and two tables of other programs."""

from __future__ import annotations

import ast
import json
import re
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from typing import Any

from calibration.camera_files.yaml_document import parse_yaml

COLMAP, MRCAL, PIX4D, XML_ROOT = "colmap cameras", "lensmodel", "pix4d cam", "xml root"
MATLAB_SCRIPT = "matlab script"
"""Keys under which documents that are not of nested mappings stand; the second is mrcal's own."""

XML_TELLS = ("DewarpData", "stCamera")
"""Words that tell whose XML it is where the root element does not."""

_COLMAP_LINE = re.compile(r"\d+\s+[A-Z][A-Z_0-9]+\s+\d+\s+\d+(\s+[-+.\deE]+)+\s*")
_TOML_LINE = re.compile(r"(\[\[?[^\[\]]+\]\]?|[\w.\"'-]+\s*=.*)\s*(#.*)?")
_BOUGUET_LINE = re.compile(r"^\s*(fc|cc|kc)\s*=\s*\[([-+.\deE\s;,]+)\]\s*;", re.MULTILINE)
_PIX4D_LINE = re.compile(r"(FOCAL|XPOFF|YPOFF|CAM_WIDTH|RADIAL_K1)\s+[-+.\deE]+\s*")


def document_in(text: str, suffix: str) -> tuple[str, Any]:
    """The name of the format, and the document. Raises ValueError where it cannot be read; the content decides."""
    lines = [line.strip() for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    start = lines[0] if lines else ""
    if start[:1] in "{[" and re.search(r"['\"]lensmodel['\"]\s*:", text):
        return "mrcal", _python_literal(text)
    if start.startswith("<"):
        return "XML", _xml(text)
    if lines and all(_COLMAP_LINE.fullmatch(line) for line in lines):
        return "COLMAP", {COLMAP: lines}
    if start.startswith("Pix4D") or sum(bool(_PIX4D_LINE.fullmatch(line)) for line in lines) >= 3:
        return "Pix4D", {PIX4D: lines}
    if len(re.findall(_BOUGUET_LINE, text)) >= 2:
        return "MATLAB", _bouguet_script(text)
    if re.search(r"^\s*(%|function\b)", text, re.MULTILINE) and suffix == ".m":
        return "MATLAB", {MATLAB_SCRIPT: text[:60]}
    if suffix == ".toml" or _TOML_LINE.fullmatch(start):
        return "TOML", tomllib.loads(text)
    if start[:1] in "{[":
        return "JSON", _json(text)
    return "YAML", parse_yaml(text)


def _bouguet_script(text: str) -> Any:
    """The lists of numbers that a Calib_Results.m of Bouguet's toolbox sets; its skew and size are plain numbers."""
    _refuse_twice(name for name, _ in re.findall(_BOUGUET_LINE, text))
    found: dict[str, Any] = {
        name: [float(word) for word in re.split(r"[\s;,]+", values.strip(" ;,"))]
        for name, values in re.findall(_BOUGUET_LINE, text)
    }
    for name, value in re.findall(r"^\s*(nx|ny|alpha_c)\s*=\s*([-+.\deE]+)\s*;", text, re.MULTILINE):
        found[name] = float(value)
    return found


def _json(text: str) -> Any:
    try:
        return json.loads(text, object_pairs_hook=_unique)
    except RecursionError:
        raise ValueError("nested too deeply for a camera file") from None


def _unique(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    _refuse_twice(name for name, _ in pairs)
    return dict(pairs)


def _refuse_twice(names: Iterable[str]) -> None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise ValueError(f"the key {name!r} twice")
        seen.add(name)


def _python_literal(text: str) -> Any:
    """mrcal's .cameramodel: the literal of a Python dictionary."""
    try:
        tree = ast.parse(text.strip(), mode="eval")
        for node in ast.walk(tree):
            if isinstance(node, ast.Dict):
                _refuse_twice(str(key.value) for key in node.keys if isinstance(key, ast.Constant))
        return ast.literal_eval(tree)
    except (SyntaxError, RecursionError, MemoryError):
        raise ValueError("not a dictionary as mrcal writes it") from None


def _xml(text: str) -> Any:
    if "<!ENTITY" in text:
        raise ValueError("entity definitions are not accepted")
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise ValueError(str(error)) from None
    name = root.tag.rsplit("}", 1)[-1]
    if name != "opencv_storage":
        parts = sorted({child.tag.rsplit("}", 1)[-1] for child in root.iter()})
        return {XML_ROOT: name, "parts": parts, "told": tuple(word for word in XML_TELLS if word in text)}
    return _xml_value(root)


def _xml_value(node: ET.Element) -> Any:
    if len(node):
        if all(child.tag == "_" for child in node):
            return [_xml_value(child) for child in node]
        _refuse_twice(child.tag for child in node)
        return {child.tag: _xml_value(child) for child in node}
    words = (node.text or "").split()
    try:
        numbers: list[float] = [float(word) for word in words]
    except ValueError:
        return (node.text or "").strip().strip('"')
    if node.tag == "data" or len(numbers) != 1:
        return numbers
    return numbers[0]
