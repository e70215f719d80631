"""The checks of a record against itself and against its map; each names the measured figure."""
