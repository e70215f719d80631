"""Figures of a flight and of the linkage, for matplotlib."""
