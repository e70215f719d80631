"""Aerobat alone: its model and wing in Pinocchio, its air, its logs, and what its estimation needs of its own."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
