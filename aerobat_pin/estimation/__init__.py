"""From a record to forces: checks, known forces, observers, calibration, scores and results, for any robot."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
