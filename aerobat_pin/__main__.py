"""Run the command line as `python -m aerobat_pin`."""

from aerobat_pin.cli import main

main()
