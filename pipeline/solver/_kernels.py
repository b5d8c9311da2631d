"""Compiled twins of the plain numpy loops; bare arrays in, bare arrays out, checked by their callers."""

from __future__ import annotations

AVAILABLE = False


def block_normals(*_: object):  # type: ignore[no-untyped-def]
    """Twin of `elimination.block_normals_plain`."""
    raise NotImplementedError


def frame_steps(*_: object):  # type: ignore[no-untyped-def]
    """Twin of `elimination.frame_steps_plain`."""
    raise NotImplementedError
