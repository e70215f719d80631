"""Learn from records without unknown forces what a belief gets wrong, and use that as a known input."""
