"""The scene around the targets: how its picture moves, what moves on its own in it, how the camera turned."""
