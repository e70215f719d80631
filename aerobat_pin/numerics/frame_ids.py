"""Frames of a Pinocchio model, by name."""

from __future__ import annotations

import pinocchio as pin

from aerobat_pin.errors import ArgumentError, FrameNotFoundError


def frame_id(model: pin.Model, name: str) -> int:
    """Return the index of a frame.

    A link and the joint that carries it often share a name; any of them will do where they are at the same place.

    Raises:
        FrameNotFoundError: there is no such frame; the message lists those that exist.
        ArgumentError: frames of that name are at different places.
    """
    if not model.existFrame(name):
        raise FrameNotFoundError(name, [frame.name for frame in model.frames if frame.name != "universe"])
    try:
        return int(model.getFrameId(name))
    except ValueError:
        first, *others = (number for number, frame in enumerate(model.frames) if frame.name == name)
    one = model.frames[first]
    for other in (model.frames[number] for number in others):
        if other.parentJoint != one.parentJoint or not other.placement.isApprox(one.placement):
            raise ArgumentError(
                f"frame '{name}': {1 + len(others)} frames have this name, at different places; rename one of them"
            )
    return first
