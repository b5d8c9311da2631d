"""The colours of every page that people are shown, one for all: what stands first in each page's style."""

from __future__ import annotations

from importlib.resources import files


def palette() -> str:
    """The style sheet that names them, light and dark."""
    return files(__package__).joinpath("palette.css").read_text(encoding="utf-8")
