"""From raw samples to the estimates that every observer gives: forces, deviations, identifiability, redundancy."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from aerobat_pin.aerobat.accelerometer_mount import Mount
from aerobat_pin.aerobat.aerobat import Aerobat
from aerobat_pin.aerobat.flight_log import SUM
from aerobat_pin.aerobat.motion import ROWS_OF_TORQUE, Torque
from aerobat_pin.aerobat.prescribed_joints import BASE_SIZE
from aerobat_pin.aerobat.raw.channels import RawRecord, raw_record
from aerobat_pin.aerobat.raw.filter import JointFilter
from aerobat_pin.aerobat.raw.find_mount import mounted
from aerobat_pin.aerobat.raw.layout import FORCE_PRIOR
from aerobat_pin.aerobat.raw.smoother import JointEstimate, JointSmoother
from aerobat_pin.errors import ScenarioError
from aerobat_pin.forces import KnownInputs
from aerobat_pin.numerics import Array
from aerobat_pin.observers import OBSERVERS, Applications, Estimate, Identifiability, Innovation, Observer
from aerobat_pin.records import Block, Channel, SmoothedMotion
from aerobat_pin.scenario import AirSection, RawSection

RAW_OBSERVERS = ("smoother", "kalman")
NIS_LIMITS = 0.5, 1.6  # of a sensor's innovations, outside of which its stated noise is questioned


def smoothed_raw(
    time: Array,
    channels: Mapping[str, Channel],
    observers: Sequence[Observer],
    progress: Callable[[float], None] | None,
    robot: Aerobat,
    air: AirSection,
    torque: Torque,
    settings: RawSection,
    mount: Mount | None,
) -> SmoothedMotion:
    """Find motion and forces together from raw samples.

    Args:
        time: (m + 1,) knots [s].
        channels: key of the record -> channel.
        observers: `smoother` and `kalman` name the joint smoother and the causal filter; frames and gain are theirs.
        progress: called with the share that is done.
        robot: the believed robot.
        air: the believed air.
        torque: which joint torque is known.
        settings: what is assumed of raw samples.
        mount: place and turn of the accelerometer as found by a calibration; as stated when None.

    Raises:
        ScenarioError: an observer cannot use raw samples, or there is no frame.
        LogError: a channel is missing.
    """
    names, frames, gain = [each.name for each in observers], observers[0].applications.frames, observers[0].gain
    if not frames:  # then `observers` is none of those that were asked for
        raise ScenarioError("observers.frames = []: raw samples show forces at frames, one or more were expected")
    if wrong := [name for name in names if name not in RAW_OBSERVERS]:
        raise ScenarioError(
            f"observers.names: {wrong[0]} needs q and v, and the log has raw samples: {' and '.join(RAW_OBSERVERS)} "
            "find both"
        )
    record = raw_record(time, channels, robot, torque, settings)
    if mount is not None:
        record = mounted(record, mount)
    smoother = JointSmoother(robot, air, frames, settings)
    smoothed = smoother.run(record, progress)
    record = record.shifted(smoothed.applied)
    inputs = smoothed_inputs(record, robot, smoother, smoothed)
    checked = OBSERVERS["force_level"](robot.model, frames, gain, ROWS_OF_TORQUE[torque]).run(
        inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known
    )
    estimates = {}
    for name in names:
        estimate = filtered(record, smoother, smoothed) if name == "kalman" else smoothed
        estimates[name] = as_estimate(name, checked, inputs, robot, torque, estimate)
    extra = {"crank": smoothed.nominal.crank.T}
    block = Block(inputs.time, inputs.q, inputs.v, inputs.tau, extra, frozenset(channels), inputs.source)
    return SmoothedMotion(block, inputs.known, estimates)


def filtered(record: RawRecord, smoother: JointSmoother, smoothed: JointEstimate) -> JointEstimate:
    """Return the joint estimate with forces, covariances and innovations of the causal filter.

    Until the filter starts, the forces are zero, as uncertain as before any sample.
    """
    samples = JointFilter(smoother, smoothed.tuning, record.channels, record.torque).run(record)
    m, points = smoothed.force.shape[:2]
    spread = (FORCE_PRIOR * smoother.weight) ** 2
    force, covariance = np.zeros((m, points, 3)), np.tile(spread * np.eye(3 * points), (m, 1, 1))
    innovation = np.zeros((m, 2))
    for k, sample in enumerate(samples[1:]):
        if sample is not None:
            force[k], covariance[k], innovation[k] = sample.force, sample.covariance, sample.innovation
    return replace(smoothed, force=force, force_covariance=covariance, innovation=innovation)


def smoothed_inputs(record: RawRecord, robot: Aerobat, smoother: JointSmoother, smoothed: JointEstimate) -> KnownInputs:
    """Return the smoothed motion, the torque over each interval and the air along it, as inputs of an observer."""
    moved = smoother.air.motion(smoothed.nominal)
    tau = np.zeros((len(record.time) - 1, robot.model.nv))
    if (torque := record.channels.get("torque")) is not None:
        middle = 0.5 * (record.time[1:] + record.time[:-1])
        values = np.column_stack([np.interp(middle, torque.time, column) for column in torque.values.T])
        if record.torque == "motor_only":
            angle = 0.5 * (smoothed.nominal.crank[1:, 0] + smoothed.nominal.crank[:-1, 0])
            values = np.column_stack(robot.linkage.solve(angle).joint_torques(0.5 * values[:, 0]) * 2)
        tau[:, list(robot.idx_v)] = values
    known = {"aerodynamic": smoother.air.fly(smoothed.nominal, np.zeros((len(tau), robot.model.nv, BASE_SIZE))).force}
    known["other known forces"] = record.known
    source = dict.fromkeys(("q", "v"), "smoothed from raw samples") | {
        "aerodynamic": "reconstructed",
        "other known forces": "measured",
        "motor_torque": record.torque,
    }
    rows = ROWS_OF_TORQUE[record.torque]
    return KnownInputs(record.time, moved.q, moved.v, tau, known, rows, source, crank=smoothed.nominal.crank[:, 0])


def as_estimate(
    name: str, checked: Estimate, inputs: KnownInputs, robot: Aerobat, torque: Torque, estimate: JointEstimate
) -> Estimate:
    """Return the forces that smoother or filter found as an estimate; without torques, their sum over the frames.

    Identifiability and redundancy are those that `force_level` checked along the smoothed motion.
    """
    (m, points, _), covariance, (total, count) = estimate.force.shape, estimate.force_covariance, estimate.innovation.T
    counted = count > 0.0
    nis = np.where(counted, total / np.maximum(count, 1.0), 1.0)
    centred = nis[counted] - 1.0
    white = float(np.sum(centred[1:] * centred[:-1]) / max(float(np.sum(centred[:-1] ** 2)), 1e-300))
    components, frames, units = estimate.force.reshape(m, -1), checked.frames, checked.units
    identifiability, warnings = checked.identifiability, warnings_of(estimate)
    if torque == "none" and points > 1:
        warnings.append(f"torque none: the split between {', '.join(frames)} is not determined; the sum is given")
        adding = np.tile(np.eye(3), points)
        components, covariance = components @ adding.T, adding @ covariance @ adding.T
        frames, units = (SUM,), units[:3]
        labels = tuple(f"{SUM}.F{axis}" for axis in "xyz")
        identifiability = Identifiability(labels, 3, np.ones(3), np.zeros((0, 3)), np.ones(3))
    deviation = np.sqrt(np.maximum(np.einsum("kii->ki", covariance), 0.0))
    J = Applications(robot.model, checked.frames).jacobian(inputs.q[:-1])  # at the start of each interval
    return replace(
        checked,
        observer=name,
        components=components,
        frames=frames,
        units=units,
        residual=np.einsum("mcn,mc->mn", J, estimate.force.reshape(m, -1)),
        identifiability=identifiability,
        standard_deviation=deviation,
        innovation=Innovation(nis, white),
        notes=tuple(notes_of(estimate)),
        warnings=tuple(warnings),
    )


def notes_of(smoothed: JointEstimate) -> list[str]:
    """Return what a reader of the estimate should know: tuning, jumps, factors."""
    lines = [f"{'chosen by likelihood' if smoothed.chosen else 'stated'}: {smoothed.tuning}"]
    if smoothed.jumps:
        lines.append(f"the forces jump at {', '.join(f'{time:.4g}' for time in smoothed.jumps)} s")
    lines += [f"factor of the {name} {value:.3f} +- {spread:.3f}" for name, (value, spread) in smoothed.factors.items()]
    return lines


def warnings_of(smoothed: JointEstimate) -> list[str]:
    """Return what spoils the estimate: clock offsets, stated noise that the samples contradict, no convergence."""
    lines = []
    if sure := [offset for offset in smoothed.offsets if offset.sure]:
        words = "; ".join(map(str, sure)) if smoothed.applied else str(sure[0])
        lines.append(f"late channel: {words}; {'' if smoothed.applied else 'not '}applied: observers.raw.apply_offsets")
    for name, ratio in smoothed.nis.items():
        if not NIS_LIMITS[0] < ratio < NIS_LIMITS[1]:
            lines.append(
                f"noise of {name}: its samples are {np.sqrt(ratio):.2g} times as far from their prediction as stated; "
                f"check observers.raw.noise.{name}"
            )
    if not smoothed.settled:
        lines.append(f"after {smoothed.iterations} linearisations the motion still changes: observers.raw.iterations")
    return lines
