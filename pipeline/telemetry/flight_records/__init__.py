"""DJI's flight records as tables (.csv): AirData's export, and that of the programs that decode DJI's own files."""
