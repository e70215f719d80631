"""The generalised residual without the Coriolis matrix: p by inverse dynamics."""

# C^T v - g = Mdot v - nle, Mdot v = dp/dh at q + h v by central differences of sixth order.

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

Vector = NDArray[np.float64]
STEP = 5e-3  # [s]: truncation and rounding of the sixth order are both below 1e-10 for rates of about 1 rad/s
LEG = """<mujoco><worldbody><body name="torso" pos="0 0 1">
  <freejoint name="root"/><inertial pos="0.01 0 0.02" mass="5" diaginertia="0.1 0.08 0.06"/>
  <body name="thigh" pos="0 0.1 -0.1">
    <joint name="hip_x" type="hinge" axis="1 0 0" pos="0 0 0.02"/>
    <joint name="hip_y" type="hinge" axis="0 1 0" armature="0.01"/>
    <joint name="hip_z" type="hinge" axis="0 0 1"/>
    <inertial pos="0 0.01 -0.15" mass="1" diaginertia="0.01 0.01 0.002"/>
    <body name="shin" pos="0 0 -0.3">
      <joint name="knee" type="hinge" axis="0 1 0.2"/>
      <inertial pos="0 0 -0.15" mass="0.5" diaginertia="0.005 0.005 0.001"/>
      <body name="foot" pos="0 0 -0.3">
        <joint name="ankle" type="ball"/><joint name="pad" type="slide" axis="0 0 1" pos="0.1 0 0"/>
        <inertial pos="0.02 0 -0.01" mass="0.2" diaginertia="0.001 0.001 0.002"/><site name="sole" pos="0 0 -0.05"/>
      </body></body></body></body></worldbody></mujoco>"""
AXES = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.6, 0.8])


def mjcf_leg() -> tuple[pin.Model, str]:
    """Return a torso with a leg whose hip and ankle have several joints between the same two links, and its sole."""
    with TemporaryDirectory() as folder:
        file = Path(folder, "leg.xml")
        file.write_text(LEG)
        return pin.buildModelFromMJCF(str(file)), "sole"


def composite(*joints: pin.JointModel) -> pin.JointModelComposite:
    """Return joints in series between the same two links, each at a place of its own."""
    made = pin.JointModelComposite()
    for joint in joints:
        made.addJoint(joint, pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.5])), np.array([0.05, -0.1, 0.2])))
    return made


JOINTS = {
    "SphericalZYX": pin.JointModelSphericalZYX(),
    "Universal": pin.JointModelUniversal(*AXES),
    "one in a Composite": composite(pin.JointModelHelicalUnaligned(AXES[1], 0.3)),
    "Composite": composite(pin.JointModelPX(), pin.JointModelRY(), pin.JointModelSpherical()),
    "Composite of chains": composite(pin.JointModelSphericalZYX(), pin.JointModelUniversal(*AXES), pin.JointModelPZ()),
    "Planar": pin.JointModelPlanar(),
    "Helical": pin.JointModelHX(0.3),
    "Unbounded": pin.JointModelRUBY(),
    "Translation": pin.JointModelTranslation(),
}


def chain(middle: pin.JointModel, base: pin.JointModel | None = None) -> pin.Model:
    """Return three links in a row; the joint in the middle is the one in question, the others are hinges."""
    return links(base or pin.JointModelRY(), middle, pin.JointModelRevoluteUnaligned(AXES[1]))


def links(*joints: pin.JointModel) -> pin.Model:
    """Return links in a row, `joint0` and on, each with a frame `tip0` and on."""
    model, at, rng = pin.Model(), 0, np.random.default_rng(1)
    for k, joint in enumerate(joints):
        place = pin.SE3(pin.exp3(rng.uniform(-1.0, 1.0, 3)), rng.uniform(-0.3, 0.3, 3))
        at = model.addJoint(at, joint, place, f"joint{k}")
        moments = pin.exp3(rng.uniform(-1.0, 1.0, 3))
        inertia = moments @ np.diag([0.02, 0.03, 0.04]) @ moments.T
        model.appendBodyToJoint(at, pin.Inertia(1.0 + k, rng.uniform(-0.2, 0.2, 3), inertia), pin.SE3.Identity())
        model.addFrame(pin.Frame(f"tip{k}", at, 0, place, pin.FrameType.OP_FRAME))
    return model


def momentum(model: pin.Model, data: pin.Data, q: Vector, v: Vector) -> Vector:
    """Return p = M v (nv,)."""
    return pin.rnea(model, data, q, np.zeros(model.nv), v) - pin.computeGeneralizedGravity(model, data, q)


def drift(model: pin.Model, data: pin.Data, q: Vector, v: Vector) -> Vector:
    """Return C^T v - g (nv,)."""
    turned = [momentum(model, data, pin.integrate(model, q, k * STEP * v), v) for k in (-3, -2, -1, 1, 2, 3)]
    slope = np.array([-1.0, 9.0, -45.0, 45.0, -9.0, 1.0]) @ turned / (60.0 * STEP)
    return slope - pin.nonLinearEffects(model, data, q, v)


def residual(model: pin.Model, time: Vector, q: Vector, v: Vector, u: Vector) -> Vector:
    """Return phi = (p_1 - p_0) / dt - mean(C^T v - g) - u of each interval (m, nv)."""
    data = model.createData()
    p = np.array([momentum(model, data, *sample) for sample in zip(q, v, strict=True)])
    pull = np.array([drift(model, data, *sample) for sample in zip(q, v, strict=True)])
    return np.diff(p, axis=0) / np.diff(time)[:, None] - 0.5 * (pull[1:] + pull[:-1]) - u


def random_record(model: pin.Model, count: int = 4) -> tuple[Vector, Vector, Vector, Vector]:
    """Return time, q, v (m + 1, n) and u (m, nv) of samples 1 s apart, whose momenta do not hide the drift."""
    rng = np.random.default_rng(2)
    q = [pin.integrate(model, pin.neutral(model), rng.uniform(-1.0, 1.0, model.nv)) for _ in range(count + 1)]
    v, u = rng.uniform(-1.0, 1.0, (count + 1, model.nv)), rng.uniform(-1.0, 1.0, (count, model.nv))
    return np.arange(count + 1.0), np.array(q), v, u
