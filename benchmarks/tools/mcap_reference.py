"""Write an MCAP file of a short simulated flight, and beside it, as JSON, the forces and arrows that it holds."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin

from aerobat_pin.experiments import estimate_dataset, run, write_flight_mcap
from aerobat_pin.experiments.mcap_messages import LONGEST_MARKER
from aerobat_pin.scenario import load_scenario

DURATION = 0.3  # [s]


def main(folder: Path) -> None:
    """Write forces.mcap and forces.json: topic -> stamp [ns] -> force [N], start and end of its arrow [m]."""
    folder.mkdir(exist_ok=True)
    flown = run(load_scenario("paper", [f"simulation.duration={DURATION}"]))
    estimates, log, model = estimate_dataset(flown.estimates), flown.log, flown.robot.model
    write_flight_mcap(model, log, estimates, folder / "forces.mcap")
    assert log.truth is not None
    forces = {}
    for point in map(str, log.truth["point"].values):
        forces[f"/truth/{point}"] = point, log.truth["force_W"].sel(point=point).values
        for name in map(str, estimates["observer"].values):
            forces[f"/force/{name}/{point}"] = point, estimates["force_W"].sel(observer=name, point=point).values
    scale = LONGEST_MARKER / max(float(np.max(np.linalg.norm(force, axis=1))) for _, force in forces.values())
    data, stamps = model.createData(), np.round(5e8 * (log.time[1:] + log.time[:-1])).astype(int)
    said: dict[str, dict[str, list[list[float]]]] = {topic: {} for topic in forces}
    for k, q in enumerate(log.measured["q"].values[:-1]):
        pin.framesForwardKinematics(model, data, q)
        for topic, (point, force) in forces.items():
            start = data.oMf[model.getFrameId(point)].translation
            arrow = start, start + scale * force[k]
            said[topic][str(stamps[k])] = [force[k].tolist(), *(end.tolist() for end in arrow)]
    (folder / "forces.json").write_text(json.dumps(said))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
