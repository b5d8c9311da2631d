"""Heights above the ellipsoid: a log's undulation, else EGM96."""
