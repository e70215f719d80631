"""Run a scenario (simulate the flight, estimate the forces, score and write the results), or a sweep of many."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
