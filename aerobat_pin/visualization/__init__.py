"""Show a flight: figures, an HTML report, and a replay in the browser.

A name is imported when it is first used, as `__init__.pyi` lists them (SPEC 1 of Scientific Python).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
