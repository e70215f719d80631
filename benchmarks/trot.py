"""A robot with four legs that trots in MuJoCo: how it moves, what its motors do, and what its feet feel.

The controller is a plain one: forces of the feet on the ground that hold height, speed and attitude (least squares),
feet in the air on arcs to where the speed asks for them (Raibert 1986).
"""

from dataclasses import dataclass

import mujoco
import numpy as np
import pinocchio as pin

from aerobat_pin import load_robot
from aerobat_pin.numerics import Array

STEP, CONTROL, SAMPLE = 5e-4, 1e-3, 2e-3  # [s]
FOOT_RADIUS, FRICTION = 0.022, 0.8
HEIGHT = 0.30  # [m] of the trunk
LIFT = 0.06  # [m] of a foot in the air
MOTOR_LAG = 1.5e-3  # [s]
DRAG = 0.15  # [N m]: Coulomb friction of each joint, of which nobody knows
ROBOT = "go2"


@dataclass(frozen=True)
class Gait:
    """When which foot is on the ground, and how fast the robot goes.

    Attributes:
        name: its name.
        offsets: phase of each foot at which it touches the ground [periods].
        duty: share of the period on the ground.
        period: of a step [s].
        speeds: forward speeds, each for the same share of the time [m/s].
        push: force on the trunk to the left [N] for 0.3 s in every 3 s.
    """

    name: str
    offsets: tuple[float, ...] = (0.0, 0.5, 0.5, 0.0)
    duty: float = 0.55
    period: float = 0.45
    speeds: tuple[float, ...] = (0.3, 0.55, 0.8)
    push: float = 0.0


TROT = Gait("trot")
WALK = Gait("walk", (0.0, 0.5, 0.75, 0.25), 0.7, 0.5, (0.15, 0.25))  # slower it sways until its knees swing over
FAST_TROT = Gait("running trot", duty=0.48, period=0.36, speeds=(0.8, 1.2))


@dataclass(frozen=True)
class Walked:
    """Samples each 2 ms: time (m + 1,), q, v, tau of the motors, accelerometer (means), and forces on feet (means).

    Attributes:
        time: (m + 1,) [s].
        q: (m + 1, 19) placement of the trunk and joint angles.
        v: (m + 1, 18) twist in body axes and joint rates.
        tau: (m + 1, 12) torque of the motors at the links [N m].
        felt: (m + 1, 3) mean specific force since the sample before [m/s2], body axes.
        force: (m, 4, 3) mean force on each foot [N], world axes.
    """

    time: Array
    q: Array
    v: Array
    tau: Array
    felt: Array
    force: Array


def mjcf(model: pin.Model, feet: tuple[str, ...]) -> str:
    """Return a robot as MJCF: its inertias and joints, spheres for feet, and a floor."""

    def words(values: Array) -> str:
        return " ".join(f"{value:.10g}" for value in values)

    def body(joint: int) -> str:
        inertia, place = model.inertias[joint], model.jointPlacements[joint]
        turn = pin.Quaternion(place.rotation)
        at = f'pos="{words(place.translation)}" quat="{turn.w} {turn.x} {turn.y} {turn.z}"'
        if joint == 1:
            own = '<freejoint/><site name="imu"/>'
        else:
            axis = words(np.eye(3)["XYZ".index(model.joints[joint].shortname()[-1])])
            own = f'<joint name="{model.names[joint]}" axis="{axis}"/>'
        full = words(inertia.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
        own += f'<inertial pos="{words(inertia.lever)}" mass="{inertia.mass}" fullinertia="{full}"/>'
        for foot in feet:
            frame = model.frames[model.getFrameId(foot)]
            if frame.parentJoint == joint:
                shape = f'type="sphere" size="{FOOT_RADIUS}" mass="0" friction="{FRICTION} 0.01 0.001"'
                own += f'<geom name="{foot}" {shape} pos="{words(frame.placement.translation)}"/>'
        below = "".join(body(child) for child in model.children[joint])
        return f'<body name="{model.names[joint]}" {at}>{own}{below}</body>'

    motors = "".join(f'<motor joint="{name}"/>' for name in model.names.tolist()[2:])
    return (
        f'<mujoco><option timestep="{STEP}" integrator="implicitfast" cone="elliptic" impratio="10"/>'
        f'<worldbody><geom name="floor" type="plane" size="0 0 1" friction="{FRICTION} 0.01 0.001"/>{body(1)}'
        f"</worldbody><actuator>{motors}</actuator>"
        '<sensor><accelerometer site="imu"/></sensor></mujoco>'
    )


class Trotter:
    """The controller: torques of the motors from the true state."""

    def __init__(self, model: pin.Model, feet: tuple[str, ...], gait: Gait, duration: float) -> None:
        self.model, self.data, self.gait, self.duration = model, model.createData(), gait, duration
        self.frames = [model.getFrameId(foot) for foot in feet]
        self.mass = pin.computeTotalMass(model)
        q = stance(model)
        pin.framesForwardKinematics(model, self.data, q)
        self.hips = np.array([self.data.oMf[frame].translation - q[:3] for frame in self.frames])
        self.lifted = self.hips + q[:3]
        self.swung = np.zeros(4, bool)

    def torque(self, time: float, q: Array, v: Array) -> Array:
        """Return the torque (12,) of the motors [N m] at a time [s]."""
        model, data, gait = self.model, self.data, self.gait
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        gravity = pin.computeGeneralizedGravity(model, data, q)
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        J = [pin.getFrameJacobian(model, data, frame, axes)[:3] for frame in self.frames]
        places = np.array([data.oMf[frame].translation for frame in self.frames])
        R = pin.Quaternion(q[3:7]).matrix()
        speed, spin = R @ v[:3], R @ v[3:6]
        ahead = R[:, 0] / np.linalg.norm(R[:2, 0])
        wanted = gait.speeds[min(int(time / self.duration * len(gait.speeds)), len(gait.speeds) - 1)]
        wanted *= min(1.0, time / 1.0)
        target = np.array([wanted * ahead[0], wanted * ahead[1], 0.0])
        phase = (time / gait.period + np.array(gait.offsets)) % 1.0
        ground = phase < gait.duty if time > 0.5 else np.ones(4, bool)
        tau = np.zeros(model.nv)
        standing = np.flatnonzero(ground)
        if len(standing):
            force = self._stand(standing, places, q, R, speed, spin, target)
            for foot, f in zip(standing, force, strict=True):
                tau -= J[foot].T @ f
        for foot in np.flatnonzero(~ground):
            if not self.swung[foot]:
                self.lifted[foot] = places[foot]
            s = (phase[foot] - gait.duty) / (1.0 - gait.duty)
            hip = q[:3] + R @ np.array([*self.hips[foot, :2], 0.0])
            reach = 0.5 * gait.duty * gait.period * speed + 0.12 * (speed - target)
            end = np.array([*(hip + reach)[:2], FOOT_RADIUS - 0.004])
            blend = 0.5 - 0.5 * np.cos(np.pi * s)
            rate = 1.0 / ((1.0 - gait.duty) * gait.period)
            at = self.lifted[foot] + blend * (end - self.lifted[foot])
            at[2] += LIFT * np.sin(np.pi * s)
            moving = 0.5 * np.pi * np.sin(np.pi * s) * rate * (end - self.lifted[foot])
            moving[2] += LIFT * np.pi * np.cos(np.pi * s) * rate
            f = 700.0 * (at - places[foot]) + 22.0 * (moving - J[foot] @ v)
            leg = slice(6 + 3 * foot, 9 + 3 * foot)
            tau[leg] += (J[foot].T @ f)[leg] + gravity[leg]
        self.swung = ~ground
        return np.asarray(np.clip(tau[6:], -40.0, 40.0))

    def _stand(
        self, standing: Array, places: Array, q: Array, R: Array, speed: Array, spin: Array, target: Array
    ) -> Array:
        """Return the forces (n, 3) of the ground on feet that stand."""
        roll, pitch, yaw = pin.rpy.matrixToRpy(R)
        push = np.array([0.0, 0.0, 9.81 + 120.0 * (HEIGHT - q[2]) - 14.0 * speed[2]])
        push += 5.0 * (target - speed) * [1.0, 1.0, 0.0]
        push[1] -= 2.0 * q[1]
        turn = np.array([-120.0 * roll - 12.0 * spin[0], -120.0 * pitch - 12.0 * spin[1], -30.0 * yaw - 8.0 * spin[2]])
        inertia = np.array([0.12, 0.3, 0.35])
        wrench = np.concatenate([self.mass * push, inertia * turn])
        arms = places[standing] - q[:3]
        A = np.vstack([np.tile(np.eye(3), len(standing)), np.hstack([pin.skew(arm) for arm in arms])])
        weight = np.array([1.0, 1.0, 1.0, 10.0, 10.0, 3.0])
        B = A * weight[:, None]
        force = np.linalg.solve(B.T @ B + 1e-3 * np.eye(B.shape[1]), B.T @ (weight * wrench)).reshape(-1, 3)
        force[:, 2] = np.clip(force[:, 2], 8.0, 250.0)
        side = np.minimum(1.0, 0.6 * force[:, 2] / np.maximum(np.linalg.norm(force[:, :2], axis=1), 1e-9))
        force[:, :2] *= side[:, None]
        return np.asarray(force)


def stance(model: pin.Model) -> Array:
    """Return the configuration (nq,) in which the robot stands."""
    q = pin.neutral(model)
    q[2] = HEIGHT
    q[7:] = np.tile([0.0, 0.78, -1.57], 4)
    return np.asarray(q)


def walked(gait: Gait, duration: float) -> Walked:
    """Let the robot walk for some seconds. RuntimeError if it falls."""
    model = load_robot(ROBOT).model
    feet = feet_of(model)
    simulated = mujoco.MjModel.from_xml_string(mjcf(model, feet))
    state = mujoco.MjData(simulated)
    geoms = {simulated.geom(foot).id: k for k, foot in enumerate(feet)}
    start = stance(model)
    state.qpos[:] = [*start[:3], start[6], *start[3:6], *start[7:]]
    data = model.createData()
    pin.framesForwardKinematics(model, data, start)
    state.qpos[2] += FOOT_RADIUS - min(data.oMf[model.getFrameId(foot)].translation[2] for foot in feet)
    controller, steps = Trotter(model, feet, gait, duration), round(duration / STEP)
    samples, felt, force = [], [], []
    command, tau = np.zeros(12), np.zeros(12)
    trunk = simulated.body(model.names[1]).id
    for step in range(steps + 1):
        q, v = _pin_state(state)
        if q[2] < 0.15 or q[9::3].max() > 0.0:  # there is no stop at a straight knee
            raise RuntimeError(f"{gait.name}: the robot fell at {state.time:.2f} s")
        if step % round(CONTROL / STEP) == 0:
            command = controller.torque(state.time, q, v)
        if step % round(SAMPLE / STEP) == 0:
            samples.append((state.time, q, v, tau.copy()))
        before = tau.copy()
        tau += STEP / MOTOR_LAG * (command - tau)
        state.xfrc_applied[trunk, 1] = gait.push if 2.0 <= state.time % 3.0 < 2.3 else 0.0
        state.ctrl[:] = 0.5 * (before + tau) - DRAG * np.tanh(v[6:] / 0.02)
        mujoco.mj_step(simulated, state)
        felt.append(state.sensordata[:3].copy())
        force.append(_foot_forces(simulated, state, geoms))
    shape = len(samples) - 1, round(SAMPLE / STEP)
    felt, force = (np.reshape(one[:-1], (*shape, *one[0].shape)).mean(axis=1) for one in (felt, force))
    return Walked(*map(np.array, zip(*samples, strict=True)), np.concatenate([felt[:1], felt]), force)


def _foot_forces(model: mujoco.MjModel, state: mujoco.MjData, geoms: dict[int, int]) -> Array:
    """Return the forces (4, 3) of the floor, the first shape of the file, on the feet."""
    force, wrench = np.zeros((4, 3)), np.zeros(6)
    for k, contact in enumerate(state.contact):
        mujoco.mj_contactForce(model, state, k, wrench)
        first, foot = contact.geom.tolist()
        if first == 0:
            force[geoms[foot]] += contact.frame.reshape(3, 3).T @ wrench[:3]
    return force


def _pin_state(state: mujoco.MjData) -> tuple[Array, Array]:
    """Return q and v as Pinocchio has them: x, y, z, w, and the twist in body axes."""
    p, v = state.qpos, state.qvel
    q = np.concatenate([p[:3], p[4:7], p[3:4], p[7:]])
    R = pin.Quaternion(q[3:7]).matrix()
    return q, np.concatenate([R.T @ v[:3], v[3:]])


def feet_of(model: pin.Model) -> tuple[str, ...]:
    """Return the frames of the feet, front left, front right, rear left, rear right."""
    names = [frame.name for frame in model.frames.tolist() if frame.type == pin.FrameType.BODY]
    feet = [name for name in names if "foot" in name.lower()]
    return tuple(next(foot for foot in feet if foot.lower().startswith(leg)) for leg in ("fl", "fr", "rl", "rr"))
