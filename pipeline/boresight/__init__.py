"""Boresight: how a camera sits in its mount, and when its video began, from targets whose places are known."""
