"""From a record to forces: checks, known forces, observers, calibration, scores and results, for any robot."""

import lazy_loader

from aerobat_pin.errors import old_names

_get, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = old_names(__name__, {"Compared": "PairedEstimate"}, _get)
