"""The road from a record to its result: checks, calibration and verdict, all at once or as a stream."""

import lazy_loader

from aerobat_pin.errors import old_names

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
MOVED_TO = ("aerobat_pin.forces", "aerobat_pin.experiments")
__getattr__ = old_names(__name__, {"Compared": "PairedEstimate"}, __getattr__, *MOVED_TO)
