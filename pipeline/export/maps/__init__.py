"""What maps and globes open: GeoJSON, KML, CZML, GPX."""
