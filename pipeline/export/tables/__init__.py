"""Comma-separated tables: tracks, poses, detections, and the tables of a solution."""
