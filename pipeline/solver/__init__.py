"""Stage 4: sight rays, poses and clocks become trajectories, clocks and corrected poses."""

from pipeline.solver.solve import solve

__all__ = ["solve"]
