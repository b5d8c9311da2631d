"""Whether the adjusted flight may be used: tests of every prior, sequence and misfit, culprits, a verdict.

settings -> prior_tests, pose_sequences, misfit -> changes -> culprits -> words -> verdict
"""

from pipeline.solver.judgement.verdict import judged, with_findings, with_refusal

__all__ = ["judged", "with_findings", "with_refusal"]
