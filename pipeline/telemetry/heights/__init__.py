"""Heights above the ellipsoid: a log's undulation, else the geoid (EGM2008 where PROJ has it, EGM96)."""
