"""Ours: every method over the Cramer-Rao bound, and what each prior is worth."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from pipeline.experiments.declare import Approach, Cell, Experiment, Grid
from pipeline.experiments.paper import noise_levels
from pipeline.experiments.paper.approaches import ALGORITHM_1, ALGORITHM_2, LI, MAP, MULTI_TI
from pipeline.experiments.paper.rotations import ROTATION_EARLIER
from pipeline.experiments.paper.scenes import PAPER_ARCS, paper_flight
from pipeline.synthetic.simulate import Noise

NOTHING_KNOWN = 100.0
ANGLE_UNKNOWN = 10.0
"""Times the true sigma: 5 degrees, as far as a linear prior makes sense."""


def bound() -> Experiment:
    """Every method over the bound."""
    cells = tuple(
        Cell(
            values={"targets": count, "order": order, "noise": name},
            scene=partial(paper_flight, order=order, targets=count, earlier_frames=ROTATION_EARLIER),
            noise=noise,
        )
        for count in (1, 4)
        for order in (1, 2)
        for name, noise in (("high", noise_levels.HIGH), ("low", noise_levels.LOW))
    )
    return Experiment(
        name="bound",
        title="Every method over the Cramer-Rao bound",
        paper="",
        about="Root mean square error over the least that any method can have on average under this noise: the inverse "
        "of the Fisher information of sightings and priors at the truth. One is perfect.",
        geometry=PAPER_ARCS.words() + "; offset 5 frames",
        cells=cells,
        approaches=(MULTI_TI, LI, ALGORITHM_1, ALGORITHM_2, MAP),
        drawings=(
            Grid(caption="Root mean square error over the bound", measure="over_bound"),
            Grid(caption="Mean error, m", measure="error_m"),
            Grid(caption="Normalised squared error of the motion (1: the claimed covariance is true)", measure="nees"),
        ),
        remarks=(noise_levels.ABOUT, noise_levels.ABOUT_LOW),
    )


def _no_attitude_bias(noise: Noise) -> Noise:
    return replace(noise, attitude_bias_rad=noise.attitude_bias_rad * ANGLE_UNKNOWN)


def _no_position_bias(noise: Noise) -> Noise:
    return replace(noise, position_bias_m=noise.position_bias_m * NOTHING_KNOWN)


def _no_attitude(noise: Noise) -> Noise:
    return replace(noise, attitude_rad=noise.attitude_rad * ANGLE_UNKNOWN)


def _no_position(noise: Noise) -> Noise:
    return replace(noise, position_m=noise.position_m * NOTHING_KNOWN)


def _no_offset(noise: Noise) -> Noise:
    return replace(noise, offset_s=None)


def _no_rate(noise: Noise) -> Noise:
    return replace(noise, frame_rate_prior=NOTHING_KNOWN)


def _exact_poses(noise: Noise) -> Noise:
    return replace(noise, attitude_bias_rad=0.0, attitude_rad=0.0, position_bias_m=0.0, position_m=0.0)


def _unbiased_poses(noise: Noise) -> Noise:
    return replace(noise, attitude_bias_rad=0.0, position_bias_m=0.0)


def priors() -> Experiment:
    """With and without each prior."""
    variants = (
        ("map, attitude bias unknown", _no_attitude_bias),
        ("map, position bias unknown", _no_position_bias),
        ("map, frames' attitude unknown", _no_attitude),
        ("map, frames' position unknown", _no_position),
        ("map, offset unknown", _no_offset),
        ("map, frame rate unknown", _no_rate),
        ("map, poses taken as unbiased", _unbiased_poses),
        ("map, poses taken as exact", _exact_poses),
    )
    noise = replace(noise_levels.HIGH, offset_s=0.05, frame_rate=0.01, frame_rate_prior=0.01)
    cells = tuple(
        Cell(
            values={"targets": count, "order": order},
            scene=partial(paper_flight, order=order, targets=count, earlier_frames=ROTATION_EARLIER),
            noise=noise,
        )
        for count in (1, 4)
        for order in (1, 2)
    )
    return Experiment(
        name="priors",
        title="What each prior is worth",
        paper="",
        about="`map` knows what the instruments are worth. Here one piece of that knowledge at a time is taken away "
        "(unknown: a sigma ten times too wide for angles, a hundred times "
        "for the rest), or the errors are denied (taken as exact), as the paper's "
        "methods do with biases. The offset is given with 0.05 s, the frame rate with 1 %.",
        geometry=PAPER_ARCS.words() + "; offset 5 frames",
        cells=cells,
        approaches=(
            MAP,
            *(Approach(name=name, settings=MAP.settings, ours=True, told=told) for name, told in variants),
        ),
        drawings=(
            Grid(caption="Mean error, m", measure="error_m"),
            Grid(caption="Normalised squared error of the motion", measure="nees"),
        ),
        remarks=(noise_levels.ABOUT,),
    )
