"""Learn a calibration from free runs: parameters of the belief, friction, what is left over a phase, what is normal."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from aerobat_pin.errors import CalibrationError
from aerobat_pin.estimation.calibration.calibration import CALIBRATION, FRICTION, Belief, Calibration, row_motion
from aerobat_pin.estimation.calibration.detection import learn_detection
from aerobat_pin.estimation.calibration.free_run import FreeRun, pushes, steady_forces
from aerobat_pin.estimation.calibration.harmonics import Harmonics, fit_harmonics
from aerobat_pin.estimation.calibration.identify import Identified, identify
from aerobat_pin.estimation.known_forces import FittedValues
from aerobat_pin.numerics import shown
from aerobat_pin.observers import JointFriction, fit_friction, row_names
from aerobat_pin.records import Parameter

HARMONICS, MOST_HARMONICS = 6, 40
FEWEST_TURNS = 3.0  # that a series over the phase can be learnt from


def learn(
    runs: Sequence[FreeRun],
    belief: Belief,
    known_parameters: Mapping[str, Parameter],
    joints: Sequence[str],
    *,
    harmonics: int = HARMONICS,
    vary: Sequence[str] = (),
    parameters: Sequence[str] | None = None,
    fitted: FittedValues = FittedValues(),
    progress: Callable[[float], None] | None = None,
) -> Calibration:
    """Learn from free runs what the belief about them gets wrong.

    Args:
        runs: runs without unknown forces, all with one belief.
        belief: that belief.
        known_parameters: the parameters that the robot knows.
        joints: those whose friction can be fitted.
        harmonics: order of the Fourier series of what is left; 0 learns its mean alone, and -1 nothing.
        vary: groups of states on which the coefficients of the series depend linearly.
        parameters: parameters to identify, and `friction`. They are used even if they do not explain the runs. When
            omitted, the usual parameters are sought where the belief is not consistent, and used only if they explain
            the runs.
        fitted: what was fitted before, and is among the known forces of the runs.
        progress: called with the share that is done.

    Raises:
        CalibrationError: a run is too short, or a name is unknown.
    """
    _check_names(runs, belief, harmonics, vary, parameters, [*known_parameters, *([FRICTION] if joints else [])])
    warnings = [line for one in runs for line in steady_forces(one)]
    notes = [f"as believed: {_sizes(runs)} unexplained"]
    found = _identified(runs, known_parameters, parameters, progress)
    if found is not None:
        notes += found.describe()
        if found.kept:
            runs = [one.with_values(found.used) for one in runs]
    if parameters is not None and FRICTION in parameters:
        friction = _fit_to_residual(runs, joints)
        notes += _friction_lines(friction, joints)
        fitted = FittedValues(fitted.coefficients, tuple(joints), friction, np.ones(len(joints)), fitted.mass)
        part = Calibration(belief, (), fitted=fitted)
        runs = [one.explained(FRICTION, part.friction_force(one.inputs, one.model)) for one in runs]
    series = None
    if harmonics >= 0 and all(one.condition is not None for one in runs):
        series, words = _learnt_series(runs, harmonics, vary)
        notes.append(words)
        if series is not None:
            runs = _without(runs, series)
        warnings += [line for one in runs for line in pushes(one)]
    squares = [np.mean(one.residual**2, axis=0) for one in runs]
    left = np.sqrt(np.mean(squares, axis=0))
    return Calibration(
        belief=belief,
        records=tuple(dict.fromkeys(one.name for one in runs)),
        identified=found,
        fitted=fitted,
        series=series,
        detection=learn_detection(runs[0].frames, [(one.model, one.inputs) for one in runs]),
        remainder=dict(zip(row_names(runs[0].model), left.tolist(), strict=True)),
        warnings=tuple(warnings),
        notes=(*notes, f"as calibrated: {_sizes(runs)} unexplained"),
    )


def _check_names(
    runs: Sequence[FreeRun],
    belief: Belief,
    harmonics: int,
    vary: Sequence[str],
    parameters: Sequence[str] | None,
    known: Sequence[str],
) -> None:
    if not -1 <= harmonics <= MOST_HARMONICS:
        raise CalibrationError(f"calibrate: harmonics = {shown(harmonics)}: from -1 to {MOST_HARMONICS} was expected")
    groups = [] if runs[0].condition is None else list(runs[0].condition.groups)
    for given, allowed, what in ((vary, groups, "vary"), (parameters or (), known, "parameters")):
        for name in given:
            if name not in allowed:
                expected = f"of {', '.join(allowed)} some were expected" if allowed else "this robot has none"
                raise CalibrationError(f"calibrate: {what} has '{name}': {expected}")
    if parameters is not None and FRICTION in parameters and belief.torque != "measured":
        raise CalibrationError("calibrate: friction is seen in measured joint torques only: torque = measured expected")
    for one in runs:
        if one.condition is not None and one.condition.turns < FEWEST_TURNS:
            raise CalibrationError(
                f"{one.name}: {one.condition.turns:.1f} turns of {one.condition.cycle}: {FEWEST_TURNS:g} or more were "
                "expected"
            )


def _identified(
    runs: Sequence[FreeRun],
    known: Mapping[str, Parameter],
    names: Sequence[str] | None,
    progress: Callable[[float], None] | None,
) -> Identified | None:
    """Identify what was asked for; without names, the usual parameters if the belief is not consistent."""
    if names is not None:
        sought = {name: known[name] for name in names if name != FRICTION}
        return identify(runs, sought, always=True, progress=progress) if sought else None
    usual = {name: one for name, one in known.items() if one.usual}
    if not usual or all(one.judged().verdict == "consistent" for one in runs):
        return None
    return identify(runs, usual, always=False, progress=progress)


def _fit_to_residual(runs: Sequence[FreeRun], joints: Sequence[str]) -> JointFriction:
    """Fit the friction of joints to what is left of their rows."""
    parts = []
    for one in runs:
        ids = [one.model.joints[one.model.getJointId(joint)] for joint in joints]
        at_q, at_v = [int(joint.idx_q) for joint in ids], [int(joint.idx_v) for joint in ids]
        parts.append((one.inputs.q[:-1, at_q], *row_motion(one.inputs, at_v), one.residual[:, at_v]))
    q, v, a, torque = (np.concatenate(values) for values in zip(*parts, strict=True))
    return fit_friction(q, v, a, torque)


def _friction_lines(friction: JointFriction, joints: Sequence[str]) -> list[str]:
    lines = [
        f"  friction of {joint}: Coulomb {1e3 * coulomb:.2f} mN m, viscous {1e3 * viscous:.3f} mN m s/rad, rotor "
        f"{1e9 * inertia:.3g} g mm2, offset {1e3 * offset:+.2f} mN m"
        for joint, coulomb, viscous, inertia, offset in zip(
            joints, friction.coulomb, friction.viscous, friction.inertia, friction.offset, strict=True
        )
    ]
    return lines + [f"  not seen: {', '.join(friction.unseen)}"] * bool(friction.unseen)


def _learnt_series(runs: Sequence[FreeRun], order: int, vary: Sequence[str]) -> tuple[Harmonics | None, str]:
    """Return the series over the phase if it lowers the error where held out, and what it does in words."""
    conditions = [one.condition for one in runs if one.condition is not None]
    varied = [state for group in vary for state in conditions[0].groups[group]]
    residuals, fitted = [one.residual for one in runs], [one.fitted for one in runs]
    trial = fit_harmonics(conditions, residuals, fitted, order, varied)
    before, after = (
        _mean_of([one.size(slice(part.stop, None)) for one, part in zip(many, fitted, strict=True)])
        for many in (runs, _without(runs, trial))
    )
    words = (
        f"{order} harmonics of {conditions[0].cycle}: {_size_of(before)} becomes {_size_of(after)} in the part held out"
    )
    if after >= before:
        return None, f"{words}; what does not repeat itself with {conditions[0].cycle} is not used"
    return fit_harmonics(conditions, residuals, [slice(None)] * len(runs), order, varied), words


def _without(runs: Sequence[FreeRun], series: Harmonics) -> list[FreeRun]:
    return [one.explained(CALIBRATION, series.force(one.condition)) for one in runs if one.condition is not None]


def _mean_of(sizes: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(sizes))))


def _sizes(runs: Sequence[FreeRun]) -> str:
    return _size_of(_mean_of([one.size() for one in runs]))


def _size_of(force: float) -> str:
    return f"{1e3 * force:.2g} mN a row" if force < 0.0995 else f"{1e3 * force:.0f} mN a row"
