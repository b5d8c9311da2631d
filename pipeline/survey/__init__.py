"""Surveyed points as photogrammetry programs write them: names, coordinates in some system, marks in pictures.

text (lists) -> rows -> WGS84 (coordinates). Pixels come out as ours: (0, 0) is the middle of the top-left pixel.
"""

from pipeline.survey.coordinates import Places, places
from pipeline.survey.lists import ControlList, ControlMark, ControlPoint, read_list, with_coordinates

__all__ = ["ControlList", "ControlMark", "ControlPoint", "Places", "places", "read_list", "with_coordinates"]
