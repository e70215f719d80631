"""The flight log keeps channels, units and truth through a file, and refuses what is not a flight."""

import io
from pathlib import Path

import numpy as np
import xarray as xr

from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.aerobat.flight_record import known_inputs
from aerobat_pin.experiments.experiment import Experiment
from aerobat_pin.experiments.write_results import estimate_dataset
from aerobat_pin.records import netcdf_bytes


def test_a_log_survives_its_file(paper: Experiment, tmp_path: Path) -> None:
    """NetCDF-4 and back: every number, unit and attribute, measured and true."""
    paper.log.save(tmp_path / "flight.nc")
    again = FlightLog.load(tmp_path / "flight.nc")
    xr.testing.assert_identical(again.measured, paper.log.measured)
    assert again.truth is not None
    xr.testing.assert_equal(again.truth, paper.log.truth)


def test_a_file_is_what_xarray_writes(paper: Experiment) -> None:
    """Names, dimensions, units, types and values, as xarray reads them; for texts, truth values and scalars too."""
    odd = xr.Dataset(
        {"truth": ("k", [True, False]), "scalar": 3, "word": "so", "none": (("e", "k"), np.zeros((0, 2)))},
        {"k": ["ä", ""], "other": ("k", [1.0, np.nan]), "elsewhere": ("bare", [1, 2, 3])},
        {"number": 2.5, "text": "", "numbers": [1.0, 2.0], "words": ["a", "b"]},
    )
    for parts in ([paper.log.measured, paper.log.truth], [estimate_dataset(paper.estimates)], [odd]):
        ours, expected = io.BytesIO(netcdf_bytes(*parts)), io.BytesIO()
        for group, mode, data in zip((None, "truth"), "wa", parts, strict=False):
            data.to_netcdf(expected, mode=mode, group=group, engine="h5netcdf")
        for group in (None, "truth")[: len(parts)]:
            found, right = (xr.load_dataset(file, group=group, engine="h5netcdf") for file in (ours, expected))
            xr.testing.assert_identical(found, right)
            assert {key: found[key].dtype for key in found} == {key: right[key].dtype for key in right}


def test_an_observer_is_fed_from_the_measured_side_alone(paper: Experiment) -> None:
    """Without its truth a log gives the same inputs, each with its source."""
    whole, blind = (known_inputs(log, paper.robot) for log in (paper.log, FlightLog(paper.log.measured)))
    np.testing.assert_array_equal(whole.tau, blind.tau)
    assert set(blind.known) == {"aerodynamic", "added_mass", "thrusters"}
    assert blind.source["motor_torque"] == "measured"
    assert blind.source["aerodynamic"] == "reconstructed"
