"""Everything that comes in: recordings of any robot, read by a map, as channels in SI units at common times."""

import lazy_loader

from aerobat_pin.errors import old_names

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = old_names(__name__, {}, __getattr__, "aerobat_pin.aerobat")
