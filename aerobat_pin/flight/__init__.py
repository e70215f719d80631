"""From a scenario to a flight log: plant, crank, sensors, and the log, the only data that estimators receive."""

from aerobat_pin.aerobat import KNOWN as KNOWN
from aerobat_pin.aerobat import LABELS as LABELS
from aerobat_pin.aerobat import FlightLog as FlightLog
from aerobat_pin.aerobat import read_log as read_log
from aerobat_pin.aerobat import write_csv as write_csv
from aerobat_pin.errors import old_names
from aerobat_pin.flight.crank import ConstantRate, CrankDrive, RateControlledMotor, SpinUp
from aerobat_pin.flight.loop import ClosedLoop, LoopRecord, Pilot
from aerobat_pin.flight.motion_and_wake import Wake, log_with_motion, wake_of
from aerobat_pin.flight.mujoco_robot import MujocoRobot
from aerobat_pin.flight.plant.kernels import advance_stage
from aerobat_pin.flight.plant.plant import Plant
from aerobat_pin.flight.plant.plant_state import interval_means
from aerobat_pin.flight.plant.simulated_elsewhere import SimulatedMotion, Simulator
from aerobat_pin.flight.plant.tables import Trajectory
from aerobat_pin.flight.sensors import Sensing
from aerobat_pin.flight.simulate import flight_log_of, simulate
from aerobat_pin.flight.thrusters import LaggedThrust, ThrusterSet, thrusters_of
from aerobat_pin.flight.trim import Trim, find_trim

__all__ = [
    "ClosedLoop",
    "ConstantRate",
    "CrankDrive",
    "LaggedThrust",
    "LoopRecord",
    "MujocoRobot",
    "Pilot",
    "Plant",
    "RateControlledMotor",
    "Sensing",
    "SimulatedMotion",
    "Simulator",
    "SpinUp",
    "ThrusterSet",
    "Trajectory",
    "Trim",
    "Wake",
    "advance_stage",
    "find_trim",
    "flight_log_of",
    "interval_means",
    "log_with_motion",
    "simulate",
    "thrusters_of",
    "wake_of",
]

__getattr__ = old_names(__name__, {"Flown": "Trajectory"})
