"""The committed files of the description through three independent readers, and the morphologies as plain values."""

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import pinocchio as pin
import pytest
import yourdfpy

import aerobat_description as description

PACKAGE = Path(description.PACKAGE_PATH)
URDF = {name: str(PACKAGE / "urdf" / f"{name}.urdf") for name in description.MORPHOLOGIES}
ROBOTS = pytest.mark.parametrize("name", description.MORPHOLOGIES)


@cache
def in_pinocchio(name: str) -> pin.Model:
    return pin.buildModelFromUrdf(URDF[name], pin.JointModelFreeFlyer())


@cache
def in_mujoco(name: str) -> mujoco.MjModel:
    """Read the committed URDF and its meshes with a free base."""
    spec = mujoco.MjSpec.from_file(URDF[name])
    spec.body("base_link").add_freejoint()
    return spec.compile()


@cache
def in_yourdfpy(name: str) -> yourdfpy.URDF:
    """Read the committed URDF and its meshes."""
    return yourdfpy.URDF.load(URDF[name])


@cache
def plain(name: str) -> dict[str, Any]:
    """Read a morphology's TOML with its parent's tables below it, without the package's own reader."""
    values = tomllib.loads((PACKAGE / "morphologies" / f"{name}.toml").read_text())
    base = plain(values["extends"]) if "extends" in values else {}
    tables = {key: base.get(key, {}) | value for key, value in values.items() if isinstance(value, dict)}
    return base | values | tables
