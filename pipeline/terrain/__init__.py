"""Terrain models: a GeoTIFF in any coordinate system becomes heights and slopes in a flight's local ENU."""

from pipeline.terrain.level import level_ground
from pipeline.terrain.read import TerrainModel, read_terrain

__all__ = ["TerrainModel", "level_ground", "read_terrain"]
