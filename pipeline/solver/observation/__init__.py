"""What was seen and when: observations as plain arrays, clocks, motion, and the residual of every sighting."""
