"""What estimates are called on their way into files, and what a person sees of the objects of a flight."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr
from support.arm import arm
from support.kernel_cases import record

from aerobat_pin.experiments.experiment import Experiment
from aerobat_pin.experiments.result_tables import estimate_dataset, estimate_table
from aerobat_pin.flight.plant.plant import Plant
from aerobat_pin.observers import Application, ForceLevelObserver, KalmanObserver


def test_moments_are_not_called_newtons_in_the_files_of_an_estimate(tmp_path: Path) -> None:
    """A wrench in frame axes beside a force along a line: text and NetCDF hold every component with its own unit."""
    model, _ = arm()
    elbow = model.names[3]
    there = [Application("tool", "wrench", "frame"), Application(elbow, direction=(0.0, 1.0, 0.0))]
    time, q, v, tau, known = record(model)
    both = [kind(model, there).run(time, q, v, tau, known) for kind in (ForceLevelObserver, KalmanObserver)]
    estimates = {one.observer: one for one in both}
    header, *rows = estimate_table(estimates).splitlines()
    table = dict(zip(header.split(","), np.array([row.split(",") for row in rows], float).T, strict=True))
    estimate_dataset(estimates).to_netcdf(tmp_path / "estimate.nc", engine="h5netcdf")
    found = xr.load_dataset(tmp_path / "estimate.nc", engine="h5netcdf")
    assert "force_W" not in found
    labels = [f"tool.{name}'" for name in ("Fx", "Fy", "Fz", "Mx", "My", "Mz")] + [f"{elbow}.along"]
    units = ["N"] * 3 + ["N m"] * 3 + ["N"]
    assert found["component"].values.tolist() == labels
    assert found["unit"].values.tolist() == units
    assert found["components"].attrs["units"] == "N, N m"
    for label, unit in zip(labels, units, strict=True):
        for one in both:
            one_label = {"observer": one.observer, "component": label}
            np.testing.assert_allclose(table[f"{one.observer}.{label} [{unit}]"], one.component(label), rtol=1e-8)
            np.testing.assert_array_equal(found["components"].sel(one_label), one.component(label))
        deviation = found["standard_deviation"].sel(observer="kalman", component=label)
        np.testing.assert_allclose(table[f"kalman.{label} deviation [{unit}]"], deviation, rtol=1e-8)
    assert np.all(np.isnan(found["standard_deviation"].sel(observer="force_level")))
    assert not any("force_level" in name and "deviation" in name for name in table)


def test_objects_show_themselves_in_a_few_lines(paper: Experiment, paper_plant: Plant) -> None:
    """Robot, linkage, air, plant and log: what it is, how large, which channels."""
    closure = paper.robot.linkage.solve(np.linspace(0.0, 1.0, 5))
    shown = {
        "Aerobat": (paper.robot, "92.1 g"),
        "Closure": (closure, "5 crank angles, t1 0.0 .. 57.3 deg"),
        "LiftingLine": (paper_plant.air.line, "16 strips"),
        "RobotAir": (paper_plant.air, "lifting_line"),
        "Plant": (paper_plant, "left_force_point"),
        "FlightLog": (paper.log, "2001 samples from 0 to 2 s"),
    }
    for name, (thing, part) in shown.items():
        text = repr(thing)
        assert text.startswith(f"{name}(")
        assert part in text
        assert text.count("\n") < 5
        assert len(text) < 600
    assert repr(paper.robot.linkage.solve(np.zeros(0))) == "Closure(no crank angle)"
    html = paper.log._repr_html_()
    assert "<td>crank_angle</td>" in html
    assert "<td>absolute crank angle t1</td>" in html
