"""What a notebook shows of robots and flights: their replay in a frame."""

from __future__ import annotations

from importlib import import_module


class ShownInNotebooks:
    """A thing that notebooks draw. Drawing lies above all rooms, so it is looked up when it is asked for."""

    def _repr_html_(self) -> str:
        """Return HTML that needs no network."""
        return str(import_module("aerobat_pin.visualization").in_frame(self))
