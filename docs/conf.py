"""How these pages are built: `sphinx-build -W docs docs/_build`; `scripts/test` does it with every warning an error."""

from importlib.metadata import version as version_of

project = "Running Fix"
author = "the Running Fix developers"
version = release = version_of("runningfix")
extensions = ["myst_parser"]
myst_enable_extensions = ["deflist", "dollarmath"]
myst_heading_anchors = 3
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = "Running Fix"
nitpicky = True
