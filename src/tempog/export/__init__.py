"""A map for other programs: map_server files and masks for Nav2, GeoJSON, arrays, MCAP."""
