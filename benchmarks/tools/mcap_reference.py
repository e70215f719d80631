"""Write an MCAP file of a short simulated flight, and beside it, as JSON, the forces that it holds."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import xarray as xr

from aerobat_pin.experiments import estimate_dataset, run, write_flight_mcap
from aerobat_pin.scenario import load_scenario

DURATION = 0.3  # [s]


def main(folder: Path) -> None:
    """Write forces.mcap and forces.json: topic -> stamp [ns] -> force [N]."""
    folder.mkdir(exist_ok=True)
    flown = run(load_scenario("paper", [f"simulation.duration={DURATION}"]))
    estimates, log = estimate_dataset(flown.estimates), flown.log
    write_flight_mcap(flown.robot.model, log, estimates, folder / "forces.mcap")
    forces = {f"/truth/{point}": log.truth["force_W"].sel(point=point).values for point in points(log.truth)}
    for name in map(str, estimates["observer"].values):
        of = estimates["force_W"].sel(observer=name)
        forces |= {f"/force/{name}/{point}": of.sel(point=point).values for point in points(estimates)}
    stamps = np.round(5e8 * (log.time[1:] + log.time[:-1])).astype(int)
    said = {
        topic: {str(stamp): [values.tolist()] for stamp, values in zip(stamps, force, strict=True)}
        for topic, force in forces.items()
    }
    (folder / "forces.json").write_text(json.dumps(said))


def points(data: xr.Dataset) -> list[str]:
    """Return the names of the points."""
    return list(map(str, data["point"].values))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
