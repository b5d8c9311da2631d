"""The part of YAML that camera files use: nested mappings, lists, numbers, texts.

OpenCV's `%YAML:1.0` files with their `!!opencv-matrix` tags, ROS camera_info and Kalibr camchains are all of it.
Anchors, multi-line texts and several documents are not, and say so.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any


class PlainYamlError(ValueError):
    """A line that is not understood; the text says which."""


@dataclass(frozen=True)
class _Line:
    number: int
    indent: int
    text: str


def parse_plain_yaml(text: str) -> Any:
    """Dicts, lists, floats, ints, bools, None and strings from `text`; raises PlainYamlError with the line."""
    lines = _logical_lines(text)
    if not lines:
        raise PlainYamlError("nothing in the file")
    value, rest = _block(lines, 0)
    if rest < len(lines):
        raise PlainYamlError(f"line {lines[rest].number}: unexpected indentation: {lines[rest].text[:60]!r}")
    return value


def _logical_lines(text: str) -> list[_Line]:
    """Lines without comments, markers and tags; a bracket left open takes in the lines that follow."""
    lines: list[_Line] = []
    open_at: _Line | None = None
    for number, raw in enumerate(text.splitlines(), 1):
        bare = _without_comment(raw).rstrip()
        if open_at is not None:
            joined = f"{open_at.text} {bare.strip()}"
            open_at = _Line(open_at.number, open_at.indent, joined)
            if _depth(joined) <= 0:
                lines.append(open_at)
                open_at = None
            continue
        if not bare.strip() or bare.startswith("%") or bare.strip() in ("---", "..."):
            continue
        line = _Line(number, len(bare) - len(bare.lstrip()), re.sub(r"!!?[\w-]+", "", bare.strip()).rstrip())
        if _depth(line.text) > 0:
            open_at = line
        else:
            lines.append(line)
    if open_at is not None:
        raise PlainYamlError(f"line {open_at.number}: a bracket is never closed (is the file cut off?)")
    return lines


def _without_comment(raw: str) -> str:
    quote = ""
    for i, char in enumerate(raw):
        if quote:
            quote = "" if char == quote else quote
        elif char in "'\"":
            quote = char
        elif char == "#" and (i == 0 or raw[i - 1].isspace()):
            return raw[:i]
    return raw


def _depth(text: str) -> int:
    bare = re.sub(r"'[^']*'|\"[^\"]*\"", "", text)
    return bare.count("[") + bare.count("{") - bare.count("]") - bare.count("}")


def _block(lines: list[_Line], at: int) -> tuple[Any, int]:
    if lines[at].text == "-" or lines[at].text.startswith("- "):
        return _list(lines, at)
    return _mapping(lines, at)


def _list(lines: list[_Line], at: int) -> tuple[list[Any], int]:
    indent, items = lines[at].indent, []
    while at < len(lines) and lines[at].indent == indent and (lines[at].text + " ").startswith("- "):
        line = lines[at]
        inner = line.text[1:].strip()
        if not inner or re.match(r"[\w.-]+\s*:(\s|$)", inner) or inner.startswith("- "):
            shift = len(line.text) - len(inner) if inner else 0
            nested = [_Line(line.number, indent + shift, inner)] if inner else []
            end = at + 1
            while end < len(lines) and lines[end].indent > indent:
                end += 1
            value, used = _block([*nested, *lines[at + 1 : end]], 0) if inner or end > at + 1 else (None, 0)
            if value is not None and used < len(nested) + end - at - 1:
                raise PlainYamlError(f"line {lines[at + 1].number}: unexpected indentation")
            items.append(value)
            at = end
        else:
            items.append(_value(inner, line.number))
            at += 1
    return items, at


def _mapping(lines: list[_Line], at: int) -> tuple[dict[str, Any], int]:
    indent = lines[at].indent
    found: dict[str, Any] = {}
    while at < len(lines) and lines[at].indent == indent:
        line = lines[at]
        pair = re.match(r"(\"[^\"]*\"|'[^']*'|[^:\s][^:]*?)\s*:(?:\s+(.*)|$)", line.text)
        if not pair:
            raise PlainYamlError(f"line {line.number}: not `key: value`: {line.text[:60]!r}")
        key, text = pair[1].strip("'\""), (pair[2] or "").strip()
        at += 1
        if text:
            found[key] = _value(text, line.number)
        elif at < len(lines) and (lines[at].indent > indent or _list_at_same_indent(lines[at], indent)):
            found[key], at = _block(lines, at)
        else:
            found[key] = None
    return found, at


def _list_at_same_indent(line: _Line, indent: int) -> bool:
    return line.indent == indent and line.text.startswith("- ")


def _value(text: str, number: int) -> Any:
    if text[0] in "[{":
        value, end = _flow(text, 0, number)
        if text[end:].strip():
            raise PlainYamlError(f"line {number}: something follows the closing bracket: {text[end:][:40]!r}")
        return value
    if text[0] in "&*|>":
        raise PlainYamlError(f"line {number}: {text[0]!r} is YAML that camera files do not need")
    return _scalar(text)


def _flow(text: str, at: int, number: int) -> tuple[Any, int]:
    """A bracketed value that starts at `text[at]`, and where it ends."""
    if at >= len(text) or text[at] not in "[{":
        found = re.compile(r"\"[^\"]*\"|'[^']*'|[^,\[\]{}:]+(?::(?!\s)[^,\[\]{}:]*)*").match(text, at)
        if not found:
            raise PlainYamlError(f"line {number}: a value is missing near {text[at : at + 20]!r}")
        return _scalar(found[0].strip()), found.end()
    closing, keyed = ("]", False) if text[at] == "[" else ("}", True)
    items: list[Any] = []
    pairs: dict[str, Any] = {}
    at = _skip(text, at + 1)
    while text[at : at + 1] != closing:
        value, at = _flow(text, at, number)
        at = _skip(text, at)
        if keyed:
            if text[at : at + 1] != ":":
                raise PlainYamlError(f"line {number}: `key: value` expected in braces")
            pairs[str(value)], at = _flow(text, _skip(text, at + 1), number)
            at = _skip(text, at)
        else:
            items.append(value)
        if text[at : at + 1] == ",":
            at = _skip(text, at + 1)
        elif text[at : at + 1] != closing:
            raise PlainYamlError(f"line {number}: {closing!r} or a comma expected near {text[at : at + 20]!r}")
    return (pairs if keyed else items), at + 1


def _skip(text: str, at: int) -> int:
    while at < len(text) and text[at].isspace():
        at += 1
    return at


def _scalar(text: str) -> Any:
    if len(text) > 1 and text[0] == text[-1] and text[0] in "'\"":
        return text[1:-1]
    named = {"true": True, "false": False, "null": None, "~": None, ".nan": float("nan"), ".inf": float("inf")}
    if text.lower() in named:
        return named[text.lower()]
    if re.fullmatch(r"[-+]?\d+", text):
        return int(text)
    if re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", text):
        return float(text)
    return float("-inf") if text.lower() == "-.inf" else text
