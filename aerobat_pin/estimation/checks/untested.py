"""Components of forces that no row to spare tests: what is wrong with the rows that show them would look like a force.

Rows to spare may all belong to other components. Of a gantry each slide alone shows a force along it; that its last
joint feels none tests nothing.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from aerobat_pin.estimation.findings import UNTESTED, WOULD_LOOK, Finding
from aerobat_pin.forces import (
    CHECKED,
    Instants,
    KnownForces,
    StoredEstimate,
    checked_share,
    shared_error,
    short_label,
)
from aerobat_pin.observers import Expected, row_names

PART = 0.1  # of what errors make of a component: a row's that is named
COMPONENTS_NAMED = 3  # in a sentence


def untested_findings(
    forces: KnownForces, instants: Instants | None, expected: Expected | None, estimate: StoredEstimate
) -> Iterator[Finding]:
    """Yield which of the components that are seen nothing tests, and the rows that show them.

    Where nothing touched the robot its rows were tested: nothing is said of a record with `use.free`. Nor of one with
    no row to spare at all, which `error bar` says.
    """
    told = forces.record.map.use.free is not None or estimate.redundancy.verdict == "blind"
    if told or expected is None or instants is None or not len(instants.rows):
        return
    some, kept = instants.weighed, instants.kept
    error = expected.row_deviation(instants.v[some])[:, None, kept]
    checked, shares = checked_share(instants.jacobians[some][..., kept], expected.force, error)
    names = np.array(list(row_names(forces.record.robot.model)))[kept]
    words = [
        f"{short_label(size.name)} (by {', '.join(names[share > PART])} alone)"
        for size, tested, share in zip(estimate.component_sizes(), checked, shares, strict=True)
        if size.seen and tested < CHECKED
    ]
    if words:
        more = f" and {len(words) - COMPONENTS_NAMED} more" * (len(words) > COMPONENTS_NAMED)
        yield Finding(UNTESTED, "note", f"nothing tests {', '.join(words[:COMPONENTS_NAMED])}{more}: {WOULD_LOOK}")
    yield from _masses(forces, instants, expected, estimate)


def _masses(forces: KnownForces, instants: Instants, expected: Expected, estimate: StoredEstimate) -> Iterator[Finding]:
    """Yield which components the masses of links may spoil by more than is stated, as no row to spare shows it."""
    spoilt = shared_error(forces.record.robot.model, instants, expected).untested
    words = [
        f"{spoilt[k]:.2g} {size.unit} of {short_label(size.name)}, where +-{size.deviation:.2g} is stated"
        for k, size in enumerate(estimate.component_sizes())
        if size.seen and size.deviation is not None and spoilt[k] > size.deviation
    ]
    if words:
        more = f" and {len(words) - COMPONENTS_NAMED} more" * (len(words) > COMPONENTS_NAMED)
        text = f"errors of a tenth would look like {', '.join(words[:COMPONENTS_NAMED])}{more}"
        yield Finding(UNTESTED, "note", f"nothing tests the masses of all links: {text}")
