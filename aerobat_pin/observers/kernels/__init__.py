"""Compiled kernels of the observers, used both for single updates and for whole records."""
