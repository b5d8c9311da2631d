"""The calibration's covariance is the solver's prior of the focal length."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.camera import CameraModel
from pipeline.records import InstrumentSigma, SightRays
from pipeline.stages.problem.priors import offset_sigma, place_sigma_px, with_focal

K = np.array([[1000.0, 0, 640], [0, 1010.0, 360], [0, 0, 1]])
RAYS = SightRays(
    camera="c", targets=("t",), target=np.zeros(1, int), frame=np.zeros(1, int), time_s=np.zeros(1),
    direction_cam=np.array([[0.0, 0, 1]]), pixel_from_ray=np.array([[[1000.0, 0, 0], [0, 1010, 0]]]),
    sigma_px=np.ones(1),
)  # fmt: skip


def model(sigma_px):
    covariance = np.zeros((4, 4))
    covariance[:2, :2] = np.outer([sigma_px, sigma_px * 1.01], [sigma_px, sigma_px * 1.01])
    return CameraModel(image_size=(1280, 720), K=K, distortion=np.zeros(0), covariance=covariance)


def test_an_uncertain_focal_length_is_refined_with_its_own_sigma():
    assert with_focal(InstrumentSigma(), {}, model(5.0), RAYS).focal == pytest.approx(0.005)


def test_what_the_flight_file_says_goes_first_and_a_certain_one_is_held():
    assert with_focal(InstrumentSigma(focal=0.02), {"focal": 0.02}, model(5.0), RAYS).focal == 0.02
    assert with_focal(InstrumentSigma(), {}, model(0.1), RAYS).focal == 0.0
    assert with_focal(InstrumentSigma(), {}, model(0.1), replace(RAYS, sigma_px=np.full(1, 0.1))).focal > 0
    unknown = CameraModel(image_size=(1280, 720), K=K, distortion=np.zeros(0))
    assert with_focal(InstrumentSigma(), {}, unknown, RAYS).focal == 0.0


def test_a_tracked_point_is_off_by_what_the_flight_file_says():
    flight = SimpleNamespace(boxes=lambda _: {"t": SimpleNamespace(width=30, height=30)})
    for sigma, wanted in (({}, np.hypot(0.25, 0.3)), ({"place_px": 0.0}, 0.0), ({"place_px": 2.0}, 2.0)):
        camera = SimpleNamespace(name="c", tracks=None, sigma=sigma)
        assert place_sigma_px(flight, camera) == pytest.approx((wanted, wanted))
    assert place_sigma_px(flight, SimpleNamespace(name="c", tracks="x.csv", sigma={})) == (0.0, 0.0)


def test_the_offset_of_two_utc_times_is_worth_what_both_are_worth_together():
    """Independent errors: 3 s and 4 s make 5 s, not 7 s; what the flight file says goes before."""
    camera = SimpleNamespace(sigma={})
    one, other = (SimpleNamespace(sigma=InstrumentSigma(offset_s=1.0), utc_sigma_s=s) for s in (3.0, 4.0))
    assert offset_sigma(camera, one, other).offset_s == pytest.approx(5.0)
    assert offset_sigma(SimpleNamespace(sigma={"offset_s": 1.0}), one, other).offset_s == 1.0
    unknown = SimpleNamespace(sigma=InstrumentSigma(offset_s=1.0), utc_sigma_s=None)
    assert offset_sigma(camera, one, unknown).offset_s == 1.0
