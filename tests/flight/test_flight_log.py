"""The flight log keeps channels, units and truth through a file, and refuses what is not a flight."""

import io
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from aerobat_pin.aerobat import FlightLog, known_inputs
from aerobat_pin.errors import LogError
from aerobat_pin.experiments import Experiment, estimate_dataset
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


def test_a_crank_that_jumps_by_full_turns_is_the_same_crank(paper: Experiment) -> None:
    """As an encoder of one turn shows it; the air's force takes its rate and acceleration."""
    jumping = paper.log.measured.copy(deep=True)
    jumping["crank_angle"].values[:] = (jumping["crank_angle"] + np.pi) % (2.0 * np.pi) - np.pi
    smooth, jumps = (known_inputs(FlightLog(each), paper.robot).known for each in (paper.log.measured, jumping))
    for name, force in smooth.items():
        np.testing.assert_allclose(jumps[name], force, atol=1e-6)


def test_what_is_not_a_flight_is_refused(paper: Experiment, tmp_path: Path) -> None:
    """Missing channels, missing or backward time, intervals that do not fit, and files of another kind."""
    measured = paper.log.measured
    with pytest.raises(LogError, match="no channel named q or pose"):
        FlightLog(measured.drop_vars("q"))
    with pytest.raises(LogError, match="no coordinate named time"):
        FlightLog(measured.drop_vars("time"))
    with pytest.raises(LogError, match="must not decrease"):
        FlightLog(measured.assign_coords(time=measured["time"].values[::-1]))
    with pytest.raises(LogError, match="intervals between"):
        FlightLog(measured.isel(interval=slice(0, -2)))
    (tmp_path / "flight.nc").write_text("not a flight")
    with pytest.raises(LogError, match="cannot be read"):
        FlightLog.load(tmp_path / "flight.nc")
    with pytest.raises(LogError, match="cannot be read"):
        FlightLog.load(tmp_path / "missing.nc")
