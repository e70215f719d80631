"""From a log and a belief to forces: known inputs, calibrations, raw sensors, recordings of any robot, and scores."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
