"""The solution methods of the settings, one module each, and how they choose parameters, order and weights."""
