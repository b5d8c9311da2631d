"""From many flights to figures: means with their Monte Carlo error, ratios with intervals, the verdict."""
