"""Tracks of a flight's cameras become targets common to them; what a match comes to as files of the user's."""
