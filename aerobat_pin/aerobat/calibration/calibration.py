"""A calibration: what free flights showed about a belief, and its use on other flights with the same belief."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from hashlib import sha256

import numpy as np

from aerobat_pin.aerobat.accelerometer_mount import Mount
from aerobat_pin.aerobat.calibration.crank_row import at_the_joints
from aerobat_pin.aerobat.calibration.detection import Detection
from aerobat_pin.aerobat.calibration.flight_state import flight_state
from aerobat_pin.aerobat.calibration.harmonics import Harmonics
from aerobat_pin.aerobat.calibration.identified import Identified
from aerobat_pin.aerobat.calibration.learnt_range import LOST_UNNOTICED, LearntRange
from aerobat_pin.aerobat.calibration.parameters import changed_belief, scaled_thrusters
from aerobat_pin.aerobat.motion import Motion
from aerobat_pin.errors import CalibrationError
from aerobat_pin.estimation import CalibrationUse, KnownInputs
from aerobat_pin.numerics import Array
from aerobat_pin.observers import JointFriction
from aerobat_pin.robot import Aerobat
from aerobat_pin.scenario import AirSection

OF_THE_DAY = {"wind", "gust", "warm_up_cycles"}  # keys of the air that may differ from flight to flight
LESS = {"measured": ("measured", "motor_only", "none"), "motor_only": ("motor_only", "none")}  # torque -> usable with
CALIBRATION, FRICTION = "calibration", "friction"  # names of the known forces; the latter also asks for its fit


@dataclass(frozen=True)
class Belief:
    """The belief that a calibration belongs to.

    Attributes:
        morphology: name of the robot.
        fingerprint: a number made of all values of the robot's morphology.
        air: the believed air.
        torque: which joint torque was known, as `observers.torque`.
    """

    morphology: str
    fingerprint: str
    air: AirSection
    torque: str

    @classmethod
    def of(cls, robot: Aerobat, air: AirSection, torque: str) -> Belief:
        """Return the belief about a robot, its air and its torques."""
        shape = robot.morphology
        return cls(shape.name, sha256(repr(shape).encode()).hexdigest()[:16], air, torque)

    def refuse_other(self, other: Belief) -> None:
        """Raise CalibrationError if this is not the belief that a flight is to be estimated with."""
        name = "the calibration"
        if (self.morphology, self.fingerprint) != (other.morphology, other.fingerprint):
            same = "with other values" if self.morphology == other.morphology else f", not to '{other.morphology}'"
            raise CalibrationError(f"{name} belongs to the robot '{self.morphology}' {same}: calibrate this one again")
        mine, theirs = (one.air.model_dump(exclude=OF_THE_DAY) for one in (self, other))
        for key, value in mine.items():
            if theirs[key] != value:
                raise CalibrationError(
                    f"{name} was learnt with air.{key} = {value}, but {theirs[key]} is believed: calibrate again with "
                    "this belief"
                )
        allowed = LESS.get(self.torque, (self.torque,))
        if other.torque not in allowed:
            raise CalibrationError(
                f"{name} was learnt with observers.torque = {self.torque}: {' or '.join(allowed)} was expected, not "
                f"{other.torque}"
            )


@dataclass(frozen=True)
class Calibration:
    """What was learnt from free flights.

    Attributes:
        belief: the belief whose errors were learnt.
        learnt: range of states of flight in which that was.
        harmonics: error that is left, over the crank's phase; None if it was not fitted.
        identified: values of parameters, with their covariance; None if none were sought.
        friction: friction of the joints; None if it was not sought.
        detection: what is normal where nothing pushes; None if that was not learnt.
        flights: names of the flights.
        notes: what was found, in words.
        accelerometer: its place and turn; None if they were not sought.
    """

    belief: Belief
    learnt: LearntRange
    harmonics: Harmonics | None
    identified: Identified | None = None
    friction: JointFriction | None = None
    detection: Detection | None = None
    flights: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    accelerometer: Mount | None = None

    @property
    def values(self) -> Mapping[str, float]:
        """Parameter -> change, of the parameters that the calibration changes."""
        return {} if self.identified is None else self.identified.used

    def believed(self, robot: Aerobat, air: AirSection) -> tuple[Aerobat, AirSection]:
        """Return robot and air with the parameters that were identified."""
        return changed_belief(robot, air, self.values) if self.values else (robot, air)

    def applied(self, inputs: KnownInputs, robot: Aerobat, moved: Motion) -> KnownInputs:
        """Return an observer's inputs, reconstructed with `believed`, with what was learnt among the known forces.

        Raises:
            CalibrationError: the crank is not recorded, or hardly turns.
        """
        near = np.ones(len(inputs.tau), bool)
        known, source = scaled_thrusters(inputs.known, self.values), dict(inputs.source)
        if self.friction is not None:
            known[FRICTION] = friction_force(self.friction, inputs, robot)
            source[FRICTION] = "calibrated"
        use = CalibrationUse("inside", "calibration: other parameters of the belief, and no harmonics")
        if self.harmonics is not None:
            state = flight_state(moved)
            near, weight = self.learnt.near(state), self.learnt.weight(state)
            series = at_the_joints(self.harmonics.force(state), robot, moved, self.belief.torque)
            known[CALIBRATION] = weight[:, None] * series
            use = self._use(1.0 - float(np.mean(weight)), self.learnt.describe(state))
            source[CALIBRATION] = f"learnt from {len(self.flights)} flight{'s' * (len(self.flights) > 1)}"
        made = replace(inputs, known=known, source=source)
        if self.detection is not None and np.any(near):
            words = "" if np.all(near) else f"; contacts are sought in the {np.mean(near):.0%} that are near to it"
            contacts = self.detection.contacts(robot.model, made, near)
            use = replace(use, words=use.words + words, contacts=contacts)
        return replace(made, calibration=use)

    def _use(self, lost: float, where: str) -> CalibrationUse:
        if lost <= LOST_UNNOTICED:
            return CalibrationUse("inside", "calibration: inside the range that was learnt")
        return CalibrationUse(
            "faded", f"calibration: {lost:.0%} faded out, as the flight leaves the range that was learnt: {where}"
        )


def friction_force(friction: JointFriction, inputs: KnownInputs, robot: Aerobat) -> Array:
    """Return the generalised force (m, nv) of the joints' friction."""
    rates, accelerations = joint_motion(inputs, robot)
    force = np.zeros((len(rates), robot.model.nv))
    force[:, list(robot.idx_v)] = friction.torque(rates, accelerations)
    return force


def joint_motion(inputs: KnownInputs, robot: Aerobat) -> tuple[Array, Array]:
    """Return mean rates and accelerations (m, 4) of the joints in each interval."""
    v, dt = inputs.v[:, list(robot.idx_v)], np.diff(inputs.time)[:, None]
    change = np.diff(v, axis=0)
    return 0.5 * (v[1:] + v[:-1]), np.divide(change, dt, out=np.zeros_like(change), where=dt > 0.0)
