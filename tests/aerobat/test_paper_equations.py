"""The paper's flight dynamics, by Euler-Lagrange from T and U of section II-B, is what Pinocchio computes."""

# Exact to rounding: T is quadratic in the rates, and the complex step differentiates by the coordinates.

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import pytest
from support.kernel_cases import random_motion

from aerobat_pin.aerobat import Aerobat, load_aerobat

EXACT = 1e-12
G = 9.81
L3 = np.array([0.0, 0.0525, 0.0])  # elbow to the distal COM, in the distal frame [m]
LINKS = ("base_link", "left_proximal", "left_distal", "right_proximal", "right_distal")
MIRROR = np.array([1.0, -1.0, 1.0])
TIE = np.vstack([np.eye(8), np.eye(8)[6:]])  # the paper's eight velocities: both wings share q_s and q_e


@pytest.fixture(scope="module")
def robot() -> Aerobat:
    """Return the paper's robot: diagonal inertias, proximal COM at half of l2, distal COM at l3."""
    l2 = np.array(load_aerobat("aerobat").morphology.elbow)
    return load_aerobat(
        "aerobat",
        {
            "proximal": {"com": list(l2 / 2.0), "inertia": [3.2715e-7, 3.6326e-6, 3.9489e-6, 0.0, 0.0, 0.0]},
            "distal": {"com": list(L3), "inertia": [4.1145e-6, 8.64045e-6, 1.27045e-5, 0.0, 0.0, 0.0]},
            "wing": {"force_point": list(L3)},
        },
    )


@dataclass
class Bodies:
    """The five bodies in the order of `LINKS`: position and velocity of the COM in world, rotation, own omega."""

    p: np.ndarray
    p_dot: np.ndarray
    omega: np.ndarray


def skew(w: np.ndarray) -> np.ndarray:
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def rot_x(angle: complex) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def quaternion_matrix(xyzw: np.ndarray) -> np.ndarray:
    e, w = xyzw[:3], xyzw[3]
    return np.eye(3) + 2.0 * w * skew(e) + 2.0 * skew(e) @ skew(e)


def paper_bodies(
    robot: Aerobat,
    p_B: np.ndarray,
    R_B: np.ndarray,
    p_B_dot: np.ndarray,
    omega_B: np.ndarray,
    angles: np.ndarray,
    rates: np.ndarray,
) -> Bodies:
    """Write out positions and velocities; angles (4,): left s, e, right s, e. Right wing: R_x(-theta), y mirrored."""
    p, p_dot, omega = [p_B], [p_B_dot], [omega_B]
    l1, l2 = np.array(robot.morphology.shoulder), np.array(robot.morphology.elbow)
    for sign, mirror, (s, e), (s_dot, e_dot) in (
        (1.0, np.ones(3), angles[:2], rates[:2]),
        (-1.0, MIRROR, angles[2:], rates[2:]),
    ):
        R_P, R_D = rot_x(sign * s), rot_x(sign * e)
        omega_P_in_B = np.array([sign * s_dot, 0.0, 0.0]) + omega_B
        omega_P = R_P.T @ omega_P_in_B
        omega_D = R_D.T @ (np.array([sign * e_dot, 0.0, 0.0]) + omega_P)
        arm_P, arm_D = R_B @ R_P @ (mirror * l2) / 2.0, R_B @ R_P @ R_D @ (mirror * L3)
        # d/dt (R l) = R [omega]x l for every length vector, constant in its own frame.
        arm_P_dot = R_B @ R_P @ skew(omega_P) @ (mirror * l2) / 2.0
        arm_D_dot = R_B @ R_P @ R_D @ skew(omega_D) @ (mirror * L3)
        p_P = p_B + R_B @ (mirror * l1) + arm_P
        p_P_dot = p_B_dot + R_B @ skew(omega_B) @ (mirror * l1) + arm_P_dot
        p += [p_P, p_P + arm_P + arm_D]
        p_dot += [p_P_dot, p_P_dot + arm_P_dot + arm_D_dot]
        omega += [omega_P, omega_D]
    return Bodies(np.array(p), np.array(p_dot), np.array(omega))


def paper_energy(robot: Aerobat, bodies: Bodies) -> tuple[complex, complex]:
    """Return T and U: sums over the five bodies, inertias diagonal and constant."""
    parts = [getattr(robot.morphology, name) for name in ("body", "proximal", "distal", "proximal", "distal")]
    mass, inertia = np.array([part.mass for part in parts]), np.array([part.inertia[:3] for part in parts])
    T = 0.5 * (np.sum(mass[:, None] * bodies.p_dot**2) + np.sum(inertia * bodies.omega**2))
    return T, np.sum(mass * G * bodies.p[:, 2])


def lagrangian_parts(robot: Aerobat, R0: np.ndarray, x: np.ndarray, x_dot: np.ndarray) -> tuple[complex, complex]:
    """Return T and U in coordinates x = (p_B, phi, four angles), R_B = R0 exp([phi]x) to second order in phi."""
    phi = x[3:6]
    R_B = R0 @ (np.eye(3) + skew(phi) + 0.5 * skew(phi) @ skew(phi))
    omega_B = (np.eye(3) - 0.5 * skew(phi) + skew(phi) @ skew(phi) / 6.0) @ x_dot[3:6]
    return paper_energy(robot, paper_bodies(robot, x[:3], R_B, x_dot[:3], omega_B, x[6:], x_dot[6:]))


def euler_lagrange(robot: Aerobat, R0: np.ndarray, x: np.ndarray, x_dot: np.ndarray, x_ddot: np.ndarray) -> np.ndarray:
    """Return d/dt (dL/dx') - dL/dx (10,) at phi = 0, for L = T - U."""
    h, units = 1e-30, np.eye(len(x))

    def momentum(at: np.ndarray, rate: np.ndarray) -> np.ndarray:
        kinetic = [[lagrangian_parts(robot, R0, at, rate + s * e)[0] for s in (1.0, -1.0)] for e in units]
        return np.array([(plus - minus) / 2.0 for plus, minus in kinetic])

    slope = [np.subtract(*lagrangian_parts(robot, R0, x + 1j * h * e, x_dot)).imag / h for e in units]
    return momentum(x, x_ddot) + momentum(x + 1j * h * x_dot, x_dot).imag / h - np.array(slope)


def paper_bodies_of(robot: Aerobat, q: np.ndarray, v: np.ndarray) -> Bodies:
    R_B = quaternion_matrix(q[3:7])
    return paper_bodies(robot, q[:3], R_B, R_B @ v[:3], v[3:6], q[list(robot.idx_q)], v[list(robot.idx_v)])


def chart(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return R0, x, x', x'' at phi = 0, and P with v = P x'; omega' = phi'' there, and p_B'' = R (v' + omega x v)."""
    R = quaternion_matrix(q[3:7])
    P = np.eye(10)
    P[:3, :3] = R.T
    x = np.concatenate([q[:3], np.zeros(3), q[7:]])
    x_ddot = np.concatenate([R @ (a[:3] + np.cross(v[3:6], v[:3])), a[3:]])
    return R, x, np.concatenate([R @ v[:3], v[3:]]), x_ddot, P


@pytest.mark.parametrize("seed", range(20))
def test_positions_and_angular_velocities_written_out_equal_pinocchio(robot: Aerobat, seed: int) -> None:
    """Paper, section II-B: positions in world, angular velocities in own frames, theta_s for the printed theta_p."""
    q, v, _ = random_motion(seed)
    data, bodies = robot.model.createData(), paper_bodies_of(robot, q, v)
    pin.forwardKinematics(robot.model, data, q, v)
    for link, position, omega in zip(LINKS, bodies.p, bodies.omega, strict=True):
        joint = robot.model.frames[robot.model.getFrameId(link)].parentJoint
        np.testing.assert_allclose(data.oMi[joint].act(robot.model.inertias[joint].lever), position, atol=EXACT, rtol=0)
        np.testing.assert_allclose(data.v[joint].angular, omega, atol=EXACT, rtol=EXACT)


@pytest.mark.parametrize("seed", range(20))
def test_kinetic_and_potential_energy_written_out_equal_pinocchio(robot: Aerobat, seed: int) -> None:
    """Paper, section II-B, T and U, with the potential energy zero at z = 0."""
    q, v, _ = random_motion(seed)
    data = robot.model.createData()
    T, U = paper_energy(robot, paper_bodies_of(robot, q, v))
    assert pin.computeKineticEnergy(robot.model, data, q, v) == pytest.approx(T, rel=EXACT, abs=EXACT)
    assert pin.computePotentialEnergy(robot.model, data, q) == pytest.approx(U, rel=EXACT, abs=EXACT)


@pytest.mark.parametrize("seed", range(5))
def test_forward_dynamics_obeys_euler_lagrange_and_the_wrong_sign_of_h_does_not(robot: Aerobat, seed: int) -> None:
    """Paper, M_d a_d = h_d + u_a + u_m + u_f; its Euler-Lagrange equation judges the acceleration of `pin.aba`."""
    q, v, _ = random_motion(seed)
    u = np.random.default_rng([0, seed]).standard_normal(10) * np.array([0.5] * 3 + [0.02] * 7)
    data = robot.model.createData()
    nle = pin.nonLinearEffects(robot.model, data, q, v).copy()
    M = pin.crba(robot.model, data, q).copy()

    def missing(a: np.ndarray) -> float:
        R, x, x_dot, x_ddot, P = chart(q, v, a)
        return float(np.max(np.abs(euler_lagrange(robot, R, x, x_dot, x_ddot) - P.T @ u)))

    right = pin.aba(robot.model, data, q, v, u).copy()
    scale = max(1.0, np.max(np.abs(nle)))
    np.testing.assert_allclose(M @ right, -nle + u, atol=EXACT * scale, rtol=0)
    assert missing(right) < EXACT * scale
    assert missing(np.linalg.solve(M, nle + u)) > 0.1


@pytest.mark.parametrize("seed", range(3))
def test_the_tied_wings_of_the_paper_obey_the_projected_equations(robot: Aerobat, seed: int) -> None:
    """Paper, q_d = [p_B, q_s, q_e] with omega_B: eight velocities, v = S v8, M8 = S^T M S, h8 = S^T h."""
    q, v, _ = random_motion(seed)
    q[9:], v[8:] = q[7:9], v[6:8]
    rng = np.random.default_rng([1, seed])
    a = TIE @ (rng.standard_normal(8) * 10.0)
    R, x, x_dot, x_ddot, P = chart(q, v, a)
    left_side = TIE.T @ np.linalg.solve(P.T, euler_lagrange(robot, R, x, x_dot, x_ddot))
    data = robot.model.createData()
    M8 = TIE.T @ pin.crba(robot.model, data, q) @ TIE
    nle8 = TIE.T @ pin.nonLinearEffects(robot.model, data, q, v)
    expected = M8 @ a[:8] + nle8
    np.testing.assert_allclose(left_side, expected, atol=EXACT * max(1.0, np.max(np.abs(expected))), rtol=0)
