"""Flights whose truth is known: scenes, drawn measurements, rendered video, written logs, board photos."""

from pipeline.synthetic.demo_scenes import demo_scene, small_scene
from pipeline.synthetic.flight import Quality, write_flight
from pipeline.synthetic.scene import Scene
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import DEMO, PAPER_HIGH, PAPER_LOW, Noise, simulate
from pipeline.synthetic.truth_file import read_truth

__all__ = [
    "DEMO",
    "PAPER_HIGH",
    "PAPER_LOW",
    "Noise",
    "Quality",
    "Scene",
    "demo_scene",
    "paper_scene",
    "read_truth",
    "simulate",
    "small_scene",
    "write_flight",
]
