"""Proposals of what to track: what moves on its own, on a contact sheet."""
