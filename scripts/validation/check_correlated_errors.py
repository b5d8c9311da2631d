"""Whether claimed sigmas hold where errors of tracked centres last: flights solved, error over sigma.

usage: python -m scripts.validation.check_correlated_errors [--runs 60]

Two cameras, 10 s at 25 Hz, four targets of order 2. Errors of the centres are put together from parts, each drawn anew
for every camera and target (`Errors`); the first two are what `check_tracking.py` and the flight of `data/` show, the
third lasts longer than the tracker's. Poses are of two grades. Printed are error over sigma, root mean square, of the
second camera's offset and of the targets' positions (every axis, at seven times), with the plain covariance and with
the cluster-robust one (sandwich).
"""

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from pipeline.records import ImageTrack, Motion, Problem, SolverSettings, Trajectory, Truth
from pipeline.solver import solve
from pipeline.stages.problem.priors import PLACE_FLOOR_PX
from pipeline.synthetic.scene import Scene
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import DEMO, Noise, noisy_rays, simulate
from scripts.validation.figures import tell

RATE_HZ, FRAMES, TIMES = 25.0, 250, 7
SIGMA_PX = 0.15
"""What the tracker claims, one sigma per axis."""
RTK = Noise(
    attitude_bias_rad=float(np.radians(0.02)),
    attitude_rad=float(np.radians(0.01)),
    position_bias_m=0.02,
    position_m=0.01,
    frame_rate_prior=0.002,
)


@dataclass(frozen=True, kw_only=True)
class Errors:
    """Of tracked centres, px per axis, root mean square.

    constant    of one camera and target
    line        on a straight line through zero in the middle of the video
    rest        what is left: a share `new` of its square is new in every frame, the other lasts `lasts_frames` (e-fold)
    place_px    what the solver is told, as `SightRays.place_sigma_px`
    """

    constant: float = 0.0
    line: float = 0.0
    rest: float = SIGMA_PX
    new: float = 1.0
    lasts_frames: float = 1.0
    place_px: float = 0.0

    def drawn(self, frames: int, rng: np.random.Generator) -> np.ndarray:
        """(frames, 2) px."""
        stays = np.exp(-1 / self.lasts_frames)
        slow = rng.normal(size=(frames, 2))
        for f in range(1, frames):
            slow[f] = stays * slow[f - 1] + np.sqrt(1 - stays**2) * slow[f]
        ramp = np.sqrt(3) * np.linspace(-1, 1, frames)[:, None]
        rest = np.sqrt(self.new) * rng.normal(size=(frames, 2)) + np.sqrt(1 - self.new) * slow
        return np.asarray(self.constant * rng.normal(size=2) + self.line * rng.normal(size=2) * ramp + self.rest * rest)


ERRORS: Mapping[str, Errors] = {
    "independent": Errors(),
    "as on held-out scenes": Errors(
        constant=0.085, line=0.033, rest=0.121, new=0.45, lasts_frames=7, place_px=PLACE_FLOOR_PX
    ),
    "as on data/flight": Errors(
        constant=0.13, line=0.053, rest=0.153, new=0.1, lasts_frames=7, place_px=PLACE_FLOOR_PX
    ),
    "lasting a second": Errors(new=0.08, lasts_frames=25),
}
POSES: Mapping[str, Noise] = {"RTK": RTK, "demo": DEMO}


@dataclass(frozen=True, kw_only=True)
class Ratios:
    """Error over sigma, root mean square: of the offset and the positions, plain and robust."""

    offset_plain: float
    offset_robust: float
    position_plain: float
    position_robust: float


def flown() -> Scene:
    """The paper's scene at the rate of a video."""
    scene = paper_scene(order=2, targets=4, given_offset_s=0.4)
    cameras = (replace(c, frame_rate=RATE_HZ, nominal_rate=RATE_HZ, frames=FRAMES) for c in scene.cameras)
    return replace(scene, cameras=tuple(cameras))


def flight(scene: Scene, errors: Errors, noise: Noise, seed: int) -> tuple[Problem, Truth]:
    """One flight whose tracked centres are off by `errors`."""
    problem, truth = simulate(scene, noise=noise, seed=seed)
    cameras = []
    for index, camera in enumerate(problem.cameras):
        rng = np.random.default_rng([seed, index])
        tracks = [_off(t, errors, rng) for t in truth.tracks if t.camera == camera.camera]
        rays = noisy_rays(scene.cameras[index], tracks, camera.frame_rate, 0.0, rng)
        sigma = np.full(len(rays.frame), SIGMA_PX)
        rays = replace(rays, sigma_px=sigma, place_sigma_px=(errors.place_px, errors.place_px))
        cameras.append(replace(camera, rays=rays))
    return replace(problem, cameras=tuple(cameras)), truth


def _off(track: ImageTrack, errors: Errors, rng: np.random.Generator) -> ImageTrack:
    return replace(track, xy_px=track.xy_px + errors.drawn(len(track.frame), rng))


def ratios(errors: Errors, noise: Noise, runs: int) -> Ratios:
    """Over `runs` flights."""
    scene, name = flown(), "uav2.offset_s"
    offsets, positions = [], []
    for seed in range(runs):
        problem, truth = flight(scene, errors, noise, seed)
        solution = solve(problem, SolverSettings())
        place = solution.shared_names.index(name)
        off = solution.clock("uav2").offset_s - truth.offset_s["uav2"]
        assert solution.shared_covariance is not None
        assert solution.shared_covariance_robust is not None
        both = solution.shared_covariance[place, place], solution.shared_covariance_robust[place, place]
        offsets.append(off / np.sqrt(both))
        for plain, robust in zip(solution.motions, solution.motions_robust, strict=True):
            true = next(t for t in truth.trajectories if t.target == plain.target)
            positions.append([_normed(m, true) for m in (plain, robust)])
    offset = np.sqrt(np.mean(np.square(offsets), axis=0))
    position = np.sqrt(np.mean(np.square(positions), axis=(0, 2, 3)))
    return Ratios(
        offset_plain=offset[0], offset_robust=offset[1], position_plain=position[0], position_robust=position[1]
    )


def _normed(motion: Motion, true: Trajectory) -> np.ndarray:
    """(TIMES, 3) error over sigma while the target was seen."""
    inside = np.flatnonzero((true.time_s >= motion.start_s) & (true.time_s <= motion.end_s))
    rows = inside[np.linspace(0, len(inside) - 1, TIMES).astype(int)]
    time = true.time_s[rows]
    sigma = np.sqrt(np.einsum("nii->ni", motion.position_covariance(time)))
    return np.asarray((motion.position_enu_m(time) - true.position_enu_m[rows]) / sigma)


def main() -> None:
    """Prints a row for every kind of error and grade of poses."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=60, help="flights for every row (default 60)")
    runs = parser.parse_args().runs
    print(f"{'errors of centres':<24}{'poses':<7}{'offset':>15}{'position':>17}")
    print(f"{'':<31}{'plain':>8}{'robust':>8}{'plain':>8}{'robust':>8}")
    for words, errors in ERRORS.items():
        for grade, noise in POSES.items():
            r = ratios(errors, noise, runs)
            cells = (r.offset_plain, r.offset_robust, r.position_plain, r.position_robust)
            tell({f"{words}, {grade}": vars(r)})
            print(f"{words:<24}{grade:<7}" + "".join(f"{cell:>8.2f}" for cell in cells), flush=True)


if __name__ == "__main__":
    main()
