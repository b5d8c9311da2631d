"""How far to believe a calibration: coverage, views that do not belong, verdict, what to photograph next."""
