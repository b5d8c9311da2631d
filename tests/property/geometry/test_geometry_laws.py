"""Laws that rotations and places obey, also where angles vanish or turn right round."""

from __future__ import annotations

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pipeline.geometry import rotation
from pipeline.geometry.geodesy import Geodetic, enu_from_geodetic, geodetic_from_enu

FINITE = st.floats(-1, 1)
VECTORS = arrays(float, 3, elements=FINITE)
ANGLES = st.floats(-179.99, 179.99)


@st.composite
def quaternions(draw):
    q = draw(arrays(float, 4, elements=FINITE))
    assume(np.linalg.norm(q) > 0.1)
    return rotation.normalised(q)


def same(a, b, atol=1e-12):
    np.testing.assert_allclose(rotation.matrix(a), rotation.matrix(b), atol=atol)


@given(quaternions(), quaternions(), quaternions())
def test_rotations_are_a_group(a, b, c):
    same(rotation.multiply(rotation.multiply(a, b), c), rotation.multiply(a, rotation.multiply(b, c)))
    same(rotation.multiply(a, rotation.conjugate(a)), np.array([1.0, 0, 0, 0]))


@given(VECTORS, st.floats(0, 1).map(lambda x: 10.0 ** (-16 * x)))
def test_log_undoes_exp_down_to_nothing(v, size):
    np.testing.assert_allclose(rotation.log(rotation.exp(v * size * 1.8)), v * size * 1.8, atol=1e-14, rtol=1e-9)


@given(quaternions(), quaternions(), st.floats(0, 1))
def test_slerp_goes_the_short_way_at_constant_rate(a, b, share):
    between = rotation.slerp(a, b, np.array(share))
    whole = np.linalg.norm(rotation.log(rotation.multiply(b, rotation.conjugate(a))))
    part = np.linalg.norm(rotation.log(rotation.multiply(between, rotation.conjugate(a))))
    assume(whole < np.pi - 1e-6)
    assert abs(part - share * whole) < 1e-7
    same(rotation.slerp(a, -b, np.array(share)), between, atol=1e-9)


@given(ANGLES, st.floats(-89.9, 89.9), ANGLES)
def test_angles_survive(yaw, pitch, roll):
    angles = np.radians([yaw, pitch, roll])
    np.testing.assert_allclose(rotation.yaw_pitch_roll(rotation.ned_from_frd(*angles)), angles, atol=1e-9)


@given(st.floats(-90, 90), st.floats(-180, 180), VECTORS)
def test_places_survive_anywhere_on_earth(lat, lon, v):
    home = Geodetic.from_degrees(lat, lon, 50.0)
    enu = v * 20_000
    np.testing.assert_allclose(enu_from_geodetic(*geodetic_from_enu(enu, home), home), enu, atol=1e-6)
