"""Write an MCAP file of a short simulated flight, and beside it, as JSON, the forces that it holds."""

import json
import sys
from pathlib import Path

import numpy as np

from aerobat_pin.experiments import estimate_dataset, run, write_flight_mcap
from aerobat_pin.scenario import load_scenario

DURATION = 0.3  # [s]


def main(folder: Path) -> None:
    """Write forces.mcap and forces.json: topic -> stamp [ns] -> force [N]."""
    folder.mkdir(exist_ok=True)
    flown = run(load_scenario("paper", [f"simulation.duration={DURATION}"]))
    estimates, log = estimate_dataset(flown.estimates), flown.log
    write_flight_mcap(flown.robot.model, log, estimates, folder / "forces.mcap")
    forces = {f"/truth/{force['point'].item()}": force.values for force in log.truth["force_W"].transpose("point", ...)}
    for name in estimates["observer"].values.tolist():
        of = estimates["force_W"].sel(observer=name).transpose("point", ...)
        forces |= {f"/force/{name}/{force['point'].item()}": force.values for force in of}
    stamps = np.round(5e8 * (log.time[1:] + log.time[:-1])).astype(int)
    said = {
        topic: {str(stamp): [values.tolist()] for stamp, values in zip(stamps, force, strict=True)}
        for topic, force in forces.items()
    }
    (folder / "forces.json").write_text(json.dumps(said))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
