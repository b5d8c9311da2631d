"""The weighted least-squares problem and its solution: unknowns and priors, normal equations, Levenberg-Marquardt."""
