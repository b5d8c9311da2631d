"""Builds the compiled loops of a wheel: Python of a narrow kind, translated to C (`translate`, `wrappers`)."""
