"""A constant that the sensor of a known force shows of nothing: its zero."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pinocchio as pin

from aerobat_pin.estimation.checks.readings import LEFT_BY_JOINTS
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.forces import Balance, FreeMotion
from aerobat_pin.numerics import Array, frame_id
from aerobat_pin.records import KnownSection, Record, world_turn

MISREAD_FORCE = "known force"  # name of the check
LEAST_CONSTANT = 0.02  # of the weight: a smaller force that a sensor shows of nothing is not named
LEAST_OF_LEGS = 0.005  # of the weight, as the sensors of legs carry all of it
NEARLY_EXACT = 0.005  # of the needed square sum, that is left
LEFT_BY_ZEROS = 0.5  # of what is left otherwise, in squares
LEAST_MOMENT = 0.005  # [m] times the weight, or the mass, that moves: a smaller moment about a point is not named


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
    record: Record, name: str, shown: Array, left: str, least_force: float = LEAST_CONSTANT
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
        f"known.{name} seems to show {' and '.join(words)} too much all the time, which leaves {left}: its zero "
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
        remainder = balance.residual + table @ fitted
        left = float(remainder @ remainder) / balance.size
        if left < (most if len(names) == 1 else LEFT_BY_ZEROS * most):
            ends = np.cumsum([balance.rubbing.shape[1], *(columns[name].shape[1] for name in names)])[:-1]
            most, best = left, dict(zip(names, np.split(fitted, ends)[1:], strict=True))
    leaves = f"{100.0 * most**0.5:.1f} %, as mapped {100.0 * before**0.5:.1f} %"
    if not best or most > max(LEFT_BY_JOINTS * before, NEARLY_EXACT):
        return [], most if best else np.inf
    found = [shown_of_nothing(record, name, shown, leaves, LEAST_OF_LEGS) for name, shown in best.items()]
    return list(itertools.chain(*found)), most
