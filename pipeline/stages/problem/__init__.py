"""Tracks, poses and camera models as the problem that the solver is asked, with the priors of what is not exact."""
