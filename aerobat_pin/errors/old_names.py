"""Names that a door had before: they work for one release, with a warning."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def old_names(
    door: str,
    names: Mapping[str, str],
    otherwise: Callable[[str], Any] | None = None,
    *moved_to: str,
    stacklevel: int = 2,
) -> Callable[[str], Any]:
    """Return the `__getattr__` of a door (PEP 562) that gives old names a DeprecationWarning.

    Args:
        door: name of the package.
        names: old name -> name now.
        otherwise: the door's `__getattr__` for all other names.
        moved_to: packages that have now what the door had before.
        stacklevel: as of `warnings.warn`: whom the warning names.
    """

    def get(name: str) -> Any:
        try:
            if name not in names and otherwise is not None:
                return otherwise(name)
        except AttributeError:
            pass
        rooms = [door] if name in names else [room for room in moved_to if name in dir(import_module(room))]
        if not rooms:
            raise AttributeError(f"module {door!r} has no attribute {name!r}")
        now = names.get(name, name)
        warnings.warn(f"{door}.{name} is called {rooms[0]}.{now} now", DeprecationWarning, stacklevel=stacklevel)
        return getattr(import_module(rooms[0]), now)

    return get
