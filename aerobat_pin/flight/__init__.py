"""From a scenario to a flight log: plant, crank, sensors, and the log, the only data that estimators receive."""

from aerobat_pin.flight.air_from_scenario import robot_air, wind_of
from aerobat_pin.flight.crank import ConstantRate, CrankDrive, RateControlledMotor, SpinUp
from aerobat_pin.flight.csv_log import read_csv, write_csv
from aerobat_pin.flight.flight_log import KNOWN, FlightLog, channel
from aerobat_pin.flight.plant.kernels import advance_stage
from aerobat_pin.flight.plant.plant import Plant
from aerobat_pin.flight.point_forces import interval_means
from aerobat_pin.flight.simulate import simulate
from aerobat_pin.flight.trim import Trim, find_trim
from aerobat_pin.flight.wake import Wake, wake_of

__all__ = [
    "KNOWN",
    "ConstantRate",
    "CrankDrive",
    "FlightLog",
    "Plant",
    "RateControlledMotor",
    "SpinUp",
    "Trim",
    "Wake",
    "advance_stage",
    "channel",
    "find_trim",
    "interval_means",
    "read_csv",
    "robot_air",
    "simulate",
    "wake_of",
    "wind_of",
    "write_csv",
]
