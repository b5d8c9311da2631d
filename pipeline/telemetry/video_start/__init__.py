"""When frame 0 was: stated by a person, by the log's camera events, or found by the camera's turning."""
