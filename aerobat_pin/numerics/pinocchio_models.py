"""Pinocchio's models: parsers that print their reasons to standard error and can leave parts out; frames; as bytes.

Bytes are in Pinocchio's binary form, as 4.0 cannot read its own text of composite joints.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import pinocchio as pin

from aerobat_pin.errors import ArgumentError, FrameNotFoundError, LogError
from aerobat_pin.numerics.arrays import Array

Loaded = TypeVar("Loaded")
LONGEST_REASON = 300  # characters
IN_STEPS = (
    "Write it as such joints, one after the other, with links without mass between them: a ball joint as three hinges, "
    "a planar one as two slides and a hinge"
)


def read_robot(path: Path, read: Callable[[], Loaded]) -> Loaded:
    """Call a function of Pinocchio that reads a robot's file.

    The path is for the message.

    Raises:
        LogError: with the parser's reasons, if it fails or leaves something out.
    """
    with tempfile.TemporaryFile() as said:
        stderr = os.dup(2)
        os.dup2(said.fileno(), 2)
        try:
            loaded, reason = read(), ""
        except Exception as error:  # of half a dozen kinds; an MJCF class that is missing is an IndexError
            reason = " ".join(str(error).rpartition("message: ")[2].partition("\nHint")[0].split()) or "no reason given"
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
        said.seek(0)
        lines = said.read().decode(errors="replace").splitlines()
    errors = [line.removeprefix("Error:").strip() for line in lines if line.startswith("Error:")]
    if errors or reason:
        raise LogError(f"robot {path}: Pinocchio cannot read it: {'; '.join(errors) or reason[:LONGEST_REASON]}")
    return loaded


def frame_jacobian(model: pin.Model, data: pin.Data, q: Array, frame: int, axes: pin.ReferenceFrame) -> Array:
    """Return the Jacobian (6, nv) of a frame at a configuration (nq,); Pinocchio's is (6,) for one velocity."""
    jacobian: Array = pin.computeFrameJacobian(model, data, q, frame, axes)
    return jacobian.reshape(6, model.nv)


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
    chosen = model.frames[first]
    for other in (model.frames[number] for number in others):
        if other.parentJoint != chosen.parentJoint or not other.placement.isApprox(chosen.placement):
            raise ArgumentError(
                f"frame '{name}': {1 + len(others)} frames have this name, at different places; rename one of them"
            )
    return first


def model_bytes(model: pin.Model) -> bytes:
    """Return a model in Pinocchio's binary form."""
    buffer = pin.serialization.StreamBuffer()
    model.saveToBinary(buffer)
    return bytes(buffer.tobytes())


def rebuilt(kind: Callable[..., Any], content: bytes, *arguments: Any) -> Any:
    """Return what `kind` makes of a stored model and further arguments."""
    model = pin.Model()
    with tempfile.NamedTemporaryFile() as file:  # Pinocchio reads no bytes, only what it wrote itself and files
        file.write(content)
        file.flush()
        model.loadFromBinary(file.name)
    return kind(model, *arguments)
