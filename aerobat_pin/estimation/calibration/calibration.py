"""A calibration: what free runs showed about a belief, and its use on other records with the same belief."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin

from aerobat_pin.errors import CalibrationError
from aerobat_pin.estimation.calibration.detection import Detection
from aerobat_pin.estimation.calibration.harmonics import LOST_UNNOTICED, Harmonics
from aerobat_pin.estimation.calibration.identify import Identified
from aerobat_pin.estimation.inputs import CalibrationUse, KnownInputs
from aerobat_pin.estimation.known_forces import FittedValues
from aerobat_pin.numerics import Array
from aerobat_pin.records import Condition

LESS = {"measured": ("measured", "motor_only", "none"), "motor_only": ("motor_only", "none")}  # torque -> usable with
CALIBRATION, FRICTION = "calibration", "friction"  # names of the known forces; the latter also asks for its fit


@dataclass(frozen=True)
class Belief:
    """The belief that a calibration belongs to.

    Attributes:
        robot: title of the robot.
        fingerprint: a number made of all values of the robot.
        torque: which joint torque was known, as `observers.torque`.
        settings: what else was believed -> its value in words, such as `air.density` or `the effort of knee`.
    """

    robot: str
    fingerprint: str
    torque: str
    settings: Mapping[str, str]

    def refuse_other(self, other: Belief) -> None:
        """Raise CalibrationError if this is not the belief that a record is to be estimated with."""
        if (self.robot, self.fingerprint) != (other.robot, other.fingerprint):
            same = "with other values" if self.robot == other.robot else f", not to '{other.robot}'"
            raise CalibrationError(
                f"the calibration belongs to the robot '{self.robot}' {same}: calibrate this one again"
            )
        for key, value in self.settings.items():
            if (found := other.settings.get(key, "nothing of that name")) != value:
                raise CalibrationError(
                    f"the calibration was learnt with {key} = {value}, but {found} is believed: calibrate again with "
                    "this belief"
                )
        allowed = LESS.get(self.torque, (self.torque,))
        if other.torque not in allowed:
            raise CalibrationError(
                f"the calibration was learnt with observers.torque = {self.torque}: {' or '.join(allowed)} was "
                f"expected, not {other.torque}"
            )


@dataclass(frozen=True)
class Calibration:
    """What was learnt from free runs.

    Attributes:
        belief: the belief whose errors were learnt.
        records: names of the records.
        identified: values of parameters, with their covariance; None if none were sought.
        fitted: friction, factors of efforts, coefficients of thrust, and the mass.
        series: error that is left, over a phase; None if the robot has none, or if it was not fitted.
        detection: what is normal where nothing pushes; None if that was not learnt.
        extras: what only the robot itself reads, such as an accelerometer's place.
        error_bar: component -> rms error without and with the calibration, where it was not fitted [N, N m].
        remainder: row -> rms of what the calibration leaves unexplained [N, N m].
        warnings: what makes the calibration doubtful, in words.
        notes: what was found, in words.
    """

    belief: Belief
    records: tuple[str, ...]
    identified: Identified | None = None
    fitted: FittedValues = FittedValues()
    series: Harmonics | None = None
    detection: Detection | None = None
    extras: Mapping[str, Array] = field(default_factory=dict)
    error_bar: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    remainder: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def changes(self) -> Mapping[str, float]:
        """Parameter -> change, of the parameters that the calibration changes."""
        return {} if self.identified is None else self.identified.used

    @property
    def origin(self) -> str:
        """Where it comes from, in words."""
        return f"learnt from {self.records[0]}" if len(self.records) == 1 else f"learnt from {len(self.records)} records"

    def applied(self, inputs: KnownInputs, model: pin.Model, condition: Condition | None) -> KnownInputs:
        """Return an observer's inputs of a whole run with what was learnt among the known forces, and the contacts.

        Args:
            inputs: the inputs, with the parameters that were identified.
            model: the model with these parameters.
            condition: phase and state; None if the robot has none.
        """
        known, source = dict(inputs.known), dict(inputs.source)
        near = np.ones(len(inputs.tau), bool)
        use = CalibrationUse("inside", "calibration: other parameters of the belief, and no harmonics")
        if self.fitted.friction is not None:
            known[FRICTION], source[FRICTION] = self.friction_force(inputs, model), "calibrated"
        if self.series is not None and condition is not None:
            weight, near = self.series.learnt.weight(condition), self.series.learnt.near(condition)
            known[CALIBRATION], source[CALIBRATION] = weight[:, None] * self.series.force(condition), self.origin
            use = _use(1.0 - float(np.mean(weight)), self.series.learnt.describe(condition))
        made = replace(inputs, known=known, source=source)
        if self.detection is not None and np.any(near):
            words = "" if np.all(near) else f"; contacts are sought in the {np.mean(near):.0%} that are near to it"
            excess = self.detection.excess(model, made, near)
            use = replace(use, words=use.words + words, contacts=self.detection.contacts(made.time, excess))
        return replace(made, calibration=use)

    def friction_force(self, inputs: KnownInputs, model: pin.Model) -> Array:
        """Return the generalised force (m, nv) of the joints' friction."""
        assert self.fitted.friction is not None
        rows = [int(model.joints[model.getJointId(joint)].idx_v) for joint in self.fitted.joints]
        force = np.zeros((len(inputs.tau), model.nv))
        force[:, rows] = self.fitted.friction.torque(*row_motion(inputs, rows))
        return force


def row_motion(inputs: KnownInputs, rows: list[int]) -> tuple[Array, Array]:
    """Return mean rates and accelerations (m, n) of rows of the velocity in each interval."""
    v, dt = inputs.v[:, rows], np.diff(inputs.time)[:, None]
    change = np.diff(v, axis=0)
    return 0.5 * (v[1:] + v[:-1]), np.divide(change, dt, out=np.zeros_like(change), where=dt > 0.0)


def _use(lost: float, where: str) -> CalibrationUse:
    if lost <= LOST_UNNOTICED:
        return CalibrationUse("inside", "calibration: inside the range that was learnt")
    return CalibrationUse(
        "faded", f"calibration: {lost:.0%} faded out, as the motion leaves the range that was learnt: {where}"
    )
