"""What may be wrong with the forces that a fixed robot's map knows: their factor or sign, a sensor's constant."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

from aerobat_pin.estimation.checks.changes import CLEARLY, FACTOR, LEFT_BY_ROBOT, Change
from aerobat_pin.estimation.checks.free_efforts import NAMED
from aerobat_pin.estimation.checks.sensor_axes import changes_of_axes
from aerobat_pin.estimation.checks.sensor_zeros import MISREAD_FORCE, felt_of_constant, shown_of_nothing
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.forces import EffortRows, Explanation, Instants
from aerobat_pin.records import Record


def changes_of_known(record: Record, instants: Instants, rows: EffortRows, without: Explanation) -> Iterator[Change]:
    """Yield another factor of each known force, a constant that its sensor shows of nothing, and its other axes."""
    kept, some = instants.kept, instants.weighed
    for name, section in record.map.known.items():
        yield Change(
            partial(_known_factor, name), instants.known[name][some][:, kept, None], doubt=FACTOR, leaves=LEFT_BY_ROBOT
        )
        felt = felt_of_constant(record, section, instants.q[some])
        if felt is not None:
            yield Change(partial(_shown_of_nothing, record, name), felt[:, kept], leaves=LEFT_BY_ROBOT)
        yield from changes_of_axes(record, instants, rows, without, name, section)


def _known_factor(name: str, found: Explanation, left: str) -> Sequence[Finding]:
    factor, clearly = 1.0 + float(found.size[0]), CLEARLY * float(found.deviation[0]) * found.independent**-0.5
    if abs(factor - 1.0) < max(NAMED, clearly):
        return []
    what = (
        f"known.{name} would have to be {factor:.3g} times as large, which leaves {left}: its unit, sign, axes or frame"
    )
    return [Finding(MISREAD_FORCE, "warning", what, factor, "1")]


def _shown_of_nothing(record: Record, name: str, found: Explanation, left: str) -> Sequence[Finding]:
    return shown_of_nothing(record, name, -found.size, left)
