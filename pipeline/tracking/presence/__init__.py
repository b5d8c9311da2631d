"""Whether a target is there: where a fix is judged, and judged lost."""
