"""What the sightings cannot determine, found numerically and said in words."""
