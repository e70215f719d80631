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

from aerobat_pin.aerobat.aerobat import Aerobat
from aerobat_pin.aerobat.motion import time_slope
from aerobat_pin.aerobat.prescribed_joints import joint_table
from aerobat_pin.numerics import Array
from aerobat_pin.observers import low_passed, typical_step
from aerobat_pin.records import Block, Parameter, Suspect
from aerobat_pin.scenario import AirSection

DISTAL = ("left_elbow", "right_elbow")  # joints that carry the outer wings


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
JOINT_RATES = slice(6, 10)
ELBOWS = np.array([0.0, 1.0, 0.0, 1.0])
LEAST_LAG = 0.004  # [s]: of a link behind its torque; a shorter one makes no difference to forces
FOLLOWING = np.radians(0.3)  # rms angle by which joints that follow from the crank's angle may differ from it
SUSPECTS = {
    "crank_zero": (Suspect("angle", 2e-3, 180.0 / np.pi, "deg"),),
    "air_density": (Suspect("change", 0.02, 100.0, "%", of_error=True),),
    "compliance": (Suspect("elbows", 0.2, 1.0, "rad/(N m)"), Suspect("their lag times that", 2e-3, 1.0, "rad s/(N m)")),
    "payload": (
        Suspect("mass", 1e-3, 1e3, "g", inertial=True),
        *(Suspect(f"mass times {axis}", 1e-5, 1e6, "g mm", inertial=True) for axis in "xyz"),
    ),
}


def changed_belief(robot: Aerobat, air: AirSection, values: Mapping[str, float]) -> tuple[Aerobat, AirSection]:
    """Return robot and air with changed parameters; those not named, and `thruster_scale`, change nothing here.

    Raises MorphologyFileError if no robot can have these values.
    """
    get = values.get
    slope = 1.0 + get("lift_slope", 0.0)
    drag, shape = (1.0 + get("drag", 0.0)) / slope, robot.morphology
    changes: dict[str, Any] = {}
    if get("wing_offset", 0.0) != 0.0:
        changes["wing"] = {"offset_x": shape.wing.offset_x + values["wing_offset"]}
    if drag != 1.0:
        coefficients = shape.aerodynamics
        changes["aerodynamics"] = {
            "profile_drag": drag * coefficients.profile_drag,
            "body_drag_area": drag * coefficients.body_drag_area,
        }
    changed = robot.with_changes(changes) if changes else robot
    changed = replace(changed, model=_other_masses(changed.model, robot.model, values))
    density = air.density * (1.0 + get("density", 0.0)) * slope
    added = air.added_mass * (1.0 + get("added_mass", 0.0)) / slope
    return changed, air.model_copy(update={"density": density, "added_mass": added})


def _other_masses(model: pin.Model, original: pin.Model, values: Mapping[str, float]) -> pin.Model:
    """Return a copy of a model with the inertias of another of the same joints, changed by the parameters."""
    changed = model.copy()
    shift = np.array([values.get(f"com_{axis}", 0.0) for axis in "xyz"])
    for i, name in enumerate(original.names.tolist()):
        factor = (1.0 + values.get("mass", 0.0)) * (1.0 + values.get("distal_mass", 0.0) * (name in DISTAL))
        inertia = original.inertias[i]
        lever = inertia.lever + shift * (i == 1)
        changed.inertias[i] = pin.Inertia(factor * inertia.mass, lever, factor * inertia.inertia)
    return changed


def carrying(model: pin.Model, load: Array) -> pin.Model:
    """Return a model whose body has a point mass more: mass [kg] and mass times place (4,) [kg m], body axes."""
    loaded, (mass, moment) = model.copy(), (float(load[0]), np.asarray(load[1:]))
    second = np.outer(moment, moment) / mass if mass else np.zeros((3, 3))  # a moment without a mass turns nothing
    inertia = (np.trace(second) * np.eye(3) - second)[np.tril_indices(3)]  # xx, xy, yy, xz, yz, zz
    parameters = model.inertias[1].toDynamicParameters() + np.concatenate([load, inertia])
    loaded.inertias[1] = pin.Inertia.FromDynamicParameters(parameters)
    return loaded


def crank_turned(block: Block, robot: Aerobat, angle: float) -> Block:
    """Return a block whose crank was an angle [rad] further, and with it the joints that it drives."""
    crank = block.extra["crank"]
    q, v = block.q.copy(), block.v.copy()
    if follows(block, robot):
        before, after = (joint_table(robot.linkage.solve(crank[0] + turn, crank[1])) for turn in (0.0, angle))
        change = np.tile(after - before, 2)  # both wings move alike
        q[:, list(robot.idx_q)] += change[:, 0]
        v[:, list(robot.idx_v)] += change[:, 1]
    return replace(block, q=q, v=v, extra={**block.extra, "crank": crank + np.array([[angle], [0.0], [0.0]])})


def follows(block: Block, robot: Aerobat) -> bool:
    """Return whether the joints are those that the closed linkage makes of the crank's angle, and not measured ones."""
    driven = joint_table(robot.linkage.solve(block.extra["crank"][0]))[:, 0]
    apart = block.q[:, list(robot.idx_q)] - np.tile(driven, 2)
    return bool(np.sqrt(np.mean(apart**2)) < FOLLOWING)


def flexed(block: Block, robot: Aerobat, values: Array) -> Block:
    """Return a block whose elbows bend by b, T b' + b = c tau: a spring and a damper carry their torque.

    `values` are c and c T. Where T is not above `LEAST_LAG` L, as about c = 0, b has the same first two terms in slow
    torques, behind a lag of L.
    """
    c, lagging = values
    lag = max(lagging / c, LEAST_LAG) if c > 0.0 else LEAST_LAG
    direct, torque = c - lagging / lag, block.tau[:, JOINT_RATES]
    now = np.concatenate([torque[:1], 0.5 * (torque[1:] + torque[:-1]), torque[-1:]])
    late = low_passed(torque - torque[0], -np.expm1(-typical_step(block.time) / lag)) + torque[0]
    bend = direct * now + (c - direct) * np.concatenate([torque[:1], late])
    bend = -bend * ELBOWS if follows(block, robot) else np.zeros_like(bend)
    q, v, rate = block.q.copy(), block.v.copy(), time_slope(bend, block.time, 1)
    q[:, list(robot.idx_q)] += bend
    v[:, list(robot.idx_v)] += rate
    return replace(block, q=q, v=v, extra={**block.extra, "bend": np.stack([bend, rate])})
