"""What may be wrong with the forces that a fixed robot's map knows: their factor or sign, a sensor's constant."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
import pinocchio as pin

from aerobat_pin.estimation.checks.changes import CLEARLY, FACTOR, LEAST_MOMENT, LEFT_BY_ROBOT, Change
from aerobat_pin.estimation.checks.free_efforts import NAMED
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.forces import Explanation, Instants
from aerobat_pin.numerics import frame_id
from aerobat_pin.records import Record

LEAST_CONSTANT = 0.02  # of the weight: a smaller force that a sensor shows of nothing is not named
MISREAD_FORCE = "known force"


def changes_of_known(record: Record, instants: Instants) -> Iterator[Change]:
    """Yield another factor of each known force, and a constant wrench that its sensor shows of nothing."""
    model, kept, some = record.robot.model, instants.kept, instants.weighed
    data = model.createData()
    for name, section in record.map.known.items():
        yield Change(
            partial(_known_factor, name), instants.known[name][some][:, kept, None], doubt=FACTOR, leaves=LEFT_BY_ROBOT
        )
        if section.powers or section.frame is None:  # nothing that a joint feels
            continue
        axes = pin.ReferenceFrame.LOCAL if section.axes == "frame" else pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        frame, size = frame_id(model, section.frame), len(section.columns) or 6
        J = [pin.computeFrameJacobian(model, data, q, frame, axes).reshape(6, -1) for q in instants.q[some]]
        felt = np.array(J)[:, :size, kept].swapaxes(1, 2)
        yield Change(partial(_shown_of_nothing, record, name), felt, leaves=LEFT_BY_ROBOT)


def _known_factor(name: str, found: Explanation, left: str) -> Sequence[Finding]:
    factor, clearly = 1.0 + float(found.size[0]), CLEARLY * float(found.deviation[0]) * found.independent**-0.5
    if abs(factor - 1.0) < max(NAMED, clearly):
        return []
    what = (
        f"known.{name} would have to be {factor:.3g} times as large, which leaves {left}: its unit, sign, axes or frame"
    )
    return [Finding(MISREAD_FORCE, "warning", what, factor, "1")]


def _shown_of_nothing(record: Record, name: str, found: Explanation, left: str) -> Sequence[Finding]:
    shown, weight, words = -found.size, record.robot.weight, list[str]()
    for values, unit, least in ((shown[:3], "N", LEAST_CONSTANT), (shown[3:], "N m", LEAST_MOMENT)):
        if float(np.linalg.norm(values)) > least * weight:
            words.append(f"({', '.join(f'{value:.2g}' for value in values)}) {unit}")
    if not words:
        return []
    what = (
        f"known.{name} seems to show {' and '.join(words)} too much all the time, which leaves {left}: its zero "
        f"(known.{name}.tare), or what the robot carries"
    )
    return [Finding(MISREAD_FORCE, "warning", what, float(np.linalg.norm(shown[:3])), "N")]
