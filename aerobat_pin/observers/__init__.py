"""Observers of external forces on any `pinocchio.Model`, from samples and known forces; no aerodynamics needed."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
