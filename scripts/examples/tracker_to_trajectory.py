"""From tracker to trajectory, step by step: the records in between are yours to look at or to replace.

usage: python scripts/examples/tracker_to_trajectory.py flight.toml
"""

import sys
from pathlib import Path

from pipeline.flight import read_flight
from pipeline.records import SolverSettings
from pipeline.solver import solve
from pipeline.stages import build_problem, measure_poses, open_sources, read_models, track_camera


def main(flight_file: str) -> None:
    """Tracks, takes poses, solves, prints."""
    flight = read_flight(Path(flight_file))
    tracks = [track for camera in flight.cameras for track in track_camera(flight, camera).tracks]  # stage 2
    for track in tracks:
        print(f"{track.camera} {track.target}: {track.seen.sum()} of {len(track.frame)} frames")
    poses = measure_poses(flight, open_sources(flight))  # stage 3
    problem = build_problem(flight, tracks, poses, read_models(flight)).problem
    solution = solve(problem, SolverSettings(method="map"))  # stage 4
    for clock in solution.clocks:
        print(f"{clock.camera}: starts {clock.offset_s:.4f} +- {clock.offset_sigma_s:.4f} s, {clock.frame_rate:.4f} Hz")
    for motion in solution.motions:
        east, north, up = motion.position_enu_m([motion.start_s])[0]
        print(f"{motion.target}: first seen at {motion.start_s:.2f} s, ({east:.1f}, {north:.1f}, {up:.1f}) m")


if __name__ == "__main__":
    main(*sys.argv[1:])
