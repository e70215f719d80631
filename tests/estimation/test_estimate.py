"""`aerobat estimate`: a recorded flight in, forces out; a known force tells sign, frame and unit."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from support.commands import aerobat

import aerobat_pin
from aerobat_pin import open_record, records
from aerobat_pin.aerobat import robot as robot_of_records
from aerobat_pin.aerobat.aerobat import Aerobat, believed_robot, load_morphology
from aerobat_pin.aerobat.air.believed_air import reconstructed_air
from aerobat_pin.aerobat.estimate import belief_about, describe_belief, estimate_flight
from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.aerobat.motion import Motion
from aerobat_pin.aerobat.tables import read_log
from aerobat_pin.errors import LogError, ScenarioError
from aerobat_pin.experiments import Check, Experiment, self_check
from aerobat_pin.numerics import Array
from aerobat_pin.scenario import AirSection, scenario_toml

HEADER = ("time [s]", "x [m]", "y [m]", "z [m]", "qx", "qy", "qz", "qw", "crank_angle [rad]", "airspeed [m/s]")
THRUST = tuple(f"thrust_{name}" for name in ("fx", "fy", "fz", "mx", "my", "mz"))


@pytest.fixture
def recorded(paper: Experiment, tmp_path: Path) -> Path:
    """Write what a hall records of the first 0.4 s of the paper's flight, with the thrusters' known wrench, as CSV."""
    log, count = paper.log.measured, 401
    thrust = log["known_thrusters"].values[:, :6]
    ends = np.vstack([thrust[:1], 0.5 * (thrust[1:] + thrust[:-1]), thrust[-1:]])[:count]
    columns = [log.time[:count], log["q"].values[:count, :7], log["crank_angle"][:count], log["airspeed"][:count], ends]
    with (tmp_path / "hall.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([*HEADER, *THRUST])
        writer.writerows(np.column_stack(columns).tolist())
    return tmp_path / "hall.csv"


@pytest.mark.usefixtures("unrendered")
def test_a_simulated_log_gives_again_what_its_run_gave(paper: Experiment, tmp_path: Path) -> None:
    """Belief from the log's own notes; the same forces to the last bit, scored against the truth that is there."""
    paper.log.save(tmp_path / "flight.nc")
    done = aerobat("estimate", "flight.nc", "--set", "observers.gain=2000", "--out", "found", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = xr.load_dataset(tmp_path / "found" / "estimate.nc", engine="h5netcdf")
    for name, estimate in paper.estimates.items():
        np.testing.assert_array_equal(found["force_W"].sel(observer=name).values, estimate.force)
    metrics = json.loads((tmp_path / "found" / "metrics.json").read_text())
    assert metrics["observers"] == paper.metrics["observers"]
    names = {path.relative_to(tmp_path / "found").as_posix() for path in (tmp_path / "found").rglob("*.*")}
    pages = {"report.html", "replay.html", "figures/estimation.png", "figures/estimation.pdf", "figures/states.png"}
    assert names >= {"belief.toml", "estimate.nc", "estimate.csv", "metrics.json", *pages}


def test_python_opens_a_run_as_any_other_record(paper: Experiment, tmp_path: Path) -> None:
    """The same road as the command's: folder or log without a map, forces to the last bit, scored against the truth."""
    paper.log.save(tmp_path / "flight.nc")
    with pytest.raises(LogError, match=r"not the folder of a run: scenario\.toml"):
        open_record(tmp_path)
    (tmp_path / "scenario.toml").write_text(scenario_toml(paper.scenario))
    assert repr(open_record(tmp_path)) == f"{tmp_path}: aerobat_guard, 0.09213 kg; 2 s in one part at 1000 Hz"
    for place in (tmp_path, tmp_path / "flight.nc"):
        result = aerobat_pin.estimate(open_record(place), ["force_level"])
        scores = result.metrics()["observers"]["force_level"]
        if place == tmp_path:  # the gain of the scenario, which the log alone does not know
            np.testing.assert_array_equal(result.estimates["force_level"].force, paper.estimates["force_level"].force)
            assert scores["left"] == paper.metrics["observers"]["force_level"]["left"]
        assert scores["right"]["Fz"]["r2"] > 0.99
    with pytest.deprecated_call(match="aerobat_pin.aerobat.open_record now"):
        assert records.open_record is open_record
    (tmp_path / "arm.csv").write_text("time,a,b\n0,1,2\n")
    with pytest.raises(LogError, match="a map says what its columns mean"):
        open_record(tmp_path / "arm.csv")


def test_a_sample_meets_its_air_once(paper: Experiment, monkeypatch: pytest.MonkeyPatch) -> None:
    """By all observers and all checks together: it is what costs most of a sample."""
    flown: list[int] = []

    def counted(robot: Aerobat, air: AirSection, moved: Motion) -> dict[str, Array]:
        flown.append(len(moved.time))
        return reconstructed_air(robot, air, moved)

    monkeypatch.setattr(robot_of_records, "reconstructed_air", counted)
    estimate_flight(paper.log, paper.robot, paper.scenario)
    assert flown == [len(paper.log.time)]


@pytest.mark.usefixtures("unrendered")
def test_a_table_from_a_hall_gives_forces_and_says_what_it_cannot(recorded: Path, paper: Experiment) -> None:
    """Poses, crank, airspeed and thrust: no torque, so the squeeze is named, and what is seen is right."""
    folder = recorded.parent
    words = ["--set", "robot.changes={wing={offset_x=-0.06}}", "--set", "observers.gain=500"]
    done = aerobat("estimate", "hall.csv", "--morphology", "aerobat_guard", *words, "--out", "found", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("believed: aerobat_guard with changes, 92.1 g, from --morphology\n")
    assert "cannot be seen at all: equal and opposite along the line" in done.stdout
    for line in ("q reconstructed", "aerodynamic reconstructed", "thrusters measured"):
        assert line in done.stdout
    with (folder / "found" / "estimate.csv").open() as file:
        rows = list(csv.reader(file))
    assert rows[0][:3] == ["start [s]", "end [s]", "momentum.left_force_point.Fx [N]"]
    at = rows[0].index("force_level.left_force_point.Fz [N]")
    left, right = (np.array([float(row[k]) for row in rows[1:]]) for k in (at, at + 3))
    truth = paper.log.truth["force_noise_free_W"].values[:400].sum(axis=1)[:, 2]
    settled = slice(20, None)  # the first derivative of a pose is one-sided
    assert np.corrcoef((left + right)[settled], truth[settled])[0, 1] > 0.99
    metrics = json.loads((folder / "found" / "metrics.json").read_text())
    assert metrics["torque"] == "none"
    assert metrics["observers"]["force_level"]["rank"] == 5
    assert metrics["seed"] is None


@pytest.mark.parametrize(
    ("noted", "morphology", "settings", "told"),
    [
        (False, None, [], "aerobat, 42.1 g, by default; --morphology chooses another"),
        (False, "aerobat_guard", [], "aerobat_guard, 92.1 g, from --morphology"),
        (False, None, ["robot.morphology=aerobat_light"], "aerobat_light, 20.0 g, from --set"),
        (True, None, [], "aerobat_guard with changes, 92.1 g, noted in the log"),
        (True, "aerobat_guard", [], "aerobat_guard, 92.1 g, from --morphology"),
        (True, None, ["robot.changes.body.mass=0.07"], "aerobat_guard with changes, 80.8 g, noted in the log"),
    ],
)
def test_the_believed_robot_is_named_with_the_reason(
    noted: bool, morphology: str | None, settings: list[str], told: str, paper: Experiment
) -> None:
    """A robot of another mass makes other forces: nobody is to believe one without knowing."""
    belief = belief_about(paper.log if noted else None, "x", morphology, [], settings)
    assert describe_belief(belief, morphology, settings) == f"believed: {told}"


@pytest.mark.parametrize(
    ("stem", "name"), [("flight 3 (wind)", "flight_3_wind_"), ("_x", "x"), ("Flügel", "Fl_gel"), ("ü", "flight")]
)
def test_a_log_may_have_any_name(stem: str, name: str) -> None:
    """As a copy of a scenario, the belief is called what a scenario can be called."""
    assert belief_about(None, stem, None, [], []).name == name


def test_a_robot_of_ones_own_is_believed_as_the_run_copied_it(paper: Experiment, tmp_path: Path) -> None:
    """Not as its file is by now, nor where it is; a shipped robot is never a file beside the log."""
    for name, noted in (("own", "wings/bird.toml"), ("shipped", "aerobat_guard")):
        FlightLog(paper.log.measured.assign_attrs(morphology=noted)).save(tmp_path / f"{name}.nc")
    (tmp_path / "morphology.toml").write_text('extends = "aerobat_guard"\nname = "bird"\n[body]\nmass = 0.09\n')
    own, shipped = (belief_about(read_log(tmp_path / f"{name}.nc"), name, None, [], []) for name in ("own", "shipped"))
    assert load_morphology(own.robot.morphology).body.mass == 0.09
    assert shipped.robot.morphology == "aerobat_guard"


@pytest.mark.parametrize("key", ["flight.velocity", "simulation.seed", "sensors.gyro.noise", "believed.air", "name"])
def test_what_no_estimate_would_heed_cannot_be_set(key: str) -> None:
    """The message names the key and what may be set; gravity may, for the believed robot falls by it."""
    said = f"'{key}' does not belong .* keys of robot, air, observers, and flight.gravity"
    with pytest.raises(ScenarioError, match=said):
        belief_about(None, "x", None, [], [f"{key}=1"])
    assert belief_about(None, "x", None, [], ["flight.gravity=1.62"]).flight.gravity == 1.62


def test_a_known_force_is_found_where_it_acts(tmp_path: Path) -> None:
    """`--self-check` without a log: a tenth of the weight, at both wings, along every world axis."""
    done = aerobat("estimate", "--self-check", "--morphology", "aerobat_light", "--observer", "momentum", cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("ok   momentum: +0.0196 N") == 6
    assert done.stdout.endswith("self-check: sign, frame and unit are right\n")
    assert list(tmp_path.iterdir()) == []
    slow = aerobat("estimate", "--self-check", "--set", "observers.gain=50", cwd=tmp_path)
    assert slow.returncode == 1
    assert "self-check: FAILED for momentum, whose forces lag behind wings that turn" in slow.stdout


def test_a_wrong_sign_frame_or_unit_does_not_pass() -> None:
    """Minus the force, the force in another axis or at the other point, grams for newtons."""
    good = Check("momentum", "left", "y", 0.1, (0.0, 0.1, 0.0), 0.0)
    assert good.ok
    wrong = [((0.0, -0.1, 0.0), 0.0), ((0.1, 0.0, 0.0), 0.0), ((0.0, 0.1, 0.0), 0.1), ((0.0, 10.0, 0.0), 0.0)]
    for found, elsewhere in wrong:
        bad = Check("momentum", "left", "y", 0.1, found, elsewhere)
        assert not bad.ok
        assert str(bad).startswith("BAD")


def test_the_self_check_waits_for_slow_observers() -> None:
    """At K = 30 1/s an estimate takes a tenth of a second to rise; it is right then, and not called wrong before."""
    belief = belief_about(None, "slow", "aerobat", ["force_level", "kalman"], ["observers.gain=30"])
    assert all(check.ok for check in self_check(believed_robot(belief), belief))


def test_a_log_that_another_robot_flew_shows_forces(paper: Experiment) -> None:
    """Which a self-check cannot see, as it simulates the belief itself."""
    own = belief_about(FlightLog(paper.log.measured), "x", None, ["force_level"], [])
    heavy = belief_about(paper.log, "x", None, ["force_level"], ["robot.changes.body.mass=0.1"])
    pairs = ((believed_robot(one), one) for one in (own, heavy))
    right, wrong = (estimate_flight(paper.log, *pair).estimates["force_level"].force for pair in pairs)
    weight = (0.1 - 0.0813) * 9.81  # the joint rows know that it does not hang on the wings: part of it shows
    assert 0.3 * weight < np.mean((wrong - right).sum(axis=1)[:, 2]) < weight


def test_it_pushes_with_a_tenth_of_the_weight_that_is_believed() -> None:
    """On the moon as well; where nothing weighs anything there is no tenth of it."""
    moon, space = (belief_about(None, "x", None, ["momentum"], [f"flight.gravity={g}"]) for g in (1.62, 0.0))
    robot = believed_robot(moon)
    checks = self_check(robot, moon)
    assert [check.applied for check in checks] == [pytest.approx(0.162 * robot.mass)] * 6
    assert all(check.ok for check in checks)
    with pytest.raises(ScenarioError, match=r"flight\.gravity = 0"):
        self_check(believed_robot(space), space)


def test_a_pose_that_hides_a_force_is_not_called_a_row_that_is_not_believed() -> None:
    """Of two joints whose rows are both believed a force along the arm leaves nothing; it was the map's fault."""
    hidden = (Check("force_level", "tip", "x", 1.0, (0.0, 0.0, 0.0), 0.0, 0.0, whole) for whole in (True, False))
    assert [str(check).rpartition("at no time: ")[2] for check in hidden] == [
        "the pose hides it",
        "the map believes no row that shows it",
    ]
