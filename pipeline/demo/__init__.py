"""The demonstration: a rendered flight goes through the same stages a user's would, then meets its truth."""

from pipeline.demo.compare import compare
from pipeline.demo.show import DemoSummary, run_demo

__all__ = ["DemoSummary", "compare", "run_demo"]
