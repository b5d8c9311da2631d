"""HTML and SVG as text that is safe by construction: plain strings are escaped, `Html` passes."""

from __future__ import annotations

import html
import json
from typing import Any

import numpy as np

from calibration.foundation.arrays import Floats

VOID = frozenset({"br", "input", "link", "meta"})
CLOSED = frozenset({"path", "line", "rect", "circle", "ellipse", "polygon", "use"})


class Html(str):
    """Text that is markup already. Anything else given to `tag` is escaped."""

    __slots__ = ()


def safe(content: str) -> Html:
    """`content` as markup: escaped, unless it is markup already."""
    return content if isinstance(content, Html) else Html(html.escape(content, quote=True))


def joined(*content: str) -> Html:
    """Several pieces as one."""
    return Html("".join(safe(c) for c in content))


def tag(name: str, /, *content: str, **attributes: Any) -> Html:
    """One element. `class_` is class, underscores become hyphens; None leaves an attribute out, True leaves it bare."""
    head = name + "".join(_attribute(key, value) for key, value in attributes.items() if value is not None)
    if name in VOID:
        return Html(f"<{head}>")
    if name in CLOSED and not content:
        return Html(f"<{head}/>")
    return Html(f"<{head}>{joined(*content)}</{name}>")


def _attribute(key: str, value: Any) -> str:
    name = key.rstrip("_").replace("_", "-")
    if value is True:
        return f" {name}"
    words = number(value) if isinstance(value, float) else str(value)
    return f' {name}="{html.escape(words, quote=True)}"'


def number(value: float, places: int = 2) -> str:
    """A coordinate: at most `places` decimals, no trailing zeros, never minus zero."""
    words = f"{value:.{places}f}"
    if "." in words:
        words = words.rstrip("0").rstrip(".")
    return "0" if words == "-0" else words


def path(xy: Floats, closed: bool = False) -> str:
    """SVG path data through points (n, 2) in pixels; a NaN lifts the pen."""
    parts: list[str] = []
    pen = "M"
    for x, y in np.asarray(xy, float).tolist():
        if x != x or y != y:
            pen = "M"
            continue
        parts.append(f"{pen}{number(x, 1)} {number(y, 1)}")
        pen = "L"
    return "".join(parts) + ("Z" if closed and parts else "")


def specks(xy: Floats) -> str:
    """SVG path data of a dot at each point (n, 2): lines of no length, to be stroked with round ends."""
    return "".join(f"M{number(x, 1)} {number(y, 1)}h0" for x, y in np.asarray(xy, float).tolist() if x == x and y == y)


def data_script(name: str, value: Any) -> Html:
    """`value` as JSON inside the page, under the id `name`: nothing in it can close the element."""
    words = json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"), sort_keys=True)
    for sign, code in (("<", "\\u003c"), (">", "\\u003e"), ("&", "\\u0026")):
        words = words.replace(sign, code)
    return Html(f'<script type="application/json" id="{html.escape(name)}">{words}</script>')
