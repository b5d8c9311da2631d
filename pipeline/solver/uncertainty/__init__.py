"""What the solved unknowns are worth: covariances, clusters of dependent sightings, jackknife, redundancy."""
