"""An outcome for people: pages and tables."""
