"""Boxes drawn by a person in a web page of this machine, written into the flight file."""

from pipeline.label.edit import boxes_swapped, with_box, without_box
from pipeline.label.server import label_server, page_text
from pipeline.label.session import LabelSession

__all__ = ["LabelSession", "boxes_swapped", "label_server", "page_text", "with_box", "without_box"]
