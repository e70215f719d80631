"""An ideal attitude hold: a wrench on the body that stands for the laboratory's guard thrusters.

    torque, body axes:  sat(kp . log3(R^T R_ref) - kd . omega)         per axis: roll, pitch, yaw
    force, world axes:  x  sat(kx (vx_ref - vx)),   y  0,   z  lift + sat(kz (z_ref - z) - dz vz)

It acts at the body's centre of mass and is a known input of the observer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aerobat_pin.numerics import Array, kernel, shaped
from aerobat_pin.scenario import Scenario


@kernel
def rotation_vector(R: Array, out: Array) -> None:
    """Write log3 of a rotation (3, 3) into out (3,): axis times angle in [0, pi], by way of the unit quaternion."""
    # The largest of the four quaternion parts is found first: nothing is divided by a small number.
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
def saturated(value: float, limit: float) -> float:
    """Clip a number to [-limit, limit]."""
    return min(max(value, -limit), limit)


@kernel
def hold_wrench(hold: Array, world: Array, twist: Array, wrench: Array) -> None:
    """Write the hold's wrench at the body's centre of mass in body axes into wrench (6,), force first.

    Args:
        hold: `AttitudeHold.packed`.
        world: (12,) placement of the body's centre of mass: rotation by columns, position.
        twist: (6,) body twist in body axes.
        wrench: (6,) written.
    """
    error_rotation = hold[26:].reshape((3, 3))
    for i in range(3):
        for j in range(3):
            error_rotation[i, j] = 0.0
            for k in range(3):
                error_rotation[i, j] += world[3 * i + k] * hold[3 * k + j]
    rotation_vector(error_rotation, wrench[3:])
    for i in range(3):
        wrench[3 + i] = saturated(hold[9 + i] * wrench[3 + i] - hold[12 + i] * twist[3 + i], hold[15 + i])
    vx = world[0] * twist[0] + world[3] * twist[1] + world[6] * twist[2]
    vz = world[2] * twist[0] + world[5] * twist[1] + world[8] * twist[2]
    forward_speed, height, speed_gain, thrust_limit = hold[18], hold[19], hold[20], hold[21]
    lift, stiffness, damping, lift_limit = hold[22], hold[23], hold[24], hold[25]
    thrust = saturated(speed_gain * (forward_speed - vx), thrust_limit)
    rise = lift + saturated(stiffness * (height - world[11]) - damping * vz, lift_limit)
    for i in range(3):
        wrench[i] = world[3 * i] * thrust + world[3 * i + 2] * rise


@dataclass(frozen=True)
class AttitudeHold:
    """Gains and limits of the hold, and the flight it keeps.

    Attributes:
        rotation: (3, 3) attitude to keep, body to world.
        forward_speed: world x velocity to keep [m/s].
        height: world z to keep [m].
        attitude_stiffness, attitude_damping, torque_limit: (3,) [N m/rad], [N m s/rad], [N m].
        speed_gain, thrust_limit: [N s/m], [N].
        lift: constant upward force [N].
        height_stiffness, height_damping, lift_limit: [N/m], [N s/m], [N].
    """

    rotation: Array
    forward_speed: float
    height: float
    attitude_stiffness: Array
    attitude_damping: Array
    torque_limit: Array
    speed_gain: float
    thrust_limit: float
    lift: float
    height_stiffness: float
    height_damping: float
    lift_limit: float

    @property
    def packed(self) -> Array:
        """All of it as (35,) numbers for the kernel: rotation by rows, gains and limits in its order, scratch."""
        gains = (self.attitude_stiffness, self.attitude_damping, self.torque_limit)
        speed = (self.forward_speed, self.height, self.speed_gain, self.thrust_limit)
        height = (self.lift, self.height_stiffness, self.height_damping, self.lift_limit)
        return np.concatenate([np.ravel(self.rotation), *gains, speed, height, np.zeros(9)])

    def wrench(self, position: Array, rotation: Array, twist: Array) -> Array:
        """Return the wrench (6,) at the body's centre of mass in body axes, force first [N, N m].

        Args:
            position: (3,) body COM in world [m].
            rotation: (3, 3) body to world.
            twist: (6,) body twist in body axes [m/s, rad/s].

        Raises:
            ShapeError: an array does not fit.
        """
        wrench = np.empty(6)
        position, rotation = shaped(position, (3,), "position"), shaped(rotation, (3, 3), "rotation")
        twist = shaped(twist, (6,), "twist")
        hold_wrench(self.packed, np.concatenate([rotation.ravel(order="F"), position]), twist, wrench)
        return wrench


def hold_about(scenario: Scenario, rotation: Array) -> AttitudeHold | None:
    """Return a scenario's hold about its start, whose attitude is `rotation` (3, 3); None where nothing holds."""
    if scenario.hold is None:
        return None
    gains = scenario.hold
    return AttitudeHold(
        rotation=rotation,
        forward_speed=scenario.flight.velocity[0],
        height=scenario.flight.position[2],
        attitude_stiffness=np.array(gains.attitude_stiffness),
        attitude_damping=np.array(gains.attitude_damping),
        torque_limit=np.array(gains.torque_limit),
        speed_gain=gains.speed_gain,
        thrust_limit=gains.thrust_limit,
        lift=gains.lift,
        height_stiffness=gains.height_stiffness,
        height_damping=gains.height_damping,
        lift_limit=gains.lift_limit,
    )
