"""Observers of external forces on any `pinocchio.Model`, from samples and known forces; no aerodynamics needed."""

from aerobat_pin.observers.analysis.bias import Bias, bias_of
from aerobat_pin.observers.analysis.events import CusumDetector, Event, LevelDetector, calibrate_cusum, calibrate_level
from aerobat_pin.observers.analysis.line_of_action import Crossing, LineOfAction, locate
from aerobat_pin.observers.analysis.noise_and_lag import (
    Prediction,
    SensorNoise,
    gain_for_deviation,
    gain_for_lag,
    predict,
)
from aerobat_pin.observers.analysis.point_of_action import PointOfAction, locate_series
from aerobat_pin.observers.applications import Application
from aerobat_pin.observers.estimate import Estimate, Innovation, Sample
from aerobat_pin.observers.friction import FRICTION_COEFFICIENTS, SMOOTH_RATE, JointFriction, fit_friction
from aerobat_pin.observers.identifiability import Identifiability
from aerobat_pin.observers.joints import row_names
from aerobat_pin.observers.kalman.kalman import KalmanObserver, KalmanSample, SmootherObserver
from aerobat_pin.observers.momentum import ForceLevelObserver, MomentumObserver, SecondOrderObserver
from aerobat_pin.observers.observer import DEFAULT_GAIN, Observer
from aerobat_pin.observers.redundancy import Redundancy, redundancy_of, slow_part
from aerobat_pin.observers.rows import MOMENT_ARM, AllBut, Rows, Tie, moving_weight, tie_joints
from aerobat_pin.observers.super_twisting import SuperTwistingObserver

OBSERVERS: dict[str, type[Observer]] = {
    kind.name: kind
    for kind in (
        MomentumObserver,
        ForceLevelObserver,
        SecondOrderObserver,
        SuperTwistingObserver,
        KalmanObserver,
        SmootherObserver,
    )
}

__all__ = [
    "DEFAULT_GAIN",
    "FRICTION_COEFFICIENTS",
    "MOMENT_ARM",
    "OBSERVERS",
    "SMOOTH_RATE",
    "AllBut",
    "Application",
    "Bias",
    "Crossing",
    "CusumDetector",
    "Estimate",
    "Event",
    "ForceLevelObserver",
    "Identifiability",
    "Innovation",
    "JointFriction",
    "KalmanObserver",
    "KalmanSample",
    "LevelDetector",
    "LineOfAction",
    "MomentumObserver",
    "Observer",
    "PointOfAction",
    "Prediction",
    "Redundancy",
    "Rows",
    "Sample",
    "SecondOrderObserver",
    "SensorNoise",
    "SmootherObserver",
    "SuperTwistingObserver",
    "Tie",
    "bias_of",
    "calibrate_cusum",
    "calibrate_level",
    "fit_friction",
    "gain_for_deviation",
    "gain_for_lag",
    "locate",
    "locate_series",
    "moving_weight",
    "predict",
    "redundancy_of",
    "row_names",
    "slow_part",
    "tie_joints",
]
