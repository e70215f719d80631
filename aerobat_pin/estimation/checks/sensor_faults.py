"""Faults of sensors: efforts that come late or early, by a clock, a filter or a driver; zeros of known forces' sensors.

The balance is solved with the efforts a time s later, beside friction and rotors, whose columns are X:

    needed - reach effort(t + s) = X b + e

Gauss-Newton finds the s that leaves least. A filter of first order acts as a delay of its time constant. Errors of
masses and of friction follow the motion and its rate, and leave as much at any s.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin

from aerobat_pin.estimation.checks.readings import LEFT_BY_JOINTS
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.forces import Balance, FreeMotion
from aerobat_pin.numerics import LATEST_SHIFT, SHIFT_STEPS, Array, frame_id
from aerobat_pin.records import LARGEST_DELAY, KnownSection, Record, world_turn

LEFT_BY_SHIFT = 0.7  # of the square sum that friction and rotors leave: a shift that leaves more is not named
SETTLED_STEP = 0.1  # of a sample, or of the shift: the search has ended
MISREAD_FORCE = "known force"  # name of the check
LEAST_CONSTANT = 0.02  # of the weight: a smaller force that a sensor shows of nothing is not named
LEAST_OF_LEGS = 0.005  # of the weight, as the sensors of legs carry all of it
NEARLY_EXACT = 0.005  # of the needed square sum, that is left
LEFT_BY_ZEROS = 0.5  # of what is left otherwise, in squares
LEAST_MOMENT = 0.005  # [m] times the weight, or the mass, that moves: a smaller moment about a point is not named


def late_efforts(record: Record, balance: Balance, least: float) -> Finding | None:
    """Return that efforts fit the motion far better at another time, and than what leaves a share `least`; or None.

    It is None for a record at its own times, whose channels cannot be shifted.
    """
    by = before = share = 0.0
    for round_ in range(SHIFT_STEPS if record.knots is None else 0):
        share, step = _share_and_step(record, balance, by)
        before = share if round_ == 0 else before
        if abs(step) < SETTLED_STEP * max(record.dt, abs(by)) or abs(by + step) > LATEST_SHIFT:
            break
        by += step
    if share > min(LEFT_BY_SHIFT * before, least) or abs(by) < max(LARGEST_DELAY, record.dt):
        return None
    leaves = f"{100.0 * share**0.5:.2g} % of what weight and motion need, as mapped {100.0 * before**0.5:.2g} %"
    return late_finding(by, leaves)


def late_finding(by: float, leaves: str) -> Finding:
    """Return that efforts come a time [s] after the motion, or, if it is negative, the motion after them."""
    early, late, parts = "the motion", "joints.effort", "effort"
    if by < 0.0:
        early, late, parts = late, early, "position and joints.velocity"
    text = (
        f"{late} comes {1e3 * abs(by):.0f} ms after {early}: shifted by that, beside friction, it leaves {leaves}: a "
        f"clock, a filter or a slow sensor (in a map: delay = {abs(by):.3f} under joints.{parts})"
    )
    return Finding("late efforts", "warning", text, by, "s")


def _share_and_step(record: Record, balance: Balance, by: float) -> tuple[float, float]:
    """Return which share of what is needed efforts a time [s] later leave, and by how much later they leave less."""
    apart = 2.0 * record.dt
    earlier, later = (balance.later(by + offset) for offset in (-apart, apart))
    slope = ((later - earlier) / (2.0 * apart))[balance.at]
    shifted = replace(balance, effort=balance.later(by))
    others = np.column_stack([balance.rubbing, balance.reach * balance.a[balance.at]])
    both = np.column_stack([others, -np.sum(balance.reach * slope, axis=1)])
    residual = shifted.residual + others @ shifted.explained_by(others)
    return balance.share_of(residual), float(shifted.explained_by(both)[-1])


def felt_of_constant(record: Record, section: KnownSection, q: Array) -> Array | None:
    """Return (m, nv, p) what 1 N and 1 N m of each column of a known wrench do at q (m, nq); None if it has none."""
    if section.powers or section.frame is None:
        return None
    model = record.robot.model
    data, frame, size = model.createData(), frame_id(model, section.frame), len(section.columns) or 6
    axes = pin.ReferenceFrame.LOCAL if section.axes == "frame" else pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    J = [pin.computeFrameJacobian(model, data, each, frame, axes).reshape(6, -1) for each in q]
    felt = section.sign * np.array(J)[:, :size].swapaxes(1, 2)
    if section.axes == "world":
        felt = (felt.reshape(*felt.shape[:2], -1, 3) @ world_turn(record.map)).reshape(felt.shape)
    return felt


def shown_of_nothing(
    record: Record, name: str, shown: Array, leaves: str, least_force: float = LEAST_CONSTANT
) -> list[Finding]:
    """Return that the sensor of a known wrench shows so much (p,) [N, N m] of nothing; nothing if that is little.

    `least_force` is the share of the weight from which a force is named.
    """
    weight, words = record.robot.weight, list[str]()
    for values, unit, least in ((shown[:3], "N", least_force), (shown[3:], "N m", LEAST_MOMENT)):
        if float(np.linalg.norm(values)) > least * weight:
            words.append(f"({', '.join(f'{value:.2g}' for value in values)}) {unit}")
    if not words:
        return []
    what = (
        f"known.{name} seems to show {' and '.join(words)} too much all the time, which leaves {leaves}: its zero "
        f"(known.{name}.tare), what the robot carries, or what carries it (buoyancy, a tether; in an orbit gravity = 0)"
    )
    return [Finding(MISREAD_FORCE, "warning", what, float(np.linalg.norm(shown[:3])), "N")]


def zeros_of_free(
    record: Record, motion: FreeMotion, balance: Balance, otherwise: Callable[[Balance], float]
) -> tuple[list[Finding], float]:
    """Return what sensors of a free robot show of nothing, and the share that is left then, in squares, if any do.

    It must leave far less than is left as mapped, beside friction, or than another number leaves (`otherwise`), and
    what all sensors may show far less than what one of them may. It is named if it makes the rows nearly exact.
    """
    felt = {name: felt_of_constant(record, section, motion.halfway) for name, section in record.map.known.items()}
    columns = {name: balance.of_forces(each) for name, each in felt.items() if each is not None}
    if not columns:
        return [], np.inf
    before, best = balance.beside_friction(balance.residual), dict[str, Array]()
    most = LEFT_BY_ZEROS * min(before, otherwise(balance))
    for names in [*([name] for name in columns), *([list(columns)] if len(columns) > 1 else [])]:
        table = np.column_stack([balance.rubbing, *(columns[name] for name in names)])
        fitted = balance.explained_by(table)
        share = balance.share_of(balance.residual + table @ fitted)
        if share < (most if len(names) == 1 else LEFT_BY_ZEROS * most):
            ends = np.cumsum([balance.rubbing.shape[1], *(columns[name].shape[1] for name in names)])[:-1]
            most, best = share, dict(zip(names, np.split(fitted, ends)[1:], strict=True))
    leaves = f"{100.0 * most**0.5:.1f} %, as mapped {100.0 * before**0.5:.1f} %"
    if not best or most > max(LEFT_BY_JOINTS * before, NEARLY_EXACT):
        return [], most if best else np.inf
    findings = [shown_of_nothing(record, name, shown, leaves, LEAST_OF_LEGS) for name, shown in best.items()]
    return list(itertools.chain(*findings)), most
