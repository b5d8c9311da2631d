"""Corners become intrinsics: first values, bundle adjustment, covariance, choice of the lens model."""
