"""The findings of the judgement in the field's words, with the human causes that are likely."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.geometry import rotation
from pipeline.solver.judgement.changes import Change
from pipeline.solver.judgement.misfit import Misfit
from pipeline.solver.judgement.pose_sequences import Sequence
from pipeline.solver.judgement.prior_tests import HeightTest

PARAMETERS = "attitude", "position", "focal", "offset", "frame-rate", "start", "readout", "place"
UPRIGHT = 0.9
"""Share of a shift that is vertical from which on a height datum is the likely cause."""


FRD_FROM_CAM = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Forward is the optical axis, right the image's right, down its down."""
SAME_RAD = math.radians(4.0)
"""How near the angles of a mount must come to what was given in another unit or with another sign to be called that."""


@dataclass(frozen=True, kw_only=True)
class Told:
    """Words and advice."""

    words: str
    advice: str


STEP = (
    "likely: the receiver changed its kind of fix (RTK lost), the estimator was reset, the gimbal was moved, or frames "
    "are missing. Look at the log there, cut the flight there, or raise sigma.position_m or sigma.attitude_deg"
)
ADVICE = {
    "attitude": "likely: a mount that is forgotten, in other units (radians), with another sign or beside the gimbal's "
    "own angles; attitudes in another convention; a calibration of another resolution or crop; another start or frame "
    "rate. If none of these, raise sigma.attitude_bias_deg to what the instrument is worth",
    "position": "likely: an origin of its own, feet for metres, east and north exchanged, a lever arm, the log of "
    "another vehicle. If none of these, raise sigma.position_bias_m to what the receiver is worth",
    "height": "likely: heights above different datums (mean sea level, ellipsoid, take-off), or feet for metres. If "
    "not, raise sigma.position_bias_m to what the receiver is worth",
    "focal": "likely: a calibration of another resolution, zoom, crop or stabilisation. Calibrate in the mode that "
    "flew, or raise sigma.focal",
    "offset": "likely: clocks that are not both UTC, or a start of the wrong video. Leave offset_s out to have it "
    "searched for, or raise sigma.offset_s",
    "frame-rate": "likely: a frame_rate that is not the video's (the container's is the default), or frames that the "
    "recorder left out. Leave frame_rate out, or raise sigma.frame_rate",
    "start": "likely: a start on another clock than the log's, or of another video. Check start, or raise "
    "sigma.start_s",
    "readout": "likely: the readout of another video mode. Take the data sheet's, or raise sigma.readout_s",
    "place": "likely: boxes around different parts of the target in different cameras. Draw them alike, or raise "
    "sigma.place",
    "motion": 'leave motion and order out (motion = "auto" lets the data say), or give a higher order',
    "exchange": "exchange their names in that camera's boxes or tracks and solve again",
    "target": "look at its tracks in every camera: another thing under the same name, a box drawn in the wrong video, "
    "a tracker that slid away; leave it out or draw its boxes again",
    "track": "look at that track: another thing under the same name, or a tracker that slid away; draw its box again "
    "or leave it out in that camera",
    "part": "the tracker has slid onto something else there: look at the overlay, track again from a new box, or end "
    "the track before",
    "step": STEP,
    "time-lost": "likely: frames that the recorder or a cut left out without a time. Give the tracks' times (time_s), "
    "or cut the flight there",
    "converted": "check how that camera's poses, mount and picture are meant: see the conventions",
    "camera": "look at that camera's calibration, mount, start, log and names of targets",
}


def correction_words(camera: str, what: str, correction: Floats, sigma: Floats, rate_hz: float) -> Told:
    """How far a block of parameters is from what its prior says; `correction` and `sigma` in the adjustment's units."""
    size, one = float(np.linalg.norm(correction)), float(np.sqrt((sigma**2).mean()))
    prior = f"its prior says {{}} (one sigma){'' if one else ', it is held'}"
    if what == "attitude":
        words = f"{camera} is turned by {number(math.degrees(size))} degrees from what its log and mount say; "
        return Told(words=words + prior.format(number(math.degrees(one))), advice=ADVICE["attitude"])
    if what == "position":
        upright = size > 0 and abs(correction[2]) > UPRIGHT * size
        way = f"({correction[0]:+.2f} east, {correction[1]:+.2f} north, {correction[2]:+.2f} up)"
        words = f"{camera} is {number(size)} m {way} from where its log says; " + prior.format(f"{number(one)} m")
        return Told(words=words, advice=ADVICE["height" if upright else "position"])
    if what == "focal":
        percent = 100 * math.expm1(float(correction[0]))
        words = f"the focal length of {camera} is {percent:+.2g} % from its calibration's; "
        return Told(words=words + prior.format(f"{number(100 * one)} %"), advice=ADVICE["focal"])
    if what == "frame-rate":
        now = rate_hz / (1 + float(correction[0]))
        words = f"{camera} ran at {now:.5g} frames a second, not at {rate_hz:.5g}; "
        return Told(words=words + prior.format(f"{number(100 * one)} %"), advice=ADVICE["frame-rate"])
    if what == "readout":
        words = f"the readout of {camera} is {1e3 * float(correction[0]):+.2g} ms from what was given; "
        return Told(words=words + prior.format(f"{number(1e3 * one)} ms"), advice=ADVICE["readout"])
    if what in ("offset", "start"):
        name = "time offset" if what == "offset" else "start in the log"
        words = f"the {name} of {camera} is {float(correction[0]):+.3g} s from what was given; "
        return Told(words=words + prior.format(f"{number(one)} s"), advice=ADVICE[what])
    words = f"{camera} sees a target at another point than the others do, by {number(size)} px; "
    return Told(words=words + prior.format(f"{number(one)} px"), advice=ADVICE["place"])


def readout_words(camera: str, given_s: float, found_s: float, sigma_s: float, moves: float) -> Told:
    """A readout that is not what was given."""
    was = "none was given" if given_s == 0 else f"{1e3 * given_s:.1f} ms was given"
    words = (
        f"the rows of {camera} are exposed one after the other: its sightings fit a readout of {1e3 * found_s:.1f} ms "
        f"(sigma {1e3 * sigma_s:.1f} ms), and {was}; with it a target would move by {number(moves)} of its sigmas"
    )
    return Told(
        words=words,
        advice=f"write readout_s = {found_s:.4f} for {camera}, the data sheet's if you have it, with "
        f"sigma.readout_s = {max(3 * sigma_s, 0.002):.3f} to refine it",
    )


def readouts_words(found_s: Mapping[str, float]) -> Told:
    """Readouts by camera that would restore a fit."""
    each = ", ".join(f"{1e3 * value:.1f} ms of {camera}" for camera, value in found_s.items())
    return Told(
        words=f"the pictures fit as if their rows were exposed one after the other, with readouts of {each}",
        advice="write readout_s for each camera (from its data sheet), or sigma.readout_s = 0.02 to refine it",
    )


def mount_words(given_ypr_rad: tuple[float, float, float], turn_rad: Floats) -> str:
    """The mount that the pictures fit, and what it looks like; `turn_rad` is the camera's attitude correction."""
    yaw, pitch, roll = (np.array(angle) for angle in given_ypr_rad)
    given = rotation.matrix(rotation.ned_from_frd(yaw, pitch, roll))
    turn = FRD_FROM_CAM @ rotation.matrix(rotation.exp(-turn_rad)) @ FRD_FROM_CAM.T
    fits = rotation.yaw_pitch_roll(rotation.from_matrix(given @ turn))
    deg = np.degrees(fits)
    words = f"the pictures fit mount = {{ roll_deg = {deg[2]:.1f}, pitch_deg = {deg[1]:.1f}, yaw_deg = {deg[0]:.1f} }}"
    was = np.array(given_ypr_rad)
    if not was.any():
        return f"{words}, and none was given"
    if np.abs(np.degrees(was) - fits).max() < SAME_RAD:
        return f"{words}: what was given, taken for radians"
    if np.abs(was[1] + fits[1]) < SAME_RAD < abs(was[1]):
        return f"{words}: the given pitch with the other sign"
    return words


def change_words(change: Change) -> Told:
    """A change other than a block set free."""
    names = " and ".join(change.targets)
    if change.kind == "converted":
        return Told(words=f"{change.camera} fits as if {change.what}", advice=ADVICE["converted"])
    if change.kind == "step":
        if change.what == "offset":
            words = f"{change.camera} loses time at about frame {change.since_frame}"
            return Told(words=words, advice=ADVICE["time-lost"])
        words = f"the {change.what} of {change.camera} jumps at about frame {change.since_frame}"
        return Told(words=words, advice=ADVICE["step"])
    if change.kind == "motion":
        return Told(words=f"the motion of {names} is richer than the order that was given", advice=ADVICE["motion"])
    if change.kind == "exchange":
        since = "" if change.since_frame is None else f" from about frame {change.since_frame} on"
        return Told(words=f"{names} look exchanged in {change.camera}{since}", advice=ADVICE["exchange"])
    if change.kind == "without-target":
        return Told(words=f"{names} contradicts everything else", advice=ADVICE["target"])
    if change.kind == "without-track":
        return Told(
            words=f"the track of {names} in {change.camera} contradicts everything else", advice=ADVICE["track"]
        )
    if change.kind == "without-camera":
        return Told(words=f"{change.camera} contradicts the other cameras", advice=ADVICE["camera"])
    when = (
        f"from about frame {change.since_frame} on"
        if change.until_frame is None
        else f"before frame {change.until_frame}"
    )
    words = f"the track of {names} in {change.camera} contradicts everything else {when}"
    return Told(words=words, advice=ADVICE["part"])


def sequence_words(one: Sequence) -> Told:
    """What a camera's pose errors do over time."""
    size, unit = float(np.linalg.norm(one.size)), "m"
    if one.part == "attitude":
        size, unit = math.degrees(size), "degrees"
    if one.kind == "step":
        return Told(
            words=f"the poses of {one.camera} jump at frame {one.frame} ({one.time_s:.1f} s of video), by about "
            f"{number(size)} {unit} of {one.part}",
            advice=STEP,
        )
    if one.kind == "drift":
        return Told(
            words=f"the poses of {one.camera} drift by about {number(size)} {unit} of {one.part} over the flight",
            advice="likely: a drifting heading or receiver, or another frame rate or start. Say how the errors move: "
            "sigma.attitude_deg with attitude_tau_s, sigma.position_m with position_tau_s",
        )
    return Told(
        words=f"the pose errors of {one.camera} are alike from frame to frame (correlation {one.correlation:.2f}), not "
        "new in every frame as claimed: the sigmas of positions are too small",
        advice="say how the errors move: sigma.attitude_tau_s and sigma.position_tau_s, with their sigmas",
    )


def height_words(one: HeightTest) -> Told:
    """A camera's height against the others'."""
    way = "higher" if one.difference_m > 0 else "lower"
    others = " and ".join(one.others)
    return Told(
        words=f"the heights of {one.camera} and {others} contradict each other: the pictures put {one.camera} "
        f"{number(abs(one.difference_m))} m {way} against {others} than their logs say; their priors allow "
        f"{number(one.sigma_m)} m (one sigma)",
        advice="likely: heights of two datums (ellipsoid, sea level, take-off) or one barometer's drift; `runningfix "
        "inspect` tells what each log's heights count from",
    )


def misfit_words(one: Misfit) -> Told:
    """Residuals larger than their sigmas promise."""
    factor = number(math.sqrt(one.factor))
    names = {"camera": one.camera, "target": one.target, "track": f"{one.target} in {one.camera}"}
    of = f"the residuals of {names[one.scope]}" if one.scope in names else "residuals"
    since = "" if one.since_frame is None else f", above all from frame {one.since_frame} on"
    return Told(
        words=f"{of} are {factor} times as large as their sigmas promise{since}",
        advice="look at the tracks and at the residuals in the report; if they are only noisy, raise sigma.pixel",
    )


def number(value: float) -> str:
    """Three significant digits, never in powers of ten for what people measure."""
    if not math.isfinite(value):
        return "unknown"
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
