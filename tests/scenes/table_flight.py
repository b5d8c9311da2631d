"""A flight without video: detections and pose tables drawn from a scene, written as a user's files would be."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from calibration.camera import project
from pipeline.export import poses_csv, tracks_csv
from pipeline.records import ImageTrack, Truth
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import PAPER_LOW, simulate

FLIGHT = """
[flight]
origin = {{ lat = 28.2, lon = 112.9, height = 60.0 }}
[cameras.{0}]
calibration = "{0}.json"
tracks = "{0}-tracks.csv"
telemetry = "{0}-poses.csv"
frame_rate = 10.0
sigma = {{ attitude_bias_deg = 0.1, attitude_deg = 0.1, position_bias_m = 0.6, position_m = 0.2 }}
[cameras.{1}]
calibration = "{1}.json"
tracks = "{1}-tracks.csv"
telemetry = "{1}-poses.csv"
frame_rate = 10.0
sigma = {{ attitude_bias_deg = 0.1, attitude_deg = 0.1, position_bias_m = 0.6, position_m = 0.2 }}
[solve]
search_s = 5.0
"""


def write_table_flight(folder: Path, seed: int = 1) -> tuple[Path, Truth]:
    """A two-camera flight of five seconds in `folder`; returns its flight file and its truth."""
    scene = paper_scene(order=1, targets=2)
    problem, truth = simulate(scene, noise=PAPER_LOW, seed=seed)
    for camera, given in zip(scene.cameras, problem.cameras, strict=True):
        lens = camera.lens
        (folder / f"{camera.name}.json").write_text(
            json.dumps({"model": "pinhole", "image_size": lens.image_size, "K": lens.K.tolist(), "distortion": []})
        )
        (folder / f"{camera.name}-poses.csv").write_text(poses_csv([given.poses]))
        pixels = project(lens, given.rays.direction_cam)
        tracks = [
            ImageTrack(
                camera=camera.name,
                target=name,
                frame=given.rays.frame[mine],
                time_s=given.rays.time_s[mine],
                xy_px=pixels[mine],
                sigma_px=given.rays.sigma_px[mine],
                state=np.zeros(mine.sum(), int),
            )
            for name, mine in ((n, given.rays.target == i) for i, n in enumerate(given.rays.targets))
        ]
        (folder / f"{camera.name}-tracks.csv").write_text(tracks_csv(tracks))
    path = folder / "flight.toml"
    path.write_text(FLIGHT.format(*(c.name for c in scene.cameras)))
    return path, replace(truth, poses=(), tracks=())
