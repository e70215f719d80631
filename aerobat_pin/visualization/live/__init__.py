"""A page on which a robot lives and can be pushed."""
