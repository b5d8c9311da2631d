"""MAVLink bytes become tables: every packet's checksum verified, damaged segmentes stepped over."""
