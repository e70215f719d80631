"""What a reader found in forces.mcap, beside what mcap_reference.py says: forces, and both ends of each arrow."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

LARGEST_ERROR = 1e-9  # [N, m]
LENGTHS = ("shaft_length", "head_length")  # of an arrow


def part_of(message: Any, path: str) -> Any:
    """Return a part of a message, whose fields are attributes or keys."""
    for name in path.split("."):
        message = message[name] if isinstance(message, dict) else getattr(message, name)
    return message


def numbers(message: Any, path: str, names: Iterable[str] = "xyz") -> list[float]:
    """Return the numbers of a vector or quaternion, whose path ends with a dot."""
    return [part_of(message, path + name) for name in names]


def compared(folder: Path, messages: Iterable[tuple[str, Any]]) -> str:
    """Return in words what was found. Raises ValueError if anything is missing or wrong.

    Args:
        folder: where forces.json is.
        messages: topic and message of all that a reader found.
    """
    said = json.loads((folder / "forces.json").read_text())
    errors, found, arrows = [0.0], 0, 0
    for topic, message in messages:
        if topic in said:
            force, *_ = said[topic][_stamp(part_of(message, "header.stamp"))]
            errors += [abs(a - b) for a, b in zip(numbers(message, "wrench.force."), force, strict=True)]
            found += 1
        if topic == "/scene":
            for entity in part_of(message, "entities"):
                _, *ends = said[part_of(entity, "id")][_stamp(part_of(entity, "timestamp"))]
                (arrow,) = part_of(entity, "arrows")
                start, length = numbers(arrow, "pose.position."), sum(numbers(arrow, "", LENGTHS))
                x, y, z, w = numbers(arrow, "pose.orientation.", "xyzw")
                along = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
                own = [*start, *(a + length * b for a, b in zip(start, along, strict=True))]
                errors += [abs(a - b) for a, b in zip(own, ends[0] + ends[1], strict=True)]
                arrows += 1
    if found != sum(map(len, said.values())) or not arrows or not max(errors) < LARGEST_ERROR:
        raise ValueError(f"{found} forces, {arrows} arrows, off by {max(errors):.0e}")
    return f"{found} forces and {arrows} arrows (`SceneUpdate`) as written, to {max(errors):.0e} N, m"


def _stamp(time: Any) -> str:
    return str(10**9 * part_of(time, "sec") + part_of(time, "nanosec"))
