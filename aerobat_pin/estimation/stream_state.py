"""State of a stream's kernels, filled with what a map, a robot and a calibration say once."""

from __future__ import annotations

import numpy as np

from aerobat_pin.errors import MapError
from aerobat_pin.estimation import stream_rings as ring_kernels
from aerobat_pin.estimation.known_forces import FittedValues
from aerobat_pin.numerics import Array, fields_of, new_state
from aerobat_pin.records import Map, PlainRobot, Request, axes_of, imu_arm


def new_rings(
    chosen: Map,
    robot: PlainRobot,
    joints: tuple[str, ...],
    asked: tuple[Request, ...],
    values: FittedValues,
    wait: float,
) -> Array:
    """Return the state of a stream without samples.

    Args:
        chosen: the map.
        robot: its robot.
        joints: joints that have channels, in the order of their columns.
        asked: what the map asks of the channels.
        values: friction of joints, and factors of their efforts.
        wait: by how much samples may arrive late [s].

    Raises:
        MapError: the wait is below 0, or too long.
    """
    if not 0.0 <= wait < ring_kernels.CLOCK_JUMP:
        raise MapError(f"online: wait = {wait}: at least 0 s and less than {ring_kernels.CLOCK_JUMP:g} s was expected")
    rubbing = values.joints if values.friction is not None or len(values.scale) else ()
    width = max(4, *(len(request.names) for request in asked))
    model = robot.model
    memory = new_state(
        ring_kernels.Rings, channels=len(asked), width=width, nq=model.nq, nv=model.nv, rubbing=len(rubbing)
    )
    rings = fields_of(memory, ring_kernels.Rings)
    rings.slot[:] = -1
    for c, request in enumerate(asked):
        count = len(request.names)
        rings.columns[c], rings.delay[c] = count, request.delay
        rings.factor[c, :count] = request.factor
        mix, shift = request.mix, request.shift
        if (turn := axes_of(chosen, request)) is not None:
            mix = turn if mix is None else turn @ mix
        if mix is not None:
            rings.mixed[c], rings.mix[c, :count, :count], rings.shift[c, :count] = 1, mix, shift
        rings.slot[ring_kernels.STREAM_KEYS.index(request.key)] = c
        if request.key.startswith("joints."):
            row = ("joints.position", "joints.velocity", "joints.effort").index(request.key)
            index = robot.q_index if row == 0 else robot.v_index
            rings.places[row, :count] = np.array([index(joint) for joint in (request.joints or joints)])
    rings.rubbed[:] = [robot.v_index(joint) for joint in rubbing]
    rings.friction[4:] = 1.0
    if values.friction is not None:
        law = values.friction
        rings.friction[:4], rings.friction[4] = (law.coulomb, law.viscous, law.inertia, law.offset), law.rate
    if len(values.scale):
        rings.friction[5] = values.scale
    rings.setting[:4] = chosen.log.longest_gap, wait, chosen.log.rate or 0.0, 0.0
    base, keys = chosen.base, {request.key: request for request in asked}
    if base.velocity is not None and base.velocity.axes == "world" and "base.velocity" in keys:
        rings.setting[4] = float(not keys["base.velocity"].names[0].startswith(f"{base.topic}.linear"))
    if base.rate is not None and base.rate.columns and base.rate.axes == "world":
        rings.setting[5] = 1.0
    rings.now[: ring_kernels.COUNT] = np.nan
    rings.now[ring_kernels.BROKEN] = 0.0
    rings.arm[:], rings.gravity[:], rings.neutral[:] = imu_arm(chosen), model.gravity.linear, robot.neutral()
    for joint, place in chosen.joints.held.items():
        rings.neutral[robot.q_index(joint)] = place
    return memory
