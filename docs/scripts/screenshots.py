"""Take the pictures of docs/replay.md: `make docs`, or `python docs/scripts/screenshots.py`. Needs a Chromium."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pinocchio as pin
from PIL import Image

from aerobat_pin.errors import BrowserError
from aerobat_pin.experiments import estimate_dataset, run
from aerobat_pin.linkage import KineticSculpture
from aerobat_pin.scenario import load_scenario
from aerobat_pin.visualization import SLOW_MOTION, Recording, linkage_animation, record, replay_flight, snapshots

FIGURES = Path(__file__).resolve().parents[1] / "figures" / "replay"
SIZE = (960, 600)  # pixels
TURN = 2.0  # [s], of the animated linkage


def flight(name: str) -> Recording:
    """Return the recording of a shipped scenario."""
    made = run(load_scenario(name))
    return replay_flight(
        made.robot, made.log, made.scenario.air, estimate_dataset(made.estimates), made.metrics["note"]
    )


def walker() -> Recording:
    """Return Pinocchio's sample humanoid, pulled at its left hand."""
    model = pin.buildSampleModelHumanoid()
    time = np.linspace(0.0, 2.0, 241)
    q = np.tile(pin.neutral(model), (len(time), 1))
    q[:, 0] = 0.6 * time
    for name, lead in (("lleg_shoulder2_joint", 0.0), ("rleg_shoulder2_joint", np.pi)):
        q[:, model.joints[model.getJointId(name)].idx_q] = 0.4 * np.sin(5.0 * time + lead)
    pull = np.column_stack([30.0 * np.ones_like(time), 0.0 * time, 20.0 + 10.0 * np.sin(5.0 * time)])
    parts = pin.buildSampleGeometryModelHumanoid(model)
    return record(model, parts, time, q, {"larm_effector_body": pull}, title="sample humanoid")


def main() -> None:
    """Rewrite the pictures, or say why not."""
    FIGURES.mkdir(parents=True, exist_ok=True)
    (FIGURES / "linkage.svg").write_text(linkage_animation(KineticSculpture(), TURN), encoding="utf-8")
    paper, dive = flight("paper"), flight("paper_open_loop")
    wanted = (
        ("page", paper, 1.11, True),
        ("dive", dive, 1.68, False),
        ("humanoid", walker(), 0.95, False),
    )
    try:
        for name, recording, time, controls in wanted:
            [picture] = snapshots(recording.html(SLOW_MOTION), [time], SIZE, controls=controls)
            Image.open(io.BytesIO(picture)).convert("RGB").save(FIGURES / f"{name}.png", optimize=True)
    except BrowserError as error:
        print(f"docs/figures/replay stays as it is: {error}")


if __name__ == "__main__":
    main()
