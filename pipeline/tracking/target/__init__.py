"""One target: its look (template), its place to a fraction of a pixel (alignment), its course, its track state."""
