"""Run a scenario (simulate the flight, estimate the forces, score and write the results), or a sweep of many.

A name is imported when it is first used, as `__init__.pyi` lists them (SPEC 1 of Scientific Python).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
