"""What every room stands on: array types, errors, whole-file writing, loops that are compiled or not."""
