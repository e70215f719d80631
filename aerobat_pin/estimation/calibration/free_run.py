"""A run without unknown forces: what is believed of it, what that leaves unexplained, and whether it was free."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from aerobat_pin.estimation.calibration.detection import settled_intervals
from aerobat_pin.forces import MOST_FITTED, KnownForces, KnownInputs, inputs_of, rows_of
from aerobat_pin.numerics import Array
from aerobat_pin.observers import (
    MOMENT_ARM,
    AllBut,
    ForceLevelObserver,
    MomentumObserver,
    Redundancy,
    force_size,
    moving_weight,
    redundancy_of,
    row_names,
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
    def name(self) -> str:
        """Name of the record."""
        return self.record.title

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
    return inputs_of(record, *stretch, forces, rows_of(record.map, record.robot, record.joints, record.channels)[0])


def residual_at_once(model: pin.Model, inputs: KnownInputs) -> Array:
    """Return the mean generalised force (m, nv) that inputs leave unexplained in each interval, not filtered."""
    observer = MomentumObserver(model, (), AT_ONCE)
    return observer.run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known).residual


def unexpected(run: FreeRun) -> Iterator[str]:
    """Yield a warning where more is left than a belief may leave, given what a calibration learnt."""
    redundancy = run.judged()
    if redundancy.verdict == "inconsistent":
        yield (
            f"{run.name}: {force_size(redundancy.belief)} a row are left unexplained: did the motion change, or are "
            "the torques so noisy? A free run was expected"
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
        times = ", ".join(
            f"{time[a]:.2f} to {time[b + 1]:.2f} s" for a, b in zip(firsts[:MOST_TOLD], lasts, strict=False)
        )
        more = f" and {len(firsts) - MOST_TOLD} more times" if len(firsts) > MOST_TOLD else ""
        yield f"{run.name}: something pushed, most from {times}{more}, with up to {force_size(float(size.max()))} a row"


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
