"""A run without unknown forces: what is believed of it, what that leaves unexplained, and whether it was free."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from aerobat_pin.estimation.calibration.detection import settled_intervals
from aerobat_pin.forces import (
    CHECKED,
    FEWEST_INSTANTS,
    LASTING,
    MOST_FITTED,
    SURE_OF_CONTACT,
    TINY,
    KnownForces,
    KnownInputs,
    believed_rows,
    burst_noise,
    column_rms,
    expected_of,
    inputs_between,
    inputs_of,
    instants_of,
    most_likely,
    point_label,
    points_of,
    quantity,
    spare_share,
)
from aerobat_pin.numerics import Array
from aerobat_pin.observers import (
    MOMENT_ARM,
    AllBut,
    Applications,
    ForceLevelObserver,
    MomentumObserver,
    Redundancy,
    force_size,
    moving_weight,
    redundancy_of,
    robot_length,
    row_names,
    scale_of_forces,
    slow_part,
)
from aerobat_pin.records import FREE_NV, Condition, Record

AT_ONCE = 1.0e9  # [1/s]: with so large a gain the filter of an observer passes every interval unchanged
HELD_OUT = 0.25  # share of each run, at its end, that checks the result
LEFT_BEHIND = 8.0  # typical sizes of what the calibration leaves: a longer or larger one is a contact
LEAST_LEFT_BEHIND = 0.02  # of the robot's weight
STEADY = 3.0  # times the error of the belief: forces that are larger are hardly made up by it
TOLD_BY = 2  # spare rows from which what is left can be told from forces
PAUSE, MOST_TOLD = 0.05, 6  # [s] between pushes that are told apart, and how many are told
LEAST_PUSH = 0.02  # of the moving weight: a smaller force is no push


@dataclass(frozen=True)
class FreeRun:
    """A stretch of a record in which no unknown force acts."""

    record: Record  # the record, whose robot is as believed so far
    forces: KnownForces  # its known forces
    stretch: tuple[int, int]  # first and last index of the record's common times
    inputs: KnownInputs  # those of an observer, with all that is known so far
    residual: Array  # (m, nv) mean generalised force that this leaves unexplained in each interval [N, N m], unfiltered
    condition: Condition | None  # phase and state; None where the robot has no phase
    weight: float  # of the robot as it was believed at first [N]

    @classmethod
    def of(cls, record: Record, forces: KnownForces, stretch: tuple[int, int]) -> FreeRun:
        """Return a run as it is believed with some known forces."""
        inputs = _inputs(record, forces, stretch)
        condition, model = record.robot.condition(record.block(*stretch)), record.robot.model
        return cls(record, forces, stretch, inputs, residual_at_once(model, inputs), condition, moving_weight(model))

    @property
    def frames(self) -> tuple[str, ...]:
        """Points at which contacts would be sought."""
        return (*self.record.map.robot.points, *self.record.map.robot.wrenches)

    @property
    def fitted(self) -> slice:
        """The intervals that are not held out."""
        return slice(0, round((1.0 - HELD_OUT) * len(self.residual)))

    def with_values(self, values: Mapping[str, float]) -> FreeRun:
        """Return the run with parameters of its robot changed."""
        robot = self.record.robot
        record, known = replace(self.record, robot=robot.changed(values)), robot.parameters
        inputs, forces = self.inputs, replace(self.forces, record=record)
        if any(value != 0.0 and not known[name].inertial for name, value in values.items()):
            inputs = _inputs(record, forces, self.stretch)
        residual = residual_at_once(record.robot.model, inputs)
        return replace(self, record=record, forces=forces, inputs=inputs, residual=residual)

    def explained(self, name: str, force: Array) -> FreeRun:
        """Return what is left once a generalised force (m, nv) is known."""
        inputs = replace(self.inputs, known={**self.inputs.known, name: force})
        return replace(self, inputs=inputs, residual=self.residual - force)

    def rows(self) -> Array:
        """Return the rows (m, k) of the residual in which all torques are known [N]; moments over 50 mm."""
        model, rows = self.record.robot.model, self.inputs.rows
        kept = rows.kept(model) if isinstance(rows, AllBut) else range(model.nv if rows == "all" else FREE_NV)
        arms = np.array([1.0 if unit == "N" else MOMENT_ARM for unit in row_names(model).values()])
        return np.asarray(self.residual[:, list(kept)] / arms[list(kept)])

    def judged(self) -> Redundancy:
        """Judge what is left: in a free run no force explains anything, so all rows count."""
        rows = self.rows()
        return redundancy_of(self.inputs.time, rows, rows.shape[1] + 1, 1, self.weight, ())


def free_runs(record: Record, forces: KnownForces, within: tuple[float, float] = (-np.inf, np.inf)) -> list[FreeRun]:
    """Return the runs of a record within a stretch [s]: its parts, or of a long one stretches at even distances."""
    stretches = record.parts if record.robot.remembers else record.spread(MOST_FITTED, *within)
    return [FreeRun.of(record, forces, stretch) for stretch in stretches]


def _inputs(record: Record, forces: KnownForces, stretch: tuple[int, int]) -> KnownInputs:
    return inputs_of(record, *stretch, forces, believed_rows(record))


def residual_at_once(model: pin.Model, inputs: KnownInputs) -> Array:
    """Return the mean generalised force (m, nv) that inputs leave unexplained in each interval, not filtered."""
    observer = MomentumObserver(model, (), AT_ONCE)
    return observer.run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known).residual


def unexpected(run: FreeRun) -> Iterator[str]:
    """Yield a warning where more is left than a belief may leave, given what a calibration learnt."""
    redundancy = run.judged()
    if redundancy.verdict == "inconsistent":
        yield (
            f"{run.record.title}: {force_size(redundancy.belief)} a row are left unexplained: did the motion change, "
            "or are the torques so noisy? A free run was expected"
        )


def pushes(run: FreeRun) -> Iterator[str]:
    """Yield in words what pushed, given what a calibration leaves.

    A free run repeats itself with its phase, so little is left of it, and as much in one cycle as in another: a contact
    leaves far more, but for the start, at which the air's past is unknown. A force that lasts is no error of the belief
    if no redundancy shows it: what a belief gets wrong is seldom explained by forces at the points alone.
    """
    time, settled = run.inputs.time, settled_intervals(run.inputs)
    size = np.sqrt(np.mean(slow_part(time, run.rows()) ** 2, axis=1)) * settled
    typical = float(np.median(size[settled])) if settled.any() else 0.0
    if size.max() > max(LEFT_BEHIND * typical, LEAST_LEFT_BEHIND * run.weight) or _lasts(run):
        above = np.flatnonzero(size > 0.5 * size.max())
        apart = np.flatnonzero(np.diff(time[above]) > PAUSE)
        firsts, lasts = above[[0, *(apart + 1)]], above[[*apart, len(above) - 1]]
        ends = zip(time[firsts[:MOST_TOLD]] - run.record.start, time[lasts + 1] - run.record.start, strict=False)
        times = ", ".join(f"{begin:.2f} to {end:.2f} s" for begin, end in ends)
        more = f" and {len(firsts) - MOST_TOLD} more times" if len(firsts) > MOST_TOLD else ""
        largest = force_size(float(size.max()))
        yield f"{run.record.title}: something pushed, most from {times}{more}, with up to {largest} a row"


def _lasts(run: FreeRun) -> bool:
    """Return whether forces at the points explain what is left, and are too large to be made up by the rest."""
    if not run.frames:
        return False
    inputs = run.inputs
    observer = ForceLevelObserver(run.record.robot.model, run.frames, AT_ONCE, inputs.rows)
    estimate = observer.run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known)
    redundancy, count = estimate.redundancy, estimate.components.shape[1]
    force = redundancy_of(inputs.time, estimate.components, count + 1, 1, run.weight, ())
    return redundancy.redundant >= TOLD_BY and force.belief > STEADY * max(redundancy.belief, redundancy.allowed)


def pushed_points(forces: KnownForces) -> tuple[list[str], list[str]]:
    """Return in words what pushed at the points of a record that was taken as free, and what it cannot tell.

    A force that lasts looks like offsets of the joints, as long as no row is to spare: then it would be learnt, and be
    missing from every later record. Where rows are to spare, a force moves them by its Jacobian, which changes with the
    pose, and an offset does not. So friction, inertia of rotors, offsets and the errors of rows are found beside the
    forces, as in a record that is pushed (`fit_beside_forces.py`), and what is found at the points must not stand out
    from its errors, of which those of friction and offsets are the largest in a short record. Friction, if the forces
    have some, was fitted as if nothing pushed.
    """
    record = forces.record
    if not record.robot.limits_forces:
        return [], []
    plain = replace(forces, values=replace(forces.values, friction=None, row_noise={}), series=None)
    inputs, points = inputs_between(record, plain), points_of(record.map)
    instants = instants_of(record, inputs, plain.values, closely=True)
    if instants is None or len(instants.rows) < FEWEST_INSTANTS or not instants.joints:
        return [], []
    expected = expected_of(record, instants, plain.values)
    kept, at, y = instants.kept, instants.at, instants.rows[:, instants.kept]
    J, error, S = instants.jacobians[:, :, kept], expected.row_error[kept], expected.force
    force = np.broadcast_to(S, J.shape[:2])
    offset = np.broadcast_to(-column_rms(instants.columns[3][:, at]) - error[at], (1, len(y), len(at)))
    x = np.concatenate([instants.columns[:3, :, at], offset])
    known = np.array([np.inf, np.inf, np.inf, 1.0])
    b, size, _, _, covariance = most_likely(y, x, known, J, at, instants.sliding, force, error)
    if not points or np.all(spare_share(J, force, np.sqrt(size) * error) < CHECKED):
        text = "no row is to spare: a force that lasts would have been learnt as friction and offset of "
        untold = f"{record.title}: {text}{', '.join(instants.joints)}; make sure that nothing pushed"
        return [], [] if forces.values.friction is None else [untold]
    residual, stiction = y.copy(), np.zeros(len(kept))
    residual[:, at] -= np.einsum("ami,ai->mi", x, b)
    stiction[at] = b[0]
    error = np.sqrt(size * error**2 + stiction**2 / 3.0 * (1.0 - instants.sliding**2))
    B = J / error[:, None]
    P = np.linalg.inv(B @ np.swapaxes(B, 1, 2) + np.diag(S**-2.0))
    G = P @ B / error[:, None]
    push = np.einsum("mck,mk->mc", G, residual)
    moved = np.einsum("mck,akm->mcak", G[:, :, at], x.transpose(0, 2, 1)).reshape(*push.shape, -1)  # by friction
    variance = np.diagonal(P, axis1=1, axis2=2) + np.einsum("mcp,pq,mcq->mc", moved, covariance, moved)
    deviation = np.sqrt(variance + burst_noise(push) ** 2)  # that of velocities is in all rows
    components = Applications(record.robot.model, points).components
    return list(_in_words(forces, components, instants.time, push, deviation)), []


def _in_words(
    forces: KnownForces, components: Sequence[str], time: Array, push: Array, deviation: Array
) -> Iterator[str]:
    """Yield what stands out of forces (m, c), with standard deviations (m, c), at times (m,) [s]."""
    record = forces.record
    for k in range(0, len(components), 3):
        force, sure = push[:, k : k + 3], deviation[:, k : k + 3]
        place, _, axis = components[k].rpartition(".")
        scale = 1.0 if axis.startswith("F") else robot_length(record.robot.model)
        size = np.linalg.norm(force, axis=1)
        along = np.sqrt(np.sum((force * sure) ** 2, axis=1)) / np.maximum(size, TINY) + TINY
        shares, least = size / np.linalg.norm(sure, axis=1), LEAST_PUSH * scale_of_forces(record.robot.model) * scale
        rms, lasting = float(np.sqrt(np.mean(size**2))), float(np.sqrt(np.mean(shares**2)))
        bar = np.maximum(SURE_OF_CONTACT * 3**0.5 * along, least)
        beyond = size / bar
        at = int(np.argmax(beyond))
        if beyond[at] > 1.0 or (lasting > LASTING and rms > least):
            when = time[beyond >= min(1.0, beyond[at])] - record.start
            unit = "N" if axis.startswith("F") else "N m"
            weight = "has a weight too much" if unit == "N" and force[:, 2].mean() > 0.0 else "lacks a weight"
            mean = ", ".join(f"{part:.3g}" for part in force.mean(axis=0))
            yield (
                f"{record.title}: something pushed at {point_label(place)}, or the model {weight}, most from "
                f"{when[0]:.2f} to {when[-1]:.2f} s, with up to {quantity(float(size[at]), unit)} "
                f"(+-{along[at]:.2g}), in the mean ({mean}) {unit} in world axes: that explains the rows of the "
                "joints, and offsets do not"
            )
