"""Camera poses at frame times, from a log or a table, and what they are worth."""
