"""What an estimate says beyond its numbers: onset, place, bias, noise and lag."""
