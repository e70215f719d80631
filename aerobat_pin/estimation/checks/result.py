"""Checks of the estimate: the stretch without contact, power, fits, commands, the sensor."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np
import pinocchio as pin

from aerobat_pin.estimation.checks.agreement import CONFUSED, FOLLOWS
from aerobat_pin.estimation.checks.known_against_motion import OTHER_AXES, known_findings, thrust_order_findings
from aerobat_pin.estimation.checks.motion import MOST_SAMPLES, checked_part
from aerobat_pin.estimation.checks.untold_forces import elsewhere_findings
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.estimation.result import Result
from aerobat_pin.forces import (
    BESIDE,
    LEAST_LEFT,
    FreeMotion,
    KnownForces,
    PairedEstimate,
    StoredEstimate,
    believed_rows,
    column_rms,
    command_sum,
    rms_in,
    settled,
    unit_direction,
)
from aerobat_pin.numerics import Array, compare_series, frame_id, runs_of_true
from aerobat_pin.observers import AllBut, Applications, Expected, moving_weight, robot_length
from aerobat_pin.records import Record, body_turn

LATE_COMMAND = 5.0e-3  # [s]
FIT_HARMS = 1.02  # times what is left without a fit, from which it does harm elsewhere; of one of next to nothing 1
FIT_WORSE = 3.0  # times what a fit leaves where it was fitted, from which it does not hold elsewhere
HARDLY, LARGE = 0.8, 0.2  # of what is left without a fit of friction, and of the effort, from which it explains nothing
HUGE = 10.0  # times the robot's own inertia, from which that of a rotor is doubted
STANDS = 0.05  # [m/s] rms of a point that carries force, up to which it may stand
ALWAYS_SEEN = 0.95  # share of the time from which a component counts as always seen
MOST_WEIGHTS = 10.0  # rms of a force, from which units are doubted
MOSTLY_SEEN = 0.5  # of the time: vertical forces that are seen less do not add up to a weight
MANY = 20_000  # intervals of which the power is taken
MOST_NAMED = 3  # stretches of a component that is not seen
ALWAYS = 0.995  # share of the time that counts as all of it
STRAIGHT_ARM = 0.3  # sine of the angle between an unseen force and the lines from far joints to it, in a straight arm
ALONG = 0.3  # share of a component along the directions that the pose hides, from which it hides the component
FAINT_LEVER = 0.1  # lever of a direction over the largest one, below which the pose hides it
FAR = 0.3  # of the farthest joint's distance: joints nearer to the force have little lever anyhow


def result_findings(
    result: Result, motion: Callable[[], FreeMotion | None], expected: Expected | None = None
) -> Iterator[Finding]:
    """Yield what the estimate itself shows, and the sensor beside it.

    `motion` gives that of a free robot's record, None if it is too short.
    """
    record, forces, estimates = result.record, result.forces, result.stored
    assert record is not None
    assert forces is not None
    yield from fit_findings(forces)
    yield from _check_commands(record, forces)
    estimate = next(iter(estimates.values()))
    for side in next(iter(result.compared.values())):
        yield from _sensor_findings(record, side, estimate)
    (sums, squares, seen), count = np.zeros((3, len(estimate.head.units))), 0
    for block in estimate.blocks():
        good = settled(record, block.time[:-1])
        shown = np.where(block.shown, block.components, 0.0)[good]
        sums, squares = sums + shown.sum(axis=0), squares + (shown**2).sum(axis=0)
        seen += block.shown[good].sum(axis=0)
        count += int(good.sum())
    mean = None
    if estimate.head.are_world_forces and np.all(seen[2::3] > MOSTLY_SEEN * count):
        mean = sums.reshape(-1, 3).sum(axis=0) / max(count, 1)
    known = [*known_findings(forces, motion() if record.robot.free else None, mean)]
    yield from known
    if all(each.check != OTHER_AXES for each in known):
        yield from thrust_order_findings(record, forces)
    if not count:
        yield Finding("settling", "warning", "no part is longer than five time constants 1/K of the observer")
        return
    yield from _force_sizes(record, estimate, np.sqrt(squares / count))
    if estimate.head.are_world_forces:
        yield from _power(record, estimate)
    yield from elsewhere_findings(record, estimate, expected)
    yield from seen_findings(record, forces, estimates)
    if record.map.use.free is not None:
        yield from _free_stretch(record, estimates)


def fit_findings(forces: KnownForces) -> Iterator[Finding]:
    """Yield fits that do not hold on the part of the record that they did not use, or explain hardly anything there."""
    efforts = _effort_sizes(forces.record) if forces.fits else {}
    yield from _rotor_findings(forces)
    for fit in forces.fits:
        noise = fit.values.get("noise", 0.0)
        smooth = [max(size**2 - noise**2, 0.0) ** 0.5 for size in (fit.outside, fit.before)]
        if fit.untold:
            yield Finding("fit", "note", fit.untold)
        if np.isnan(fit.outside) and not fit.name.endswith(BESIDE):  # which k tests
            text = f"{fit.name}: no further part is known to be free of contact (use.free), so nothing tests it"
            yield Finding("fit", "note", text)
        elif fit.outside > FIT_HARMS * fit.before or fit.outside > max(FIT_WORSE * fit.inside, LEAST_LEFT * fit.before):
            sizes = (
                f"leaves {fit.outside:.3g} {fit.unit} on the rest, {fit.inside:.3g} where fitted, "
                f"{fit.before:.3g} without"
            )
            yield Finding("fit", "warning", f"{fit.name} does not hold: it {sizes}", fit.outside, fit.unit)
        elif smooth[0] > HARDLY * smooth[1] and smooth[0] > LARGE * efforts.get(fit.name, np.inf):
            text = (
                f"{fit.name} explains hardly anything: {fit.outside:.3g} of {fit.before:.3g} {fit.unit} are left on "
                "the rest; sign, order, zero or gear of a joint may be wrong, or the mass"
            )
            yield Finding("fit", "warning", text, fit.outside, fit.unit)


def _rotor_findings(forces: KnownForces) -> Iterator[Finding]:
    """Yield rotors that fits take for far heavier than all of the robot, as motion in other units makes them."""
    robot, friction = forces.record.robot, forces.values.friction
    if friction is None:
        return
    mass = sum(inertia.mass for inertia in robot.model.inertias.tolist()[1:])
    for joint, inertia in zip(forces.values.joints, friction.inertia.tolist(), strict=True):
        unit, whole = ("kg", mass) if robot.slides(joint) else ("kg m2", mass * robot_length(robot.model) ** 2)
        if inertia > HUGE * whole:
            text = f"the rotor of {joint} would have {inertia:.3g} {unit}, all of the robot has {whole:.3g}"
            asked = "are units and factors of its positions, rates and efforts right?"
            yield Finding("fit", "warning", f"{text}: {asked}", inertia, unit)


def _effort_sizes(record: Record) -> dict[str, float]:
    """Return name of a joint's fit of friction -> rms of its effort [N, N m]."""
    if "joints.effort" not in record.channels or not record.parts:
        return {}
    means = [record.means("joints.effort", record.times(*ends)) for ends in record.spread(MANY)]
    rms = column_rms(np.concatenate(means)).tolist()
    return {f"friction of {joint}": size for joint, size in zip(record.driven, rms, strict=True)}


def _sensor_findings(record: Record, side: PairedEstimate, estimate: StoredEstimate) -> Iterator[Finding]:
    """Yield sign and factor of the sensor against the estimate, on its liveliest component, if that is always seen."""
    k = side.liveliest
    name = f"{side.reference.frame}.{side.reference.labels[k]}"
    if estimate.seen is not None and estimate.seen[estimate.head.identifiability.components.index(name)] < ALWAYS_SEEN:
        return
    estimated, sensed = side.sample(MOST_SAMPLES)
    comparison = compare_series(estimated[:, [k]], sensed[:, [k]], np.arange(len(estimated)) * record.dt)
    if comparison is None or not comparison.swings.all():
        return
    factor, correlation = float(comparison.factor[0]), float(comparison.correlation[0])
    good, why = abs(factor - 1.0) < 0.15, ""
    if correlation < -FOLLOWS:
        good, why = False, ": check.wrench.sign, or .axes"
    elif abs(correlation) < CONFUSED:
        good, why = False, ": other axes, another point"
    text = f"the sensor's {name} is {factor:.3g} times the estimate, correlation {correlation:.2f}{why}"
    yield Finding("sensor against estimate", "good" if good else "warning", text, factor, "1")


def _check_commands(record: Record, forces: KnownForces) -> Iterator[Finding]:
    """Yield how late the acceleration follows the commands of thrusts; of those that point one way, their sum."""
    if "check.specific_force" not in record.channels:
        return
    time = record.times(*checked_part(record))
    felt = record.means("check.specific_force", time) @ body_turn(record.map).T
    alike: dict[tuple[float, ...], list[str]] = {}
    for name, section in record.map.known.items():
        if section.powers:
            alike.setdefault((section.delay, *unit_direction(section).tolist()), []).append(name)
    for (delay, *direction), names in alike.items():
        measured = (felt @ np.array(direction))[:, None]
        commands = np.sum([command_sum(record, name, time) for name in names], axis=0)
        comparison = compare_series(commands[:, None], measured, time[:-1])
        if comparison is None or comparison.correlation[0] < FOLLOWS:
            continue
        what = f"{', '.join(f'known.{name}' for name in names)} lead{'s' if len(names) == 1 else ''}"
        text = (
            f"{what} the acceleration by {1e3 * comparison.lag:.0f} ms beyond {'its' if len(names) == 1 else 'their'} "
            f"delay of {1e3 * delay:.0f} ms"
        )
        late = abs(comparison.lag) > max(LATE_COMMAND, record.dt)
        yield Finding("lag of command", "warning" if late else "good", text, comparison.lag, "s")


def _force_sizes(record: Record, estimate: StoredEstimate, rms: Array) -> Iterator[Finding]:
    """Yield that a force is larger than any that a robot stands; `rms` (c,) is that of each component [N, N m]."""
    weight = moving_weight(record.robot.model)
    weights = [size / weight for size, unit in zip(rms, estimate.head.units, strict=True) if unit == "N"]
    if max(weights, default=0.0) > MOST_WEIGHTS:
        what = f"a force of {max(weights):.0f} weights of the robot, rms: rad, rad/s, N m and s were expected"
        yield Finding("size of forces", "warning", what, max(weights), "1")


def _power(record: Record, estimate: StoredEstimate) -> Iterator[Finding]:
    """Yield the mean power of each force at its point: positive drives the robot, negative brakes it."""
    model = record.robot.model
    first, last = record.parts[0]
    block = record.block(first, min(last, first + MANY))
    offset = estimate.index(block.time[0])
    estimated = estimate.between(offset, offset + len(block.tau))
    every = slice(None, None, max(1, len(block.tau) // 1000))
    chosen = np.flatnonzero(settled(record, estimated.time[:-1])[every]) * every.step
    if not len(chosen):
        return
    frames, force = estimated.frames, estimated.force[chosen]
    data, points, speed = model.createData(), [frame_id(model, frame) for frame in frames], np.empty(force.shape)
    for row, q, v in zip(speed, block.q[chosen], block.v[chosen], strict=True):
        pin.forwardKinematics(model, data, q, v)
        row[:] = [pin.getFrameVelocity(model, data, point, pin.LOCAL_WORLD_ALIGNED).linear for point in points]
    powers, size = np.mean(np.sum(force * speed, axis=2), axis=0), np.sum(force**2, axis=2)
    moved = np.sum(size * np.sum(speed**2, axis=2), axis=0) / np.maximum(np.sum(size, axis=0), 1e-12)
    yield from _held_still(record, frames, np.sqrt(moved))
    means = ", ".join(f"{frame} {power:.3g} W" for frame, power in zip(frames, powers, strict=True))
    yield Finding("power", "note", f"mean power of the force at its point: {means}", float(powers.sum()), "W")


def _held_still(record: Record, frames: tuple[str, ...], speeds: Array) -> Iterator[Finding]:
    """Yield points that move where they carry force, though something that the map holds still may move instead.

    `speeds` (k,) are their rms [m/s], weighted by the squares of the forces.
    """
    model, fixed = record.robot.model, ["the base"] if record.map.base.held else []
    fast = [(frame, speed) for frame, speed in zip(frames, speeds.tolist(), strict=True) if speed > STANDS]
    bodies = [model.frames[frame_id(model, frame)].parentJoint for frame, _ in fast]
    carrying = {joint for body in bodies for joint in model.supports[body]}
    fixed += [name for name in record.map.joints.held if model.getJointId(name) in carrying]
    if fixed and fast:
        words = ", ".join(f"{frame} at {speed:.2g} m/s" for frame, speed in fast)
        text = (
            f"points move where they carry force: {words}. A foot on the ground stands; does what the map holds still "
            f"move in its place ({', '.join(fixed)})? Then its position belongs into the map"
        )
        yield Finding("held still", "note", text, max(speed for _, speed in fast), "m/s")


def _free_stretch(record: Record, estimates: Mapping[str, StoredEstimate]) -> Iterator[Finding]:
    """Yield the force that is found where the map says that nothing touches the robot."""
    free = record.map.use.free
    assert free is not None
    for name, estimate in estimates.items():
        sizes = rms_in(record, estimate, free)
        if sizes is None:
            yield Finding("stretch without contact", "warning", f"use.free = {list(free)}: nothing estimated there")
            return
        labels, units = estimate.head.identifiability.components, estimate.head.units
        words = ", ".join(
            f"{label} {size:.3g} {unit}"
            for label, size, unit in zip(labels, sizes, units, strict=True)
            if np.isfinite(size)
        )
        text, largest = f"{name} finds {words} rms where nothing touches the robot: its error bar", np.nanargmax(sizes)
        yield Finding("stretch without contact", "note", text, float(sizes[largest]), units[largest])


def seen_findings(record: Record, forces: KnownForces, estimates: Mapping[str, StoredEstimate]) -> Iterator[Finding]:
    """Yield when the pose does not show a component and why, and whether anything verifies the deviations."""
    named: set[str] = set()
    for estimate in estimates.values():
        if estimate.seen is None:
            continue
        for k, size in enumerate(estimate.component_sizes()):
            if size.seen is None or size.seen > ALWAYS or size.name in named:
                continue
            named.add(size.name)
            unseen = np.concatenate([~block.shown[:, k] for block in estimate.blocks()])
            hidden = sorted(runs_of_true(unseen), key=lambda ends: ends[0] - ends[1])  # the longest first
            begin, end = hidden[0]
            times = ", ".join(
                f"{estimate.start[a] - record.start:.3g} to {estimate.start[b - 1] - record.start + record.dt:.3g} s"
                for a, b in hidden[:MOST_NAMED]
            )
            times += f" and {len(hidden) - MOST_NAMED} times more" if len(hidden) > MOST_NAMED else ""
            sure = "" if size.deviation is None else f", +-{size.deviation:.2g} {size.unit} there"
            why = _reason(record, estimate, (begin + end) // 2, k)
            text = f"{size.name}: seen {size.seen:.0%} of the time{sure}; not seen {times}: {why}"
            yield Finding("what the pose shows", "note", text, size.seen, "1")
        if (
            estimate.head.doubt is not None
            and estimate.doubt is None
            and not forces.values.row_noise
            and "bar" not in named
        ):
            named.add("bar")
            text = "error bar unverified: no row to spare shows how large the errors are, and no calibration says it"
            yield Finding("error bar", "note", text)


def _reason(record: Record, estimate: StoredEstimate, at: int, component: int) -> str:
    """Return in words which force the rows do not show at an interval, or that they err too much for a component."""
    head, time = estimate.head, estimate.start[at]
    if not head.are_world_forces:
        return "no row shows it"
    index = int(np.clip(round(record.index_after(time - record.start)), 0, record.parts[-1][1] - 1))
    q = record.block(index, index + 1).q[0]
    rows = believed_rows(record)
    kept = rows.kept(record.robot.model) if isinstance(rows, AllBut) else slice(None)
    J = Applications(record.robot.model, head.frames).jacobian(q)[:, kept]
    _, levers, directions = np.linalg.svd(J.T, full_matrices=True)
    levers = np.pad(levers, (0, len(directions) - len(levers)))
    faintest = directions[levers <= FAINT_LEVER * levers[0]]
    part: Array = faintest.T @ faintest[:, component]  # what the pose hides of the component
    if np.linalg.norm(part) < ALONG:
        return "the rows that show it err too much there"
    hidden = (faintest[-1] if abs(faintest[-1, component]) >= ALONG else part).reshape(-1, 3)
    loudest = int(np.argmax(np.linalg.norm(hidden, axis=1)))
    direction = hidden[loudest] / np.linalg.norm(hidden[loudest])
    direction = direction * np.sign(direction[np.argmax(np.abs(direction))])
    axes = ", ".join(f"{value:.2f}" for value in direction.round(2) + 0.0)  # no -0.00
    words = f"a force along ({axes}) at {head.frames[loudest]} hardly turns a joint"
    straight = not record.robot.free and _is_straight(record, q, head.frames[loudest], direction)
    return f"{words}: the arm is straight" if straight else words


def _is_straight(record: Record, q: Array, frame: str, direction: Array) -> bool:
    """Return whether a direction at a frame points to all joints that carry the frame from afar."""
    model = record.robot.model
    data, index = model.createData(), frame_id(model, frame)
    pin.framesForwardKinematics(model, data, q)
    carrying = [joint for joint in model.supports[model.frames[index].parentJoint] if joint > 0]
    lines = np.array([data.oMf[index].translation - data.oMi[joint].translation for joint in carrying])
    lengths = np.linalg.norm(lines, axis=1)
    far = lengths > FAR * lengths.max()
    across = np.linalg.norm(np.cross(lines, direction), axis=1)
    return bool(np.all(across[far] < STRAIGHT_ARM * lengths[far]))
