"""The command line: parse, call, print, exit code."""

from aerobat_pin.cli.app import main

__all__ = ["main"]
