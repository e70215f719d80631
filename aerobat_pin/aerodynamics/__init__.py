"""Sigma_Aero: the unsteady lifting line on any planform, and the robot's aerodynamics: strips, added mass, wind."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
