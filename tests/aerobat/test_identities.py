"""Identities of rigid-body dynamics on the shipped robots, each against something that does not share its code."""

# Mdot = C + C^T and p' = tau + J^T f + C^T v - g: Haddadin, De Luca & Albu-Schaeffer 2017.

import numpy as np
import pinocchio as pin
import pytest
from support.kernel_cases import random_motion
from support.observer_twins import remembered

from aerobat_description import MORPHOLOGIES
from aerobat_pin.aerobat import Aerobat, known_inputs, load_aerobat, prescribed_joint_dynamics
from aerobat_pin.experiments import Experiment
from aerobat_pin.flight import simulate
from aerobat_pin.forces import KnownInputs
from aerobat_pin.observers import external_forces, joint_wrench
from aerobat_pin.scenario import load_scenario

SEEDS = range(5)
FRAMES = ("base_link", "left_proximal", "left_distal", "left_force_point", "right_force_point", "right_linkage_J8")
LOCAL, ALIGNED, WORLD = (pin.ReferenceFrame.LOCAL, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED, pin.ReferenceFrame.WORLD)


@pytest.fixture(scope="module", params=MORPHOLOGIES)
def robot(request: pytest.FixtureRequest) -> Aerobat:
    return load_aerobat(request.param)


def richardson_rate_of_mass_matrix(model: pin.Model, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Central differences of M along exp(h v), extrapolated twice: error O(h^6)."""
    data = model.createData()

    def difference(h: float) -> np.ndarray:
        ahead, behind = (pin.crba(model, data, pin.integrate(model, q, s * h * v)).copy() for s in (1.0, -1.0))
        return (ahead - behind) / (2.0 * h)

    once = [(4.0 * difference(h / 2.0) - difference(h)) / 3.0 for h in (2e-3, 1e-3)]
    return (16.0 * once[1] - once[0]) / 15.0


@pytest.mark.parametrize("seed", SEEDS)
def test_rate_of_the_mass_matrix_is_coriolis_plus_its_transpose(robot: Aerobat, seed: int) -> None:
    """Paper, section III: Mdot = C + C^T, here in body twists; tolerance relative to the largest entry of Mdot."""
    q, v, _ = random_motion(seed)
    expected = richardson_rate_of_mass_matrix(robot.model, q, v)
    C = pin.computeCoriolisMatrix(robot.model, robot.model.createData(), q, v)
    scale = np.max(np.abs(expected))
    np.testing.assert_allclose(C + C.T, expected, atol=1e-9 * scale, rtol=0)
    assert np.max(np.abs(2.0 * C - expected)) > 0.1 * scale  # C alone is not half of it: the transpose matters


def momentum_and_drift(robot: Aerobat, inputs: KnownInputs) -> np.ndarray:
    """Return p and C^T v - g along a flight (2, n + 1, nv)."""
    rows = [remembered(robot.model, (), q, v)[:2] for q, v in zip(inputs.q, inputs.v, strict=True)]
    return np.moveaxis(rows, 1, 0)


def momentum_balance(log_dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fly 0.05 s of `paper`; return p (n + 1, nv), the logged mean forces (n, nv), and C^T v - g (n + 1, nv)."""
    scenario = load_scenario("paper", ["simulation.duration=0.05", f"simulation.dt={log_dt}", "air.warm_up_cycles=1"])
    log = simulate(scenario)
    robot = load_aerobat(scenario.robot.morphology, scenario.robot.changes)
    inputs = known_inputs(log, robot)
    forces = inputs.tau + inputs.known["thrusters"]
    forces = forces + sum(log.truth[name].values for name in ("aerodynamic", "added_mass", "unknown"))
    p, drift = momentum_and_drift(robot, inputs)
    return p, forces, drift


def test_momentum_obeys_its_equation_along_a_forced_flight() -> None:
    """Over each interval p' = tau + J^T f + C^T v - g: the trapezoid errs with dt^2/12 times its second derivative."""
    # Simpson's rule, its middle from the run at half the step, errs with dt^4: the rest is quadrature, no missing term.
    dt = 1e-3
    runs = {n: momentum_balance(dt / n) for n in (1, 2, 4)}
    trapezoid = {}
    for n, (p, forces, drift) in runs.items():
        miss = np.diff(p, axis=0) * n / dt - forces - 0.5 * (drift[1:] + drift[:-1])
        trapezoid[n] = np.max(np.abs(miss), axis=0)
    p, forces, drift = runs[2]
    simpson = (drift[:-2:2] + 4.0 * drift[1::2] + drift[2::2]) / 6.0
    miss = (p[2::2] - p[:-2:2]) / dt - 0.5 * (forces[::2] + forces[1::2]) - simpson
    scale = np.max(np.abs(forces), axis=0)
    assert np.max(trapezoid[1] / scale) < 1e-3
    np.testing.assert_allclose(trapezoid[2] / trapezoid[1], 0.25, atol=0.01)
    np.testing.assert_allclose(trapezoid[4] / trapezoid[2], 0.25, atol=0.01)
    assert np.max(np.abs(miss) / scale) < 1e-7


@pytest.mark.parametrize("reference", [LOCAL, ALIGNED, WORLD], ids=lambda reference: reference.name)
def test_external_forces_enter_inverse_dynamics_as_minus_J_T_f(robot: Aerobat, reference: pin.ReferenceFrame) -> None:
    """Derivation: rnea(fext) - rnea() = -J^T f, J in the frame of the wrench; linear, so all frames are pushed."""
    model, data, rng = robot.model, robot.model.createData(), np.random.default_rng(2)
    q, v, a = random_motion(0)
    pin.computeJointJacobians(model, data, q)
    moved, expected = [], np.zeros(model.nv)
    for frame in FRAMES:
        wrench = rng.standard_normal(6)
        J = pin.computeFrameJacobian(model, model.createData(), q, model.getFrameId(frame), reference)
        joint, force = joint_wrench(model, data, frame, wrench, reference)
        np.testing.assert_allclose(pin.getJointJacobian(model, data, joint, LOCAL).T @ force.vector, J.T @ wrench)
        moved.append((joint, force))
        expected += J.T @ wrench
    pushed = pin.rnea(model, data, q, v, a, external_forces(model, moved)).copy()
    np.testing.assert_allclose(pin.rnea(model, data, q, v, a) - pushed, expected, atol=1e-12, rtol=0)


@pytest.mark.parametrize("seed", SEEDS)
def test_prescribed_joint_dynamics_is_forward_dynamics_under_its_own_torque(robot: Aerobat, seed: int) -> None:
    """Featherstone's articulated-body algorithm, fed with the motor torque found, returns the same acceleration."""
    q, v, a = random_motion(seed)
    force = np.random.default_rng([4, seed]).standard_normal(10) * np.array([0.5] * 3 + [0.02] * 7)
    model, data = robot.model, robot.model.createData()
    M, nle = pin.crba(model, data, q).copy(), pin.nonLinearEffects(model, data, q, v).copy()
    acceleration, torque = prescribed_joint_dynamics(M, nle, force, a[6:])
    np.testing.assert_array_equal(acceleration[6:], a[6:])
    np.testing.assert_array_equal(torque[:6], 0.0)
    expected = pin.aba(model, data, q, v, force + torque)
    np.testing.assert_allclose(acceleration, expected, atol=1e-10 * np.max(np.abs(expected)), rtol=0)


def test_the_trapezoid_of_the_drift_is_good_to_a_thousandth_and_either_end_alone_is_not(paper: Experiment) -> None:
    """Of p' = u + u_f + C^T v - g; the rectangle rule, with C^T v - g of either end, errs by 6 % instead of 0.06 %."""
    inputs, truth = known_inputs(paper.log, paper.robot), paper.log.truth["unknown"].values[:1000]
    p, drift = momentum_and_drift(paper.robot, inputs)
    rest = np.diff(p, axis=0) / np.diff(inputs.time)[:, None] - inputs.tau - sum(inputs.known.values())
    signal = np.std(truth, axis=0)
    told = signal > 1e-3 * signal.max()

    def error(drift: np.ndarray) -> float:
        """Return the error of the mean external force, rms of the rows that have a signal, over the signal."""
        missed = ((rest - drift)[:1000] - truth)[:, told]
        return float(np.max(np.sqrt(np.mean(missed**2, axis=0)) / signal[told]))

    trapezoid = error(0.5 * (drift[1:] + drift[:-1]))
    assert trapezoid < 1e-3
    assert min(error(drift[:-1]), error(drift[1:])) > 50.0 * trapezoid
