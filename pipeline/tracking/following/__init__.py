"""From frame to frame: predict, look, refine, verify, search; and a whole video through it."""
