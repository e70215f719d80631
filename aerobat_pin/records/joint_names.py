"""How a log calls the joints of a robot: a list, of its columns, or a table that renames those of a topic."""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Iterable, Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator

LIKENESS = 0.6  # of names, from which one is suggested for the other


def _checked_names(given: Any) -> Any:
    """Return a list of texts, or a table of texts. Raises ValueError for anything else."""
    texts = (*given, *given.values()) if isinstance(given, Mapping) else given
    if not isinstance(texts, list | tuple) or not all(isinstance(text, str) for text in texts):
        raise ValueError("joints.names: a list of joints, or a table {name in the topic = joint}, was expected")
    if isinstance(given, Mapping) and len(set(given.values())) < len(given):
        raise ValueError("joints.names: each joint once was expected")
    return given


JointNames = Annotated[tuple[str, ...] | dict[str, str], BeforeValidator(_checked_names)]


def listed_joints(names: tuple[str, ...] | dict[str, str]) -> tuple[str, ...]:
    """Return the joints of the columns in their order; none where names of a topic are changed."""
    return () if isinstance(names, dict) else names


def renamed_joints(names: tuple[str, ...] | dict[str, str]) -> dict[str, str]:
    """Return name in the topic -> joint, for those that differ."""
    return names if isinstance(names, dict) else {}


def nearest_joints(heard: Iterable[str], joints: Iterable[str]) -> dict[str, str]:
    """Return name in the topic -> the joint with the most similar name, each once, as far as names are alike."""

    def plain(name: str) -> str:
        return re.sub("[^a-z0-9]", "", name.lower().removesuffix("_joint"))

    plain_names, nearest = {plain(name): name for name in heard}, {}
    for joint in joints:
        for close in difflib.get_close_matches(plain(joint), plain_names, n=1, cutoff=LIKENESS):
            nearest[plain_names.pop(close)] = joint
    return nearest


def as_names(renamed: Mapping[str, str]) -> str:
    """Return the line of a map that renames joints."""
    pairs = (f"{json.dumps(name, ensure_ascii=False)} = {json.dumps(joint)}" for name, joint in renamed.items())
    return f"names = {{{', '.join(pairs)}}}"
