"""What metrics, terminal and report say about how far an estimate can be trusted."""

from __future__ import annotations

import json

from aerobat_pin.estimation import ObserverScores
from aerobat_pin.experiments.experiment import Experiment, run
from aerobat_pin.scenario.scenario import load_scenario
from aerobat_pin.visualization.report import report_html

NAMES = 'observers.names=["momentum", "force_level", "kalman"]'
SHORT = ("simulation.duration=0.2", "air.warm_up_cycles=1", NAMES)


def flown(*settings: str) -> Experiment:
    """Fly the first 0.2 s of `paper`."""
    return run(load_scenario("paper", [*SHORT, *settings]))


def test_unseen_forces_have_an_infinite_deviation_in_every_table() -> None:
    """Without joint torques, Fy of either wing: `null` in metrics, `infinite` in terminal and report."""
    experiment = flown("observers.torque=none")
    observers = experiment.metrics["observers"]
    assert "deviation" in observers["kalman"]
    for wing in ("left", "right"):
        x, y, z = observers["kalman"]["deviation"][wing]
        assert y is None
        assert 0.0 < x < 1.0
        assert 0.0 < z < 1.0
    assert observers["force_level"]["deviation"] is None
    for row in experiment.scores.rows():
        assert (row[-1] == "infinite") == (row[2] == "Fy")
    assert "infinite" in repr(experiment.scores)
    assert "infinite" in report_html(experiment, {})


def test_the_belief_is_judged_in_words_and_numbers() -> None:
    """Consistent, or off by so much; the same for all observers, and a warning where it is off."""
    right, wrong = flown(), flown('believed.air.model="quasi_steady"')
    for experiment, verdict in ((right, "consistent"), (wrong, "inconsistent")):
        for entry in experiment.metrics["observers"].values():
            assert entry["redundancy"]["verdict"] == verdict
            assert (entry["redundancy"]["rows"], entry["redundancy"]["redundant"]) == (10, 4)
        assert len(experiment.scores.verdicts) == 1
    assert right.metrics["warnings"] == []
    assert right.metrics["observers"]["force_level"]["redundancy"]["rms"] < 1e-3
    assert wrong.metrics["observers"]["force_level"]["redundancy"]["rms"] > 0.02
    (warning,) = wrong.metrics["warnings"]
    assert warning.startswith("momentum, force_level, kalman: belief off by about")
    assert "not to be trusted; blind to errors that look like forces at left_force_point" in warning
    for text in (repr(wrong.scores), report_html(wrong, {})):
        assert "not to be trusted" in text
    assert "innovations" in repr(right.scores)
    assert set(right.metrics["observers"]["kalman"]["innovation"]) == {"nis", "whiteness"}


def test_momentum_says_what_it_loses_when_the_motors_torque_alone_is_known() -> None:
    """It alone; a file of metrics gives the scores back."""
    experiment = flown("observers.torque=motor_only")
    (warning,) = experiment.metrics["warnings"]
    assert warning.startswith("momentum: filters the rows before it combines them")
    assert warning in repr(experiment.scores)
    for name, found in experiment.scores.observers.items():
        assert ObserverScores.from_json(json.loads(json.dumps(experiment.metrics["observers"][name]))) == found
