"""What a flight file names, opened: the clocks of videos, logs and tables of poses, detections and tracks."""
