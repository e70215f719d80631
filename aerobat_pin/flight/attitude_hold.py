"""The attitude hold: an ideal controller that replaces the thrusters on the laboratory's protective cage (the guard).

    torque, body axes:  sat(kp . f log3(R^T R_ref) - kd . omega)       per axis: roll, pitch, yaw
    force, world axes:  x  sat(kx (vx_ref - vx)),   y  0,   z  lift + sat(kz (z_ref - z) - dz vz)

The controller's wrench acts at the body's centre of mass and is a known input of the observer. `sat` clips each
component to its limit; `log3` is the rotation vector. The factor f is 1 for errors up to 90 deg and falls smoothly to 0
at 180 deg: there log3 changes its sign, and a torque with such a jump would depend on the integrator's step. Any
continuous attitude law vanishes somewhere beside the reference (Bhat and Bernstein, Systems and Control Letters 39,
2000). The kink where a component reaches its limit remains: a flight that passes it converges with order two to three
in the step, and with order four where the limits are wide.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from aerobat_pin.numerics import Array, kernel, saturated
from aerobat_pin.scenario import Scenario


@kernel
def rotation_vector(R: Array, out: Array) -> None:
    """Write the rotation vector log3(R) of a rotation (3, 3) into out (3,): unit axis times angle in [0, pi]."""
    # The largest component of the unit quaternion is computed first, so that no division is by a small number.
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    if trace > 0.0:
        w = 0.5 * np.sqrt(1.0 + trace)
        x, y, z = ((R[2, 1] - R[1, 2]) / (4 * w), (R[0, 2] - R[2, 0]) / (4 * w), (R[1, 0] - R[0, 1]) / (4 * w))
    elif R[0, 0] >= R[1, 1] and R[0, 0] >= R[2, 2]:
        x = 0.5 * np.sqrt(1.0 + R[0, 0] - R[1, 1] - R[2, 2])
        w, y, z = ((R[2, 1] - R[1, 2]) / (4 * x), (R[0, 1] + R[1, 0]) / (4 * x), (R[0, 2] + R[2, 0]) / (4 * x))
    elif R[1, 1] >= R[2, 2]:
        y = 0.5 * np.sqrt(1.0 - R[0, 0] + R[1, 1] - R[2, 2])
        w, x, z = ((R[0, 2] - R[2, 0]) / (4 * y), (R[0, 1] + R[1, 0]) / (4 * y), (R[1, 2] + R[2, 1]) / (4 * y))
    else:
        z = 0.5 * np.sqrt(1.0 - R[0, 0] - R[1, 1] + R[2, 2])
        w, x, y = ((R[1, 0] - R[0, 1]) / (4 * z), (R[0, 2] + R[2, 0]) / (4 * z), (R[1, 2] + R[2, 1]) / (4 * z))
    sine = np.sqrt(x * x + y * y + z * z)
    factor = 2.0 if sine < 1e-12 else 2.0 * np.arctan2(sine, abs(w)) / sine
    if w < 0.0:
        factor = -factor
    out[0], out[1], out[2] = factor * x, factor * y, factor * z


@kernel
def attitude_error(R: Array, out: Array) -> None:
    """Write the hold's attitude error f log3(R) (3,) for an error rotation R (3, 3).

    f is 10 s^3 - 15 s^4 + 6 s^5 with s = 2 - angle / 90 deg, so that the error is twice continuously differentiable.
    """
    rotation_vector(R, out)
    s = 2.0 - np.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2]) / (0.5 * np.pi)
    if s < 1.0:
        factor = s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
        for i in range(3):
            out[i] *= factor


class AttitudeHold(NamedTuple):
    """Reference values, gains and limits of the attitude hold, as numbers or as views of a kernel's memory.

    References: `rotation` (3, 3) is the attitude, body to world, `forward_speed` the velocity along world x [m/s],
    `height` the world z [m]. Attitude, each (3,): `attitude_stiffness` [N m/rad], `attitude_damping` [N m s/rad],
    `torque_limit` [N m]. Speed: `speed_gain` [N s/m], `thrust_limit` [N]. Height: `lift`, the constant upward force
    [N], `height_stiffness` [N/m], `height_damping` [N s/m], `lift_limit` [N].
    """

    rotation: Annotated[Array, "3, 3"]
    forward_speed: Annotated[Any, ""]
    height: Annotated[Any, ""]
    attitude_stiffness: Annotated[Array, "3"]
    attitude_damping: Annotated[Array, "3"]
    torque_limit: Annotated[Array, "3"]
    speed_gain: Annotated[Any, ""]
    thrust_limit: Annotated[Any, ""]
    lift: Annotated[Any, ""]
    height_stiffness: Annotated[Any, ""]
    height_damping: Annotated[Any, ""]
    lift_limit: Annotated[Any, ""]


@kernel
def hold_wrench(hold: AttitudeHold, world: Array, twist: Array, error_rotation: Array, wrench: Array) -> None:
    """Write the attitude hold's wrench (6,) [N, N m] on the body, at its centre of mass and in body axes.

    `world` (12,) is the placement of the body's centre of mass, rotation by columns, then position, `twist` (6,) is in
    body axes; `error_rotation` (3, 3), R^T R_ref, the reference attitude as seen from the body, is written, too.
    """
    target, limit = hold.rotation, hold.torque_limit
    stiffness, damping = hold.attitude_stiffness, hold.attitude_damping
    vx = world[0] * twist[0] + world[3] * twist[1] + world[6] * twist[2]
    vz = world[2] * twist[0] + world[5] * twist[1] + world[8] * twist[2]
    thrust = saturated(hold.speed_gain[()] * (hold.forward_speed[()] - vx), hold.thrust_limit[()])
    push = hold.height_stiffness[()] * (hold.height[()] - world[11]) - hold.height_damping[()] * vz
    rise = hold.lift[()] + saturated(push, hold.lift_limit[()])
    for i in range(3):
        for j in range(3):
            error_rotation[i, j] = 0.0
            for k in range(3):
                error_rotation[i, j] += world[3 * i + k] * target[k, j]
    attitude_error(error_rotation, wrench[3:])
    for i in range(3):
        wrench[3 + i] = saturated(stiffness[i] * wrench[3 + i] - damping[i] * twist[3 + i], limit[i])
        wrench[i] = world[3 * i] * thrust + world[3 * i + 2] * rise


def hold_about(scenario: Scenario, rotation: Array) -> AttitudeHold | None:
    """Return a scenario's attitude hold, or None if it has none.

    The hold keeps the attitude `rotation` (3, 3), and the x velocity and height of the scenario's start.
    """
    if scenario.hold is None:
        return None
    return AttitudeHold(
        rotation=rotation,
        forward_speed=scenario.flight.velocity[0],
        height=scenario.flight.position[2],
        **{name: np.array(value) for name, value in scenario.hold if name in AttitudeHold._fields},
    )
