"""Forces along a record: what is known of them, what an observer finds beside it, and how sure that is."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
