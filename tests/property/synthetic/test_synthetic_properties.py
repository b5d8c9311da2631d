"""What holds for any scene: paths, hiding, boxes, the sense of rotation errors."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.geometry import rotation
from pipeline.synthetic.flight import _whole_side
from pipeline.synthetic.scene import Bridge, look_at, polynomial_motion
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import Noise, disturbed, simulate

small = st.floats(-20, 20)


@given(rows=st.lists(st.tuples(small, small, small), min_size=1, max_size=6), at=st.floats(-3, 12))
def test_a_polynomial_is_the_sum_of_its_powers(rows, at):
    powers = np.array(rows)
    motion = polynomial_motion("x", powers, (-3.0, 12.0))
    want = at ** np.arange(len(powers)) @ powers
    size = 1 + np.abs(powers).sum() * max(1.0, 12.0 ** (len(powers) - 1))
    assert np.abs(motion.position_enu_m(np.array([at]))[0] - want).max() < 1e-9 * size


@given(turn=st.floats(0, 6.28), along=st.floats(-40, 40), across=st.floats(-20, 20))
def test_a_bridge_hides_exactly_its_outline_from_straight_above(turn, along, across):
    bridge = Bridge(centre_enu_m=(5.0, -3.0, 6.0), heading_rad=turn, length_m=30.0, width_m=10.0)
    way, side = np.array([np.sin(turn), np.cos(turn)]), np.array([np.cos(turn), -np.sin(turn)])
    flat = np.array([5.0, -3.0]) + along * way + across * side
    hidden = bridge.hides(np.array([[*flat, 300.0]]), np.array([[*flat, 1.0]]))[0]
    if abs(abs(along) - 15) > 1e-6 and abs(abs(across) - 5) > 1e-6:
        assert hidden == (abs(along) < 15 and abs(across) < 5)


@given(centre=st.floats(0, 2000), reach=st.floats(2, 60))
def test_a_whole_side_is_centred_to_a_quarter_pixel_and_covers(centre, reach):
    low, length = _whole_side(centre, reach)
    assert abs(low + length / 2 - 0.5 - centre) <= 0.25 + 1e-9
    assert low - 0.5 <= centre - reach
    assert low + length - 0.5 >= centre + reach


@given(place=st.tuples(small, small, st.floats(1, 50)), goal=st.tuples(small, small, st.floats(-5, 0)))
def test_looking_at_a_point_puts_it_on_the_optical_axis(place, goal):
    yaw, pitch = look_at(np.array([place]), np.array(goal))
    enu_from_cam = rotation.enu_from_cam(rotation.ned_from_frd(yaw, pitch, np.zeros(1)))
    sight = rotation.rotate(rotation.conjugate(enu_from_cam), np.array([goal]) - np.array([place]))[0]
    assert np.abs(sight[:2]).max() < 1e-9 * np.linalg.norm(sight) + 1e-9
    assert sight[2] > 0


@given(turn=st.tuples(*[st.floats(-0.3, 0.3)] * 3), axis=st.tuples(*[st.floats(-1, 1)] * 3))
def test_true_is_the_turn_times_the_measured(turn, axis):
    true = rotation.exp(np.array(axis))
    measured = disturbed(true, np.array(turn))
    back = rotation.multiply(rotation.exp(np.array(turn)), rotation.conjugate(measured))
    assert abs(abs((back * rotation.conjugate(true)).sum()) - 1) < 1e-12


@settings(max_examples=15, deadline=None)
@given(offset=st.floats(0, 10), order=st.integers(0, 3), targets=st.integers(1, 8), seed=st.integers(0, 1000))
def test_every_drawn_problem_is_whole(offset, order, targets, seed):
    scene = paper_scene(order=order, targets=targets, offset_frames=offset)
    problem, truth = simulate(scene, noise=Noise(pixel_px=1.0, attitude_rad=0.01), seed=seed)
    assert truth.offset_s["uav2"] == offset / 10
    for camera in problem.cameras:
        assert np.isin(camera.rays.frame, camera.poses.frame).all()
        assert np.isfinite(camera.rays.direction_cam).all()
        assert np.abs(np.linalg.norm(camera.rays.direction_cam, axis=1) - 1).max() < 1e-9
        assert len(camera.rays.frame) > 40 * targets
