"""An ideal attitude hold: a wrench on the body that stands for the laboratory's guard thrusters.

    torque, body axes:  sat(kp . log3(R^T R_ref) - kd . omega)         per axis: roll, pitch, yaw
    force, world axes:  x  sat(kx (vx_ref - vx)),   y  0,   z  lift + sat(kz (z_ref - z) - dz vz)

It acts at the body's centre of mass and is a known input of the observer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from aerobat_pin.arrays import Array


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

    def wrench(self, position: Array, rotation: Array, twist: Array) -> Array:
        """Return the wrench (6,) at the body's centre of mass in body axes, force first [N, N m].

        Args:
            position: (3,) body COM in world [m].
            rotation: (3, 3) body to world.
            twist: (6,) body twist in body axes [m/s, rad/s].
        """
        velocity_W = rotation @ twist[:3]
        error = pin.log3(rotation.T @ self.rotation)
        torque = self.attitude_stiffness * error - self.attitude_damping * twist[3:]
        thrust = self.speed_gain * (self.forward_speed - velocity_W[0])
        rise = self.height_stiffness * (self.height - position[2]) - self.height_damping * velocity_W[2]
        force_W = np.array(
            [
                np.clip(thrust, -self.thrust_limit, self.thrust_limit),
                0.0,
                self.lift + np.clip(rise, -self.lift_limit, self.lift_limit),
            ]
        )
        return np.concatenate([rotation.T @ force_W, np.clip(torque, -self.torque_limit, self.torque_limit)])
