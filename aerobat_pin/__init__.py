"""Aerobat on Pinocchio: what is pushing on my robot?"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from aerobat_pin.robot import Aerobat, load_aerobat

__version__ = "0.1.0"
__all__ = ["Aerobat", "__version__", "load_aerobat"]


def __getattr__(name: str) -> Any:
    """Import the robot when it is first asked for, so that `import aerobat_pin` alone costs nothing."""
    if name in ("Aerobat", "load_aerobat"):
        from aerobat_pin import robot

        return getattr(robot, name)
    raise AttributeError(f"module 'aerobat_pin' has no attribute '{name}'")
