"""From local ENU to cells of a raster, as polynomials in east and north: smooth, and asked for often."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats

ORDER, NODES = 4, 15
"""Order of the polynomials, and nodes a side on which they are fitted: good to a thousandth of a cell over 10 km."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Smooth:
    """k smooth functions of east and north around `centre_m`, over `half_m`: `coefficients` (ORDER + 1, ORDER + 1, k).

    Chebyshev polynomials of (place - centre) / half.
    """

    centre_m: Floats
    half_m: float
    coefficients: Floats

    def at(self, place_m: Floats) -> tuple[Floats, Floats]:
        """Values (n, k) and derivatives (n, 2, k) by east and north."""
        u = (place_m - self.centre_m) / self.half_m
        power = [np.polynomial.chebyshev.chebvander(u[:, i], ORDER) for i in range(2)]
        slope = [
            np.polynomial.chebyshev.chebvander(u[:, i], ORDER - 1)
            @ np.polynomial.chebyshev.chebder(np.eye(ORDER + 1)) / self.half_m
            for i in range(2)
        ]  # fmt: skip
        value = np.einsum("ni,nj,ijk->nk", power[0], power[1], self.coefficients, optimize=True)
        by_east = np.einsum("ni,nj,ijk->nk", slope[0], power[1], self.coefficients, optimize=True)
        by_north = np.einsum("ni,nj,ijk->nk", power[0], slope[1], self.coefficients, optimize=True)
        return value, np.stack([by_east, by_north], axis=1)


def fitted(function: Callable[[Floats], Floats], centre_m: Floats, half_m: float) -> tuple[Smooth, Floats]:
    """`function` of places (n, 2) -> (n, k) as a `Smooth`, and by how much it misses (k,) at worst."""
    node = np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)
    u = np.stack(np.meshgrid(node, node, indexing="ij"), axis=-1).reshape(-1, 2)
    value = function(centre_m + half_m * u)
    design = (
        np.polynomial.chebyshev.chebvander(u[:, 0], ORDER)[:, :, None]
        * np.polynomial.chebyshev.chebvander(u[:, 1], ORDER)[:, None, :]
    ).reshape(len(u), -1)
    found = np.linalg.lstsq(design, value, rcond=None)[0]
    missed = np.abs(design @ found - value).max(axis=0)
    shape = (ORDER + 1, ORDER + 1, value.shape[1])
    return Smooth(centre_m=centre_m, half_m=half_m, coefficients=found.reshape(shape)), np.asarray(missed)
