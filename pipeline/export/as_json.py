"""solution.json: everything that was found, with its covariance, and what could not be known.

Angles in degrees, everything else SI; covariances in the squares of the units beside them. null: not determined.
Nothing of the run itself (no clock time, no duration) is in it, so the same flight gives the same bytes.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.export.text.cells import utc_texts
from pipeline.geometry.splines import spline
from pipeline.records import (
    Bias,
    Clock,
    Correction,
    DepthRange,
    Landmark,
    Motion,
    Redundancy,
    Results,
    Solution,
    Verdict,
)

FORMAT = 1
"""Of solution.json; grows when a reader of the old one would be misled."""


def solution_json(results: Results) -> str:
    """The solution as JSON text, numbers exact (covariances to 9 digits), arrays of numbers on one line each."""
    return dumps(_document(results)) + "\n"


def dumps(value: Any) -> str:
    """JSON text of plain values, arrays and records' mappings; NaN and infinities become null.

    Raises TypeError for anything that has no plain form: a programmer's mistake.
    """
    return _laid_out(plain(value), "")


def plain(value: Any) -> Any:
    """`value` in JSON's own types."""
    if isinstance(value, np.ndarray | np.generic):
        listed = value.tolist()
        return listed if value.dtype.kind == "f" and np.isfinite(value).all() else plain(listed)
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, str | bool | int) or value is None:
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, PurePath):
        return value.as_posix()
    if isinstance(value, Sequence):
        return [plain(item) for item in value]
    raise TypeError(f"{type(value).__name__} has no plain form in a file")


def correlation(covariance: Floats) -> Floats:
    """Correlations (n, n) of a covariance; NaN beside a variance of zero."""
    sigma = np.sqrt(np.diag(covariance))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(covariance / np.outer(sigma, sigma))


def polynomial(motion: Motion) -> dict[str, Any]:
    """The paper's coefficients a_k, b_k, c_k (eq. 10) about the middle of the motion, with their covariance.

    covariance is (3 (K + 1),) squared, ordered a_0, b_0, c_0, a_1, ...; None where it was not determined.
    """
    epoch = 0.5 * (motion.start_s + motion.end_s)
    k = motion.degree
    return {
        "epoch_s": epoch,
        "meaning": "position_enu_m = sum of row k times (t - epoch_s)^k, row k in m/s^k",
        "coefficients": short(motion.power_coefficients(epoch), 12),
        "covariance": None if motion.covariance_band is None else short(_power_covariance(motion, epoch, k)),
    }


def short(values: Floats, digits: int = 9) -> Floats:
    """`values`, any shape, to so many significant digits; below those, machines may differ."""
    form = f"%.{digits}g"
    return np.array([float(form % v) for v in np.ravel(values).tolist()]).reshape(np.shape(values))


def _document(results: Results) -> dict[str, Any]:
    s = results.solution
    return {
        "format": FORMAT,
        "title": results.title,
        "versions": dict(sorted(results.versions.items())),
        "inputs_sha256": dict(sorted(results.inputs.items())),
        "settings": results.settings,
        "solver_settings": s.settings,
        "method": s.method,
        "status": s.status,
        "message": s.message,
        "iterations": s.iterations,
        "cost": s.cost,
        "chi_square": s.chi_square,
        "degrees_of_freedom": s.degrees_of_freedom,
        "verdict": verdict_plain(s.verdict),
        "unit_weight": _unit_weight(s),
        "observations": len(s.sightings.frame),
        "frame": _frame(results),
        "clocks": [_clock(c) for c in s.clocks],
        "biases": [_bias(b) for b in s.biases],
        "corrections": [_correction(c) for c in s.corrections],
        "motions": [_motion(m, s, results.typical_sigma_m.get(m.target)) for m in s.motions],
        "depths": [_depth(d) for d in s.depths],
        **_known(s),
        "shared": _shared(s),
        "redundancies": [_redundancy(r) for r in s.redundancies],
        "offset_candidates": [
            {"offset_s": c.offset_s, "frame_rate": c.frame_rate, "cost": c.cost} for c in s.offset_candidates
        ],
        "findings": [
            {"kind": f.kind, "subject": f.subject, "words": f.words, "carried_by": f.carried_by} for f in s.findings
        ],
        "warnings": results.warnings,
    }


def _frame(results: Results) -> dict[str, Any]:
    origin, utc = results.origin, results.utc_s
    place = origin and {
        "latitude_deg": round(math.degrees(origin.lat_rad), 12),
        "longitude_deg": round(math.degrees(origin.lon_rad), 12),
        "ellipsoidal_height_m": origin.height_m,
    }
    return {
        "axes": "local east, north, up in metres on WGS84",
        "origin": place,
        "utc_at_common_time_0": None if utc is None else utc_texts(utc, np.zeros(1))[0],
    }


def _unit_weight(solution: Solution) -> dict[str, Any] | None:
    """The chi-square test: `interval_95` is where the factor falls in 95 of 100 flights whose sigmas are true."""
    test = solution.unit_weight
    if test is None:
        return None
    return {
        "redundancy": short(np.array(solution.expected_chi_square)),
        "variance_factor": short(np.array(test.variance_factor)),
        "interval_95": short(np.array([test.low, test.high])),
        "p_value": short(np.array(test.p_value)),
        "passed": test.passed,
    }


def verdict_plain(verdict: Verdict) -> dict[str, Any]:
    """The verdict as files and `--json` hold it."""
    return {
        "grade": verdict.grade,
        "reasons": [
            {
                "kind": r.kind,
                "subject": r.subject,
                "grade": r.grade,
                "words": r.words,
                "advice": r.advice,
                "figure": short(np.array(r.figure), 6) if math.isfinite(r.figure) else None,
                "measure": r.measure,
            }
            for r in verdict.reasons
        ],
    }


def _depth(of: DepthRange) -> dict[str, Any]:
    """A target's distance that has no symmetric sigma; null: no upper end."""
    return {
        "target": of.target,
        "camera": of.camera,
        "time_s": of.time_s,
        "depth_m": short(np.array(of.depth_m)),
        "sigma_m": short(np.array(of.sigma_m)),
        "within_68_m": short(np.array(of.within_68_m)),
        "within_95_m": short(np.array(of.within_95_m)),
    }


def _known(solution: Solution) -> dict[str, Any]:
    """Landmarks and ground, where the flight has them."""
    told: dict[str, Any] = {}
    if solution.landmarks:
        told["landmarks"] = [_landmark(mark) for mark in solution.landmarks]
    if solution.ground:
        told["ground"] = [
            {
                "target": g.target,
                "off_m": short(np.array(g.off_m)),
                "sigma_m": short(np.array(g.sigma_m)),
                "rows": g.rows,
            }
            for g in solution.ground
        ]
    return told


def _landmark(of: Landmark) -> dict[str, Any]:
    told: dict[str, Any] = {
        "landmark": of.name,
        "kind": of.kind,
        "position_enu_m": of.position_enu_m,
        "sigma_m": short(of.sigma_m),
        "sightings": of.sightings,
        "residual_px": short(np.array(of.residual_px)) if math.isfinite(of.residual_px) else None,
    }
    if of.surveyed_enu_m is not None and of.off_m is not None:
        told["surveyed_enu_m"] = of.surveyed_enu_m
        told["off_m"] = short(of.off_m)
        told["off_sigma_m"] = short(of.off_sigma_m)
        told["error_over_sigma"] = short(np.array(of.error_over_sigma), 6)
    return told


def _redundancy(of: Redundancy) -> dict[str, Any]:
    """How much of a camera's or target's sightings is left over to check them with, and what it says."""
    return {
        of.kind: of.subject,
        "equations": of.equations,
        "redundancy": short(np.array(of.redundancy)),
        "chi_square": short(np.array(of.chi_square)),
    }


def _clock(clock: Clock) -> dict[str, Any]:
    told: dict[str, Any] = {
        "camera": clock.camera,
        "offset_s": clock.offset_s,
        "offset_sigma_s": clock.offset_sigma_s,
        "frame_rate": clock.frame_rate,
        "frame_rate_sigma": clock.frame_rate_sigma,
        "nominal_rate": clock.nominal_rate,
        "drifts": clock.deviation_frame is not None,
    }
    if clock.deviation_frame is not None:
        told["deviation_frame"] = clock.deviation_frame
        told["deviation_s"] = clock.deviation_s
        told["deviation_sigma_s"] = clock.deviation_sigma_s
    return told


def _bias(bias: Bias) -> dict[str, Any]:
    return {
        "camera": bias.camera,
        "rotation_deg": short(np.degrees(bias.rotation_rad), 12),
        "rotation_sigma_deg": short(np.degrees(bias.rotation_sigma_rad)),
        "position_m": bias.position_m,
        "position_sigma_m": bias.position_sigma_m,
        "focal_scale": bias.focal_scale,
        "focal_scale_sigma": bias.focal_scale_sigma,
        **(
            {"readout_s": bias.readout_s, "readout_sigma_s": bias.readout_sigma_s}
            if bias.readout_s or bias.readout_sigma_s
            else {}
        ),
    }


def _correction(of: Correction) -> dict[str, Any]:
    """What the adjustment took from one prior; `block` with its chi-square and grade is what the verdict rests on."""
    return {
        "parameter": of.parameter,
        "value": short(np.array(of.value), 12),
        "prior_sigma": short(np.array(of.prior_sigma)),
        "sigma": short(np.array(of.sigma)),
        "in_prior_sigmas": short(np.array(of.in_sigmas)),
        "beyond": of.beyond,
        "block": of.block,
        "chi_square": short(np.array(of.chi_square)),
        "freedom": of.freedom,
        "grade": of.grade,
    }


def _motion(motion: Motion, solution: Solution, typical_sigma_m: float | None) -> dict[str, Any]:
    robust = next((m for m in solution.motions_robust if m.target == motion.target), None)
    told: dict[str, Any] = {
        "target": motion.target,
        "kind": motion.kind,
        "degree": motion.degree,
        "start_s": motion.start_s,
        "end_s": motion.end_s,
        "typical_sigma_m": None if typical_sigma_m is None else short(np.array(typical_sigma_m), 6),
        "knots_s": motion.knots_s,
        "coefficients_enu_m": motion.coefficients,
        "covariance_band": _band(motion),
    }
    if robust is not None:
        told["covariance_band_robust"] = _band(robust)
    if motion.kind == "polynomial":
        told["polynomial"] = polynomial(motion)
    return told


def _band(motion: Motion) -> Floats | None:
    """Element [i][j] holds the covariance of coefficient i with i + j, row by row (ee, en, eu, ne, ...)."""
    if motion.covariance_band is None:
        return None
    p, width = motion.covariance_band.shape[:2]
    return short(motion.covariance_band).reshape(p, width, 9)


def _power_covariance(motion: Motion, epoch_s: float, degree: int) -> Floats:
    """Covariance of the power coefficients: each is linear in the spline's, its k-th derivative over k!."""
    if motion.covariance_band is None:
        raise ValueError("no covariance to turn")
    p = degree + 1
    at, knots = np.array([epoch_s]), motion.knots_s
    rows = [spline(knots, np.eye(p), degree, at, k)[0] / math.factorial(k) for k in range(p)]
    power_from_spline = np.array(rows)
    full = np.zeros((p, p, 3, 3))
    for i in range(p):
        for j in range(p - i):
            full[i, i + j] = motion.covariance_band[i, j]
            full[i + j, i] = motion.covariance_band[i, j].T
    turned = np.einsum("ai,ijxy,bj->axby", power_from_spline, full, power_from_spline).reshape(3 * p, 3 * p)
    sigma = np.sqrt(np.diag(turned))
    noise = np.abs(turned) < 1e-12 * np.outer(sigma, sigma)
    return np.where(noise, 0.0, 0.5 * (turned + turned.T))


def _shared(solution: Solution) -> dict[str, Any]:
    told: dict[str, Any] = {"names": solution.shared_names, "covariance": None, "correlation": None}
    if solution.shared_covariance is not None:
        told["sigma"] = short(np.sqrt(_larger_variances(solution.shared_covariance, solution.shared_covariance_robust)))
        told["covariance"] = short(solution.shared_covariance)
        told["correlation"] = np.round(correlation(solution.shared_covariance), 6) + 0.0
    if solution.shared_covariance_robust is not None:
        told["covariance_robust"] = short(solution.shared_covariance_robust)
    return told


def _larger_variances(plain: Floats, robust: Floats | None) -> Floats:
    return np.asarray(np.diag(plain) if robust is None else np.maximum(np.diag(plain), np.diag(robust)))


def _laid_out(value: Any, indent: str) -> str:
    """JSON text of plain values: what holds other containers is broken into lines, a row of scalars is not."""
    inner = indent + " "
    if isinstance(value, dict) and value:
        parts = [f"{json.dumps(key, ensure_ascii=False)}: {_laid_out(item, inner)}" for key, item in value.items()]
        return "{\n" + ",\n".join(inner + part for part in parts) + f"\n{indent}}}"
    if isinstance(value, list) and value and isinstance(value[0], dict | list):
        return "[\n" + ",\n".join(inner + _laid_out(item, inner) for item in value) + f"\n{indent}]"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)
