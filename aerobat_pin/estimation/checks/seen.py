"""Findings about what the rows show of the forces sought, and whether anything shows the size of their errors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from aerobat_pin.estimation.findings import Finding
from aerobat_pin.estimation.known_forces import KnownForces
from aerobat_pin.estimation.stored_estimate import StoredEstimate
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Applications
from aerobat_pin.records import Record

MOST_NAMED = 3  # stretches of a component that is not seen
ALWAYS = 0.995  # share of the time that counts as all of it
STRAIGHT_ARM = 0.3  # sine of the angle between an unseen force and the lines from far joints to it, in a straight arm
FAR = 0.3  # of the farthest joint's distance: joints nearer to the force have little lever anyhow


def seen_findings(record: Record, forces: KnownForces, estimates: Mapping[str, StoredEstimate]) -> Iterator[Finding]:
    """Yield when the pose does not show a component and why, and whether anything verifies the deviations."""
    told: set[str] = set()
    for estimate in estimates.values():
        if estimate.seen is None:
            continue
        for k, size in enumerate(estimate.component_sizes()):
            if size.seen is None or size.seen > ALWAYS or size.name in told:
                continue
            told.add(size.name)
            hidden = sorted(_stretches(estimate, k), key=lambda ends: ends[0] - ends[1])  # the longest first
            begin, end = hidden[0]
            times = ", ".join(
                f"{estimate.start[a] - record.start:.3g} to {estimate.start[b - 1] - record.start + record.dt:.3g} s"
                for a, b in hidden[:MOST_NAMED]
            )
            times += f" and {len(hidden) - MOST_NAMED} times more" if len(hidden) > MOST_NAMED else ""
            sure = "" if size.deviation is None else f", +-{size.deviation:.2g} {size.unit} there"
            why = _reason(record, estimate, (begin + end) // 2)
            text = f"{size.name}: seen {size.seen:.0%} of the time{sure}; not seen {times}: {why}"
            yield Finding("what the pose shows", "note", text, size.seen, "1")
        if (
            estimate.head.doubt is not None
            and estimate.doubt is None
            and not forces.values.row_noise
            and "bar" not in told
        ):
            told.add("bar")
            text = "error bar unverified: no row to spare shows how large the errors are, and no calibration says it"
            yield Finding("error bar", "note", text)


def _stretches(estimate: StoredEstimate, k: int) -> list[tuple[int, int]]:
    """Return first and last (exclusive) index of the stretches in which a component is not seen."""
    shown: NDArray[np.bool_] = np.concatenate([[True], *(block.shown[:, k] for block in estimate.blocks()), [True]])
    edges = np.flatnonzero(np.diff(shown.astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _reason(record: Record, estimate: StoredEstimate, at: int) -> str:
    """Return in words which force the rows do not show at an interval."""
    head, time = estimate.head, estimate.start[at]
    if not head.are_world_forces:
        return "no row shows it"
    index = int(np.clip(round((time - record.start) * record.rate), 0, record.parts[-1][1] - 1))
    q = record.block(index, index + 1).q[0]
    J = Applications(record.robot.model, head.frames).jacobian(q)
    faintest: Array = np.linalg.svd(J.T, full_matrices=True)[2][-1].reshape(-1, 3)
    loudest = int(np.argmax(np.linalg.norm(faintest, axis=1)))
    direction = faintest[loudest] / np.linalg.norm(faintest[loudest])
    direction = direction * np.sign(direction[np.argmax(np.abs(direction))])
    axes = ", ".join(f"{value:.2f}" for value in direction + 0.0)
    words = f"a force along ({axes}) at {head.frames[loudest]} hardly turns a joint"
    straight = not record.robot.free and _is_straight(record, q, head.frames[loudest], direction)
    return f"{words}: the arm is straight" if straight else words


def _is_straight(record: Record, q: Array, frame: str, direction: Array) -> bool:
    """Return whether a direction at a frame points to all joints that carry the frame from afar."""
    model = record.robot.model
    data, index = model.createData(), model.getFrameId(frame)
    pin.framesForwardKinematics(model, data, q)
    carrying = [joint for joint in model.supports[model.frames[index].parentJoint] if joint > 0]
    lines = np.array([data.oMf[index].translation - data.oMi[joint].translation for joint in carrying])
    lengths = np.linalg.norm(lines, axis=1)
    far = lengths > FAR * lengths.max()
    across = np.linalg.norm(np.cross(lines, direction), axis=1)
    return bool(np.all(across[far] < STRAIGHT_ARM * lengths[far]))
