"""Rotations, splines and geodesy: arrays in, arrays out. Knows no record, file or unit but SI."""
