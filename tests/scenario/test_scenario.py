"""Scenario files: what is shipped loads, what is written reads back, wrong is named; a flight's size, before it."""

from pathlib import Path
from typing import Any

import pytest

from aerobat_pin.aerobat import load_morphology
from aerobat_pin.errors import AerobatError, MorphologyFileError, ScenarioError, SweepError
from aerobat_pin.experiments import run
from aerobat_pin.experiments.sweep.sweep_file import read_sweep
from aerobat_pin.experiments.write_results import write_scenario
from aerobat_pin.flight import simulate
from aerobat_pin.scenario import (
    changed_keys,
    changes_text,
    described,
    load_scenario,
    parse_scenario,
    scenario_of_run,
    scenario_toml,
    shipped_scenarios,
)


@pytest.mark.parametrize("drive", ["constant", "spin_up", "motor"])
def test_a_shipped_scenario_survives_writing_and_reading(drive: str, tmp_path: Path) -> None:
    """The resolved scenario holds every default, of the drives its own alone, and gives the same scenario again."""
    more = ["air.gust.amplitude=[1.0, 0.0, 0.0]", "air.lift_limit=1.4", f"crank.drive={drive}"]
    scenario = load_scenario("observer_benchmark", ["simulation.seed=7", "robot.changes.wing.offset_x=-0.05", *more])
    text, file = scenario_toml(scenario), tmp_path / "scenario.toml"
    assert [f"[crank.{table}]" in text for table in ("spin_up", "motor")] == [drive == "spin_up", drive == "motor"]
    assert ("torque_limit = 0.15" in text) == (drive == "motor")
    file.write_text(text, encoding="utf-8")
    assert load_scenario(file) == scenario


@pytest.mark.parametrize(
    ("stem", "given", "name"),
    [("my", "paper", "my"), ("-my flight", "paper", "my_flight"), ("my", "own", "own"), ("--", "paper", "paper")],
)
def test_a_copy_of_a_shipped_scenario_takes_its_files_name(stem: str, given: str, name: str, tmp_path: Path) -> None:
    """And says where it comes from; a name of one's own stays."""
    text = scenario_toml(load_scenario("paper", ["simulation.seed=7"])).replace('"paper"', f'"{given}"', 1)
    (tmp_path / f"{stem}.toml").write_text(text, encoding="utf-8")
    copied = load_scenario(tmp_path / f"{stem}.toml", ["observers.gain=500"])
    assert copied.name == name
    if name.startswith("my"):
        assert copied.description == "made from paper"


def test_a_believed_robot_of_ones_own_is_found_beside_its_scenario_and_copied(tmp_path: Path) -> None:
    """As the robot that flies; what comes of the first file later changes nothing."""
    folder = tmp_path / "run"
    folder.mkdir()
    (tmp_path / "bird.toml").write_text('extends = "aerobat_guard"\nname = "bird"\n[body]\nmass = 0.09\n')
    (tmp_path / "flight.toml").write_text('name = "flight"\n[believed.robot]\nmorphology = "bird.toml"\n')
    write_scenario(load_scenario(tmp_path / "flight.toml"), folder)
    (tmp_path / "bird.toml").unlink()
    believed = scenario_of_run(folder).believed_robot
    assert load_morphology(believed.morphology).body.mass == 0.09
    (folder / "scenario.toml").write_text('name = "flight"\n[believed.robot]\nmorphology = "../bird.toml"\n')
    with pytest.raises(ScenarioError, match="outside the folder of its run"):
        scenario_of_run(folder)


def test_a_part_that_is_taken_off_in_python_is_off_in_the_written_scenario(tmp_path: Path) -> None:
    """TOML has no null: `tail = None` is written as `tail = false`."""
    values = load_scenario("paper").model_dump(exclude_none=True)
    values["robot"]["changes"] = {"tail": None, "wing": {"force_point": None}}
    scenario = parse_scenario(values, "without a tail")
    (tmp_path / "paper.toml").write_text(scenario_toml(scenario), encoding="utf-8")
    assert load_scenario(tmp_path / "paper.toml") == scenario
    assert load_morphology("aerobat", scenario.robot.changes).tail is None


def test_settings_reach_numbers_words_lists_and_list_entries() -> None:
    """`--set` takes TOML values and bare words, counts list entries from 0, and reaches all of them by a `*`."""
    scenario = load_scenario(
        "paper",
        [
            "simulation.dt=0.0005",
            "robot.morphology=aerobat",
            "unknown_force.1.axes=world",
            "unknown_force.0.direction=[1, 0, 0]",
            "unknown_force.*.noise=0.5",
        ],
    )
    assert scenario.simulation.dt == 0.0005
    assert scenario.robot.morphology == "aerobat"
    assert [force.noise for force in scenario.unknown_force] == [0.5, 0.5]
    assert [force.axes for force in scenario.unknown_force] == ["link", "world"]
    assert scenario.unknown_force[0].direction == (1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("unknown_force.0.frme='x'", "unknown key 'unknown_force.0.frme'; did you mean 'frame'"),
        ("simulation.dt=-0.001", "simulation.dt = -0.001: input should be greater than 0"),
        ("simulation.dt=nan", "simulation.dt = nan: input should be a finite number"),
        ("observers.gain=1e300", "observers.gain = 1e+300: input should be less than or equal to 1000000000000"),
        ('observers.names=["momentum", "momentum"]', "'momentum' is there twice"),
        ('observers.frames=["left_distal", "left_distal"]', "'left_distal' is there twice"),
        ("flight.position=[0, 0, -1e9]", "2 = -1000000000.0: input should be greater than or equal to -1000000"),
        ("unknown_force.0.step_end=0.5", "step from step_start = 1.0 s to step_end = 0.5 s: step_end comes later"),
        ("sensors.gyro.delay=1e300", "sensors.gyro.delay = 1e+300"),
        ("name=my paper", "name = 'my paper': letters, digits, '.', '_' and '-' without spaces were expected"),
        ("simulation.duration=[1]", "simulation.duration"),
        ("air.gust={amplitude = [1.0, 0.0, 0.0], duration = 0.0}", "air.gust.duration = 0"),
        ("air.wind=[1,0]", "air.wind = [1, 0]: 3 numbers were expected"),
        ("air.wind=1,0,0", "air.wind = '1,0,0': input should be a valid list, such as [1, 0, 0]"),
        ("flight.velocity=4", "flight.velocity = 4: input should be a valid list, such as [4, 0.0, 0.0]"),
        ("unknown_force.0.direction=[1]", "unknown_force.0.direction = [1]: 3 numbers were expected"),
        ("observers.names=momentum", 'input should be a valid list, such as ["momentum"]'),
        ("air.wave={frequency=2}", "a valid list, such as [{frequency = 2}]"),
        ("crank.frequency=fast", "crank.frequency = 'fast'"),
        ("crank.drive=steam", "crank.drive = 'steam': input should be 'constant', 'spin_up' or 'motor'"),
        ("crank.motor.torque_limit=0.1", 'crank.motor is given, but crank.drive = "constant"; write drive = "motor"'),
        ("unknown_force.9.noise=0", "'9' is not an index of 'unknown_force', a list of 2"),
        ("unknown_force.²=0", "'²' is not an index of 'unknown_force', a list of 2"),
        ("hold.*=0", "'hold' is a table, not a list; '*' stands for the items of a list"),
        ("simulation.dt.x=1", "'simulation.dt' is a value, not a table"),
        ("simulation.dt", "dotted.key=value was expected"),
        ("unknown_force.0.signal=stp", "unknown_force.0.signal = 'stp': did you mean 'step'? There are paper, step"),
        ("unknown_force.0={frame='a', signal='impulse', impulse='x'}", "unknown_force.0.impulse = 'x': input should"),
        ("unknown_force.0={frame='a', signal='step', end=0.1}", "start = 0.5 s to end = 0.1 s: end comes later"),
        ("unknown_force.0={frame='a', signal='recorded'}", "missing key 'unknown_force.0.file'"),
        ("unknown_force.0={frame='a', signal='sine', step=1}", "unknown key 'unknown_force.0.step'"),
        ("sensors.gyro.noise=[1, 2]", "sensors.gyro.noise = [1.0, 2.0]: one number, or 3, were expected"),
        ("sensors.airspeed.bias=[1, 2]", "sensors.airspeed.bias = [1.0, 2.0]: one number was expected"),
        ("sensors.gyro.noise=-1", "sensors.gyro.noise = [-1.0]: deviations are not negative"),
        ("sensors.gyro.noise=nan", "sensors.gyro.noise.0 = nan: input should be a finite number"),
        ("sensors.gyro.dropout=1", "sensors.gyro.dropout = 1: input should be less than 1"),
        ("sensors.gyro.rate=1001", "sensors.gyro.rate = 1001 Hz: the log has 1000 samples a second"),
        ("sensors.gyr.noise=1", "unknown key 'sensors.gyr'; did you mean 'gyro'?"),
        ("sensors.gyr=none", "unknown key 'sensors.gyr'; did you mean 'gyro'?"),
        ("observers.kalman.sensor_noise=[0.1, 0.1]", "kalman.sensor_noise = [0.1, 0.1]: 3 numbers were expected"),
        ("observers.kalman.misfit=0", "observers.kalman.misfit = 0: input should be greater than 0"),
        ("observers.kalman.known_error.aerodynamic=-1", "known_error.aerodynamic = -1: input should be"),
    ],
)
def test_a_wrong_setting_names_key_value_and_rule(setting: str, message: str) -> None:
    """One clear message for each mistake, about the key as the file has it."""
    with pytest.raises(ScenarioError) as caught:
        load_scenario("paper", [setting])
    assert str(caught.value).count(message) == 1


@pytest.mark.parametrize(
    ("rate", "other"), [("4000", "1000"), ("1001", "1000"), ("700", "1000"), ("300", "333.333333"), ("333.3", "333.")]
)
def test_a_law_that_cannot_keep_its_rate_is_refused(rate: str, other: str) -> None:
    """It has its turn at samples alone: faster ones are none, and 3.33 ms would be 3 and 4; the advice is taken."""
    with pytest.raises(ScenarioError, match=rf"control\.rate = {rate} Hz: .* such as {other}") as caught:
        load_scenario("hover_closed_loop", [f"control.rate={rate}"])
    advised = str(caught.value).split()[-2]
    assert load_scenario("hover_closed_loop", [f"control.rate={advised}"]).control is not None
    assert load_scenario("hover_closed_loop", ["control.rate=2000", "simulation.dt=5e-4"]).control is not None


def test_a_controller_does_not_fly_by_raw_sensors_or_without_weight() -> None:
    """It would see the exact motion; it moves sideways by the thrust that carries it. Either key alone is fine."""
    with pytest.raises(ScenarioError, match=r"control with sensors\.motion_capture: .* was expected"):
        load_scenario("hover_closed_loop", ["sensors={motion_capture={}, gyro={}}"])
    assert load_scenario("raw_sensors").sensors.raw
    with pytest.raises(ScenarioError, match=r"flight\.gravity = 0 with control: .* some gravity was expected"):
        load_scenario("hover_closed_loop", ["flight.gravity=0"])
    assert load_scenario("paper", ["flight.gravity=0"]).flight.gravity == 0.0


def test_a_file_that_is_not_there_or_not_toml_is_named(tmp_path: Path) -> None:
    """The message lists the shipped names, or says where the TOML breaks."""
    with pytest.raises(ScenarioError, match=r"no scenario 'papr'.*observer_benchmark, paper"):
        load_scenario("papr")
    for missing in ("papr.toml", "scenarios/papr"):
        with pytest.raises(ScenarioError, match=f"^scenario file {missing}: there is no such file$"):
            load_scenario(missing)
        with pytest.raises(SweepError, match=f"^sweep file {missing}: there is no such file$"):
            read_sweep(missing)
    broken = tmp_path / "broken.toml"
    broken.write_text("name = [", encoding="utf-8")
    with pytest.raises(ScenarioError, match="not valid TOML"):
        load_scenario(broken)
    empty = tmp_path / "empty.toml"
    empty.write_text("", encoding="utf-8")
    with pytest.raises(ScenarioError, match="missing key 'name'"):
        load_scenario(empty)


def test_a_robots_file_that_is_missing_or_wrong_is_named(tmp_path: Path) -> None:
    """Also where the rule it breaks is one of the robot's own."""
    with pytest.raises(MorphologyFileError, match=r"^morphology file my_robot\.toml: there is no such file$"):
        load_morphology("my_robot.toml")
    file = tmp_path / "bird.toml"
    file.write_text('extends = "aerobat"\nname = "bird"\n[body]\nmass = -0.09\n', encoding="utf-8")
    with pytest.raises(MorphologyFileError, match=r"^morphology file .*bird\.toml: body\.mass = -0\.09: "):
        load_morphology(file)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("unknown_force.0.frame=left_tip", "frame = 'left_tip': did you mean 'left_distal'? The robot's frames"),
        ("unknown_force.0.direction=[0, 0, 0]", "a direction must not be zero"),
        ("unknown_force.0.frame=universe", "unknown_force.0.frame = 'universe': the robot's frames are root_joint"),
        ("observers.frames=['universe']", "is fixed to the world"),
        ("observers.frames=['left_tip']", "no frame named 'left_tip'"),
        ("observers.names=['magic']", "choose from momentum, force_level"),
        ("observers.names=[]", "choose from momentum, force_level"),
        ("robot.morphology=albatross", "no morphology named 'albatross'"),
        ("robot.changes.wing.offset=1", "unknown key 'wing.offset'; did you mean 'offset_x'"),
        ("robot.changes.linkage.L3b=0.002", "the linkage cannot close at J4 for a crank angle of"),
        ("robot.changes.body.mass=-1", "body.mass = -1"),
        ("robot.changes.body.mass=nan", "body.mass = nan: finite numbers were expected"),
    ],
)
def test_what_the_robot_cannot_do_is_refused_before_flying(setting: str, message: str) -> None:
    """Frames, observers, morphology and linkage are checked when the run starts."""
    with pytest.raises(AerobatError) as caught:
        run(load_scenario("paper", ["simulation.duration=0.01", setting]))
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("settings", "changed"),
    [
        ([], {}),
        (["believed.air.density=1.47"], {"believed.air.density": 1.47}),
        (["unknown_force.*.noise=0.5"], {"unknown_force.0.noise": 0.5, "unknown_force.1.noise": 0.5}),
        (["sensors.gyro.noise=0.05", "observers.gain=50"], {"sensors.gyro.noise": [0.05], "observers.gain": 50.0}),
        (["air.wind=[1,0,0]"], {"air.wind": [1.0, 0.0, 0.0]}),
        (['observers.names=["kalman"]'], {"observers.names": ["kalman"]}),
        (["simulation.seed=1"], {}),  # as it is
        (["name=mine", "simulation.seed=7"], {}),  # another scenario: nothing that it could be taken for
    ],
)
def test_what_differs_from_the_shipped_scenario_is_named(settings: list[str], changed: dict[str, Any]) -> None:
    """Dotted keys as `--set` takes them, with the new values; defaults of a new table stay out."""
    assert changed_keys(load_scenario("paper", settings)) == changed


def test_what_is_taken_away_is_named_too() -> None:
    """A hold that is gone is null; a list of another length is one value."""
    values = load_scenario("paper").model_dump(exclude_none=True)
    del values["hold"]
    values["unknown_force"] = values["unknown_force"][:1]
    changed = changed_keys(parse_scenario(values, "mine"))
    assert changed["hold"] is None
    assert [force["frame"] for force in changed["unknown_force"]] == ["left_force_point"]
    assert set(changed) == {"hold", "unknown_force"}
    assert changes_text("paper", changed).startswith("changed from paper: hold = none, unknown_force = [{frame = left")


@pytest.mark.parametrize("name", shipped_scenarios())
def test_a_shipped_scenario_changes_nothing(name: str) -> None:
    """Not even after it was written with all its defaults."""
    assert changed_keys(load_scenario(name)) == {}
    assert changes_text(name, {}) == ""


def test_a_description_does_not_contradict_its_scenario() -> None:
    """That of a shipped scenario goes when a key changes and comes back with it; the user's own stays."""
    paper = load_scenario("paper")
    short = described(load_scenario("paper", ["simulation.duration=0.5"]))
    assert short.description == "changed from paper: simulation.duration = 0.5"
    longer = short.model_copy(update={"simulation": paper.simulation.model_copy(update={"duration": 3.0})})
    assert described(longer).description == "changed from paper: simulation.duration = 3"
    assert described(short.model_copy(update={"simulation": paper.simulation})) == paper == described(paper)
    own = load_scenario("paper", ["description=mine", "simulation.duration=0.5"])
    assert described(own) == own
    assert "2 s, noise" not in repr(short)


def test_a_long_list_of_changes_stays_a_line() -> None:
    """Eight of them, and how many more; six digits of a number."""
    text = changes_text("paper", {f"key{i}": 1.0 / 3.0 for i in range(10)})
    assert text.startswith("changed from paper: key0 = 0.333333, key1")
    assert text.endswith("key7 = 0.333333, and 2 more")


@pytest.mark.parametrize("strips", [4, 40])
def test_the_log_has_the_size_that_was_estimated(strips: int) -> None:
    """To 3 %: measured and true channels together."""
    scenario = load_scenario("paper", ["simulation.duration=0.05", "simulation.dt=1e-4", f"air.strips={strips}"])
    log = simulate(scenario)
    assert log.measured.nbytes + log.truth.nbytes == pytest.approx(scenario.size.log_bytes, rel=0.03)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            ["simulation.duration=1e7"],
            r"duration = 1e\+07 s .* 1e\+10 steps, a log of 2\.\d+e\+04 GB and about 1e\+06 s",
        ),
        (["simulation.dt=1e-12"], r"dt = 1e-12 s.*at most 2 GB and 3600 s are allowed: a shorter simulation\.duration"),
        (["simulation.dt=1e-12", "simulation.duration=1e-11"], "a longer simulation.dt"),  # the warm-up alone
        (["simulation.duration=10_000", "simulation.dt=0.02", "unknown_force.*.tick=1e-5"], r"unknown_force\.\*\.tick"),
        (["simulation.duration=1e10", "simulation.dt=1e-300"], "not a whole number of steps"),
    ],
)
def test_too_large_a_flight_is_refused_before_it_takes_memory(settings: list[str], message: str) -> None:
    """With the estimate, the limit, and the key to change; also where a copy of a good scenario is made too large."""
    with pytest.raises(ScenarioError, match=message):
        load_scenario("paper", settings)


def test_python_is_refused_as_the_command_line_is() -> None:
    """`model_copy` checks nothing."""
    good = load_scenario("paper")
    large = good.model_copy(update={"simulation": good.simulation.model_copy(update={"duration": 1e7})})
    with pytest.raises(ScenarioError, match=r"a shorter simulation\.duration"):
        simulate(large)
