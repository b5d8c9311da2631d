"""Drawings without meaning: scales, panels, marks, ellipses, names beside their points."""
