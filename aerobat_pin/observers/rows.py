"""The rows of the generalised residual: the joints that they belong to, those that an observer uses, and their weights.

Some rows are in N (translation of a free base, sliding joints) and all others in N m. To compare them, a moment is
divided by the lever arm `MOMENT_ARM`. If joint torques are not measured, the joint rows contain no information and are
not used.

Observers need axes that are fixed in the link that a joint carries, as Pinocchio's Coriolis matrix assumes them. It is
wrong where the axes of a joint turn with the joint's own angles: two hinges between the same two links (a `Composite`
joint, as MJCF makes it), `SphericalZYX`, `Universal`. These joints are chains of simpler joints with massless links
between them, so an observer computes with the chain instead. Its q, v and frames are those of the joint. A joint that
is no such chain (`Ellipsoid`), or that has no coordinate of its own (`Mimic`), is refused.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from aerobat_pin.errors import ObserverError
from aerobat_pin.numerics import Array, guarded, shown

MOMENT_ARM = 0.05  # [m]
WEIGHTLESS = 1.0  # [m/s2] of gravity, below which motion hides the weight and which way is up; on the Moon it is 1.6
IN_ORBIT = 0.01  # of the weight on Earth: beside it pushes are sought there
UNSEEN_SHARE = 1.0e-3  # part of a component in an unseen unit pattern from which it counts as unseen itself
BASE_ROWS = 6  # rows of a free-flyer base
TIED = 3  # integer by which the kernels identify tied rows
ROWS = ("all", "base", "base+power")  # a name's index is the integer by which the kernels identify it
HINGES = [f"{kind}{axis}" for kind in ("R", "RUB", "H") for axis in "XYZ"]
HINGES += ["RevoluteUnaligned", "RevoluteUnboundedUnaligned", "HelicalUnaligned"]
SLIDES = ["PX", "PY", "PZ", "PrismaticUnaligned"]
# Rows of a joint: F is a force [N], M a moment [N m].
PARTS = {
    "JointModelFreeFlyer": ("Fx", "Fy", "Fz", "Mx", "My", "Mz"),
    "JointModelTranslation": ("Fx", "Fy", "Fz"),
    "JointModelPlanar": ("Fx", "Fy", "Mz"),
    "JointModelSpherical": ("Mx", "My", "Mz"),
    **{f"JointModel{kind}": ("F",) for kind in SLIDES},
    **{f"JointModel{kind}": ("M",) for kind in HINGES},
}


def has_free_base(model: pin.Model) -> bool:
    """Say whether the first joint of a model is a free-flyer."""
    return bool(model.njoints > 1 and model.joints[1].shortname() == "JointModelFreeFlyer")


def row_names(model: pin.Model) -> dict[str, str]:
    """Return the name of each row of the generalised residual and its unit, `N` or `N m`, in the order of v.

    A row is called like its joint (`elbow`), or, if the joint has several, joint and part (`ball.Mx`). A free-flyer
    that is the first joint is called `base`.
    """
    rows = {}
    for joint, name in zip(model.joints.tolist()[1:], model.names.tolist()[1:], strict=True):
        title, parts = "base" if joint.id == 1 and has_free_base(model) else name, PARTS[joint.shortname()]
        for part in parts:
            rows[title if len(parts) == 1 else f"{title}.{part}"] = "N" if part[0] == "F" else "N m"
    return rows


def serial_model(model: pin.Model) -> pin.Model:
    """Return a model with the same q, v and frames whose joints all have axes fixed in the link that they carry.

    The joints of a chain are called like the joint that they replace, with a number: `hip.0`, `hip.1`. A model that
    needs no change is returned itself.

    Raises:
        ObserverError: a joint is no chain of joints with fixed axes, or follows another joint.
    """
    joints, names = model.joints.tolist(), model.names.tolist()
    if all(joint.shortname() in PARTS for joint in joints[1:]):
        return model
    serial, link = pin.Model(), [0]  # link: the joint of the new model that carries the link of each joint
    for joint, name in zip(joints[1:], names[1:], strict=True):
        chain, at = _chain(joint.extract(), name), link[model.parents[joint.id]]
        chain[0] = chain[0][0], model.jointPlacements[joint.id] * chain[0][1]
        for k, (part, placement) in enumerate(chain):
            at = serial.addJoint(at, part, placement, name if len(chain) == 1 else f"{name}.{k}")
        serial.inertias[at] = model.inertias[joint.id]
        link.append(at)
    for frame in model.frames.tolist()[1:]:
        moved = pin.Frame(frame.name, link[frame.parentJoint], frame.parentFrame, frame.placement, frame.type)
        serial.addFrame(moved, False)
    for constant in ("name", "gravity", "armature", "lowerPositionLimit", "upperPositionLimit"):
        setattr(serial, constant, getattr(model, constant))
    return serial


def _chain(joint: pin.JointModel, name: str) -> list[tuple[pin.JointModel, pin.SE3]]:
    """Return the joints, with placements, to which a joint is equal. Raises ObserverError if there are none."""
    kind, identity = joint.shortname(), pin.SE3.Identity()
    if kind in PARTS:
        return [(joint, identity)]
    if kind == "JointModelSphericalZYX":
        return [(pin.JointModelRZ(), identity), (pin.JointModelRY(), identity), (pin.JointModelRX(), identity)]
    if kind == "JointModelUniversal":
        return [(pin.JointModelRevoluteUnaligned(axis), identity) for axis in (joint.axis1, joint.axis2)]
    if kind == "JointModelComposite":
        chain = []
        for part, placement in zip(joint.joints.tolist(), joint.jointPlacements.tolist(), strict=True):
            (first, offset), *others = _chain(part.extract(), name)
            chain += [(first, placement * offset), *others]
        return chain
    if kind == "JointModelMimic":
        advice = "build the model without mimic joints (buildModelFromUrdf(..., mimic=False)) and tie the two by a Tie"
    else:
        advice = f"a joint with fixed axes was expected, or a chain of them: {', '.join(known[10:] for known in PARTS)}"
    raise ObserverError(f"joint '{name}' of type {kind[10:]}: observers cannot use it; {advice}")


@guarded(map=("nv", "ns"))
@dataclass(frozen=True)
class Tie:
    """Coordinates assumed to move together, v = S v_s: an observer then uses only S^T times the residual.

    With p_s = S^T p and M_s = S^T M S the tied robot obeys p_s' = S^T (u + J^T f + C^T v - g). The paper ties the left
    wing to the right wing, which leaves eight of ten velocities. The tie is an assumption: generalised forces that
    would move the tied coordinates apart do not appear in S^T times the residual.

    Attributes:
        name: name of the tie, which appears in every result.
        map: the matrix S (nv, ns).
    """

    name: str
    map: Array


@dataclass(frozen=True, init=False)
class AllBut:
    """All rows but some: those whose known force is not to be believed, such as a rail's or an unsensed joint's.

    Args:
        names: names of joints (`rail`), of parts of joints with several rows (`ball.Mx`), `base`, or parts of the base
            (`base.Fx`, in body axes). Any force is considered possible in these rows.
    """

    names: tuple[str, ...]

    def __init__(self, *names: str) -> None:
        object.__setattr__(self, "names", names)

    def kept(self, model: pin.Model) -> list[int]:
        """Return the indices of the rows that are believed. Raises ObserverError for an unknown name or if none is."""
        rows, dropped = list(row_names(model)), set()
        for name in self.names:
            named = {row for row in rows if row == name or row.startswith(f"{name}.")}
            if not named:
                raise ObserverError(f"rows: no joint or part '{name}' in this model; there are {', '.join(rows)}")
            dropped |= named
        if len(dropped) == len(rows):
            raise ObserverError(f"rows: no row is left without {', '.join(self.names)}")
        return [i for i, row in enumerate(rows) if row not in dropped]


Rows = Literal["all", "base", "base+power"] | Tie | AllBut


def moving_weight(model: pin.Model, rows: Rows = "all") -> float:
    """Return the weight [N] of everything that moves: the physical scale of forces on a robot, gravity or not.

    Where some rows are not believed, as of joints that are held, it is what the joints of the others move: of a robot
    with a free base all of it, as its legs carry it.
    """
    masses = np.array([inertia.mass for inertia in model.inertias.tolist()])[1:]
    if isinstance(rows, AllBut) and not has_free_base(model):
        kept, joints = {*rows.kept(model)}, model.joints.tolist()[1:]
        believed = {joint.id for joint in joints if not kept.isdisjoint(range(joint.idx_v, joint.idx_v + joint.nv))}
        masses = masses[[not believed.isdisjoint(chain) for chain in model.supports.tolist()[1:]]]
    return -float(pin.Model.gravity981[2]) * float(masses.sum())


@guarded()
def scale_of_forces(model: pin.Model, rows: Rows = "all") -> float:
    """Return the force [N] beside which a push is sought: what moves weighs it; in an orbit it is a hundredth of that.

    A free robot without gravity, held up by nothing, shows far smaller pushes than one that something carries.
    """
    return moving_weight(model, rows) * (IN_ORBIT if has_free_base(model) and is_weightless(model) else 1.0)


@guarded()
def is_weightless(model: pin.Model) -> bool:
    """Return whether gravity is too weak to compare anything with, as in an orbit."""
    return bool(np.linalg.norm(model.gravity.linear) < WEIGHTLESS)


@guarded()
def tie_joints(model: pin.Model, pairs: dict[str, str]) -> Tie:
    """Tie both joints of every pair, so that they have the same rate, as all in a chain do; it is called after them.

    Args:
        model: any model.
        pairs: joint -> the joint that moves with it, such as `{"left_shoulder": "right_shoulder"}`.

    Raises:
        ObserverError: a joint is not in the model, or moves with more than one degree of freedom.
    """
    model = serial_model(model)
    name = ", ".join(f"{first} with {second}" for first, second in pairs.items())
    for joint in [*pairs, *pairs.values()]:
        if not model.existJointName(joint) or model.joints[model.getJointId(joint)].nv != 1:
            raise ObserverError(f"tie {name}: '{joint}' is not a joint of one degree of freedom of this model")
    leader = np.arange(model.nv)  # of each velocity, the one that stands for all which are tied to it
    for pair in pairs.items():
        first, second = (model.joints[model.getJointId(joint)].idx_v for joint in pair)
        leader[leader == leader[second]] = leader[first]
    return Tie(name, np.equal.outer(leader, np.unique(leader)).astype(float))


class BelievedRows:
    """The rows of the residual that an observer uses, in the form that kernels and identifiability need.

    Attributes:
        name: `all`, `base`, `base+power`, the name of a tie, or `all but` and names of rows.
        number: the integer by which the kernels identify this choice of rows.
        weight: (nv,) weights of the rows, 1 for forces and 1/`MOMENT_ARM` for moments.
        count: how many rows there are.
        tied: (nv, ns) matrix L for tied rows: L^T phi are their weighted sums, or the weighted rows that are left.
            Empty unless rows are tied or left out.
    """

    def __init__(self, model: pin.Model, rows: Rows) -> None:
        """Check the rows and compute their weights. Raises ObserverError if the model does not have these rows."""
        nv = int(model.nv)
        forces = np.array([unit == "N" for unit in row_names(model).values()])
        self.weight: Array = np.where(forces, 1.0, 1.0 / MOMENT_ARM)
        self.tied: Array = np.zeros((0, 0))
        self.rows = rows
        if isinstance(rows, Tie):
            if np.shape(rows.map)[:1] != (nv,) or not np.all(np.isfinite(rows.map)):
                raise ObserverError(f"tie {rows.name}: a finite map of {nv} rows was expected")
            self.name, self.number = rows.name, TIED
            norms = np.maximum(np.linalg.norm(rows.map, axis=0), 1e-12)
            self.tied = rows.map * np.where(np.any(rows.map[forces], axis=0), 1.0, 1.0 / MOMENT_ARM) / norms
        elif isinstance(rows, AllBut):
            self.name, self.number = f"all but {', '.join(rows.names)}", TIED
            self.tied = np.diag(self.weight)[:, rows.kept(model)]
        elif not isinstance(rows, str) or rows not in ROWS or (rows != "all" and not has_free_base(model)):
            raise ObserverError(
                f"rows = {shown(rows)}: a Tie, AllBut or one of {', '.join(ROWS)} was expected; no base on a fixed one"
            )
        else:
            self.name, self.number = rows, ROWS.index(rows)
        self.count = self.map(np.zeros(nv)).shape[1]

    def map(self, velocity: Array) -> Array:
        """Return L (..., nv, k) such that L^T phi are the weighted rows in use, at velocities (..., nv)."""
        nv = len(self.weight)
        return self.of(np.broadcast_to(np.eye(nv), (*velocity.shape, nv)), velocity)

    def of(self, force: Array, velocity: Array, power: int = 1) -> Array:
        """Return L^T phi (m, ..., k), the weighted rows in use of one or several forces (m, ..., nv) at each instant.

        Velocities (m, nv) of the joints are the direction of the power row, which is 0 at rest. Each entry of L is
        taken to a power: with 2, variances of generalised forces become those of the rows.
        """
        if self.number == TIED:
            return np.asarray(force @ self.tied**power)
        weighted = self.weight**power * force
        if self.rows == "all":
            return np.asarray(weighted)
        base = weighted[..., :BASE_ROWS]
        if self.rows == "base":
            return np.asarray(base)
        joints = velocity[..., BASE_ROWS:]
        speed = np.linalg.norm(joints / self.weight[BASE_ROWS:], axis=-1, keepdims=True)
        along = np.divide(joints, speed, out=np.zeros_like(joints), where=speed > 0.0) ** power
        along = along.reshape(*along.shape[:-1], *(1,) * (force.ndim - along.ndim), -1)
        return np.concatenate([base, np.sum(along * force[..., BASE_ROWS:], axis=-1, keepdims=True)], axis=-1)
