"""Flights whose truth is known: scenes, drawn measurements, rendered video, written logs, board photos."""
