"""The calibration board: what is printed on it, its page to print, and what a photo showed of it."""
