"""Many flights on many processes or machines, with the same numbers however many there are."""
