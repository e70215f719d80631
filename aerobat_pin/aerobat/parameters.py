"""The parameters of a belief that flights can identify, and a belief in which they have other values.

| parameter | what changes |
|---|---|
| `mass` | all masses and inertias, by one factor |
| `distal_mass` | masses and inertias of the outer wings |
| `com_x`, `com_y`, `com_z` | the body's centre of mass, in body axes [m] |
| `wing_offset` | x of the whole wing [m], as `wing.offset_x` |
| `density` | density of the air, and with it every aerodynamic force |
| `lift_slope` | circulatory lift alone: density by this factor, drag and added mass by its inverse |
| `drag` | profile drag of the strips and drag of the body |
| `added_mass` | the wings' added mass, as `air.added_mass` |
| `thruster_scale` | the known force of thrusters |

A factor is given as its change, so 0.05 is 5 % more than believed, and zero leaves a parameter as it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from aerobat_pin.numerics import Array
from aerobat_pin.records import Parameter
from aerobat_pin.robot import Aerobat
from aerobat_pin.scenario import AirSection

DISTAL = ("left_elbow", "right_elbow")  # joints that carry the outer wings
SCALED_FORCE = "thrusters"  # the known force that `thruster_scale` changes


PARAMETERS = {
    "mass": Parameter("1", 0.1, usual=True, inertial=True),
    "distal_mass": Parameter("1", 0.2, usual=True, inertial=True),
    "com_x": Parameter("m", 5e-3, usual=True, inertial=True),
    "com_y": Parameter("m", 5e-3, inertial=True),
    "com_z": Parameter("m", 5e-3, usual=True, inertial=True),
    "wing_offset": Parameter("m", 1e-2, usual=True),
    "density": Parameter("1", 0.2, usual=True),
    "lift_slope": Parameter("1", 0.2, usual=True),
    "drag": Parameter("1", 0.5, usual=True),
    "added_mass": Parameter("1", 0.3, usual=True),
    "thruster_scale": Parameter("1", 0.1),
}


def changed_belief(robot: Aerobat, air: AirSection, values: Mapping[str, float]) -> tuple[Aerobat, AirSection]:
    """Return robot and air with changed parameters.

    Args:
        robot: the believed robot.
        air: the believed air.
        values: parameter -> change; parameters that are not named, and `thruster_scale`, change nothing here.

    Raises:
        MorphologyFileError: no robot can have these values.
    """
    get = values.get
    slope = 1.0 + get("lift_slope", 0.0)
    drag, shape = (1.0 + get("drag", 0.0)) / slope, robot.morphology
    changes: dict[str, Any] = {}
    if get("wing_offset", 0.0) != 0.0:
        changes["wing"] = {"offset_x": shape.wing.offset_x + values["wing_offset"]}
    if drag != 1.0:
        own = shape.aerodynamics
        changes["aerodynamics"] = {
            "profile_drag": drag * own.profile_drag,
            "body_drag_area": drag * own.body_drag_area,
        }
    changed = robot.with_changes(changes) if changes else robot
    changed = replace(changed, model=_other_masses(changed.model, robot.model, values))
    density = air.density * (1.0 + get("density", 0.0)) * slope
    added = air.added_mass * (1.0 + get("added_mass", 0.0)) / slope
    return changed, air.model_copy(update={"density": density, "added_mass": added})


def scaled_thrusters(known: Mapping[str, Array], change: float) -> dict[str, Array]:
    """Return known forces with those of thrusters changed by `thruster_scale`."""
    factor = 1.0 + change
    return {name: factor * force if name == SCALED_FORCE else force for name, force in known.items()}


def _other_masses(model: pin.Model, own: pin.Model, values: Mapping[str, float]) -> pin.Model:
    """Return a copy of a model with the inertias of another of the same joints, changed by the parameters."""
    changed = model.copy()
    shift = np.array([values.get(f"com_{axis}", 0.0) for axis in "xyz"])
    for i, name in enumerate(own.names.tolist()):
        factor = (1.0 + values.get("mass", 0.0)) * (1.0 + values.get("distal_mass", 0.0) * (name in DISTAL))
        inertia = own.inertias[i]
        lever = inertia.lever + shift * (i == 1)
        changed.inertias[i] = pin.Inertia(factor * inertia.mass, lever, factor * inertia.inertia)
    return changed
