"""Photos and videos of a board, and what they say about their camera."""
