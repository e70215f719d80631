"""Learn a calibration from free flights: parameters of the belief first, then what is left over the crank's phase."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.calibration.calibrate_mount import calibrate_mount
from aerobat_pin.aerobat.calibration.calibration import (
    CALIBRATION,
    FRICTION,
    Belief,
    Calibration,
    friction_force,
    joint_motion,
)
from aerobat_pin.aerobat.calibration.crank_row import at_the_crank, at_the_joints
from aerobat_pin.aerobat.calibration.detection import learn_detection
from aerobat_pin.aerobat.calibration.flight_state import STATE_GROUPS, FlightState, flight_state
from aerobat_pin.aerobat.calibration.free_flight import FreeFlight, interval_residual, unexplained
from aerobat_pin.aerobat.calibration.free_run import contacts, refuse_forced, steady_forces
from aerobat_pin.aerobat.calibration.harmonics import Harmonics, fit_harmonics
from aerobat_pin.aerobat.calibration.identified import Identified
from aerobat_pin.aerobat.calibration.identify import HELD_OUT, identify
from aerobat_pin.aerobat.calibration.learnt_range import LearntRange
from aerobat_pin.aerobat.calibration.parameters import PARAMETERS
from aerobat_pin.aerobat.flight_record import flight_motion
from aerobat_pin.aerobat.motion import Motion
from aerobat_pin.errors import CalibrationError
from aerobat_pin.estimation import KnownInputs
from aerobat_pin.numerics import Array, guarded, shown
from aerobat_pin.observers import JointFriction, fit_friction
from aerobat_pin.robot import JOINTS

HARMONICS, MOST_HARMONICS = 6, 40
BY_DEFAULT = ("mass", "distal_mass", "com_x", "com_z", "wing_offset", "density", "lift_slope", "drag", "added_mass")
FEWEST_FLAPS = 3.0  # that a series over the phase can be learnt from


@dataclass(frozen=True)
class Remainder:
    """What is left unexplained of a flight, (m, nv), with model, inputs, motion and state by which it was found."""

    flight: FreeFlight
    model: pin.Model
    inputs: KnownInputs
    residual: Array
    moved: Motion
    state: FlightState

    @property
    def learnt(self) -> slice:
        """The intervals that are not held out."""
        return slice(0, round((1.0 - HELD_OUT) * len(self.residual)))

    def explained(self, name: str, force: Array) -> Remainder:
        """Return what is left once a generalised force (m, nv) is known."""
        inputs = replace(self.inputs, known={**self.inputs.known, name: force})
        return replace(self, inputs=inputs, residual=self.residual - force)

    def size(self, part: slice = slice(None)) -> float:
        """Return the rms of a part [N per row], without what the sensors' noise explains."""
        return unexplained(self.flight, self.residual, part).belief


@guarded()
def calibrate(
    flights: Sequence[FreeFlight],
    *,
    harmonics: int = HARMONICS,
    vary: Sequence[str] = (),
    parameters: Sequence[str] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Calibration:
    """Learn a calibration; of raw samples the accelerometer's place and turn alone.

    Args:
        flights: flights without unknown forces, all with one belief.
        harmonics: order of the Fourier series of what is left; 0 learns its mean alone, and -1 nothing.
        vary: of `speed`, `frequency`, `attitude`: what the coefficients of the series depend on linearly.
        parameters: parameters to identify, and `friction`. They are used even if they do not explain the flights. When
            omitted, the usual parameters are sought where the belief is not consistent, and used only if they explain
            the flights.
        progress: called with the share that is done.

    Raises:
        CalibrationError: there is no flight, one is not free or too short, beliefs differ, or a name is unknown.
    """
    if not -1 <= harmonics <= MOST_HARMONICS:
        raise CalibrationError(f"calibrate: harmonics = {shown(harmonics)}: from -1 to {MOST_HARMONICS} was expected")
    _check_names(flights, vary, parameters)
    for one in flights:
        refuse_forced(one)
        Belief.of(flights[0].robot, flights[0].air, flights[0].torque).refuse_other(
            Belief.of(one.robot, one.air, one.torque)
        )
    if any(one.log.is_raw for one in flights):
        return calibrate_mount(flights, parameters)
    left = [_as_believed(one) for one in flights]
    notes = [line for one in flights for line in steady_forces(one)]
    notes.append(f"as believed: {_sizes(left)} unexplained")
    found = _parameters(left, parameters, progress)
    if found is not None:
        notes += found.describe()
        if found.kept:
            left = [_with_parameters(one, found) for one in left]
    friction = None
    if parameters is not None and FRICTION in parameters:
        friction = _friction(left)
        notes += _friction_lines(friction)
        left = [one.explained(FRICTION, friction_force(friction, one.inputs, one.flight.robot)) for one in left]
    series = None
    if harmonics >= 0:
        states = tuple(state for group in vary for state in STATE_GROUPS[group])
        trial = _without(left, _fitted(left, harmonics, states, held_out=True))
        before, after = (_mean_of([one.size(slice(one.learnt.stop, None)) for one in many]) for many in (left, trial))
        found_words = (
            f"{harmonics} harmonics of the crank: {_size_of(before)} becomes {_size_of(after)} in the part held out"
        )
        if after < before:
            series = _fitted(left, harmonics, states, held_out=False)
            left = _without(left, series)
            notes.append(found_words)
        else:
            notes.append(f"{found_words}; what does not repeat itself with the crank is not used")
        notes += [line for one in left for line in contacts(one.flight, one.residual)]
    return Calibration(
        belief=Belief.of(flights[0].robot, flights[0].air, flights[0].torque),
        learnt=LearntRange.of(np.concatenate([one.state.values for one in left])),
        harmonics=series,
        identified=found,
        friction=friction,
        detection=learn_detection(flights[0].frames, [(one.model, one.inputs) for one in left]),
        flights=tuple(one.name for one in flights),
        notes=(*notes, f"as calibrated: {_sizes(left)} unexplained"),
    )


def _check_names(flights: Sequence[FreeFlight], vary: Sequence[str], parameters: Sequence[str] | None) -> None:
    if not flights:
        raise CalibrationError("calibrate: flights = []: a flight without unknown forces was expected, or several")
    known = (*PARAMETERS, FRICTION)
    for given, allowed, what in ((vary, tuple(STATE_GROUPS), "vary"), (parameters or (), known, "parameters")):
        for name in given:
            if name not in allowed:
                raise CalibrationError(f"calibrate: {what} has '{name}': of {', '.join(allowed)} some were expected")
    joints = parameters is not None and FRICTION in parameters
    if joints and any(one.torque != "measured" for one in flights):
        raise CalibrationError("calibrate: friction is seen in measured joint torques only: torque = measured expected")


def _as_believed(flight: FreeFlight) -> Remainder:
    moved = flight_motion(flight.log, flight.robot, flight.air)
    state = flight_state(moved)
    flaps = abs(float(state.phase[-1] - state.phase[0])) / (2.0 * np.pi)
    if flaps < FEWEST_FLAPS:
        raise CalibrationError(f"{flight.name}: {flaps:.1f} flaps: {FEWEST_FLAPS:g} or more were expected")
    model = flight.robot.model
    return Remainder(flight, model, flight.inputs, interval_residual(model, flight.inputs), moved, state)


def _parameters(
    left: Sequence[Remainder], names: Sequence[str] | None, progress: Callable[[float], None] | None
) -> Identified | None:
    """Identify what was asked for; without names, the usual parameters if the belief is not consistent."""
    flights = [one.flight for one in left]
    if names is None:
        if all(unexplained(one.flight, one.residual).verdict == "consistent" for one in left):
            return None
        return identify(flights, BY_DEFAULT, always=False, progress=progress)
    sought = [name for name in dict.fromkeys(names) if name != FRICTION]
    return identify(flights, sought, always=True, progress=progress) if sought else None


def _with_parameters(one: Remainder, found: Identified) -> Remainder:
    inputs, robot = one.flight.seen_with(dict(found.used))
    return replace(one, model=robot.model, inputs=inputs, residual=interval_residual(robot.model, inputs))


def _friction(left: Sequence[Remainder]) -> JointFriction:
    parts = []
    for one in left:
        at_q, at_v = list(one.flight.robot.idx_q), list(one.flight.robot.idx_v)
        parts.append((one.inputs.q[:-1, at_q], *joint_motion(one.inputs, one.flight.robot), one.residual[:, at_v]))
    q, v, a, torque = (np.concatenate(values) for values in zip(*parts, strict=True))
    return fit_friction(q, v, a, torque)


def _friction_lines(friction: JointFriction) -> list[str]:
    lines = [
        f"  friction of {joint}: Coulomb {1e3 * coulomb:.2f} mN m, viscous {1e3 * viscous:.3f} mN m s/rad, rotor "
        f"{1e9 * inertia:.3g} g mm2, offset {1e3 * offset:+.2f} mN m"
        for joint, coulomb, viscous, inertia, offset in zip(
            JOINTS, friction.coulomb, friction.viscous, friction.inertia, friction.offset, strict=True
        )
    ]
    return lines + [f"  not seen: {', '.join(friction.unseen)}"] * bool(friction.unseen)


def _fitted(left: Sequence[Remainder], order: int, varied: Sequence[str], *, held_out: bool) -> Harmonics:
    """Fit the series to all intervals, or to all but those held out."""
    parts = [one.learnt if held_out else slice(None) for one in left]
    states = [one.state.part(part) for one, part in zip(left, parts, strict=True)]
    rows = [at_the_crank(one.residual, one.moved, one.flight.torque) for one in left]
    return fit_harmonics(states, [row[part] for row, part in zip(rows, parts, strict=True)], order, varied)


def _without(left: Sequence[Remainder], series: Harmonics) -> list[Remainder]:
    made = []
    for one in left:
        force = at_the_joints(series.force(one.state), one.flight.robot, one.moved, one.flight.torque)
        made.append(one.explained(CALIBRATION, force))
    return made


def _mean_of(sizes: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(sizes))))


def _sizes(left: Sequence[Remainder]) -> str:
    return _size_of(_mean_of([one.size() for one in left]))


def _size_of(force: float) -> str:
    return f"{1e3 * force:.2g} mN a row" if force < 0.0995 else f"{1e3 * force:.0f} mN a row"
