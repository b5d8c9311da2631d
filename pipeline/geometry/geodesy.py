"""WGS84: geodetic coordinates, earth-centred earth-fixed (ECEF) and local ENU.

Closed formulas of Snyder and Bowring; the tests hold them against PROJ and GeographicLib. Latitude and longitude in
radians, heights in metres above the ellipsoid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats

SEMI_MAJOR_M = 6378137.0
FLATTENING = 1 / 298.257223563
E2 = FLATTENING * (2 - FLATTENING)


@dataclass(frozen=True, kw_only=True)
class Geodetic:
    """A place: `lat_rad`, `lon_rad`, `height_m` above the ellipsoid."""

    lat_rad: float
    lon_rad: float
    height_m: float

    @staticmethod
    def from_degrees(lat_deg: float, lon_deg: float, height_m: float) -> Geodetic:
        """The same from degrees, as files say it."""
        return Geodetic(lat_rad=float(np.radians(lat_deg)), lon_rad=float(np.radians(lon_deg)), height_m=height_m)


def ecef_from_geodetic(lat_rad: Floats, lon_rad: Floats, height_m: Floats) -> Floats:
    """ECEF metres (..., 3)."""
    lat, lon, h = (np.asarray(a, float) for a in (lat_rad, lon_rad, height_m))
    normal = SEMI_MAJOR_M / np.sqrt(1 - E2 * np.sin(lat) ** 2)
    flat = (normal + h) * np.cos(lat)
    return np.stack([flat * np.cos(lon), flat * np.sin(lon), (normal * (1 - E2) + h) * np.sin(lat)], axis=-1)


def geodetic_from_ecef(ecef_m: Floats) -> Floats:
    """Latitude, longitude, height (..., 3); Bowring's start and Newton-like steps, well below 1e-9 m near the earth."""
    x, y, z = np.moveaxis(np.asarray(ecef_m, float), -1, 0)
    flat = np.hypot(x, y)
    b = SEMI_MAJOR_M * (1 - FLATTENING)
    beta = np.arctan2(SEMI_MAJOR_M * z, b * flat)
    for _ in range(4):
        lat = np.arctan2(z + E2 / (1 - E2) * b * np.sin(beta) ** 3, flat - E2 * SEMI_MAJOR_M * np.cos(beta) ** 3)
        beta = np.arctan2((1 - FLATTENING) * np.sin(lat), np.cos(lat))
    normal = SEMI_MAJOR_M / np.sqrt(1 - E2 * np.sin(lat) ** 2)
    height = flat * np.cos(lat) + z * np.sin(lat) - SEMI_MAJOR_M**2 / normal
    return np.stack([lat, np.arctan2(y, x), height], axis=-1)


def enu_from_ecef_matrix(origin: Geodetic) -> Floats:
    """Rotation (3, 3) of ECEF axes into ENU axes at `origin`."""
    sa, ca, so, co = np.sin(origin.lat_rad), np.cos(origin.lat_rad), np.sin(origin.lon_rad), np.cos(origin.lon_rad)
    return np.array([[-so, co, 0.0], [-sa * co, -sa * so, ca], [ca * co, ca * so, sa]])


def _origin_ecef(origin: Geodetic) -> Floats:
    return ecef_from_geodetic(np.array(origin.lat_rad), np.array(origin.lon_rad), np.array(origin.height_m))


def enu_from_geodetic(lat_rad: Floats, lon_rad: Floats, height_m: Floats, origin: Geodetic) -> Floats:
    """Local ENU metres (..., 3) of places."""
    offset = ecef_from_geodetic(lat_rad, lon_rad, height_m) - _origin_ecef(origin)
    return np.asarray(offset @ enu_from_ecef_matrix(origin).T)


def geodetic_from_enu(enu_m: Floats, origin: Geodetic) -> Floats:
    """Latitude, longitude, height (..., 3) of local ENU metres (..., 3)."""
    return geodetic_from_ecef(np.asarray(enu_m, float) @ enu_from_ecef_matrix(origin) + _origin_ecef(origin))


def enu_axes_turn(place: Geodetic, origin: Geodetic) -> Floats:
    """Rotation (3, 3) of ENU axes at `place` into ENU axes at `origin`: attitudes are given where the vehicle is.

    The earth's curvature turns the vertical by 0.009 degrees per kilometre.
    """
    return np.asarray(enu_from_ecef_matrix(origin) @ enu_from_ecef_matrix(place).T)


def enu_axes_turn_many(places: Floats, origin: Geodetic) -> Floats:
    """Rotations (n, 3, 3) of ENU axes at places (n, 3) (latitude, longitude, height) into ENU axes at `origin`."""
    lat, lon = np.asarray(places, float)[:, :2].T
    sa, ca, so, co = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    rows = np.array([[-so, co, np.zeros_like(so)], [-sa * co, -sa * so, ca], [ca * co, ca * so, sa]])
    return np.asarray(enu_from_ecef_matrix(origin) @ np.moveaxis(rows, (0, 1), (2, 1)))
