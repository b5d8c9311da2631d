"""Section 2.4 of the paper: occlusion, more targets, more cameras, and the count of equations and unknowns."""

from __future__ import annotations

from functools import partial

from pipeline.experiments.declare import Cell, Curve, Experiment, Grid, Spell
from pipeline.experiments.paper import noise_levels
from pipeline.experiments.paper.approaches import ALGORITHM_1, ALGORITHM_2, MAP, MULTI_TI
from pipeline.experiments.paper.rotations import ROTATION_EARLIER
from pipeline.experiments.paper.scenes import PAPER_ARCS, PAPER_FRAMES, paper_flight

APPROACHES = (MULTI_TI, ALGORITHM_1, ALGORITHM_2, MAP)
SOLVABLE = (
    "Solvable says whether the paper's count holds for Algorithm 2: with N targets of order K, C cameras and F frames "
    "in all, (2 N - 3) F \u2265 3 N (K + 1) + 2 C."
)
GEOMETRY = PAPER_ARCS.words() + "; offset 5 frames; order 1"


def solvable(targets: int, order: int, cameras: int, frames: int) -> str:
    """The paper's condition of section 2.4 for Algorithm 2: "yes" or "no"."""
    return "yes" if (2 * targets - 3) * frames >= 3 * targets * (order + 1) + 2 * cameras else "no"


def occlusion() -> Experiment:
    """Error as targets disappear."""
    cells = tuple(
        Cell(
            values={"hidden_share": share},
            scene=partial(paper_flight, targets=4, earlier_frames=ROTATION_EARLIER),
            noise=noise_levels.HIGH,
            hidden=_hidden(share),
        )
        for share in (0.0, 0.2, 0.4, 0.6, 0.8)
    )
    return Experiment(
        name="occlusion",
        title="Targets that disappear",
        paper="Section 2.4",
        about="Two cameras, four targets. In each camera each target is hidden for a share of the flight, at different "
        "times: from 60 % on, hardly any instant is left at which both cameras see the same target.",
        geometry=GEOMETRY,
        cells=cells,
        approaches=APPROACHES,
        drawings=(
            Curve(caption="Mean error, m", measure="error_m", x="hidden_share"),
            Grid(caption="Mean error, m", measure="error_m"),
        ),
        remarks=(noise_levels.ABOUT,),
    )


def _hidden(share: float) -> tuple[Spell, ...]:
    """A spell per camera and target, each beginning elsewhere and going on from frame 0 where it runs out."""
    length = round(share * PAPER_FRAMES)
    spells = []
    for camera in range(2):
        for target in range(4):
            first = (target * 13 + camera * 25) % PAPER_FRAMES
            last = first + length
            spells.append(Spell(camera=camera, target=target, first=first, last=min(last, PAPER_FRAMES)))
            if last > PAPER_FRAMES:
                spells.append(Spell(camera=camera, target=target, first=0, last=last - PAPER_FRAMES))
    return tuple(s for s in spells if s.last > s.first)


def targets() -> Experiment:
    """Error as the number of targets grows."""
    cells = tuple(
        Cell(
            values={"targets": n, "solvable": solvable(n, 1, 2, 2 * PAPER_FRAMES)},
            scene=partial(paper_flight, targets=n, earlier_frames=ROTATION_EARLIER),
            noise=noise_levels.HIGH,
        )
        for n in (1, 2, 3, 4, 6, 8)
    )
    return Experiment(
        name="targets",
        title="More targets",
        paper="Section 2.4",
        about="Two cameras, one to eight targets; error of the first target.",
        geometry=GEOMETRY,
        cells=cells,
        approaches=APPROACHES,
        drawings=(
            Curve(caption="Mean error, m", measure="error_m", x="targets", log_y=True),
            Grid(caption="Mean error, m", measure="error_m"),
        ),
        remarks=(noise_levels.ABOUT, SOLVABLE),
    )


def cameras() -> Experiment:
    """Error as the number of cameras grows."""
    cells = tuple(
        Cell(
            values={"cameras": n, "solvable": solvable(4, 1, n, n * PAPER_FRAMES)},
            scene=partial(paper_flight, cameras=n, targets=4, earlier_frames=ROTATION_EARLIER),
            noise=noise_levels.HIGH,
        )
        for n in (2, 3, 4, 6)
    )
    return Experiment(
        name="cameras",
        title="More cameras",
        paper="Section 2.4",
        about="Two to six cameras, four targets; error of the first target. Each further camera's offset is unknown.",
        geometry=GEOMETRY,
        cells=cells,
        approaches=APPROACHES,
        drawings=(
            Curve(caption="Mean error, m", measure="error_m", x="cameras", log_y=True),
            Grid(caption="Mean error, m", measure="error_m"),
        ),
        remarks=(noise_levels.ABOUT, SOLVABLE),
    )
