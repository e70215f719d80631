"""What goes wrong, and what stays whole then: exceptions, endings on signals, files written completely or not at all.

Only the standard library is imported, so that the command line can load this room before anything else.
"""

from aerobat_pin.errors.ending import cleaned, end_on_signals, raising
from aerobat_pin.errors.exceptions import (
    AerobatError,
    ArgumentError,
    BrowserError,
    CalibrationError,
    ControlWarning,
    CrankError,
    ExtraError,
    FrameNotFoundError,
    LinkageError,
    LogError,
    MapError,
    MorphologyFileError,
    NearSingularWarning,
    ObserverError,
    OutputError,
    OutputWarning,
    ScenarioError,
    ShapeError,
    SimulationError,
    SweepError,
    TrimError,
    WorkersLostError,
)
from aerobat_pin.errors.foreign_files import DEEPEST_XML, MOST_TIMES_LARGER, MOST_UNPACKED, foreign_file, foreign_xml
from aerobat_pin.errors.given_files import check_private, content_of, plain_json
from aerobat_pin.errors.output_folder import claimed, output_folder, replace_results
from aerobat_pin.errors.whole_files import (
    check_file,
    locked,
    opened_folder,
    write_files,
    write_text,
)

__all__ = [
    "DEEPEST_XML",
    "MOST_TIMES_LARGER",
    "MOST_UNPACKED",
    "AerobatError",
    "ArgumentError",
    "BrowserError",
    "CalibrationError",
    "ControlWarning",
    "CrankError",
    "ExtraError",
    "FrameNotFoundError",
    "LinkageError",
    "LogError",
    "MapError",
    "MorphologyFileError",
    "NearSingularWarning",
    "ObserverError",
    "OutputError",
    "OutputWarning",
    "ScenarioError",
    "ShapeError",
    "SimulationError",
    "SweepError",
    "TrimError",
    "WorkersLostError",
    "check_file",
    "check_private",
    "claimed",
    "cleaned",
    "content_of",
    "end_on_signals",
    "foreign_file",
    "foreign_xml",
    "locked",
    "opened_folder",
    "output_folder",
    "plain_json",
    "raising",
    "replace_results",
    "write_files",
    "write_text",
]
