"""Tables: columns as the design fixes them, missing values as empty cells, exact reading of what was written."""

from __future__ import annotations

import dataclasses
import io
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from calibration.foundation.errors import InputFileError
from pipeline.export import (
    clock_csv,
    poses_csv,
    read_poses_csv,
    read_tracks_csv,
    sightings_csv,
    timing_csv,
    tracks_csv,
    trajectory_csv,
)
from pipeline.records import ImageTrack, PoseTrack
from tests.scenes.export import BUS, VAN, poses, tiny_results, tracks

COLUMNS = {
    tracks_csv(()): "camera,target,frame,time_s,x_px,y_px,sigma_px,state,fix",
    poses_csv(()): "camera,frame,time_s,east_m,north_m,up_m,qw,qx,qy,qz",
    timing_csv(tiny_results()): "camera,offset_s,offset_sigma_s,frame_rate,frame_rate_sigma",
    clock_csv(tiny_results()): "camera,frame,deviation_s,deviation_sigma_s",
    trajectory_csv(tiny_results()): "target,time_s,utc,east_m,north_m,up_m,latitude_deg,longitude_deg,height_m,"
    "ve_mps,vn_mps,vu_mps,cov_ee,cov_en,cov_eu,cov_nn,cov_nu,cov_uu",
    sightings_csv(tiny_results()): "camera,target,frame,time_s,residual_x_px,residual_y_px,residual_sigma,weight,"
    "east_m,north_m,up_m",
}


def table(text: str | None) -> pd.DataFrame:
    assert text is not None
    return pd.read_csv(io.StringIO(text))


def same_track(one: ImageTrack, other: ImageTrack) -> None:
    assert (one.camera, one.target) == (other.camera, other.target)
    for name in ("frame", "time_s", "xy_px", "sigma_px", "state", "box"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def same_poses(one: PoseTrack, other: PoseTrack) -> None:
    assert one.camera == other.camera
    for name in ("frame", "time_s", "position_enu_m", "enu_from_cam"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.mark.parametrize(("text", "header"), COLUMNS.items(), ids=[h.split(",")[1] for h in COLUMNS.values()])
def test_columns(text: str, header: str) -> None:
    assert text.splitlines()[0] == header
    assert text.endswith("\n")
    assert "nan" not in text


def test_tracks_read_back_bit_for_bit(tmp_path: Path) -> None:
    path = tmp_path / "tracks.csv"
    path.write_text(tracks_csv(tracks()))
    for one, other in zip(read_tracks_csv(path), tracks(), strict=True):
        same_track(one, other)


def test_a_lost_row_has_empty_cells() -> None:
    assert tracks_csv(tracks()).splitlines()[3].endswith(",2,0.08,,,,lost,")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("tracked", "seen", r"line 2, column state: 'seen'; expected one of tracked, reacquired, lost"),
        ("100.1", "", r"line 2, column x_px: an empty cell; expected a finite number, as the target is not lost"),
        (",5,0.2", ",1,0.2", r"line 5, column frame: '1'; expected a frame after 2"),
        ("0.08", "soon", r"line 4, column time_s: 'soon'"),
    ],
)
def test_edited_tracks_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "tracks.csv"
    path.write_text(tracks_csv(tracks()).replace(old, new, 1))
    with pytest.raises(InputFileError, match=message):
        read_tracks_csv(path)


def test_poses_read_back_bit_for_bit(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    measured, refined = poses(1 / 3), poses(0.1 + 0.2)
    path.write_text(poses_csv(measured, refined))
    for one, other in zip(read_poses_csv(path), measured, strict=True):
        same_poses(one, other)
    for one, other in zip(read_poses_csv(path, refined=True), refined, strict=True):
        same_poses(one, other)


def test_a_frame_that_was_not_refined_has_empty_cells(tmp_path: Path) -> None:
    still, flying = poses()
    part = dataclasses.replace(
        flying,
        frame=flying.frame[1:2],
        time_s=flying.time_s[1:2],
        position_enu_m=flying.position_enu_m[1:2],
        enu_from_cam=flying.enu_from_cam[1:2],
    )
    path = tmp_path / "poses.csv"
    path.write_text(poses_csv((still, flying), (part,)))
    found = table(path.read_text())
    assert found["refined_east_m"].notna().tolist() == [False, False, False, False, True, False]
    (again,) = read_poses_csv(path, refined=True)
    same_poses(again, part)
    assert [p.camera for p in read_poses_csv(path)] == ["uav1", "uav2"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0.5,-0.5,0.5,-0.5", "0.5,-0.5,0.5,0.9", r"line 2, column qw: a quaternion of length 1.24"),
        ("0.5,-0.5,0.5,-0.5", "0.5,,0.5,-0.5", r"line 2, column qx: an empty cell; expected a finite number"),
        ("uav1,1,", "uav1,0,", r"line 3, column frame: '0'; expected a frame after 0"),
        ("qw", "q0", r"header: .*rename the column q0 to qw"),
    ],
)
def test_edited_poses_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "poses.csv"
    path.write_text(poses_csv(poses()).replace(old, new, 1))
    with pytest.raises(InputFileError, match=message):
        read_poses_csv(path)


def test_no_drift_no_clock_table() -> None:
    results = tiny_results()
    steady = dataclasses.replace(results.solution, clocks=results.solution.clocks[:1])
    assert clock_csv(dataclasses.replace(results, solution=steady)) is None


def test_timing_and_drift_give_back_the_clock() -> None:
    results = tiny_results()
    clock = results.solution.clock("uav2")
    timing = table(timing_csv(results)).set_index("camera").loc["uav2"]
    drift = table(clock_csv(results))
    frame = np.array([0.0, 3.0, 20.0, 50.0])
    common = frame / timing.frame_rate + timing.offset_s + np.interp(frame, drift.frame, drift.deviation_s)
    np.testing.assert_allclose(common, clock.common_time_s(frame / clock.nominal_rate), atol=1e-9)


@pytest.mark.parametrize(("share", "wanted"), [(0.25, 1.0), (9.0, 3.0)])
def test_timing_tells_the_larger_of_plain_and_robust_sigmas(share: float, wanted: float) -> None:
    results = tiny_results()
    clock = results.solution.clock("uav2")
    names = ("uav2.offset_s", "uav2.frame_rate")
    robust = share * np.diag([clock.offset_sigma_s**2, clock.frame_rate_sigma**2])
    solution = dataclasses.replace(results.solution, shared_names=names, shared_covariance_robust=robust)
    timing = table(timing_csv(dataclasses.replace(results, solution=solution))).set_index("camera").loc["uav2"]
    assert timing.offset_sigma_s == pytest.approx(wanted * clock.offset_sigma_s)
    assert timing.frame_rate_sigma == pytest.approx(wanted * clock.frame_rate_sigma)


def test_trajectory_says_what_the_record_says() -> None:
    results = tiny_results()
    found = table(trajectory_csv(results))
    bus, van = found[found.target == BUS], found[found.target == VAN]
    record = results.trajectories[0]
    np.testing.assert_allclose(bus[["east_m", "north_m", "up_m"]], record.position_enu_m, atol=1e-6)
    np.testing.assert_allclose(bus[["ve_mps", "vn_mps", "vu_mps"]], record.velocity_mps, atol=1e-6)
    upper = record.covariance[:, *np.triu_indices(3)]
    np.testing.assert_allclose(bus.filter(like="cov_"), upper, rtol=1e-8, atol=1e-15)
    assert van.filter(like="cov_").isna().to_numpy().all()


def test_utc_is_exact_to_the_microsecond() -> None:
    text = trajectory_csv(tiny_results(utc_s=1740830400.1))
    assert table(text).utc[1] == "2025-03-01T12:00:01.600000Z"


def test_without_origin_and_utc_those_cells_are_empty() -> None:
    found = table(trajectory_csv(tiny_results(origin=None, utc_s=None)))
    assert found[["utc", "latitude_deg", "longitude_deg", "height_m"]].isna().to_numpy().all()
    assert found[["east_m", "ve_mps"]].notna().to_numpy().all()


def test_sightings_one_row_each() -> None:
    found = table(sightings_csv(tiny_results()))
    assert found.residual_y_px.tolist() == [-0.5, 12.0]
    assert found.weight.tolist() == [1.0, 0.112]
