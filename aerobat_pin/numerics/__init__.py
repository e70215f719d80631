"""Arrays, compiled kernels, views of Pinocchio's results and integration on manifolds, independent of any robot."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
