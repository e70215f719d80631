"""Where unknown forces can act, a kind of force or wrench at each of some frames; and which of them can be determined.

Every unknown is the size of a component: a unit force or unit moment at a frame's origin, in world or in frame axes.
Take a component with force direction d and moment direction m, in world axes at the point P. Moved to the world's
origin, it is the wrench (d, m + P x d). This wrench times Pinocchio's world Jacobian of the joint that carries the
frame is the component's row of the Jacobian.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from aerobat_pin.errors import ObserverError
from aerobat_pin.numerics import Array, frame_id, guarded, placements
from aerobat_pin.observers.rows import MOMENT_ARM, UNSEEN_SHARE, BelievedRows

EXAMINED = 64  # worst instants of a run that are examined closely
RANK_TOLERANCE = 1.0e-6  # share of the largest singular value, below which a singular value counts as zero


@guarded()
@dataclass(frozen=True)
class Application:
    """A frame at whose origin an unknown force or wrench acts.

    Attributes:
        frame: name of the frame.
        kind: `force` (three components), or `wrench` (six: force, then moment about the frame's origin).
        axes: axes in which the components are given, those of the `world` or of the `frame`.
        direction: if given, the force acts only along this vector, in `axes`, and there is one component. The vector
            does not need unit length.
    """

    frame: str
    kind: Literal["force", "wrench"] = "force"
    axes: Literal["world", "frame"] = "world"
    direction: tuple[float, float, float] | None = None

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the components, such as `tool.Fx`."""
        if self.direction is not None:
            return (f"{self.frame}.along",)
        names = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")[: 6 if self.kind == "wrench" else 3]
        mark = "" if self.axes == "world" else "'"
        return tuple(f"{self.frame}.{name}{mark}" for name in names)

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each component, `N` or `N m`."""
        return tuple("N m" if np.any(direction[3:]) else "N" for direction in self.directions)

    @property
    def directions(self) -> Array:
        """(k, 6) force direction and moment direction of each component, in `axes`."""
        if self.direction is not None:
            along = np.array(self.direction, float)
            size = float(np.linalg.norm(along)) if along.shape == (3,) else 0.0
            if self.kind != "force" or not (np.isfinite(size) and size > 0.0):
                raise ObserverError(
                    f"application at '{self.frame}': a direction of three finite numbers, not all zero, was expected"
                )
            return np.concatenate([along / size, np.zeros(3)])[None]
        return np.eye(6)[: 6 if self.kind == "wrench" else 3]


class Applications:
    """All applications of an observer, looked up in its model.

    Args:
        model: any model.
        applications: applications, or names of frames at whose origins a force acts.

    Raises:
        FrameNotFoundError: a frame is not in the model.
        ObserverError: a frame is named twice or fixed to the world, or a direction is
            not three finite numbers or is zero.

    Attributes:
        frames: (n,) names of the frames.
        components: (c,) labels of the components.
        units: (c,) unit of each component, `N` or `N m`.
        table: (c, 11) for each component: joint, position (3) in the joint's frame [m], force and moment direction (6),
            and 1 if the directions are fixed in the joint's frame, 0 if in the world.
        support: (c, nv) 1 where the velocity coordinate moves the frame, else 0.
        scale: (c,) 1 for forces and `MOMENT_ARM` [m] for moments: the moment of 1 N at that lever arm.
    """

    def __init__(self, model: pin.Model, applications: Sequence[str | Application]) -> None:
        self.model = model
        self.given = tuple(Application(item) if isinstance(item, str) else item for item in applications)
        self.frames = tuple(application.frame for application in self.given)
        if len(set(self.frames)) != len(self.frames):
            raise ObserverError(f"force frames {list(self.frames)}: different names were expected")
        self.components = tuple(label for application in self.given for label in application.labels)
        self.units = tuple(unit for application in self.given for unit in application.units)
        rows, support = [], []
        for application in self.given:
            frame = model.frames[frame_id(model, application.frame)]
            if frame.parentJoint == 0:
                raise ObserverError(
                    f"force frame '{frame.name}' is fixed to the world: a force on it cannot be observed"
                )
            moves = np.zeros(model.nv)
            for joint in (model.joints[k] for k in model.supports[frame.parentJoint].tolist()[1:]):
                moves[joint.idx_v : joint.idx_v + joint.nv] = 1.0
            R = frame.placement.rotation if application.axes == "frame" else np.eye(3)
            for direction in application.directions:
                both = (*(R @ direction[:3]), *(R @ direction[3:]))
                rows.append([frame.parentJoint, *frame.placement.translation, *both, application.axes == "frame"])
                support.append(moves)
        self.table: Array = np.array(rows, float).reshape(-1, 11)
        self.support: Array = np.array(support).reshape(-1, model.nv)
        self.scale = np.where(np.any(self.table[:, 7:10] != 0.0, axis=1), MOMENT_ARM, 1.0)

    def jacobian(self, q: ArrayLike) -> Array:
        """Return J (..., c, nv) at configurations (..., nq): components f have the generalised force J^T f."""
        model, data, q = self.model, self.model.createData(), np.asarray(q, float)
        every, oMi = q.reshape(-1, model.nq), placements(data.oMi)
        world, places = np.empty((len(every), 6, model.nv)), np.empty((len(every), *oMi.shape))
        for q_k, J, place in zip(every, world, places, strict=True):
            J[:] = pin.computeJointJacobians(model, data, q_k).reshape(J.shape)  # that of one joint is (6,)
            place[:] = oMi
        return self.jacobians(world, places).reshape(*q.shape[:-1], len(self.components), model.nv)

    def jacobians(self, world: Array, places: Array) -> Array:
        """Return J (m, c, nv) at m configurations, from Pinocchio's world Jacobians and the placements of its joints.

        Args:
            world: (m, 6, nv) `data.J`, at the world's origin.
            places: (m, njoints, 12) `data.oMi`, each as rotation by columns, then translation.
        """
        blocks = [np.zeros((len(world), 0, world.shape[2]))]
        for application in self.given:
            frame = self.model.frames[frame_id(self.model, application.frame)]
            joint, at = places[:, frame.parentJoint], frame.placement
            x, y, z = (at.translation @ joint[:, :9].reshape(-1, 3, 3) + joint[:, 9:]).T[..., None]  # of the point
            a, b, c = world[:, 3:].swapaxes(0, 1)
            linear = world[:, :3] + np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=1)  # its velocity
            moving = np.concatenate([linear, world[:, 3:]], axis=1)
            directions = application.directions
            if application.axes == "frame":
                R = at.rotation.T @ joint[:, :9].reshape(-1, 3, 3)  # its rows are the frame's axes in the world
                directions = np.concatenate([directions[:, :3] @ R, directions[:, 3:] @ R], axis=2)
            blocks.append(directions @ moving)
        return np.concatenate(blocks, axis=1) * self.support


@dataclass(frozen=True, repr=False)
class Identifiability:
    """Which components the geometry lets an observer determine, at the worst configuration of a run.

    A pattern is a combination of components. It leaves no trace if it does not change the rows that the observer uses.
    Everything here is computed from the map of components to these rows. In this map, moments are divided by a lever
    arm of 50 mm to compare them with forces.

    Attributes:
        components: (c,) labels of the components, such as `tool.Fx`.
        rank: number of independent components that the rows determine.
        singular_values: (c,) singular values of the weighted map, largest first.
        null_space: (c - rank, c) unit patterns of components that leave no trace; the last is the faintest.
        deviation: (c,) standard deviation [N or N m] of each component if every weighted row has white noise of 1 N;
            infinite if the component belongs to a pattern that leaves no trace. Each at its own worst instant.
    """

    components: tuple[str, ...]
    rank: int
    singular_values: Array
    null_space: Array
    deviation: Array

    @property
    def null_direction(self) -> Array | None:
        """The faintest pattern, (n, 3) if the components are n forces, else (c,); None at full rank."""
        if not len(self.null_space):
            return None
        last: Array = self.null_space[-1]
        return last.reshape(-1, 3) if all(".F" in name for name in self.components) and len(last) % 3 == 0 else last

    @property
    def condition(self) -> float:
        """Ratio of largest to smallest singular value; infinite if the rank is not full, 1 without components."""
        if not self.singular_values.size:
            return 1.0
        return float("inf") if len(self.null_space) else float(self.singular_values[0] / self.singular_values[-1])

    def describe(self) -> list[str]:
        """Describe the patterns that leave no trace, one line for each; empty at full rank."""
        return [_pattern(self.components, row) for row in self.null_space]

    def __repr__(self) -> str:
        title = f"Identifiability: rank {self.rank} of {len(self.components)}, condition {self.condition:.3g}"
        return "\n".join([title, *(f"  no trace: {pattern}" for pattern in self.describe())])


def judge(
    applications: Applications, jacobians: Array, velocities: Array, believed: BelievedRows, pivots: Array | None = None
) -> Identifiability:
    """Return the identifiability at the worst instant of a run with Jacobians (m, c, nv) of the components.

    The joints' part of the velocities (m, nv) is the direction of the power row. `pivots` (m - 1,) are the smallest of
    the equations of each interval, over their trace: the smallest of all say which instants are worst, of which
    `EXAMINED` are looked at. When omitted, every instant is.
    """
    count = len(applications.components)
    if not count:
        return Identifiability((), 0, np.zeros(0), np.zeros((0, 0)), np.zeros(0))
    at = np.arange(len(jacobians))
    if pivots is not None and len(pivots) > EXAMINED:
        last = np.sort(np.argpartition(pivots, EXAMINED)[:EXAMINED])
        at = np.unique([last, last + 1])  # both ends of these intervals
    scale = applications.scale
    moving = velocities[at if believed.name == "base+power" else at[:1]]  # no other rows depend on the velocity
    chosen = scale[:, None] * (jacobians[at] @ believed.map(moving))
    squares = np.linalg.eigvalsh(chosen @ np.swapaxes(chosen, 1, 2))  # fast and accurate enough to find the worst
    worst = int(np.argmin(squares[:, 0] / np.maximum(squares[:, -1], 1e-300)))
    _, values, vectors = np.linalg.svd(chosen[worst].T, full_matrices=True)
    values = np.concatenate([values, np.zeros(count - len(values))])
    rank = int(np.sum(values > RANK_TOLERANCE * values[0]))
    if rank == count:
        seen = np.sqrt(np.max(np.diagonal(np.linalg.inv(chosen @ np.swapaxes(chosen, 1, 2)), axis1=1, axis2=2), axis=0))
    else:
        with np.errstate(divide="ignore", invalid="ignore"):
            seen = np.sqrt(np.sum((vectors[:rank] / values[:rank, None]) ** 2, axis=0))
    hidden = np.any(np.abs(vectors[rank:]) > UNSEEN_SHARE, axis=0)
    return Identifiability(
        components=applications.components,
        rank=rank,
        singular_values=values,
        null_space=vectors[rank:],
        deviation=np.where(hidden, np.inf, scale * seen),
    )


def _pattern(components: Sequence[str], row: Array) -> str:
    """Describe in words a pattern of components that leaves no trace."""
    points: dict[str, Array] = {}
    for name, value in zip(components, row, strict=True):
        frame, axis = name.rsplit(".", 1)
        if axis in ("Fx", "Fy", "Fz"):
            points.setdefault(frame, np.zeros(3))["xyz".index(axis[1])] = value
        elif abs(value) > 1e-6:
            points = {}
            break
    loud = [frame for frame, force in points.items() if np.linalg.norm(force) > 1e-6]
    if len(loud) == 2 and np.allclose(points[loud[0]], -points[loud[1]], atol=1e-6):
        return f"equal and opposite along the line from {loud[0]} to {loud[1]}"
    parts = [f"{value:+.2f} {name}" for name, value in zip(components, row, strict=True) if abs(value) > 5e-3]
    return "together: " + ", ".join(parts)
