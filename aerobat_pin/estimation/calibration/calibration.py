"""A calibration: what free runs showed about a belief, and its use on other records with the same belief."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from aerobat_pin.errors import CalibrationError
from aerobat_pin.estimation.calibration.detection import SETTLING, Detection
from aerobat_pin.estimation.calibration.error_bar import bar_words
from aerobat_pin.estimation.calibration.identify import Identified
from aerobat_pin.estimation.checks.readings import UNLIMITED
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.forces import (
    CALIBRATION,
    FRICTION,
    CalibrationUse,
    Contact,
    FittedValues,
    KnownForces,
    KnownInputs,
    LearntError,
    ModelCheck,
    fitted_forces,
)
from aerobat_pin.numerics import Array
from aerobat_pin.records import KnownSection, Map, PlainRobot, Record, encoder_words, torque_per_unit

TORQUE = "observers.torque"  # which joint torque is known, among the assumptions of a robot that can choose
EFFORT, ENCODER = "the effort of ", "the encoder of "  # of a joint that has channels, among what is believed
RAREST, POSITIONS = (0.01, 0.99), 20_000  # quantiles of a joint's positions, and of how many
LEAST_OUTSIDE, OUTSIDE, OFTEN = 0.1, 0.2, 0.1  # [rad, m], share of a range, of the time: farther and oftener is told
# torque of a calibration -> torques of the records that it serves
USABLE_WITH = {"measured": ("measured", "motor_only", "none"), "motor_only": ("motor_only", "none")}


@dataclass(frozen=True)
class Belief:
    """The belief that a calibration belongs to.

    Attributes:
        robot: title of the robot.
        fingerprint: a number made of all values of the robot.
        settings: what else was believed -> its value in words, such as `air.density` or `the effort of knee`.
    """

    robot: str
    fingerprint: str
    settings: Mapping[str, str]

    def refuse_other(self, other: Belief) -> None:
        """Raise CalibrationError if this is not the belief that a record is to be estimated with."""
        if (self.robot, self.fingerprint) != (other.robot, other.fingerprint):
            same = " with other values" if self.robot == other.robot else f", not to '{other.robot}'"
            raise CalibrationError(
                f"the calibration belongs to the robot '{self.robot}'{same}: calibrate this one again"
            )
        for key, value in self.settings.items():
            believed = other.settings.get(key, value if key.startswith((EFFORT, ENCODER)) else "nothing of that name")
            if believed not in (USABLE_WITH.get(value, (value,)) if key == TORQUE else (value,)):
                raise CalibrationError(
                    f"the calibration was learnt with {key} = {value}, but {believed} is believed: calibrate again "
                    "with this belief"
                )


def belief_of(chosen: Map, robot: PlainRobot, joints: Sequence[str]) -> Belief:
    """Return what is believed of a record: its robot, what the robot assumes, and what the map's numbers mean.

    The robot is as believed at first, and the joints are those that have channels.
    """
    effort, settings = chosen.joints.effort, dict(robot.assumptions)
    settings |= {f"{EFFORT}{name}": f"{torque_per_unit(effort, name):.9g} N m per unit" for name in joints}
    if not robot.moves_joints:
        settings |= {f"{ENCODER}{name}": words for name, words in encoder_words(chosen.joints, joints).items()}
    settings |= {f"known.{name}": _law(known) for name, known in chosen.known.items()}
    return Belief(robot.title, robot.fingerprint(), settings)


def _law(known: KnownSection) -> str:
    """Return what the coefficients of a thrust multiply, in words."""
    supply = ""
    if known.supply is not None:
        supply = f", {'divided by' if known.supply.divide else 'times'} its supply"
    where = f"along {list(known.direction)} of {known.frame or 'the base'} in {known.axes} axes"
    return f"{known.law} of commands over {known.full_scale:g}{supply}, {where}"


@dataclass(frozen=True)
class Calibration:
    """What was learnt from free runs.

    Attributes:
        belief: the belief whose errors were learnt.
        records: names of the records.
        identified: values of parameters, with their covariance; None if none were sought.
        fitted: friction, factors of efforts, coefficients of thrust, and the mass.
        series: error that is left, over phase and state; None if the robot has none, or if it was not fitted.
        detection: what is normal where nothing pushes; None if that was not learnt.
        extras: what only the robot itself reads, such as an accelerometer's place.
        error_bar: component -> rms error without and with the calibration, where it was not fitted [N, N m].
        row_noise: row -> root second moment of what is left of it where nothing pushes, in data that no fit used
            [N, N m]; empty where that is not known.
        ranges: joint -> where it was, but for the rarest hundredths [rad, m].
        warnings: what makes the calibration doubtful, in words.
        notes: what was found, in words.
        correct: whether a cause that is named of another record is corrected there; not kept in a file.
    """

    belief: Belief
    records: tuple[str, ...]
    identified: Identified | None = None
    fitted: FittedValues = field(default_factory=FittedValues)
    series: LearntError | None = None
    detection: Detection | None = None
    extras: Mapping[str, Array] = field(default_factory=dict)
    error_bar: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    row_noise: Mapping[str, float] = field(default_factory=dict)
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    correct: bool = False

    @property
    def changes(self) -> Mapping[str, float]:
        """Parameter -> change, of the parameters that the calibration changes."""
        return {} if self.identified is None else self.identified.used

    @property
    def origin(self) -> str:
        """Where it comes from, in words."""
        count = len(self.records)
        return f"learnt from {self.records[0]}" if count == 1 else f"learnt from {count} records"

    def applied(self, record: Record) -> Record:
        """Return a record whose robot has the learnt parameters, and whose map fits nothing that was learnt.

        Raises:
            CalibrationError: the calibration belongs to another robot, or to a map that means something else.
        """
        self.belief.refuse_other(belief_of(record.map, record.robot, record.joints))
        return replace(record, map=self.without_fits(record.map), robot=self.believed(record.robot))

    def believed(self, robot: PlainRobot) -> PlainRobot:
        """Return a robot with all that was learnt about it."""
        robot = robot.changed(self.changes) if self.changes else robot
        robot = robot.with_extras(self.extras) if self.extras else robot
        robot = robot.with_links(self.fitted.links) if len(self.fitted.links) else robot
        return robot if self.fitted.mass == 1.0 else robot.heavier(self.fitted.mass)

    def without_fits(self, chosen: Map) -> Map:
        """Return a map that has the learnt coefficients of thrust, and fits no friction that was learnt."""
        known, joints = dict(chosen.known), chosen.joints
        for name, coefficients in self.fitted.coefficients.items():
            known[name] = known[name].model_copy(update={"coefficients": tuple(coefficients.tolist()), "fit": None})
        if self.fitted.friction is not None:
            joints = joints.model_copy(update={"friction": None})
        return chosen.model_copy(update={"known": known, "joints": joints})

    def forces(self, record: Record) -> KnownForces:
        """Return the known forces of a record that `applied` returned: what the map still fits, and what was learnt."""
        fitted = self.fitted
        forces = fitted_forces(record, fitted)
        fits = tuple(replace(fit, log=fit.log or self.records[0]) for fit in fitted.fits)
        sources = {} if self.series is None else {CALIBRATION: self.origin}
        sources |= {} if fitted.friction is None else {FRICTION: "calibrated"}
        values = replace(forces.values, fits=(*fits, *forces.values.fits), row_noise=self.row_noise)
        return replace(forces, values=values, series=self.series, sources=sources)

    @property
    def use_of_extras(self) -> CalibrationUse:
        """How it was used where the robot found motion and forces together."""
        return CalibrationUse(f"calibration: {'; '.join(self.notes[:1])}", warnings=self.warnings)

    def findings(self, record: Record) -> Iterator[Finding]:
        """Yield what a report says about the calibration, and joints that are where it did not see them."""
        yield Finding("calibration", "note", f"{self.origin}; {bar_words(self.error_bar)}")
        beyond = list[str]()
        for joint, at in _positions([record]).items():
            low, high = self.ranges.get(joint, (-np.inf, np.inf))
            margin = max(LEAST_OUTSIDE, OUTSIDE * (high - low))
            if (share := float(np.mean((at < low - margin) | (at > high + margin)))) > OFTEN:
                unit = "m" if record.robot.slides(joint) else "rad"
                beyond.append(f"{joint} {100.0 * share:.0f} % of the time ({low:.2g} to {high:.2g} {unit})")
        if beyond:
            text = (
                f"beyond where they were calibrated: {', '.join(beyond)}: what masses and friction get wrong there it "
                "did not see, and may be more than is stated"
            )
            yield Finding("postures", "warning", text)


def ranges_of(records: Sequence[Record]) -> dict[str, tuple[float, float]]:
    """Return joint -> from and to of its positions in some records, but for the rarest hundredths [rad, m]."""
    return {joint: tuple(np.quantile(at, RAREST).tolist()) for joint, at in _positions(records).items()}


def _positions(records: Sequence[Record]) -> dict[str, Array]:
    """Return joint -> its positions (m,) at some times of all records [rad, m].

    None of a robot with a phase, nor of joints that turn on and on, as wheels do: their file states no limits.
    """
    positions = dict[str, list[Array]]()
    for record in records:
        if "joints.position" not in record.channels or record.robot.remembers:
            continue
        model, turned = record.robot.model, record.channels["joints.position"].turns
        limits = list(zip(model.lowerPositionLimit.tolist(), model.upperPositionLimit.tolist(), strict=True))
        for ends in record.spread(POSITIONS):
            table = record.at("joints.position", record.times(*ends))
            for joint, column in zip(record.joints, table.T, strict=True):
                low, high = limits[record.robot.q_index(joint)]
                if 0.0 < high - low < UNLIMITED and joint not in turned:
                    positions.setdefault(joint, []).append(column)
    return {joint: np.concatenate(parts) for joint, parts in positions.items()}


TRAIN, REGULAR_TRAIN = 4, 0.1  # gaps between contacts that make a train, and by how many cycles most of them may differ


class CalibrationWatch:
    """Follows a record on its way to the observers: what pushes."""

    settling = SETTLING

    def __init__(self, calibration: Calibration, model: ModelCheck | None = None) -> None:
        """Begin with nothing seen; `model` is what was found of the belief before."""
        self._calibration, self._model = calibration, model
        self._excess: list[tuple[Array, Array]] = []
        self._contacts: list[Contact] = []
        self._until: float | None = None  # end of the part before [s]
        self._turns: list[tuple[Array, Array]] = []  # times [s] and cycles

    def take(self, record: Record, inputs: KnownInputs, kept: slice, *, ends: bool) -> None:
        """Take the inputs of a block.

        Args:
            record: the record, whose robot has what was learnt.
            inputs: the inputs, with a lead before the intervals that count.
            kept: the intervals that count.
            ends: whether a part of the record ends with them.
        """
        detection, series = self._calibration.detection, self._calibration.series
        if detection is None:
            return
        widened = 1.0 if series is None or inputs.condition is None else series.widened(inputs.condition)
        if inputs.condition is not None:
            self._turns.append((inputs.time[kept], inputs.condition.phase[kept] / (2.0 * np.pi)))
        excess = detection.excess(record.robot.model, inputs, widened)
        self._excess.append((inputs.time[kept.start : kept.stop + 1], excess[kept]))
        if ends:
            times, sizes = zip(*self._excess, strict=True)
            time = np.concatenate([*(part[:-1] for part in times), times[-1][-1:]])
            until = self._until  # a hole is behind what lasts until the end of a part
            self._contacts = [
                contact if contact.end is not None else replace(contact, end=until) for contact in self._contacts
            ]
            self._contacts += detection.contacts(time, np.concatenate(sizes))
            self._excess, self._until = [], float(time[-1])

    def use(self) -> CalibrationUse:
        """Return how the calibration was used."""
        learnt = self._calibration
        contacts = None if learnt.detection is None else tuple(self._contacts)
        warnings = (*learnt.warnings, *self._trains())
        return CalibrationUse(f"calibration: {learnt.origin}", contacts, self._model, warnings)

    def _trains(self) -> Iterator[str]:
        """Yield a warning about contacts that come at one phase of the cycle, cycle for cycle."""
        if not self._turns:
            return
        time, turns = (np.concatenate(values) for values in zip(*self._turns, strict=True))
        for frame in dict.fromkeys(contact.point for contact in self._contacts):
            onsets = [contact.onset for contact in self._contacts if contact.point == frame]
            gaps = np.abs(np.diff(np.interp(onsets, time, turns)))
            if len(gaps) >= TRAIN and np.mean(np.abs(gaps - np.median(gaps)) < REGULAR_TRAIN) > 0.5:
                yield (
                    f"{len(onsets)} contacts at {frame}, one every {np.median(gaps):.2f} cycles: an error of the "
                    "belief, or a force that swings with the cycle"
                )
