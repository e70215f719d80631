"""What only Aerobat's estimation needs: its channels, its air along a motion, its calibration, its joint smoother."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
