"""Photos to views, views to a camera: what the command line runs."""
