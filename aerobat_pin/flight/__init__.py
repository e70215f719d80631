"""From a scenario to a flight log: plant, crank, sensors, and the log, the only data that estimators receive."""

from aerobat_pin.flight.air_from_scenario import robot_air, wind_of
from aerobat_pin.flight.channels import KNOWN, LABELS, channel
from aerobat_pin.flight.crank import ConstantRate, CrankDrive, RateControlledMotor, SpinUp
from aerobat_pin.flight.csv_log import read_csv, write_csv
from aerobat_pin.flight.flight_log import FlightLog
from aerobat_pin.flight.loop import ClosedLoop, LoopRecord, Pilot
from aerobat_pin.flight.netcdf import StoredVariable, netcdf_variables, read_netcdf
from aerobat_pin.flight.plant.kernels import advance_stage
from aerobat_pin.flight.plant.plant import Plant
from aerobat_pin.flight.point_forces import interval_means
from aerobat_pin.flight.sensors import Sensing
from aerobat_pin.flight.shown_motion import log_with_motion
from aerobat_pin.flight.simulate import simulate
from aerobat_pin.flight.thrusters import LaggedThrust, ThrusterSet, thrusters_of
from aerobat_pin.flight.trim import Trim, find_trim
from aerobat_pin.flight.wake import Wake, wake_of
from aerobat_pin.flight.write_netcdf import netcdf_bytes, seal_netcdf

__all__ = [
    "KNOWN",
    "LABELS",
    "ClosedLoop",
    "ConstantRate",
    "CrankDrive",
    "FlightLog",
    "LaggedThrust",
    "LoopRecord",
    "Pilot",
    "Plant",
    "RateControlledMotor",
    "Sensing",
    "SpinUp",
    "StoredVariable",
    "ThrusterSet",
    "Trim",
    "Wake",
    "advance_stage",
    "channel",
    "find_trim",
    "interval_means",
    "log_with_motion",
    "netcdf_bytes",
    "netcdf_variables",
    "read_csv",
    "read_netcdf",
    "robot_air",
    "seal_netcdf",
    "simulate",
    "thrusters_of",
    "wake_of",
    "wind_of",
    "write_csv",
]
