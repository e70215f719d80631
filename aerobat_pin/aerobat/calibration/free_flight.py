"""A flight without unknown forces, the belief about it, and what the belief leaves unexplained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.calibration.parameters import OF_MASS, changed_belief, scaled_thrusters
from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.aerobat.flight_record import known_inputs
from aerobat_pin.aerobat.torque import Torque
from aerobat_pin.estimation import KnownInputs
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.observers import MOMENT_ARM, MomentumObserver, Redundancy, moving_weight, redundancy_of
from aerobat_pin.robot import BASE_SIZE, FORCE_POINTS, Aerobat
from aerobat_pin.scenario import AirSection, RawSection

AT_ONCE = 1.0e9  # [1/s]: with so large a gain the filter of an observer passes every interval unchanged


@guarded()
@dataclass(frozen=True)
class FreeFlight:
    """A flight without unknown forces, what is believed of it, and the frames at which contacts would be sought.

    `raw` is the table `observers.raw`, for a log of raw samples.
    """

    name: str
    log: FlightLog
    robot: Aerobat
    air: AirSection
    torque: Torque
    frames: Sequence[str] = FORCE_POINTS
    raw: RawSection | None = None

    @cached_property
    def inputs(self) -> KnownInputs:
        """The inputs of an observer under the belief as it is."""
        return known_inputs(self.log, self.robot, self.torque, self.air)

    def seen_with(self, values: Mapping[str, float]) -> tuple[KnownInputs, Aerobat]:
        """Return the inputs of an observer, and the robot, with changed parameters."""
        robot, air = changed_belief(self.robot, self.air, values)
        of_air = {name: value for name, value in values.items() if name not in OF_MASS and value != 0.0}
        unchanged = not of_air and self.torque != "modelled"
        inputs = self.inputs if unchanged else known_inputs(self.log, robot, self.torque, air)
        return replace(inputs, known=scaled_thrusters(inputs.known, values)), robot

    @property
    def weight(self) -> float:
        """Weight of the believed robot [N]."""
        return moving_weight(self.robot.model)


def interval_residual(model: pin.Model, inputs: KnownInputs) -> Array:
    """Return phi (m, nv): mean unknown generalised force of each interval, not filtered, in N and N m."""
    observer = MomentumObserver(model, (), AT_ONCE)
    return observer.run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known).residual


def weighted(flight: FreeFlight, residual: Array) -> Array:
    """Return the rows of a residual (m, nv) that the flight's torques make known [N]; moments are divided by 50 mm."""
    rows = residual if flight.torque in ("measured", "modelled") else residual[:, :BASE_SIZE]
    return np.asarray(rows / np.where(np.arange(rows.shape[1]) < 3, 1.0, MOMENT_ARM))


def unexplained(flight: FreeFlight, residual: Array, part: slice = slice(None)) -> Redundancy:
    """Judge a part of what is left (m, nv) of a free flight: there no force explains anything, so all rows count."""
    start, stop, _ = part.indices(len(residual))
    rows = weighted(flight, residual)[start:stop]
    return redundancy_of(flight.inputs.time[start : stop + 1], rows, rows.shape[1] + 1, 1, flight.weight, ())
