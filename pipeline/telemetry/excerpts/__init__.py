"""Minutes out of a long log without reading the rest."""
