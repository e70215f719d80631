"""Raw laboratory sensors: from samples of motion capture, inertial unit, crank encoder and torque to forces."""

import lazy_loader

from aerobat_pin.errors import old_names

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = old_names(__name__, {"RawChannel": "SensorSamples"}, __getattr__)
