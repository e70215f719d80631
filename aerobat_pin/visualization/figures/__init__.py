"""Draw figures of a flight and of the linkage with matplotlib."""
