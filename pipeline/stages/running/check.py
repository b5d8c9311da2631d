"""What is checked before a command begins long work: said, or refused where it is certain."""

from __future__ import annotations

from collections.abc import Mapping

from calibration.camera import CameraModel
from calibration.foundation.progress import Progress, silent
from pipeline.flight import Flight
from pipeline.stages.checks.outlook import Outlook, look_ahead, refuse
from pipeline.stages.inputs.cameras import read_models
from pipeline.stages.running.inputs import check_files
from pipeline.stages.running.ledger import Ledger, key_of
from pipeline.stages.running.poses import Measure, measuring
from pipeline.stages.running.provenance import decisive, input_hashes


def check_flight(flight: Flight, progress: Progress = silent) -> Outlook:
    """All that can be seen of a flight before tracking. Raises InputFileError where a file that it names is missing."""
    check_files(flight)
    return look_ahead(flight, lambda: read_models(flight), measuring(flight, progress))


def doubts_of(ledger: Ledger, flight: Flight, models: Mapping[str, CameraModel], measure: Measure) -> tuple[str, ...]:
    """The doubts about a flight, a sentence each; of a finished run, as they were said then.

    Raises what a command cannot go on with.
    """
    key = key_of({"stage": "check", "inputs": input_hashes(flight), "made with": decisive()})
    if not ledger.finished("check", key):
        found = look_ahead(flight, lambda: models, measure)
        refuse(found)
        ledger.remember("check", key, [doubt.words for doubt in found.doubts])
    return ledger.warnings("check")
