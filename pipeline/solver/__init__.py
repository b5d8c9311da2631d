"""Stage 4: sight rays, poses and clocks become trajectories, clocks and corrected poses."""

from pipeline.solver.solve import how_compiled, make_ready, solve

__all__ = ["how_compiled", "make_ready", "solve"]
