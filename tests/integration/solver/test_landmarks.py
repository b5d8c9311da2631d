"""Surveyed points take the constant errors of cameras out; check points are held against the answer only."""

import json

import numpy as np

from pipeline.flight import read_flight
from pipeline.stages import run_solve
from pipeline.synthetic.scene import pixels_of
from pipeline.synthetic.scenes import paper_scene
from tests.scenes.table_flight import write_table_flight

PLACES = {"mast": (-20.0, 15.0, 1.0), "kerb": (25.0, -10.0, 0.0), "roof": (5.0, 30.0, 6.0), "stone": (-5.0, -20.0, 0.5)}


def tables(rng, names, check=()):
    """Landmarks of the flight file: where they are, and marked in every tenth frame to one pixel."""
    lines = []
    for name in names:
        lines.append(f"[landmarks.{name}]")
        lines += [f"{axis}_m = {value}" for axis, value in zip(("east", "north", "up"), PLACES[name], strict=True)]
        lines += ["sigma_m = 0.05", f"check = {str(name in check).lower()}"]
        for camera in paper_scene(order=1, targets=2).cameras:
            frames = np.arange(0, 50, 10)
            pixels, _ = pixels_of(camera, frames, np.tile(PLACES[name], (len(frames), 1)))
            pixels = pixels + rng.normal(size=pixels.shape)
            marks = [
                f"{{ frame = {f}, x = {x:.3f}, y = {y:.3f}, sigma_px = 1.0 }}"
                for f, (x, y) in zip(frames, pixels, strict=True)
            ]
            lines.append(f"points.{camera.name} = [ {', '.join(marks)} ]")
    return "\n".join(lines) + "\n"


def solved(folder, seed, names=(), check=()):
    path, truth = write_table_flight(folder, seed)
    path.write_text(path.read_text() + tables(np.random.default_rng(seed), names, check))
    results = run_solve(read_flight(path), folder / "out").results
    errors, claims = [], []
    for found, true in zip(results.trajectories, truth.trajectories, strict=True):
        at = np.linspace(0.1, 0.9, 5) * (found.time_s[-1] - found.time_s[0]) + found.time_s[0]
        axes = range(3)
        here = np.stack([np.interp(at, found.time_s, found.position_enu_m[:, k]) for k in axes], 1)
        there = np.stack([np.interp(at, true.time_s, true.position_enu_m[:, k]) for k in axes], 1)
        errors.append(here - there)
        claims.append(found.covariance[np.searchsorted(found.time_s, at)])
    return np.concatenate(errors), np.concatenate(claims), json.loads((folder / "out" / "solution.json").read_text())


def test_three_surveyed_points_take_most_of_the_error_out_and_claims_stay_true(tmp_path):
    squares, before, after, claimed = [], [], [], []
    for seed in (1, 2, 3):
        for name in ("without", "with"):
            (tmp_path / f"{name}{seed}").mkdir()
        error, claim, _ = solved(tmp_path / f"without{seed}", seed)
        before.append(np.trace(claim, axis1=1, axis2=2).mean())
        error, claim, told = solved(tmp_path / f"with{seed}", seed, ("mast", "kerb", "roof"))
        after.append((error**2).sum(axis=1).mean())
        claimed.append(np.trace(claim, axis1=1, axis2=2).mean())
        squares.append(np.einsum("ni,nij,nj->n", error, np.linalg.inv(claim), error).mean() / 3)
        assert {one["landmark"] for one in told["landmarks"]} == {"mast", "kerb", "roof"}
    assert np.sqrt(np.mean(claimed)) < 0.6 * np.sqrt(np.mean(before))
    assert np.sqrt(np.mean(after)) < 0.6 * np.sqrt(np.mean(before))
    assert 0.2 < np.mean(squares) < 3.0


def test_a_check_point_takes_no_part_and_is_told(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    error, _, told = solved(tmp_path / "a", 1, ("mast", "kerb", "stone"), check=("stone",))
    same, _, _ = solved(tmp_path / "b", 1, ("mast", "kerb"))
    np.testing.assert_allclose(error, same, atol=1e-3)
    stone = next(one for one in told["landmarks"] if one["landmark"] == "stone")
    assert stone["kind"] == "check"
    assert stone["error_over_sigma"] < 3.3
    assert 0.05 < max(stone["off_sigma_m"]) < 2.0


def test_a_landmark_that_is_elsewhere_is_not_good(tmp_path):
    marked = tables(np.random.default_rng(1), ("mast", "kerb", "roof"))
    path, _ = write_table_flight(tmp_path, 1)
    path.write_text(path.read_text() + marked.replace("east_m = 25.0", "east_m = 30.0"))
    solution = run_solve(read_flight(path), tmp_path / "out").results.solution
    assert solution.verdict.grade != "good"
