"""Sweep files and their tables: what is varied becomes a label, what fails a reason, what is wrong a message."""

import csv
import json
import re
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from support.commands import call

from aerobat_pin.control import loop_margins
from aerobat_pin.errors import OutputError, SweepError, WorkersLostError
from aerobat_pin.experiments import effects_text, load_sweep, run, run_sweep, shipped_sweeps, sweep_effects
from aerobat_pin.experiments.experiment import _effort
from aerobat_pin.experiments.sweep import plan
from aerobat_pin.experiments.sweep.plan import RESERVED_NAMES, flight_columns, outcome_of
from aerobat_pin.experiments.sweep.sweep_file import SweepFile
from aerobat_pin.scenario import load_scenario
from aerobat_pin.visualization import draw_sweep

SHORT = """
name = "short"
base = "paper"
seeds = 2
[set]
"simulation.duration" = 0.05
"air.strips" = 4
"air.warm_up_cycles" = 1
"""
RANGES = """
[ranges]
"observers.gain" = {from = 100, to = 1000, count = 2, spacing = "log"}
[variants.who]
both = {}
one = {"observers.names" = ["force_level"], "unknown_force.*.noise" = 0.02}
"""
BROKEN = """
[ranges]
"robot.changes.linkage.L3b" = [0.002, 6.71e-3]
"""
FACTORS = """
[factors.noise]
values = [0.5, 2.0]
[factors.noise.of]
"sensors.gyro.noise" = 0.01
"observers.kalman.sensor_noise" = [0.02, 0.01, 0.05]
"unknown_force.*.noise" = 0.03
"""
DRAWS = """
[draws]
count = 3
seed = 5
[draws.values]
"believed.air.density" = {distribution = "uniform", low = 1.0, high = 1.4}
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "short.toml"
    path.write_text(text)
    return path


def test_the_example_of_the_page_is_a_whole_sweep_file(tmp_path: Path) -> None:
    """It plans as many runs as it says; and the page names every key that a sweep file may have."""
    page = (Path(__file__).resolve().parents[2] / "docs" / "studies.md").read_text()
    [example] = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    sweep = load_sweep(written(tmp_path, example))
    assert sweep.file.name == "mine"
    assert len(sweep.indices) == 2 * 3 * 2
    assert "2 x 3 x 2 runs" in sweep.file.description
    for key in SweepFile.model_fields:
        assert re.search(rf"^\| `\[?{key}(\.NAME)?\]?` \|", page, re.MULTILINE), key


def test_the_grid_holds_the_numbers_of_the_single_runs_under_their_labels(tmp_path: Path) -> None:
    """Each run of the sweep against `run` of its scenario, to the last bit; NaN where an observer was not asked for."""
    sweep = load_sweep(written(tmp_path, SHORT + RANGES))
    run_sweep(sweep, tmp_path / "out")
    grid = xr.load_dataset(tmp_path / "out" / "results.nc", engine="h5netcdf")
    twice = ("observers.gain", "who", "seed", "observer", "point", "bound")
    assert dict(grid.sizes) == dict.fromkeys(twice, 2) | {"axis": 3}
    np.testing.assert_allclose(grid["observers.gain"], [100.0, 1000.0])
    for number, index in list(enumerate(sweep.indices))[::3]:
        labels = sweep.labels(index)
        scenario = sweep.scenarios[number]
        assert scenario.simulation.seed == labels["seed"]
        assert [force.noise for force in scenario.unknown_force] == [0.02 if labels["who"] == "one" else 0.01] * 2
        metrics = run(scenario).metrics
        here = grid.sel(labels)
        for axis in "xyz":
            for score in ("r2", "r2_noise_free", "rmse", "lag_s"):
                found = float(here[score].sel(observer="force_level", point="right", axis=axis))
                expected = metrics["observers"]["force_level"]["right"][f"F{axis}"][score]
                assert found == expected or (expected is None and np.isnan(found))
        assert np.isnan(here["r2"].sel(observer="momentum")).all() == (labels["who"] == "one")
        np.testing.assert_array_equal(here["position_end"], metrics["flight"]["position_end"])
        assert float(here["motor_power_mean"]) == metrics["flight"]["motor_power_mean"]
    own = {str(name) for name in grid.variables} - {one.name for one in sweep.dimensions}
    assert own <= RESERVED_NAMES, "another name that no dimension may have"

    finished, written_first = tmp_path / "out" / "finished.jsonl", (tmp_path / "out" / "results.nc").read_bytes()
    finished.write_text("".join(reversed(finished.read_text().splitlines(keepends=True))))
    run_sweep(sweep, tmp_path / "out")
    assert (tmp_path / "out" / "results.nc").read_bytes() == written_first, "runs that ended in another order"


def test_a_run_that_fails_is_in_the_tables_with_its_reason(tmp_path: Path) -> None:
    """A linkage that cannot close costs its own runs and no others."""
    grid = run_sweep(load_sweep(written(tmp_path, SHORT + BROKEN)), tmp_path / "out")
    reasons = grid["failed"].transpose("robot.changes.linkage.L3b", "seed").values
    assert all("cannot close at J4" in one for one in reasons[0])
    assert list(reasons[1]) == ["", ""]
    assert np.isnan(grid["rmse"].values[0]).all()
    assert np.isfinite(grid["rmse"].values[1]).all()
    rows = list(csv.DictReader((tmp_path / "out" / "results.csv").open()))
    assert [row["run"] for row in rows] == ["0", "1", "2", "3"]
    assert "cannot close at J4" in rows[0]["failed"]
    assert rows[0]["momentum.left.Fx.rmse"] == ""
    assert float(rows[3]["momentum.left.Fx.rmse"]) == float(grid["rmse"].values[1, 1, 0, 0, 0])


def test_keys_without_quotation_marks_are_keys(tmp_path: Path) -> None:
    """TOML makes tables of them; before, they took the place of the whole ones, and the gust and the gain were gone."""
    text = SHORT.replace('"paper"', '"gust"').replace('"air.strips"', "air.strips")
    sweep = load_sweep(written(tmp_path, text + "[variants.gain.high]\nobservers.gain = 900\nair.gust.start = 0.1\n"))
    base, run = load_scenario("gust"), sweep.scenarios[0]
    assert run.air.gust == base.air.gust.model_copy(update={"start": 0.1})
    assert run.air.strips == 4
    assert run.observers == base.observers.model_copy(update={"gain": 900.0})
    quoted = SHORT + RANGES.split("[variants")[0] + FACTORS + DRAWS
    plain = re.sub(r'"((?:\w+\.)+\w+)"(?= =)', r"\1", quoted)
    assert plain.count('"') == quoted.count('"') - 2 * 7
    assert load_sweep(written(tmp_path, plain)).file == load_sweep(written(tmp_path, quoted)).file


def test_a_factor_scales_several_keys_from_their_references(tmp_path: Path) -> None:
    """One number, the coordinate; a number, a list and every item of a list of tables follow it."""
    sweep = load_sweep(written(tmp_path, SHORT + FACTORS))
    for number, index in enumerate(sweep.indices):
        factor, scenario = sweep.labels(index)["noise"], sweep.scenarios[number]
        assert factor in (0.5, 2.0)
        assert scenario.sensors.fitted["gyro"].noise == (factor * 0.01,)
        assert scenario.observers.settings("kalman")["sensor_noise"] == (factor * 0.02, factor * 0.01, factor * 0.05)
        assert [force.noise for force in scenario.unknown_force] == [factor * 0.03] * 2
    noise = run_sweep(sweep, tmp_path / "out")["noise"]
    np.testing.assert_array_equal(noise, [0.5, 2.0])
    assert "sensors.gyro.noise = 0.01, observers.kalman.sensor_noise = [0.02" in noise.attrs["long_name"]


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    folder = tmp_path_factory.mktemp("drawn")
    return run_sweep(load_sweep(written(folder, SHORT + DRAWS)), folder / "out")


def test_draws_are_the_same_for_every_seed_whatever_other_keys_there_are(drawn: xr.Dataset, tmp_path: Path) -> None:
    """The drawn values are coordinates along `draw`."""
    more = '"believed.air.added_mass" = {distribution = "normal", mean = 1.0, deviation = 0.1}\n'
    both = [one.believed_air.density for one in load_sweep(written(tmp_path, SHORT + DRAWS + more)).scenarios]
    assert both[0::2] == both[1::2]
    assert len(set(both)) == 3
    assert all(1.0 < one < 1.4 for one in both)
    np.testing.assert_array_equal(drawn["believed.air.density"], both[0::2])
    assert drawn["believed.air.density"].dims == ("draw",)


ONE, TWICE, AIR = '[ranges]\n"observers.gain" = ', "is varied by two dimensions", '\nof = {"air.density" = 1}'
DRAWN = '[draws]\ncount = 2\n[draws.values]\n"air.density" = {distribution = '
NORMAL = '"normal", mean = 1, deviation = 0.1}'
NOISES, RATE = "unknown_force.*.noise", "crank.frequency"
GUST = f"'air.gust.start' {TWICE}, of which 'a' sets 'air.gust'"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[rages]", "unknown key 'rages'; did you mean 'ranges'?"),
        ('[ranges]\n"observers.gain" = {from = 1, too = 2, count = 3}', "unknown key 'ranges.observers.gain.too'"),
        ('[ranges]\n"observers.gain" = {from = 1, to = 2, count = 1}', "ranges.observers.gain.count = 1: "),
        ('[ranges]\n"observers.gain" = {from = 0, to = 2, count = 3, spacing = "log"}', "wants both above 0"),
        ('[ranges]\n"observers.gain" = 3', "ranges.observers.gain = 3: "),
        ('[ranges]\n"observers.gain" = [1, 1]', "each value once"),
        ('[ranges]\n"observers.gain" = [-1.0]', "observers.gain = -1.0: input should be greater than 0"),
        ('[ranges]\n"observers.gian" = [1.0]', "unknown key 'observers.gian'; did you mean 'gain'?"),
        ('[ranges]\n"flight.velocity.3" = [1.0]', "'3' is not an index of 'flight.velocity', a list of 3"),
        ('[ranges]\n"flight.gravity.x" = [1.0]', "'flight.gravity' is a value, not a table"),
        ('[ranges]\n"simulation.seed" = [1, 2]', "counted up by `seeds`"),
        ("[ranges]\nseed = [1]", "'seed' is the name of two dimensions"),
        (ONE + '[1, 2]\n[variants.a]\nb = {"observers.gain" = 3}', f"'observers.gain' {TWICE}"),
        ('[ranges]\n"air.gust.start" = [0, 1]\n[variants.a]\nb = {"air.gust" = {amplitude = [0, 0, 1]}}', GUST),
        (f'[ranges]\ncrank = [{{frequency = 3}}]\n"{RATE}" = [5, 6]', f"'{RATE}' {TWICE}"),
        (f'[ranges]\n"{NOISES}" = [0.1]\n"unknown_force.0.noise" = [0.2]', f"'{NOISES}' {TWICE}"),
        ("[variants.observer]\na = {}", "'observer' is a name in the results"),
        ("[factors.noise]\nvalues = [1]", "missing key 'factors.noise.of'"),
        ('[factors.noise]\nvalues = ["a"]\nof = {"air.density" = 1}', "factors.noise.values.0 = 'a': "),
        ("[factors.noise]\nvalues = [1, 1]" + AIR, "factors.noise.values = [1.0, 1.0]: each value once"),
        ('[factors.noise]\nvalues = [1]\nof = {"air.density" = "b"}', "factors.noise.of.air.density = 'b': "),
        (DRAWN + '"unifrm"}', "'uniform'"),
        (DRAWN + '"uniform", low = 2, high = 1}', "low < high"),
        ('[ranges]\n"air.density" = {from = 1, to = 2, count = 1000000}', "at most 100000"),
        (ONE + "{from = 1, to = 2, count = 1_000_000_000}", "at most 100000 runs and 30 days"),
        (DRAWN.replace("2", "1_000_000_000") + NORMAL, "1000000000 draw x 2 seed are 2000000000 runs"),
        ('[variants."a/b"]\nc = {}', "dimension 'a/b': a name without / of 1 to 255 bytes"),
        ('[variants.""]\nc = {}', "dimension '': a name"),
        ('[variants."."]\nc = {}', "dimension '.': a name"),
        ('[factors."a\\nb"]\nvalues = [1]' + AIR, r"dimension 'a\nb': a name"),
        (f'[factors."{300 * "é"}"]\nvalues = [1]' + AIR, "a name without /"),
        (DRAWN.replace("air.density", "robot.changes.a/b") + NORMAL, "dimension 'robot.changes.a/b'"),
        ('[ranges]\n"simulation.dt" = [1e-12]', "at simulation.dt = 1e-12, "),
        ('[ranges]\n"simulation.dt" = [1e-12]', "at most 2 GB and 3600 s"),
    ],
)
def test_a_wrong_sweep_costs_one_message_exit_code_2_and_leaves_nothing(
    text: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Key, value and rule, before anything flies; a thousand million runs used to be counted up first."""
    start = time.process_time()
    path = written(tmp_path, SHORT + text)
    assert call("sweep", str(path), "--out", str(tmp_path / "out")) == 2
    printed = capsys.readouterr()
    assert message in printed.err
    assert "Traceback" not in printed.err
    assert [one.name for one in tmp_path.iterdir()] == ["short.toml"]
    assert time.process_time() - start < 5.0  # [s] of this process alone; milliseconds are usual


def test_many_long_runs_are_refused_though_each_is_allowed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Flights of 25 minutes take 150 s each, so 200 of them take a third of a day, which is all here."""
    monkeypatch.setattr(plan, "MOST_DAYS", 0.3)
    text, start = SHORT.replace("0.05", "1500.0"), time.process_time()
    assert len(load_sweep(written(tmp_path, text.replace("seeds = 2", "seeds = 10"))).scenarios) == 10
    for seeds, days in ((200, r"0\.3\d*"), (10**9, ".*")):
        with pytest.raises(SweepError, match=f"{seeds} seed are {seeds} runs, about {days} days on one processor"):
            load_sweep(written(tmp_path, text.replace("seeds = 2", f"seeds = {seeds}")))
    assert time.process_time() - start < 5.0


def test_labels_that_no_table_can_hold_are_refused_before_the_first_flight(tmp_path: Path) -> None:
    """NetCDF has no integers above 64 bits."""
    with pytest.raises(SweepError, match=r"sweep short: labels 1\d+, 1\d+, \.\.\. of seed"):
        run_sweep(load_sweep(written(tmp_path, SHORT + '"simulation.seed" = 1' + 30 * "0")), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_each_run_of_a_robot_has_the_warnings_of_its_loading(tmp_path: Path) -> None:
    """The second one, too, for which the robot of the first is taken."""
    sweep = load_sweep(written(tmp_path, SHORT + '"robot.changes.linkage.L1" = 0.0086\n'))
    said = [json.loads(outcome_of(scenario))["warnings"] for scenario in sweep.scenarios]
    assert "nearly singular at J4" in said[0][0]
    assert said[0] == said[1]


def test_a_folder_keeps_to_its_sweep(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Another sweep is refused, a folder of something else with --force too; --force leaves foreign files alone."""
    out = tmp_path / "out"
    path = str(written(tmp_path, SHORT))
    out.mkdir()
    (out / "results.csv").write_text("mine")
    for force in ([], ["--force"]):
        assert call("sweep", path, "--out", str(out), "--jobs", "1", *force) == 2
        assert "holds no sweep; an empty or missing one was expected" in capsys.readouterr().err
    (out / "results.csv").unlink()
    assert call("sweep", path, "--out", str(out), "--jobs", "1") == 0
    printed = capsys.readouterr().out
    assert "seed = 1 " in printed
    assert f"results in {out}/: results.nc, results.csv, sweep.png" in printed
    assert (out / "sweep.png").read_bytes().startswith(b"\x89PNG")
    (out / "notes.txt").write_text("mine")
    kept = (out / "finished.jsonl").read_bytes()
    assert call("sweep", path, "--out", str(out), "--jobs", "1") == 0
    assert "going on: 2 of 2 runs are finished" in capsys.readouterr().out
    written(tmp_path, SHORT.replace("seeds = 2", "seeds = 3"))
    assert call("sweep", path, "--out", str(out), "--jobs", "1") == 2
    assert "holds another sweep: seeds differ" in capsys.readouterr().err
    assert (out / "finished.jsonl").read_bytes() == kept
    assert call("sweep", path, "--out", str(out), "--jobs", "1", "--force") == 0
    assert len((out / "finished.jsonl").read_text().splitlines()) == 3
    assert (out / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize("share", [0.5, 0.9999])
def test_a_line_that_was_cut_off_is_flown_again(share: float, tmp_path: Path) -> None:
    """As a power failure leaves it: a part of a line, or all but its end; nothing else is repeated."""
    sweep, out = load_sweep(written(tmp_path, SHORT)), tmp_path / "out"
    run_sweep(sweep, out)
    whole = (out / "finished.jsonl").read_bytes()
    first, second = whole.splitlines(keepends=True)
    (out / "finished.jsonl").write_bytes(first + second[: int(share * len(second))])
    seen: list[int] = []
    run_sweep(sweep, out, progress=lambda finished, count, failed: seen.append(finished))
    assert seen == [1, 2]
    assert (out / "finished.jsonl").read_bytes() == whole


def test_a_loop_that_is_lost_is_said(tmp_path: Path) -> None:
    """Its numbers stand in the tables, and among the warnings what `aerobat run` ends with exit code 2 for."""
    text = SHORT.replace('"paper"', '"hover_closed_loop"').replace("0.05", "0.8").replace("seeds = 2", "seeds = 1")
    [scenario] = load_sweep(written(tmp_path, text + '"thrusters.factor" = 0.1\n')).scenarios
    outcome = json.loads(outcome_of(scenario))
    assert outcome["flight"]["rms_z"] > 0.3
    assert outcome["warnings"][-1].startswith("the controller is LOST at 0.")


def test_a_loop_that_is_unstable_has_no_margins() -> None:
    """Beyond the largest gain of a stable loop Ms fell from 135 to 4.8, and the delay margin rose to 25 ms."""
    columns = {}
    for roll in (100, 150):
        margins = loop_margins(load_scenario("hover_closed_loop", [f"control.roll={roll}"]))
        control = {"slew_rms": 0.0, "saturated_share": 0.0, "margins": {name: asdict(m) for name, m in margins.items()}}
        columns[roll] = flight_columns({"flight": {}, "control": control})
    assert columns[100]["largest_ms"] > 100.0
    assert columns[150] == {"slew_rms": 0.0, "saturated_share": 0.0}
    shaky = {axis: {"stable": axis == "height"} for axis in ("roll", "pitch", "yaw", "height", "forward")}
    said = _effort({"saturated_share": 0.0, "margins": shaky})
    assert said.endswith("unstable by its gains: roll, pitch, yaw, forward")  # in any order, by the seed of hashes


def test_a_sweep_of_closed_loops_goes_on(tmp_path: Path) -> None:
    """What the loop adds to a run's numbers is read again; before, `slew_rms` was nothing that a sweep writes."""
    sweep, out = load_sweep(written(tmp_path, SHORT.replace('"paper"', '"hover_closed_loop"'))), tmp_path / "out"
    whole = run_sweep(sweep, out)
    first, _ = (out / "finished.jsonl").read_bytes().splitlines(keepends=True)
    (out / "finished.jsonl").write_bytes(first)
    xr.testing.assert_identical(run_sweep(sweep, out), whole)
    assert np.all(np.isfinite(whole["slew_rms"]))


def test_two_sweeps_do_not_share_a_folder(tmp_path: Path) -> None:
    """The second one is told so while the first one flies."""
    sweep, told = load_sweep(written(tmp_path, SHORT)), []

    def progress(*_: int) -> None:
        with pytest.raises(OutputError, match=r"another process \([0-9]+\) writes into it"):
            run_sweep(sweep, tmp_path / "out")
        told.append(True)

    run_sweep(sweep, tmp_path / "out", progress=progress)
    assert told


def test_a_fault_of_ours_in_one_run_does_not_stop_the_rest(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Whatever is raised is a reason, with its name."""

    def faulty(scenario: Any, **more: Any) -> Any:
        if scenario.simulation.seed == 1:
            raise ZeroDivisionError("ours")
        return run(scenario, **more)

    monkeypatch.setattr(plan, "run", faulty)
    grid = run_sweep(load_sweep(written(tmp_path, SHORT)), tmp_path / "out")
    assert list(grid["failed"].values) == ["ZeroDivisionError: ours", ""]


def test_where_all_runs_fail_the_exit_code_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path, SHORT + BROKEN.replace(", 6.71e-3", ""))
    assert call("sweep", str(path), "--out", str(tmp_path / "out"), "--jobs", "1") == 2
    printed = capsys.readouterr()
    assert "2 of 2 runs are finished, 2 of them failed" in printed.out
    assert "cannot close at J4" in printed.err


def test_a_cluster_that_is_not_there_is_an_error(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from aerobat_pin.experiments.sweep import run_sweep as workers

    monkeypatch.setattr(workers, "CONNECT", 0.3)
    with pytest.raises(WorkersLostError, match=r"tcp://127.0.0.1:9: cannot be reached"):
        run_sweep(load_sweep(written(tmp_path, SHORT)), tmp_path / "out", cluster="tcp://127.0.0.1:9")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["morphology", "gain_noise", "model_error", "sample_rate", "sensor_noise"])
def test_a_shipped_sweep_is_listed_and_every_run_of_it_is_a_scenario(name: str) -> None:
    assert shipped_sweeps()[name]
    sweep = load_sweep(name)
    assert sweep.file.name == name
    assert len(sweep.scenarios) == np.prod(sweep.shape)
    assert len({json.dumps(one.model_dump()) for one in sweep.scenarios}) > 0.5 * len(sweep.scenarios)


def made_grid() -> xr.Dataset:
    """Return results whose error is 1 mN at one point, and gain x wind at the other; the fastest wind fails twice."""
    gain, wind, seed = np.array([1.0, 10.0, 100.0]), ["calm", "strong"], [1, 2]
    rmse = np.zeros((3, 2, 2, 1, 2, 3))
    rmse[..., 0, 0] = 1e-3
    rmse[..., 1, 2] = 1e-3 * gain[:, None, None, None] * np.array([1.0, 2.0])[None, :, None, None]
    rmse[2, 1] = np.nan
    dims = ("observers.gain", "wind", "seed")
    coords = {"observers.gain": gain, "wind": wind, "seed": seed, "observer": ["momentum"], "point": ["left", "right"]}
    failed = np.where(np.isnan(rmse[..., 0, 0, 0]), "diverged", "").astype(object)
    data = {"rmse": ((*dims, "observer", "point", "axis"), rmse), "failed": (dims, failed)}
    return xr.Dataset(data, coords | {"axis": ["x", "y", "z"]})


def test_what_each_quantity_does_is_a_table() -> None:
    """Median and range over all runs with a value, worked by hand; failed runs do not count, seeds are no effect."""
    gain, wind = sweep_effects(made_grid())
    assert (gain.name, gain.labels, wind.name, wind.labels) == (
        *("observers.gain", ("1", "10", "100")),
        *("wind", ("calm", "strong")),
    )
    size = {one: np.sqrt(0.5 * (1.0 + one**2)) for one in (1.0, 2.0, 10.0, 20.0, 100.0)}
    middle = 0.5 * (size[10.0] + size[20.0])
    expected = [
        [0.5 * (size[1.0] + size[2.0]), size[1.0], size[2.0]],
        [middle, size[10.0], size[20.0]],
        [size[100.0]] * 3,
    ]
    assert gain.errors["momentum [mN]"] == pytest.approx(np.array(expected))
    assert wind.errors["momentum [mN]"][0] == pytest.approx([size[10.0], size[1.0], size[100.0]])
    header, *lines = effects_text([gain, wind]).splitlines()
    assert header.split() == ["median", "error,", "least", "..", "largest", "momentum", "[mN]"]
    assert [line.split()[:3] for line in lines][3:] == [["wind", "=", "calm"], ["wind", "=", "strong"]]
    assert lines[2].split()[3:] == ["70.7,", "70.7", "..", "70.7"]
    figure = draw_sweep([gain, wind], "made")
    figure.draw_without_rendering()
    by_gain, by_wind = figure.axes[:2]
    assert [text.get_text() for text in by_gain.get_xticklabels()] == ["1", "10", "100"]
    assert [text.get_text() for text in by_wind.get_xticklabels()] == ["calm", "strong"]
    assert not any("$" in text.get_text() for text in by_gain.get_yticklabels())
    np.testing.assert_array_equal(by_gain.lines[0].get_ydata(), gain.errors["momentum [mN]"][:, 0])


def test_draws_are_told_by_thirds_of_what_was_drawn(drawn: xr.Dataset) -> None:
    """One key at a time; of three draws each is a third."""
    [effect] = sweep_effects(drawn)
    order = np.argsort(drawn["believed.air.density"].values)
    assert effect.name == "believed.air.density"
    assert effect.values == pytest.approx(drawn["believed.air.density"].values[order])
    size = 1e3 * np.sqrt((drawn["rmse"].sel(observer="momentum") ** 2).sum("axis").mean("point"))
    assert effect.errors["momentum [mN]"][:, 0] == pytest.approx(np.median(size.values, axis=1)[order])
    assert effect.labels[0].endswith("(lowest third)")
