"""How two rays meet: by how much they miss each other, and how high that place is.

With centres C_a, C_b, unit directions d_a, d_b and w = C_b - C_a:

    miss    r = w . (d_a x d_b) / |d_a x d_b|            metres, signed
    depths  s_a = (w.d_a - c w.d_b) / (1 - c^2),  s_b = (c w.d_a - w.d_b) / (1 - c^2),   c = d_a.d_b
    height  of the middle between C_a + s_a d_a and C_b + s_b d_b

with one sigma each from the directions' (rad) and centres' (m), first order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Bools, Floats

PARALLEL = 0.03
"""Sine of the angle between two rays under which their miss has no direction and their depth none either."""
NEAREST_M, FARTHEST_M = 2.0, 20_000.0
"""Depths at which noise is reckoned."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Meeting:
    """Two sets of rays (..., n): where they meet (..., n, 3), miss and height with sigmas, depths (metres).

    behind  (..., n) true where they meet behind a camera, by more than noise
    """

    place_m: Floats
    miss_m: Floats
    miss_sigma_m: Floats
    height_sigma_m: Floats
    depth_a_m: Floats
    depth_b_m: Floats
    behind: Bools

    @property
    def height_m(self) -> Floats:
        """(..., n) of the place."""
        return self.place_m[..., 2]


def meet(
    centre_a: Floats, ray_a: Floats, centre_b: Floats, ray_b: Floats, turn_a: Floats, turn_b: Floats, shift_m: float
) -> Meeting:
    """Rays of two cameras, (..., 3) and broadcast against each other; `turn` (...) rad and `shift_m` are one sigma."""
    w = centre_b - centre_a
    c = np.sum(ray_a * ray_b, axis=-1)
    wa, wb = np.sum(w * ray_a, axis=-1), np.sum(w * ray_b, axis=-1)
    normal = np.cross(ray_a, ray_b)
    sine = np.maximum(np.sqrt(np.maximum(1 - c * c, 0)), 1e-6)
    depth_a, depth_b = (wa - c * wb) / sine**2, (c * wa - wb) / sine**2
    far_a, far_b = (np.clip(np.abs(s), NEAREST_M, FARTHEST_M) for s in (depth_a, depth_b))
    across_a, across_b = far_a * turn_a, far_b * turn_b
    across = np.sqrt(across_a**2 + across_b**2 + shift_m**2)
    along = across / sine
    up_a, up_b = ray_a[..., 2], ray_b[..., 2]
    steep = np.sqrt(0.5 * (up_a**2 + up_b**2))
    place = 0.5 * (centre_a + depth_a[..., None] * ray_a + centre_b + depth_b[..., None] * ray_b)
    return Meeting(
        place_m=place,
        miss_m=np.sum(w * normal, axis=-1) / sine,
        miss_sigma_m=across * np.maximum(1.0, PARALLEL / sine),
        height_sigma_m=np.hypot(steep * along, across),
        depth_a_m=depth_a,
        depth_b_m=depth_b,
        behind=np.asarray(np.minimum(depth_a, depth_b) < -3 * along),
    )
