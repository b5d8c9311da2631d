"""Sections 2.1 and 2.2 of the paper: what can be had with clocks that agree, and from one camera alone."""

from __future__ import annotations

from functools import partial

from pipeline.experiments.declare import Cell, Experiment, Grid
from pipeline.experiments.paper import noise_levels
from pipeline.experiments.paper.approaches import INTERSECTION, MAP, TRIANGULATION
from pipeline.experiments.paper.scenes import PAPER_ARCS, one_camera, paper_flight


def synchronised() -> Experiment:
    """Section 2.1."""
    together = tuple(
        Cell(
            values={"cameras": cameras, "order": order, "unnoticed_offset_frames": 0},
            scene=partial(
                paper_flight, cameras=cameras, order=order, earlier_frames=0.0, known_clocks=True, arcs=PAPER_ARCS
            ),
            noise=noise_levels.with_known_clocks(noise_levels.HIGH),
        )
        for cameras in (2, 3, 4)
        for order in (1, 2)
    )
    apart = tuple(
        Cell(
            values={"cameras": 2, "order": 1, "unnoticed_offset_frames": frames},
            scene=partial(paper_flight, earlier_frames=frames, arcs=PAPER_ARCS),
            noise=noise_levels.HIGH,
        )
        for frames in (1, 2, 5, 10)
    )
    return Experiment(
        name="synchronised",
        title="Triangulation, when clocks agree and when they only seem to",
        paper="Section 2.1",
        about="Frames taken at the same instants, two to four cameras: every instant is a triangulation. Then two "
        "cameras whose offset nobody noticed; `map` is told that it does not know it.",
        geometry=PAPER_ARCS.words(),
        cells=together + apart,
        approaches=(TRIANGULATION, INTERSECTION, MAP),
        drawings=(Grid(caption="Mean error, m", measure="error_m"),),
        remarks=(
            noise_levels.ABOUT,
            "A motion is drawn through the triangulated points, so that all three answer the same question.",
        ),
    )


CASES = (
    ("curved", "the camera's path is of a higher order than the target's"),
    ("straight", "camera and target both move uniformly"),
    ("still", "all sight rays meet in one point, the camera"),
    ("parallel", "the camera keeps beside the target: all sight rays are parallel"),
)


def monocular() -> Experiment:
    """Section 2.2."""
    cells = tuple(
        Cell(
            values={"case": case, "order": order},
            scene=partial(one_camera, kind=case, order=order),
            noise=noise_levels.LOW,
        )
        for case, _ in CASES
        for order in (1, 2)
        if case != "straight" or order == 1
    )
    return Experiment(
        name="monocular",
        title="One camera alone, and where that cannot work",
        paper="Section 2.2, Fig. 4",
        about="Trajectory intersection from one camera with known time: "
        + "; ".join(f"{name}: {words}" for name, words in CASES)
        + ". Where the geometry is degenerate there is no bound.",
        geometry="one UAV about 90 m from a target at 10 m/s, 50 frames in 5 s; curved: a circle of 40 m radius, "
        "25 m/s",
        cells=cells,
        approaches=(INTERSECTION, MAP),
        drawings=(
            Grid(caption="Mean error, m (no figure: refused as not determined)", measure="error_m"),
            Grid(caption="Share of flights with an answer", measure="solved_share"),
        ),
        refused=True,
        remarks=(noise_levels.ABOUT_LOW,),
    )
