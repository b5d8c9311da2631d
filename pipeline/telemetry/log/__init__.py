"""What every format is read into: the flight log and its series, raw tables, the file's bytes."""
