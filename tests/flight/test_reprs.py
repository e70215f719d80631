"""What a person sees of the flight's objects is a few lines."""

from __future__ import annotations

import numpy as np

from aerobat_pin.experiments.experiment import Experiment
from aerobat_pin.flight.plant.plant import Plant


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
