"""A run without unknown forces: what is believed of it, what that leaves unexplained, and whether it was free."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from aerobat_pin.estimation.calibration.detection import settled_intervals
from aerobat_pin.estimation.calibration.map_fits import used_by_fits
from aerobat_pin.estimation.gain_regression import MOST_FITTED, fits_to_sensor
from aerobat_pin.estimation.inputs import KnownInputs, inputs_of
from aerobat_pin.estimation.inverse_dynamics import contact_torque
from aerobat_pin.estimation.known_forces import KnownForces
from aerobat_pin.estimation.run_observers import rows_of, settled
from aerobat_pin.numerics import Array
from aerobat_pin.observers import (
    MOMENT_ARM,
    AllBut,
    ForceLevelObserver,
    MomentumObserver,
    Redundancy,
    force_size,
    low_passed,
    moving_weight,
    redundancy_of,
    row_names,
    slow_part,
    typical_step,
)
from aerobat_pin.records import FREE_NV, Condition, Record

AT_ONCE = 1.0e9  # [1/s]: with so large a gain the filter of an observer passes every interval unchanged
HELD_OUT = 0.25  # share of each run, at its end, that checks the result
LEFT_BEHIND = 8.0  # typical sizes of what the calibration leaves: a longer or larger one is a contact
LEAST_LEFT_BEHIND = 0.02  # of the robot's weight
STEADY = 3.0  # times the error of the belief: forces that are larger are hardly made up by it
TOLD_BY = 2  # spare rows from which what is left can be told from forces
PAUSE, MOST_TOLD = 0.05, 6  # [s] between pushes that are told apart, and how many are told
RAISED_BY = 2.0  # deviations by which the second moment of errors of rows is raised
FEWEST_LEFT = 10  # intervals that no fit used, from which the noise of the rows follows


@dataclass(frozen=True)
class FreeRun:
    """A stretch of a record in which no unknown force acts.

    Attributes:
        record: the record, whose robot is as believed so far.
        forces: its known forces.
        stretch: first and last index of the record's common times.
        inputs: those of an observer, with all that is known so far.
        residual: (m, nv) mean generalised force that this leaves unexplained in each interval [N, N m], not filtered.
        condition: phase and state; None where the robot has no phase.
        weight: of the robot as it was believed at first [N].
    """

    record: Record
    forces: KnownForces
    stretch: tuple[int, int]
    inputs: KnownInputs
    residual: Array
    condition: Condition | None
    weight: float

    @classmethod
    def of(cls, record: Record, forces: KnownForces, stretch: tuple[int, int]) -> FreeRun:
        """Return a run as it is believed with some known forces."""
        inputs = _inputs(record, forces, stretch)
        condition, model = record.robot.condition(record.block(*stretch)), record.robot.model
        return cls(record, forces, stretch, inputs, _residual(record, inputs), condition, moving_weight(model))

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
        return replace(self, record=record, forces=forces, inputs=inputs, residual=_residual(record, inputs))

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

    def judged(self, part: slice = slice(None)) -> Redundancy:
        """Judge what is left in a part: in a free run no force explains anything, so all rows count."""
        start, stop, _ = part.indices(len(self.residual))
        rows = self.rows()[start:stop]
        return redundancy_of(self.inputs.time[start : stop + 1], rows, rows.shape[1] + 1, 1, self.weight, ())

    def size(self, part: slice = slice(None)) -> float:
        """Return the rms of what is left in a part [N per row], without what the sensors' noise explains."""
        return self.judged(part).belief


def free_runs(record: Record, forces: KnownForces, within: tuple[float, float] = (-np.inf, np.inf)) -> list[FreeRun]:
    """Return the runs of a record within a stretch [s]: its parts, or of a long one stretches at even distances."""
    stretches = record.parts if record.robot.remembers else record.spread(MOST_FITTED, *within)
    return [FreeRun.of(record, forces, stretch) for stretch in stretches]


def row_noise(runs: Sequence[FreeRun], *, learnt: bool) -> dict[str, float]:
    """Return row -> root second moment of what is left where it moves [N, N m], in data that no fit used.

    It is taken behind the low-pass of the observers, as errors that this takes out do not reach their forces. A joint
    at rest says nothing of its errors when it slides: an instant counts by how far it does. A few errors may all be
    small: the second moment is raised by twice its deviation, and is at least that of the data that a fit used. A row
    that hardly moves has none.

    Args:
        runs: the runs, with all that is known of them.
        learnt: whether more than the map's fits was learnt from them, from all but the part that is held out.
    """
    names = row_names(runs[0].record.robot.model) if runs else {}
    count, square, different = np.zeros((3, 2, len(names)))  # where nothing was fitted, and where it was
    for run in runs:
        robot, time, v = run.record.robot, run.inputs.time, run.inputs.v
        fitted = used_by_fits(run.record, run.forces.values, time[:-1])
        if learnt:
            fitted[run.fitted] = True
        share = -np.expm1(-float(run.record.map.observer.gain) * typical_step(time))
        sliding = np.tanh(0.5 * (v[1:] + v[:-1]) / run.forces.values.stiction(robot)[1])
        sliding[:, : FREE_NV if robot.free else 0] = 1.0
        residual = sliding * low_passed(run.residual, share)
        for which, kept in enumerate(settled(run.record, time[:-1]) & part for part in (~fitted, fitted)):
            if not kept.any():
                continue
            power = np.abs(np.fft.fft(residual[kept], axis=0)) ** 2  # as many errors differ as frequencies have a part
            different[which] += np.sum(power, axis=0) ** 2 / np.maximum(np.sum(power**2, axis=0), 1e-300)
            count[which] += np.sum(sliding[kept] ** 2, axis=0)
            square[which] += np.sum(residual[kept] ** 2, axis=0)
    raised = square / np.maximum(count, 1e-300) * (1.0 + RAISED_BY * np.sqrt(2.0 / np.maximum(different, 1.0)))
    raised = np.maximum(raised[0], square[1] / np.maximum(count[1], 1e-300))
    return {name: float(np.sqrt(raised[k])) for k, name in enumerate(names) if count[0, k] >= FEWEST_LEFT}


def noise_where_known(forces: KnownForces) -> dict[str, float]:
    """Return what `row_noise` does for where nothing touches by the map, or a sensor says what; else nothing."""
    record = forces.record
    if fits_to_sensor(record.map):
        pushed = free_runs(record, forces)
        runs = [run.explained("sensor", contact_torque(record, record.block(*run.stretch))) for run in pushed]
        return row_noise(runs, learnt=False)
    free = record.map.use.free
    return {} if free is None else row_noise(free_runs(record, forces, free), learnt=False)


def _inputs(record: Record, forces: KnownForces, stretch: tuple[int, int]) -> KnownInputs:
    return inputs_of(record, *stretch, forces, rows_of(record.map, record.robot, record.joints, record.channels)[0])


def _residual(record: Record, inputs: KnownInputs) -> Array:
    observer = MomentumObserver(record.robot.model, (), AT_ONCE)
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
