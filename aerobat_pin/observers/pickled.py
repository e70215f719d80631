"""Observers as bytes: models in Pinocchio's binary form, as 4.0 cannot read its own text of composite joints."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from typing import Any

import pinocchio as pin


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
