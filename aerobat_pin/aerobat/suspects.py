"""What may change from day to day about Aerobat, and what it would change in the belief about a flight.

| cause | parameters |
|---|---|
| `crank_zero` | by how much the crank's angle is recorded too small [rad] |
| `air_density` | relative change of the air's density, and of the learnt error with it: most of it is the air's |
| `compliance` | flexibility c of both elbows, angle behind the linkage's per torque; c T, T the lag of a damper |
| `payload` | mass at the body, and mass times place in body axes; a steady force on the body looks the same |

Where the joints of a log are those that the linkage makes of the crank's angle, they share its zero, and do not show a
link that bends. Where they are measured, the crank's zero is that of the phase alone, and nothing bends unseen.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin

from aerobat_pin.numerics import Array
from aerobat_pin.observers import low_passed, typical_step
from aerobat_pin.records import Block, Suspect
from aerobat_pin.robot import Aerobat

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


def aerobat_suspects(kind: str) -> Mapping[str, tuple[Suspect, ...]]:
    """Return the causes that a flight can show, by the kind of known torque."""
    return {name: group for name, group in SUSPECTS.items() if name != "compliance" or kind == "measured"}


def carrying(model: pin.Model, load: Array) -> pin.Model:
    """Return a model whose body has a point mass more: mass [kg] and mass times place (4,) [kg m], body axes."""
    loaded, own = model.copy(), model.inertias[1].toDynamicParameters()
    loaded.inertias[1] = pin.Inertia.FromDynamicParameters(own + np.concatenate([load, np.zeros(6)]))
    return loaded


def crank_turned(block: Block, robot: Aerobat, angle: float) -> Block:
    """Return a block whose crank was an angle [rad] further, and with it the joints that it drives."""
    crank = block.extra["crank"]
    q, v = block.q.copy(), block.v.copy()
    for sign, turn in ((-1.0, 0.0), (1.0, angle)) if follows(block, robot) else ():
        closure = robot.linkage.solve(crank[0] + turn, crank[1])
        angles = np.stack([closure.theta_s, closure.theta_e] * 2, axis=1)
        rates = np.stack([closure.theta_s_dot, closure.theta_e_dot] * 2, axis=1)
        q[:, list(robot.idx_q)] += sign * angles
        v[:, list(robot.idx_v)] += sign * rates
    return replace(block, q=q, v=v, extra={**block.extra, "crank": crank + np.array([[angle], [0.0], [0.0]])})


def follows(block: Block, robot: Aerobat) -> bool:
    """Return whether the joints are those that the closed linkage makes of the crank's angle, and not measured ones."""
    closure = robot.linkage.solve(block.extra["crank"][0])
    apart = block.q[:, list(robot.idx_q)] - np.stack([closure.theta_s, closure.theta_e] * 2, axis=1)
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
    q, v = block.q.copy(), block.v.copy()
    q[:, list(robot.idx_q)] += bend
    v[:, list(robot.idx_v)] += np.gradient(bend, block.time, axis=0)
    return replace(block, q=q, v=v)
