"""Robots that live while one watches: simulated under a force that somebody sets, or heard from a recording or node."""
