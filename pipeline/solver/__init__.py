"""Stage 4: sight rays, poses and clocks become trajectories, clocks and corrected poses."""

from pipeline.solver.solve import make_ready, solve

__all__ = ["make_ready", "solve"]
