"""XML as text: elements built in order, then laid out; the same bytes every time."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

_FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def child(parent: ET.Element, tag: str, text: str | None = None, **attributes: str) -> ET.Element:
    """A new last child. Characters that XML 1.0 cannot hold become U+FFFD."""
    told = {name: clean(value) for name, value in attributes.items()}
    element = ET.SubElement(parent, tag, told)
    if text is not None:
        element.text = clean(text)
    return element


def clean(text: str) -> str:
    """`text` without the characters that XML 1.0 cannot hold."""
    return _FORBIDDEN.sub("\ufffd", text)


def document(root: ET.Element) -> str:
    """The whole document, an element per line."""
    ET.indent(root, " ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
