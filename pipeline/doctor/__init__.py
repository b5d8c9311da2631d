"""Is this installation whole: what is installed, what can be written, and a self-test with known answers."""

from pipeline.doctor.installation import Finding, findings
from pipeline.doctor.self_test import TRIALS, Trial, tried

__all__ = ["TRIALS", "Finding", "Trial", "findings", "tried"]
