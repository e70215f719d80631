"""A flight in single steps is the flight in one call; wrenches between them are known forces, sensors as in the log."""

import numpy as np
import pinocchio as pin
import pytest
from support.kernel_cases import plant_of

from aerobat_pin.aerobat import FlightLog, flown_robot
from aerobat_pin.errors import CrankError, ShapeError, SimulationError
from aerobat_pin.flight import Plant, Sensing, interval_means, simulate
from aerobat_pin.flight.plant.stepping import SteppedFlight
from aerobat_pin.flight.sensors import measure
from aerobat_pin.scenario import load_scenario

STEPS, DT = 60, 1e-3


def held_of(plant: Plant, count: int = STEPS) -> np.ndarray:
    return interval_means(plant.forces, np.arange(count + 1) * DT, plant.scenario.simulation.seed)


@pytest.mark.parametrize("settings", [(), ('crank.drive="motor"',), ("air.strips=40",)], ids=["", "motor", "substeps"])
def test_single_steps_make_the_same_flight_to_the_bit(settings: tuple[str, ...]) -> None:
    """Prescribed crank, crank with a motor, and several integration steps in an interval; twice with one plant."""
    plant = plant_of("paper", *settings)
    held = held_of(plant)
    whole = plant.fly(STEPS, DT, held)
    for _ in range(2):
        samples = [plant.start(held, DT), *(plant.step() for _ in range(STEPS))]
        made = plant.flight.trajectory()
        for name in ("q", "v", "air", "crank_angle", "crank_rate", "loads"):
            np.testing.assert_array_equal(getattr(made, name), getattr(whole, name), strict=True)
        for one, other in zip(made.forces, whole.forces, strict=True):
            np.testing.assert_array_equal(one, other, strict=True)
        np.testing.assert_array_equal([v for _, v in samples], whole.v)
        np.testing.assert_allclose([q for q, _ in samples], whole.q, rtol=0.0, atol=1e-12)


def test_who_writes_into_what_a_step_returns_does_not_move_the_robot() -> None:
    """As one that takes off where the flight began, or turns a quaternion's sign."""
    plant, ends = plant_of("paper"), []
    for moved in (0.0, 1.0):
        for q, v in (plant.start(held_of(plant), DT), plant.step(), plant.as_measured()[:2]):
            q += moved
            v += moved
        ends.append(np.concatenate(plant.step()))
    np.testing.assert_array_equal(*ends)


def test_a_wrench_on_the_body_is_a_known_force_and_replaces_the_hold() -> None:
    """Its mean stands in the log's thruster channel, and the body accelerates as M and nle say."""
    plant = plant_of("paper")
    plant.start(held_of(plant), DT)
    wrench = np.array([0.01, -0.02, 0.9, 1e-3, 2e-3, -3e-3])
    plant.step(wrench)
    plant.step()
    flown = plant.flight.trajectory()
    np.testing.assert_allclose(flown.forces.thrusters[:, :6], [wrench, wrench], rtol=0.0, atol=1e-15)
    assert not np.any(flown.forces.thrusters[:, 6:])
    plant.start(held_of(plant), DT)
    plant.step()
    before = plant.flight.trajectory().forces.thrusters[0, :6]
    assert np.linalg.norm(before - wrench) > 0.1  # a new flight begins with the hold


def test_an_impulse_by_a_command_changes_the_momentum_by_as_much() -> None:
    """World momentum with and without a push of 50 N over one step of 0.1 ms, when nothing else can change much."""
    plant = plant_of("paper_open_loop", "simulation.dt=1e-4")
    change, wrench = [], np.array([0.0, 50.0, 0.0, 0.0, 0.0, 0.0])
    for push in (np.zeros(6), wrench):
        plant.start(np.zeros((2, len(plant.forces), 1)), 1e-4)
        q, v = plant.step(push)
        data = plant.model.createData()
        change.append(pin.computeCentroidalMomentum(plant.model, data, q, v).linear)
    impulse = pin.Quaternion(plant.initial.placement[3:]).matrix() @ wrench[:3] * 1e-4
    # Air on the moving body and the added mass of the wings take a part of it.
    np.testing.assert_allclose(change[1] - change[0], impulse, rtol=0.0, atol=0.05 * 50e-4)


@pytest.mark.parametrize("elastic", [(), ("plant.elbow.stiffness=0.2", "plant.elbow.damping=2e-4")])
def test_an_endless_flight_goes_on_in_the_same_memory(elastic: tuple[str, ...]) -> None:
    """Windows of 20 steps give the flight of 60, deflections pass on too; without `endless` the flight ends."""
    plant = plant_of("paper_open_loop", "unknown_force=[]", *elastic)
    whole = plant.fly(STEPS, DT, held_of(plant))
    plant.start(held_of(plant, 20), DT, endless=True)
    samples = np.array([plant.step()[0] for _ in range(STEPS)])
    np.testing.assert_allclose(samples, whole.q[1:], rtol=0.0, atol=1e-12)
    plant.start(held_of(plant, 2), DT)
    plant.step()
    plant.step()
    with pytest.raises(SimulationError, match="the flight has ended after 2 steps"):
        plant.step()


def test_a_crank_may_have_turned_two_thousand_times() -> None:
    """12,571 rad, as after seven minutes of flapping, are no divergence; and rows never flown are not returned."""
    flights = []
    for turns in (0, 2000):
        plant = plant_of("paper", 'crank.drive="motor"', f"crank.start_deg={270 + 360 * turns}")
        flights.append(plant.fly(STEPS, DT, held_of(plant)))
    np.testing.assert_allclose(flights[1].q, flights[0].q, rtol=0.0, atol=1e-9)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(SteppedFlight, "is_hopeless", True)
        assert len(plant.fly(STEPS, DT, held_of(plant)).q) == 2


def test_a_motor_on_the_crank_follows_a_commanded_rate() -> None:
    """The crank is a second, slow actuator: after 0.4 s it turns within 3 % of the new rate on average."""
    plant = plant_of("paper", 'crank.drive="motor"', "crank.motor.start_frequency=4")
    plant.start(held_of(plant, 700), DT)
    for k in range(700):
        plant.step(crank_rate=2.0 * np.pi * 3.0 if k == 0 else None)
    rate = plant.flight.trajectory().crank_rate
    assert rate[0] == pytest.approx(2.0 * np.pi * 4.0)
    assert np.mean(rate[-333:]) == pytest.approx(2.0 * np.pi * 3.0, rel=0.03)


def test_steps_that_cannot_be_flown_are_refused_in_a_line() -> None:
    """Before `start`, with a wrong wrench, with a crank that no motor turns; one that diverges keeps the flight."""
    plant = plant_of("paper")
    with pytest.raises(SimulationError, match=r"start\(\) must come before"):
        plant.step()
    plant.start()
    with pytest.raises(ShapeError, match="command"):
        plant.step(np.zeros(5))
    with pytest.raises(CrankError, match="no motor turns this crank"):
        plant.step(crank_rate=1.0)
    plant.step()
    tearing = np.array([1e4, 0.0, 0.0, 0.0, 0.0, 0.0])
    with pytest.raises(SimulationError, match="the flight diverged at t = ") as raised:
        all(plant.step(tearing) for _ in range(100))
    assert raised.value.kept is not None


PERFECT = []
NOISY = ["sensors.gyro.noise=0.003", "sensors.attitude.noise=0.003", "sensors.velocity.walk=0.1"]
POOR = [
    *("sensors.position.rate=90", "sensors.position.delay=0.012", "sensors.position.dropout=0.4"),
    *("sensors.attitude.quantum=0.01", "sensors.attitude.dropout=0.2", "sensors.gyro.bias=[0.1, 0.2, 0.3]"),
    *("sensors.velocity.rate=250", "sensors.velocity.delay=0.03", "sensors.joint_angle.noise=0.01"),
    *("sensors.joint_rate.dropout=0.5", "sensors.crank_angle.noise=0.02", "sensors.crank_angle.delay=0.004"),
]


@pytest.mark.parametrize("settings", [PERFECT, NOISY, POOR], ids=["perfect", "noisy", "poor"])
def test_a_controller_sees_to_the_bit_what_the_log_shows(settings: list[str]) -> None:
    """Noise, walk, bias, quantum, rate, delay and dropout, at all samples of a flight of 0.15 s."""
    scenario = load_scenario("paper", ["simulation.duration=0.15", "simulation.seed=7", *settings])
    robot = flown_robot(scenario)
    exact = simulate(scenario.model_copy(update={"sensors": load_scenario("paper").sensors}), robot=robot)
    log = measure(exact, robot, scenario.sensors, 7)
    sensing = Sensing(robot, scenario.sensors, exact.time, 7)
    q, v = exact.measured["q"].values, exact.measured["v"].values
    crank, seen, turned = exact.measured["crank_angle"].values, [], []
    for k in range(len(q)):
        seen.append(sensing.read(k, q[k], v[k]))
        turned.append(sensing.crank(k, crank[k]))
    np.testing.assert_array_equal(turned, log.measured["crank_angle"].values)
    np.testing.assert_array_equal([one for one, _ in seen], log.measured["q"].values)
    np.testing.assert_array_equal([one for _, one in seen], log.measured["v"].values)
    assert (np.max(np.abs(log.measured["q"].values - q)) > 1e-3) == bool(settings)


def test_errors_are_drawn_anew_after_the_last_time() -> None:
    """The window of 50 samples repeats its times, not its noise."""
    scenario = load_scenario("paper", NOISY)
    robot = flown_robot(scenario)
    sensing = Sensing(robot, scenario.sensors, np.arange(50) * 1e-3, 1)
    v = np.zeros(robot.model.nv)
    seen = np.array([sensing.read(k, robot.q0, v)[1][3:6] for k in range(150)])
    assert np.std(seen) == pytest.approx(0.003, rel=0.1)
    assert abs(np.corrcoef(seen[:50].ravel(), seen[50:100].ravel())[0, 1]) < 0.3


def free(strips: int, dt: float, duration: float) -> FlightLog:
    """Fly `paper_open_loop` without unknown forces."""
    settings = [f"air.strips={strips}", f"simulation.dt={dt}", f"simulation.duration={duration}"]
    return simulate(load_scenario("paper_open_loop", settings).model_copy(update={"unknown_force": []}))


def test_number_of_steps_follows_the_fastest_mode_of_the_air() -> None:
    """Eigenvalues of A times the airspeed of the fastest strip: one step of 1 ms with 16 strips, several with 64."""
    counts = []
    for strips in (16, 64):
        plant = plant_of("paper_open_loop", f"air.strips={strips}")
        counts.append(plant.substeps(1e-3))
        modes = np.linalg.eigvals(plant.air.line.state_space(1.0).A)
        assert plant.air.line.fastest_mode == pytest.approx(np.abs(modes).max(), rel=1e-9)
    assert counts[0] == 1
    assert counts[1] >= 6


def test_a_divided_step_is_two_steps_of_half_the_length() -> None:
    """32 strips: two steps of 0.5 ms in an interval of 1 ms; same states, forces are means over both."""
    whole, halves = free(32, 1e-3, 0.1), free(32, 5e-4, 0.1)
    for name in ("q", "v"):
        np.testing.assert_allclose(whole.measured[name].values, halves.measured[name].values[::2], atol=1e-9)
    for name in ("aerodynamic", "added_mass"):
        pairs = halves.truth[name].values.reshape(-1, 2, whole.truth[name].shape[1])
        np.testing.assert_allclose(whole.truth[name].values, pairs.mean(axis=1), atol=1e-9)
