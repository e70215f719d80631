"""The robot in Pinocchio: models, frames, wing and prescribed-joint dynamics, made from description and linkage."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
