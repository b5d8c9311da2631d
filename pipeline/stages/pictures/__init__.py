"""Pictures from the videos for the report: which moments, then one pass through each video for all of them."""
