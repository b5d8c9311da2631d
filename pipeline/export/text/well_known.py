"""Geometry in well-known binary (ISO, little-endian): points and lines with a height."""

from __future__ import annotations

import struct

import numpy as np

from calibration.foundation.arrays import Floats

POINT_Z, LINE_Z = 1001, 1002


def well_known_points(place: Floats) -> list[bytes | None]:
    """Points (n, 3) of longitude, latitude, height; None where one is not finite."""
    packed = np.zeros(len(place), dtype=[("order", "u1"), ("kind", "<u4"), ("xyz", "<f8", 3)])
    packed["order"], packed["kind"], packed["xyz"] = 1, POINT_Z, place
    known: list[bool] = np.asarray(np.isfinite(place).all(axis=1)).tolist()
    return [row.tobytes() if good else None for row, good in zip(packed, known, strict=True)]


def well_known_line(place: Floats) -> bytes:
    """A line through places (n, 3) of longitude, latitude, height."""
    return struct.pack("<BII", 1, LINE_Z, len(place)) + np.asarray(place, "<f8").tobytes()
