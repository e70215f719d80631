"""Recordings of any robot: read by a map, checked, brought to common times, and their unknown forces estimated."""

from aerobat_pin.estimation.recordings.channels import LogChannel
from aerobat_pin.estimation.recordings.estimate_recording import RecordingEstimate, estimate_recording
from aerobat_pin.estimation.recordings.map_file import describe_map, load_map, parse_map, with_options
from aerobat_pin.estimation.recordings.map_tables import Map
from aerobat_pin.estimation.recordings.online import OnlineEstimator, OnlineSample
from aerobat_pin.estimation.recordings.sensor_scores import Compared
from aerobat_pin.estimation.recordings.stored_estimate import StoredEstimate
from aerobat_pin.estimation.recordings.suggest import suggested_map
from aerobat_pin.estimation.recordings.write_mcap import write_flight_mcap, write_mcap

__all__ = [
    "Compared",
    "LogChannel",
    "Map",
    "OnlineEstimator",
    "OnlineSample",
    "RecordingEstimate",
    "StoredEstimate",
    "describe_map",
    "estimate_recording",
    "load_map",
    "parse_map",
    "suggested_map",
    "with_options",
    "write_flight_mcap",
    "write_mcap",
]
