"""Frames of a Pinocchio model, by name."""

from __future__ import annotations

import pinocchio as pin

from aerobat_pin.errors import FrameNotFoundError


def frame_id(model: pin.Model, name: str) -> int:
    """Return the index of a frame. Raises FrameNotFoundError, which lists the existing frames."""
    if not model.existFrame(name):
        raise FrameNotFoundError(name, [frame.name for frame in model.frames if frame.name != "universe"])
    return int(model.getFrameId(name))
