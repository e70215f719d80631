"""Free flights of `paper`, calibrations learnt from them, and other flights as calibrated observers see them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pinocchio as pin

from aerobat_pin import aerobat
from aerobat_pin.aerobat.motion import Torque
from aerobat_pin.estimation import Calibration, CalibrationWatch, calibrate
from aerobat_pin.forces import KnownForces, KnownInputs, inputs_of
from aerobat_pin.records import Record
from aerobat_pin.scenario import AirSection, load_scenario
from support.mismatch import MISMATCHES, Seen, flown, heavier, shifted

FREE = ("simulation.duration=4.0",)
SIX_ERRORS = (  # of wing offset, density, added mass; with masses, centre of mass and drag in `with_six_errors`
    "believed.robot.changes.wing.offset_x=-0.055",
    "believed.robot.changes.aerodynamics.profile_drag=0.045",
    "believed.air.density=1.0412",
    "believed.air.added_mass=1.2",
)


def with_six_errors(model: pin.Model) -> None:
    """Change a model: all masses 5 % and the outer wings 15 % too heavy, the body's centre of mass 3 mm forward."""
    for change in (heavier(1.05), heavier(1.15, "left_elbow", "right_elbow"), shifted):
        change(model)


@dataclass(frozen=True)
class FreeFlight:
    """A flight without unknown forces, and what is believed of it."""

    log: aerobat.FlightLog
    robot: aerobat.Aerobat
    air: AirSection
    torque: Torque = "measured"

    def plugged(self) -> aerobat.AerobatRobot:
        """Return the believed robot in its air."""
        return aerobat.AerobatRobot.of(self.robot, self.air, self.torque)

    def record(self) -> Record:
        """Return the flight as a record to calibrate from."""
        return aerobat.free_record(self.log, self.plugged(), label="free")


def believed(
    log: aerobat.FlightLog, settings: Sequence[str], change: Callable[[pin.Model], None] | None = None
) -> FreeFlight:
    """Return a flight of `paper` with a belief: settings, and a change of the model."""
    scenario = load_scenario("paper", ["unknown_force=[]", *settings])
    robot: aerobat.Aerobat = aerobat.believed_robot(scenario)
    if change is not None:
        robot = replace(robot, model=robot.model.copy())
        change(robot.model)
    return FreeFlight(log, robot, scenario.believed_air)


@cache
def free_flight(row: str, sensors: tuple[str, ...] = (), seed: int = 101) -> FreeFlight:
    """Return 4 s of free flight with one of the beliefs of `MISMATCHES`."""
    wrong = MISMATCHES[row]
    log, _ = flown("no force", seed, (*FREE, *wrong.true, *sensors))
    return believed(log, wrong.believed, wrong.change)


@cache
def learnt(row: str, sensors: tuple[str, ...] = (), seed: int = 101) -> Calibration:
    """Return what the harmonics of the crank show in such a flight."""
    return calibrate([free_flight(row, sensors, seed).record()], parameters=[])


def flight_inputs(record: Record, calibration: Calibration | None) -> KnownInputs:
    """Return the inputs of an observer of a whole flight, with a calibration that was `applied` to it, or without."""
    forces, rows = KnownForces(record) if calibration is None else calibration.forces(record), record.robot.rows()
    assert rows is not None
    inputs = inputs_of(record, *record.parts[0], forces, rows)
    if calibration is None:
        return inputs
    watch = CalibrationWatch(calibration)
    watch.take(record, inputs, slice(0, len(inputs.tau)), ends=True)
    return replace(inputs, calibration=watch.use())


def seen_with(
    calibration: Calibration, free: FreeFlight, flight: str, seed: int = 1, more: tuple[str, ...] = ()
) -> Seen:
    """Return a flight as observers with the belief of a free flight, and a calibration, see it."""
    log, _ = flown(flight, seed, more)
    record = calibration.applied(aerobat.flight_record(log, free.plugged()))
    inputs = flight_inputs(record, calibration)
    truth = np.stack([aerobat.true_force(log, name)[1] for name in aerobat.FORCE_POINTS], axis=1)
    return Seen(record.robot.model, inputs, truth)
