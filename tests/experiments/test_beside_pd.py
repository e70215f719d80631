"""What a closed loop says of its course, beside PD alone."""

from aerobat_pin.experiments import Experiment, beside_pd, run
from aerobat_pin.scenario import load_scenario
from aerobat_pin.visualization.result_pages import report_html

SHORT = ("simulation.duration=0.9",)
PD = ("control.feedforward=false", "control.integral=false")


def test_a_closed_loop_says_how_far_off_it_was_and_pd_alone() -> None:
    """In metres and degrees, with saturation and margins; PD flies the same blow with the same noise."""
    made = beside_pd(run(load_scenario("impact_closed_loop", SHORT)))
    alone = run(load_scenario("impact_closed_loop", [*SHORT, *PD]))
    assert made.metrics["control"]["pd_rms"] == alone.flight.rms
    own, pd, effort = made.scores.notes
    assert own.startswith("off its course by ")
    assert own.endswith(" deg rms")
    assert pd.startswith("PD alone, in the same disturbance: ")
    assert "% of the commands at a limit; least margins: Ms 1." in effort
    assert "ms more delay (" in effort
    for line in made.scores.notes:
        assert line in repr(made.scores)
    assert "the same with PD alone, rms" in report_html(made, {})
    assert "no true force to compare with" in repr(made.scores)
    assert "no signal" not in repr(made.scores)
    assert beside_pd(alone).metrics["control"]["pd_rms"] is None


def test_a_flight_without_a_controller_is_left_as_it_is(paper: Experiment) -> None:
    assert beside_pd(paper) is paper
