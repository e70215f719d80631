"""What a record says first, in one sentence, whatever it is a record of."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.recorded import edited, recorded
from support.swinging_arm import arm, arm_map, recording

from aerobat_pin.estimation import Finding, Result, estimate
from aerobat_pin.estimation.findings import quantity
from aerobat_pin.experiments import Experiment
from aerobat_pin.forces import CalibrationUse, Contact, StoredEstimate, along_itself, largest_of
from aerobat_pin.forces.observer_scores import MEDIAN_DEVIATION, score_table
from aerobat_pin.observers import Estimate, force_size
from aerobat_pin.visualization import draw_estimation, report_html

SEEN = "every direction of these forces can be seen."


def judged(paper: Experiment, made: Estimate) -> Result:
    """Return the result of an estimate that nothing is compared with."""
    return replace(paper.scores, stored={"momentum": StoredEstimate.of(made)}, references=(), events=())


def noisy(paper: Experiment, deviation: float = 0.01, *, stated: bool = True) -> Estimate:
    """Return an estimate of nothing but white noise."""
    made = paper.estimates["momentum"]
    noise = np.random.default_rng(1).normal(0.0, deviation, made.components.shape)
    sure = np.full_like(noise, deviation) if stated else None
    return replace(made, components=noise, standard_deviation=sure)


def test_the_verdict_comes_first_everywhere(paper: Experiment) -> None:
    """On the terminal, in the report, in a notebook and in `metrics.json`; its numbers are those of the table."""
    verdict = paper.scores.verdict
    force = np.linalg.norm(paper.estimates["momentum"].force, axis=2)
    left, right = (quantity(float(size), "N") for size in force.max(axis=0))
    told = f"momentum finds a push at left (up to {left} upward, at 1.11 s) and right (up to {right}"
    assert verdict.startswith(told)
    scores = [one.rmse for axes in paper.scores.observers["momentum"].points.values() for one in axes.values()]
    error = quantity(float(np.linalg.norm(scores)) / 2**0.5, "N")
    assert f"it is off the true force by {error} rms, 1.4 % of it; {SEEN}" in verdict
    assert repr(paper.scores).splitlines()[0] == verdict
    assert paper.metrics["verdict"] == verdict
    assert f"<b>{verdict}</b>" in paper._repr_html_()
    page = report_html(paper, {})
    assert page.index(verdict) < page.index("<h2") < page.index("<table")
    assert paper.metrics["warnings"] == []
    assert "warning" not in repr(paper.scores)
    assert "contradicts itself" not in page


def test_it_is_the_first_observers_not_the_best_ones(paper: Experiment) -> None:
    """Who is nearest to the truth is known in a simulation alone."""
    first = paper.scores.verdict
    turned = replace(paper.scores, stored=dict(reversed(paper.scores.stored.items())))
    assert first.startswith("momentum ")
    assert turned.verdict.startswith("force_level ")


@pytest.mark.parametrize("stated", [True, False])
def test_noise_is_no_push_and_a_push_in_noise_is_one(paper: Experiment, stated: bool) -> None:
    """Ten errors high for one sample, or two errors for all the time; the place, the time and the way are named."""
    made = noisy(paper, stated=stated)
    sure = "its standard deviation, as stated, is 17.3 mN" if stated else "how sure that is cannot be said"
    quiet = judged(paper, made).verdict
    assert quiet.startswith(f"momentum finds no push that stands out from its errors; {sure}")
    for where, size, words in ((slice(700, 701), -0.2, "downward"), (slice(None), -0.06, "")):
        components = made.components.copy()
        components[where, 5] += size
        found = judged(paper, replace(made, components=components)).verdict
        assert found.startswith("momentum finds a push at right (up to ")
        assert (" +-10 mN" in found) == ("+- is one standard deviation" in found) == stated
        assert "; nothing at left stands out from its errors; " in found
        assert f"{words}, at " in found
        if words:
            assert f", at {made.time[700]:.2f} s)" in found


def test_what_an_observer_states_before_it_knows_anything_counts_nowhere(paper: Experiment) -> None:
    """Neither in the deviation, which is a median, nor as a push."""
    made = noisy(paper)
    made.standard_deviation[:50] = 10.0
    made.components[:50] = 500.0
    stored = StoredEstimate.of(made)
    assert stored.risen == made.time[50]
    assert stored.deviation == pytest.approx(np.full(6, 0.01))
    assert "no push" in judged(paper, made).verdict
    filtered = StoredEstimate.of(paper.estimates["momentum"])
    assert filtered.deviation is None
    assert filtered.risen == pytest.approx(5.0 / float(np.min(filtered.head.gain)), abs=1.1e-3)


def test_a_push_is_judged_by_the_deviation_at_its_time(paper: Experiment) -> None:
    """What is large where little is known is no push; a smaller one where much is known is."""
    made = noisy(paper)
    made.standard_deviation[600:650, 3:] = 1.0  # fifty samples, of which the median knows nothing
    made.components[600:650, 5] += 1.0
    assert "no push" in judged(paper, made).verdict
    made.components[700, 3:5] += 0.2
    found = judged(paper, made).verdict
    assert re.search(r"right \(up to \d+ \+-10 mN along \(0\.\d\d, 0\.\d\d, -?0\.0\d\)", found)
    assert f", at {made.time[700]:.2f} s)" in found


def test_a_push_that_nearly_stands_out_is_told_with_what_would(paper: Experiment) -> None:
    """Of 8.4 deviations nothing was said, and 8.7 would have been a push; of half as many there is nothing to say."""
    made = noisy(paper)
    made.components[700, 3:] = [0.0, 0.0, 0.084]
    near = f"; right (up to 84 +-10 mN upward, at {made.time[700]:.2f} s) is 8.4 deviations, of which 8.66 would; "
    assert f"no push that stands out from its errors{near}" in judged(paper, made).verdict
    made.components[700, 5] = 0.042
    assert "deviations, of which" not in judged(paper, made).verdict


def test_contacts_are_the_pushes_where_they_are_sought(paper: Experiment) -> None:
    """Each with its times, size, deviation and direction, on the record's clock; without one there is no push."""
    made = noisy(paper)
    made.components[600:650, 5] -= 0.5
    made.components[700:720, 2] += 0.25
    ends = [(float(made.time[begin]), float(made.time[end])) for begin, end in ((600, 650), (700, 720))]
    places = made.frames[::-1]
    contacts = [Contact(place, begin, begin, end) for place, (begin, end) in zip(places, ends, strict=True)]
    use = CalibrationUse("calibration: of the test", tuple(contacts))
    found = replace(judged(paper, made), calibration=use)
    first, second = (f"from {begin:.2f} s to {end:.2f} s)" for begin, end in ends)
    assert found.verdict.startswith("momentum finds 2 pushes, at right (up to 5")
    assert f" +-10 mN downward, {first} and left (up to 2" in found.verdict
    assert f" +-10 mN upward, {second}; +- is one standard deviation at that time" in found.verdict
    assert "no push" in replace(found, calibration=CalibrationUse("calibration: of the test", ())).verdict
    told, (begin, end) = contacts[0].told(0.25), ends[0]
    assert f"from {begin - 0.25:.3f} s to {end - 0.25:.3f} s (by the log's stamps from {begin:.3f} s" in told


def test_what_cannot_be_seen_is_said(paper: Experiment) -> None:
    """Of a pose that hides a force, the component and for how long; of a wrong belief, what is not to be trusted."""
    made = noisy(paper)
    made.components[:, 0] += 1.0
    made.standard_deviation[:, 4] = 1.0
    made.standard_deviation[::4, 3] = 1.0
    hidden = judged(paper, replace(made, expected_force=np.ones(6), seen=1.0 - made.standard_deviation**2))
    assert hidden.verdict.endswith("it cannot see right.Fy; it sees only at times right.Fx (75 % of the time).")
    off = replace(noisy(paper), unexplained=np.full((len(made.components), 18), 0.1), standard_deviation=None)
    assert "belief off by about" in judged(paper, off).verdict


def test_what_a_check_doubts_and_what_nothing_tests_is_said(paper: Experiment, tmp_path: Path) -> None:
    """A wrong sign is a sure push where no row is to spare: three joints, three components."""
    for check in ("effort sign", "held channel", "gyro against attitude", "late channel", "swapped thrusts", "gap"):
        doubted = replace(judged(paper, noisy(paper)), findings=(Finding(check, "warning", "is wrong"),))
        assert (f"a check doubts the record: {check}" in doubted.verdict) == (check != "gap")
    (tmp_path / "arm.urdf").write_text(arm())
    recording(tmp_path, "pushed", pushed=True, seed=2, seconds=2.0)
    values = edited(arm_map(), {"joints.friction": None})
    found = estimate(recorded(tmp_path / "pushed.csv", values), trust=True)
    assert "no row is to spare: a wrong sign, order, mass, mounting or friction would look like" in found.verdict


@pytest.mark.parametrize(("size", "unit"), [(0.01, "mN"), (20.0, "N")])
def test_a_table_is_in_one_unit(size: float, unit: str, paper: Experiment) -> None:
    """Of errors and their deviations, of mean, least and largest; what no force explains is in N from 1 N on."""
    large = {"momentum": StoredEstimate.of(noisy(paper, size))}
    header, rows = score_table(replace(paper.scores, stored=large).observers)
    cells = [row[header.index(name)] for row in rows for name in ("error rms", MEDIAN_DEVIATION)]
    assert {cell.split()[1] for cell in cells} == {unit}
    sizes = judged(paper, noisy(paper, size)).sizes
    assert {cell.split()[1] for row in sizes[1:] for cell in row[2:-1]} == {"N"}
    assert [force_size(force) for force in (0.0046, 0.238, 3.671, 30140.0)] == ["4.6 mN", "238 mN", "3.67 N", "30140 N"]
    [axis] = {axis.get_ylabel() for axis in draw_estimation(replace(paper.scores, stored=large)).axes[2:3]}
    assert axis == f"error [{unit}]"


def test_every_observer_is_drawn(paper: Experiment) -> None:
    """Also the fifth and the sixth, each in a line of its own."""
    stored = {f"observer {k}": StoredEstimate.of(paper.estimates["momentum"]) for k in range(6)}
    figure = draw_estimation(replace(paper.scores, stored=stored))
    lines = [line for line in figure.axes[0].lines if str(line.get_label()).startswith("estimated: ")]
    assert [line.get_label() for line in lines] == [f"estimated: {name}" for name in stored]
    assert len({(line.get_color(), line.get_linestyle()) for line in lines}) == 6
    assert {f"estimated: {name}" for name in stored} <= {text.get_text() for text in figure.legends[0].get_texts()}


def test_what_is_not_shown_adds_nothing_to_a_deviation_along_a_force() -> None:
    """It is 0, +- infinity: the product was no number, and a warning."""
    assert along_itself(np.array([3.0, 0.0]), np.array([0.5, np.inf])) == 0.5


def test_the_largest_error_of_a_contact_is_not_its_size() -> None:
    """10 N +-7 is an error's size beside 6 N +-0.7; without deviations, or with like ones, the largest force is."""
    force = np.array([[5.8, 0.0], [10.0, 0.0], [6.0, 0.0]])
    deviation = np.array([[0.6, 0.6], [7.0, 0.1], [0.7, np.inf]])
    assert [largest_of(force, each) for each in (deviation, None, np.ones((3, 2)))] == [2, 1, 1]


def test_sizes_are_read_at_a_glance() -> None:
    """Three digits, and a unit that needs no power of ten."""
    told = [quantity(size, "N") for size in (0.0, 4.04e-4, 0.2384, 0.9997, 12.34, 999.7, 12340.0)]
    assert told == ["0 mN", "0.404 mN", "238 mN", "1 N", "12.3 N", "1 kN", "12.3 kN"]
