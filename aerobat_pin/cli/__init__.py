"""The command line `aerobat`: parse the arguments, call the package, print the results, and set the exit code."""

from aerobat_pin.cli.app import main

__all__ = ["main"]
