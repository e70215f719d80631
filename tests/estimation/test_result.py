"""One score and one `metrics.json` for every source: a flight with its truth, a recording with a force sensor."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from support.recorded import recorded
from support.walking_log import table, table_map, urdf, walk

from aerobat_pin.estimation import estimate
from aerobat_pin.experiments import Experiment, write
from aerobat_pin.forces import Moments, PairedEstimate, StoredEstimate
from aerobat_pin.records import series_of

EVERYWHERE = {
    *"contacts version verdict scenario seed changed versions warnings notes inputs calibration model".split(),
    *"log robot mass rate used_s parts checks fits observers".split(),
}
OBSERVER = {
    *"rank condition null_direction redundancy deviation events components unseen".split(),
    *"innovation warnings notes gain rows mean".split(),
}
TRUTH = {"r2", "r2_noise_free", "rmse", "lag_s"}


@pytest.mark.parametrize("name", ["momentum", "force_level"])
def test_a_sensor_that_shows_the_truth_gives_the_scores_of_the_truth(paper: Experiment, name: str) -> None:
    """To 1e-14, block by block from a file on disk; what only a sensor has is there and right."""
    stored = StoredEstimate.of(paper.estimates[name])
    for truth in paper.scores.references:
        rows = np.asarray(truth.noise_free)
        sensor = replace(truth, kind="sensor", values=series_of(stored.start.spool, rows), noise_free=None)
        own, other = (PairedEstimate.of(stored, one, paper.scores.dt) for one in (truth, sensor))
        shown = other.scores()
        for axis, score in own.scores().items():
            assert shown[axis].r2 == pytest.approx(score.r2_noise_free, abs=1e-14)
            assert shown[axis].lag_s == pytest.approx(score.lag_s, abs=1e-14)
            assert score.factor is None
            assert shown[axis].factor == pytest.approx(1.0, abs=0.02)
        noisy = PairedEstimate.of(stored, replace(truth, kind="sensor", noise_free=None), paper.scores.dt)
        for axis, score in noisy.scores().items():
            assert score.rmse == pytest.approx(own.scores()[axis].rmse, abs=1e-14)
            assert score.r2 == pytest.approx(own.scores()[axis].r2, abs=1e-14)


def test_moments_of_pieces_are_those_of_the_whole() -> None:
    """Far from zero, where sums of squares would lose what the scores are made of."""
    rng = np.random.default_rng(0)
    truth = 1e4 + rng.normal(0.0, 1.0, (5000, 2))
    found = truth + rng.normal(0.0, 0.1, truth.shape)
    whole, pieces = Moments(2), Moments(2)
    whole.add(found, truth)
    for first in range(0, 5000, 777):
        pieces.add(found[first : first + 777], truth[first : first + 777])
    expected = 1.0 - np.sum((found - truth) ** 2, axis=0) / np.sum((truth - truth.mean(axis=0)) ** 2, axis=0)
    slope = [np.polyfit(found[:, k] - 1e4, truth[:, k], 1)[0] for k in range(2)]
    for one in (whole, pieces):
        assert one.r2 == pytest.approx(expected, abs=1e-14)
        assert one.rmse == pytest.approx(np.sqrt(np.mean((found - truth) ** 2, axis=0)), rel=1e-13)
        assert one.factor == pytest.approx(slope, rel=1e-9)
        assert one.offset == pytest.approx(np.mean(found - truth, axis=0), abs=1e-11)


def test_metrics_have_the_same_keys_for_every_source(paper: Experiment, tmp_path: Path) -> None:
    """Of a flight with its truth and of a recording with a sensor; the file is what Python gives."""
    (tmp_path / "quadruped.urdf").write_text(urdf())
    result = estimate(recorded(tmp_path / "walk.csv", table_map(Path("quadruped.urdf")), table=table(walk())))
    (tmp_path / "out").mkdir()
    write(result, tmp_path / "out")
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert metrics == json.loads(json.dumps(result.metrics()))
    assert " and 2 more; it is off the force sensor at FL_FOOT by " in result.verdict  # of four feet
    assert metrics["verdict"] == result.verdict
    for found, point in ((metrics, "FL_FOOT"), (paper.metrics, "left")):
        assert set(found) >= EVERYWHERE
        assert found["version"] == 2
        for entry in found["observers"].values():
            assert set(entry) >= OBSERVER | {point}
            for score in entry[point].values():
                assert set(score) >= TRUTH
    assert set(paper.metrics) - EVERYWHERE == {"flight", "torque", "note"}
    assert paper.metrics["observers"]["momentum"]["left"]["Fx"].keys() == TRUTH
    sensed = metrics["observers"]["force_level"]["FL_FOOT"]["Fz"]
    assert sensed == asdict(result.observers["force_level"].points["FL_FOOT"]["Fz"])
    assert metrics["used_s"] == pytest.approx(3.0)


def test_the_table_has_a_column_for_what_these_references_mean(paper: Experiment) -> None:
    """Noise for a truth; and no column without any meaning."""
    assert paper.scores.header == (*("observer", "point", "axis", "R2", "R2 noise-free", "error rms", "lag"),)
    assert len(list(paper.scores.rows())) == 12
    assert "factor" not in repr(paper.scores)
    hint = "R2 noise-free is lower where the estimate follows the noise of the true force, which is no error of it"
    assert paper.scores.hints == [hint]
