"""Run the command line as `python -m aerobat_pin.cli`."""

from aerobat_pin.cli import main

main()
