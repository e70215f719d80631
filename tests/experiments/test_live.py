"""Robots that live: what a user sets acts, and the estimate is that of the batch or the known answer."""

import copy
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from support.walking_log import FEET, bag, bag_map, table, table_map, urdf, walk

from aerobat_pin import open_record
from aerobat_pin.errors import LogError, ObserverError, ScenarioError
from aerobat_pin.estimation import estimate
from aerobat_pin.experiments import LIVE_OBSERVERS, LiveFlight, LiveRecording, LiveRobot, LiveRow
from aerobat_pin.experiments.live import flight
from aerobat_pin.records import parse_map
from aerobat_pin.scenario import load_scenario

LONG = 1e3  # [s] of work that a test allows
WAVE = "{amplitude=[0.0, 0.6, 0.3], frequency=0.7}"  # of the wind


def errors(rows: list[LiveRow]) -> np.ndarray:
    """Return estimate less true force (n, p, 3) [N]."""
    return np.array([row.estimate - row.true for row in rows])


@pytest.fixture
def hovering() -> LiveFlight:
    live = LiveFlight(load_scenario("hover_closed_loop"))
    live.change({"noise": 0.0, "gain": 1000.0})
    live.advance(0.1, LONG)
    return live


def test_a_hovering_robot_feels_what_is_set_and_flies_on(hovering: LiveFlight) -> None:
    """0.02 N within 0.03 % over three flaps, past the end of the flight's tables; the robot stays where it is."""
    hovering.change({"force": [[0.0, 0.0, 0.02], [0.0, 0.01, 0.0]]})
    rows = hovering.advance(1.5, LONG)
    assert len(rows) >= 1499
    np.testing.assert_allclose(rows[-1].true, [[0.0, 0.0, 0.02], [0.0, 0.01, 0.0]], rtol=0.0, atol=1e-12)
    off = errors(rows[-632:])  # three flaps
    assert np.abs(off.mean(axis=0)).max() < 3e-4 * 0.02
    assert np.sqrt(np.mean(off**2)) < 2e-3 * 0.02
    assert np.linalg.norm(hovering.q[:3]) < 0.1
    assert hovering.said == ""


def test_wind_and_noise_act_while_it_flies(hovering: LiveFlight) -> None:
    """Wind that nobody believes in looks like a force; noise of the sensors shakes the estimate, a lower gain less."""
    hovering.change({"force": np.zeros((2, 3)).tolist(), "wind": [0.3, 0.0, 0.0]})
    blown = hovering.advance(0.6, LONG)
    assert np.abs(errors(blown[-400:])).max() > 2e-3
    hovering.change({"wind": [0.0, 0.0, 0.0], "noise": 1.0})
    rough = errors(hovering.advance(0.3, LONG)).std(axis=0)
    hovering.change({"gain": 20.0})
    smooth = errors(hovering.advance(0.6, LONG)[-300:]).std(axis=0)
    assert np.all(rough > 5.0 * smooth)


def test_what_was_flown_is_a_run(hovering: LiveFlight) -> None:
    """What the sensors showed, and the truth; the batch sees what the stream has seen."""
    hovering.change({"noise": 0.0, "gain": 1000.0, "observer": "momentum"})
    rows = hovering.advance(0.4, LONG)
    made = hovering.result(lambda *_: None)
    assert list(made.estimates) == ["momentum"]
    assert len(made.log.time) == round(made.flight.duration / hovering.dt) + 1
    batch = made.estimates["momentum"].components[-200:-1].reshape(-1, 2, 3)
    live = np.array([row.estimate for row in rows[-199:]])
    np.testing.assert_allclose(batch, live, rtol=0.0, atol=1e-4)


def test_what_was_flown_later_is_estimated_in_the_wind_of_its_own_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing pushes in a wind that is known: nothing is found, also after the first seconds that are kept."""
    monkeypatch.setattr(flight, "KEPT", 0.5)
    monkeypatch.setattr(flight, "LEAST_SAVED", 0.2)
    settings = ["air.strips=4", "air.warm_up_cycles=1", "sensors={}", "observers.gain=1000"]
    live = LiveFlight(load_scenario("hover_closed_loop", [*settings, f"air.wave=[{WAVE}]"]))
    live.advance(0.6, LONG)
    first = live.result(lambda *_: None)  # too little of the second window yet
    live.advance(0.3, LONG)
    second = live.result(lambda *_: None)
    largest = [np.abs(made.estimates["force_level"].force[100:]).max() for made in (first, second)]
    assert max(largest) < 2e-4, largest
    assert [made.log.time[0] for made in (first, second)] == pytest.approx([0.0, 0.5])
    assert second.flight.duration == pytest.approx(0.399)


def test_every_observer_lives(hovering: LiveFlight) -> None:
    """On a flight and on a stream, one after the other: 10 % of a force that stays, without noise."""
    for live in (hovering, LiveRobot("ur5")):
        force = np.zeros((len(live.points), 3))
        force[0, 2] = 0.3 * live.limit
        live.change({"noise": 0.0, "gain": 100.0, "force": force.tolist()})
        for observer in LIVE_OBSERVERS:
            live.change({"observer": observer})
            off = errors(live.advance(0.5, LONG)[-200:]).mean(axis=0)
            assert np.abs(off[0]).max() < 0.1 * force[0, 2], observer


def test_what_is_known_of_the_joint_torques_counts_while_it_lives() -> None:
    """Without any, the base's rows see two forces sideways as one, as in the run; before, all torques were known."""
    settings = ["air.strips=4", "sensors={}", "observers.names=['force_level']", "observers.torque=none"]
    live = LiveFlight(load_scenario("hover_closed_loop", settings))
    live.advance(0.1, LONG)
    live.change({"force": [[0.0, 0.0, 0.02], [0.0, 0.01, 0.0]]})
    rows = live.advance(0.3, LONG)
    batch = live.result(lambda *_: None).estimates["force_level"].components[-100:-1].reshape(-1, 2, 3)
    np.testing.assert_allclose([row.estimate for row in rows[-99:]], batch, rtol=0.0, atol=1e-4)
    assert np.abs(errors(rows[-99:]))[..., 1].max() > 4e-3
    with pytest.raises(ScenarioError, match="'modelled' takes a whole flight"):
        LiveFlight(load_scenario("hover_closed_loop", ["observers.torque=modelled"]))


def test_a_filter_that_doubts_the_air_lives() -> None:
    """Names of known forces are a run's: it was "lost: OK" at every second step; a large gain is no refusal."""
    settings = ["air.strips=4", "observers.names=['kalman']", "observers.kalman.known_error={aerodynamic=0.2}"]
    live = LiveFlight(load_scenario("hover_closed_loop", [*settings, "observers.gain=4000"]))
    assert len(live.advance(0.05, LONG)) == 49
    assert live.said == ""
    live.change({"force": [[0.0, 0.0, 0.02], [0.0, 0.0, 0.0]]})
    np.testing.assert_allclose(live.advance(0.05, LONG)[-1].true[0], [0.0, 0.0, 0.02], rtol=0.0, atol=1e-12)


def test_a_robot_that_is_lost_begins_again() -> None:
    live = LiveFlight(load_scenario("hover_closed_loop", ["air.strips=4"]))
    live.limit = 10.0
    live.change({"force": [[0.0, 0.0, 9.0], [0.0, 0.0, 0.0]]})
    while not live.said and live.time < 8.0:
        live.advance(0.5, LONG)
    assert live.said.startswith("lost: ")
    assert live.advance(0.1, LONG)
    assert np.linalg.norm(live.q[:3]) < 0.1


def test_only_a_scenario_that_keeps_its_robot_up_can_live() -> None:
    """And only observers that need no future."""
    with pytest.raises(ScenarioError, match="no table control"):
        LiveFlight(load_scenario("paper"))
    with pytest.raises(ScenarioError, match=r"observer smoother corrects .* \['kalman'\] is its half"):
        LiveFlight(load_scenario("hover_closed_loop", ["observers.names=['smoother']"]))
    for names, hint in (("[]", "choose from"), ("['momentm']", "did you mean 'momentum'")):
        with pytest.raises(ScenarioError, match=hint):
            LiveFlight(load_scenario("hover_closed_loop", [f"observers.names={names}"]))
    live = LiveRobot("double_pendulum")
    for force in (float("nan"), "much", [1.0], None):
        with pytest.raises((TypeError, ValueError)):
            live.change({"force": force})
    for wrong in ({"observer": "smoother"}, {"gain": -1.0}, {"gain": float("nan")}):
        with pytest.raises(ObserverError, match="a gain up to 2000"):
            live.change(wrong)


@pytest.mark.parametrize("name", ["ur5", "solo12"])
def test_a_standing_robot_comes_to_rest_where_springs_weight_and_force_balance(name: str) -> None:
    """J^T f = K (q - q0) + g(q) - g(q0) by Pinocchio; the estimate is the force."""
    live = LiveRobot(name)
    live.change({"noise": 0.0})
    force = np.zeros((len(live.points), 3))
    force[0] = np.array([0.5, -0.3, 0.7]) * live.limit
    live.change({"force": force.tolist()})
    rows = live.advance(3.0, LONG)
    np.testing.assert_allclose(rows[-1].estimate, force, rtol=0.0, atol=0.003 * live.limit)
    model, data = live.model, live.model.createData()
    frame = model.getFrameId(live.points[0])
    J = pin.computeFrameJacobian(model, data, live.q, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)[:3]
    turned = live.spring * (live.q - live.posture)
    weight = [pin.computeGeneralizedGravity(model, data, q).copy() for q in (live.q, live.posture)]
    np.testing.assert_allclose(J.T @ force[0], turned + weight[0] - weight[1], rtol=0.0, atol=1e-3 * live.spring)


def test_what_stood_is_a_recording(tmp_path: Path) -> None:
    """With the force at its first point as the sensor; another observer goes on at once."""
    live = LiveRobot("ur5")
    live.advance(0.5, LONG)
    live.change({"force": [[0.0, 0.0, 10.0]], "observer": "momentum", "gain": 100.0})
    assert live.advance(0.5, LONG)
    found = live.result(lambda *_: None)
    assert list(found.estimates) == ["momentum"]
    assert found.metrics()["observers"]["momentum"]["tool0"]["Fz"]["r2"] > 0.95


def test_a_recording_lives_as_the_batch_has_it(tmp_path: Path) -> None:
    (tmp_path / "quadruped.urdf").write_text(urdf())
    values = copy.deepcopy(table_map(tmp_path / "quadruped.urdf"))
    values |= {"log": {"time": {"column": "t"}}, "check": {}}
    chosen, log = parse_map(values, "of the test"), tmp_path / "log.csv"
    table(walk(1.0)).to_csv(log, index=False, float_format="%.17g")
    live = LiveRecording(log, chosen, tmp_path)
    rows = live.advance(10.0, LONG)
    assert live.ended
    assert live.points == FEET
    name = live.observer
    whole = estimate(open_record(log, chosen, tmp_path), [name]).estimates[name]
    np.testing.assert_allclose([row.time for row in rows], whole.time[1:], rtol=0.0, atol=1e-9)
    batch = whole.components.reshape(-1, len(FEET), 3)
    np.testing.assert_allclose([row.estimate for row in rows], batch, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(live.q, walk(1.0).q[-1], atol=1e-6)


def test_a_recording_that_lacks_what_a_stream_waits_for_is_refused(tmp_path: Path) -> None:
    """Of a topic without efforts, which an estimate does without: it was played to its end without a force."""
    pytest.importorskip("rosbags")
    (tmp_path / "quadruped.urdf").write_text(urdf())
    bag(walk(0.3), tmp_path / "bag", unmeasured=walk(0.3).joints)
    chosen = parse_map(bag_map(tmp_path / "quadruped.urdf") | {"check": {}}, "of the test")
    assert "joints.effort" not in open_record(tmp_path / "bag", chosen, tmp_path).channels
    with pytest.raises(LogError, match=r"no /joint_states\.effort\.FL_HAA, which a stream waits for; `aerobat estima"):
        LiveRecording(tmp_path / "bag", chosen, tmp_path)
