"""The versions of the packages that can change the results."""

from __future__ import annotations

from functools import cache
from importlib import metadata

VERSIONED_PACKAGES = ("aerobat-pinocchio", "pin", "numpy", "scipy", "xarray", "h5netcdf", "pydantic")


@cache
def versions() -> dict[str, str]:
    """Return package -> version."""
    return {name: metadata.version(name) for name in VERSIONED_PACKAGES}
