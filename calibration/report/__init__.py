"""A calibration for people: one page."""
