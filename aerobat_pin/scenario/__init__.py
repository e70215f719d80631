"""Read and check scenario files: their keys, units and defaults, and the messages that explain a wrong value."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
