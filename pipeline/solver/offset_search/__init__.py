"""The global search of time offsets: nothing known of the clocks, no start needed."""
