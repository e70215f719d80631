"""Names that a door had before: they work for one release, with a warning."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Mapping
from typing import Any


def old_names(
    door: str, names: Mapping[str, str], otherwise: Callable[[str], Any] | None = None
) -> Callable[[str], Any]:
    """Return the `__getattr__` of a door (PEP 562) that gives old names a DeprecationWarning.

    Args:
        door: name of the package.
        names: old name -> name now.
        otherwise: the door's `__getattr__` for all other names.
    """

    def get(name: str) -> Any:
        if name in names:
            warnings.warn(f"{door}.{name} is called {names[name]} now", DeprecationWarning, stacklevel=2)
            return getattr(sys.modules[door], names[name])
        if otherwise is None:
            raise AttributeError(f"module {door!r} has no attribute {name!r}")
        return otherwise(name)

    return get
