"""Files and folders that are always whole: written completely or not at all, whatever ends the program.

Only the standard library is imported, so that the command line can load this room before anything else.
"""

from aerobat_pin.files.ending import cleaned, end_on_signals, raising
from aerobat_pin.files.output_folder import claimed, output_folder, replace_results
from aerobat_pin.files.whole_files import check_file, picture_files, write_files, write_text

__all__ = [
    "check_file",
    "claimed",
    "cleaned",
    "end_on_signals",
    "output_folder",
    "picture_files",
    "raising",
    "replace_results",
    "write_files",
    "write_text",
]
