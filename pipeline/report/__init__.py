"""Results become one page that people can read, print and keep: `render_report`.

Every figure is a pure function from records to markup; `page` puts them in order.
"""

from pipeline.report.page import render_report
from pipeline.report.views.log import log_picture

__all__ = ["log_picture", "render_report"]
