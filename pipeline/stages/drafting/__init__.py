"""A folder of videos, logs and camera files becomes a draft of a flight file, with what was guessed marked as such."""
