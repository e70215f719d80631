"""The recursions of the joint smoother against dense least squares over a whole record, its rows against quotients."""

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat import load_aerobat
from aerobat_pin.aerobat.raw.channels import SensorSamples
from aerobat_pin.aerobat.raw.dynamics import LinearDynamics, wings_by_crank
from aerobat_pin.aerobat.raw.layout import POSE_ERROR, TWIST_ERROR, Layout
from aerobat_pin.aerobat.raw.nominal_motion import NominalMotion, wing_angles, wing_motion
from aerobat_pin.aerobat.raw.recursion import Filtered, SampleRows, Smoothed, filter_record, smooth_record
from aerobat_pin.aerobat.raw.rows import ROWS_BY_SENSOR, Sensed
from aerobat_pin.linkage import joint_series

MOVING = 15
STATES = MOVING + 5
FRESH = np.array([MOVING + 2, MOVING + 4], dtype=np.intp)


def random_record(rng: np.random.Generator, m: int, each: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, SampleRows]:
    """Return a random model of m intervals with samples at every knot: F, shift, noise, and the samples."""
    F = np.zeros((m, MOVING, STATES))
    F[:, :, :MOVING] = np.eye(MOVING)
    F += 0.1 * rng.standard_normal(F.shape)
    shift, noise = 0.1 * rng.standard_normal((m, MOVING)), rng.uniform(0.1, 1.0, (m, STATES))
    h, R = rng.standard_normal(((m + 1) * each, STATES)), rng.uniform(0.2, 1.0, (m + 1) * each)
    start = (each * np.arange(m + 2)).astype(np.intp)
    e = rng.standard_normal((m + 1) * each)
    return F, shift, noise, SampleRows(start, h, e, R, np.zeros(len(e), dtype=np.intp))


def filtered_from(x: np.ndarray, P: np.ndarray, m: int, samples: int) -> Filtered:
    """Return what a filter starts from and writes to."""
    n = len(x)
    return Filtered(x, P, np.empty((samples, n)), np.empty((samples, 2)), np.empty((m + 1, n)), np.empty((m + 1, n, n)))


def test_filter_and_smoother_solve_the_least_squares_of_the_whole_record() -> None:
    """States, covariances and likelihood of a random model are those of the joint Gaussian of all states."""
    rng = np.random.default_rng(4)
    n, m, each = STATES, 4, 3
    F, shift, noise, rows = random_record(rng, m, each)
    x0, root = 0.3 * rng.standard_normal(n), rng.standard_normal((n, n))
    P0 = root @ root.T / n + np.eye(n)

    # The joint Gaussian: mean and covariance of all states stacked, then conditioned on the samples.
    steps, moves = [], []
    for k in range(m):
        step = np.eye(n)
        step[:MOVING] = F[k]
        step[FRESH[0] : FRESH[1]] = 0.0
        steps.append(step)
        moves.append(np.pad(shift[k], (0, n - MOVING)))
    mean, blocks = [x0], {(0, 0): P0}
    for k in range(m):
        mean.append(steps[k] @ mean[k] + moves[k])
        for j in range(k + 1):
            blocks[k + 1, j] = steps[k] @ (blocks[k, j] if k >= j else blocks[j, k].T)
        blocks[k + 1, k + 1] = steps[k] @ blocks[k, k] @ steps[k].T + np.diag(noise[k])
    h, e, R = rows.h, rows.e, rows.R
    size = n * (m + 1)
    C, H = np.zeros((size, size)), np.zeros((len(e), size))
    for (i, j), block in blocks.items():
        C[i * n : (i + 1) * n, j * n : (j + 1) * n] = block
        C[j * n : (j + 1) * n, i * n : (i + 1) * n] = block.T
    for i in range(len(e)):
        k = i // each
        H[i, k * n : (k + 1) * n] = h[i]

    def conditioned(count: int) -> tuple[np.ndarray, np.ndarray, float]:
        G, miss = H[:count], e[:count] - H[:count] @ np.concatenate(mean)
        S = G @ C @ G.T + np.diag(R[:count])
        gain = np.linalg.solve(S, G @ C).T
        score = -0.5 * (miss @ np.linalg.solve(S, miss) + np.linalg.slogdet(S)[1])
        return np.concatenate(mean) + gain @ miss, C - gain @ G @ C, score

    made = filtered_from(x0.copy(), P0.copy(), m, len(e))
    score = filter_record(F, shift, noise, FRESH, rows, made)
    np.testing.assert_allclose(score, conditioned(len(e))[2], rtol=1e-10)
    for k in range(m + 1):
        best, spread, _ = conditioned(each * (k + 1))
        at = slice(k * n, (k + 1) * n)
        np.testing.assert_allclose(made.states[k], best[at], atol=1e-10)
        np.testing.assert_allclose(made.covariances[k], spread[at, at], atol=1e-10)
    block, knots = np.array([0, n], dtype=np.intp), (m + 1, n)
    smoothed = Smoothed(made, *map(np.empty, (knots, (m + 1, n, n), knots, knots, (m + 1, n, n))))
    smooth_record(F, FRESH, block, rows, smoothed)
    best, spread, _ = conditioned(len(e))
    np.testing.assert_allclose(smoothed.states.ravel(), best, atol=1e-10)
    for k in range(m + 1):
        at = slice(k * n, (k + 1) * n)
        np.testing.assert_allclose(smoothed.blocks[k], spread[at, at], atol=1e-10)


def test_the_adjoint_gives_the_derivative_of_the_likelihood_by_each_variance() -> None:
    """(sum l^2 - sum N) / 2 over the knots, against a difference quotient of the log-likelihood."""
    rng = np.random.default_rng(5)
    n, m, each = STATES, 6, 4
    F, shift, noise, rows = random_record(rng, m, each)
    made = filtered_from(np.empty(n), np.empty((n, n)), m, len(rows.e))

    def likelihood(added: np.ndarray) -> float:
        made.x[:], made.P[:] = 0.0, np.eye(n)
        return filter_record(F, shift, added, FRESH, rows, made)

    likelihood(noise)
    block, knots = np.array([MOVING, MOVING + 2], dtype=np.intp), (m + 1, n)
    smoothed = Smoothed(made, *map(np.empty, (knots, (0, 2, 2), knots, knots, (m + 1, 2, 2))))
    smooth_record(F, FRESH, block, rows, smoothed)
    for state in (0, MOVING - 1, MOVING, MOVING + 2, n - 1):
        step = np.zeros(n)
        step[state] = 1e-5
        slope = (likelihood(noise + step) - likelihood(noise - step)) / 2e-5
        found = 0.5 * np.sum(smoothed.pulls[1:, state] ** 2 - smoothed.informations[1:, state])
        np.testing.assert_allclose(found, slope, rtol=1e-5)
    np.testing.assert_allclose(smoothed.inside[:, 0, 0], smoothed.informations[:, MOVING])


SMALL = 1e-6


def test_an_accelerometer_feels_what_its_row_says() -> None:
    """Random motions of the body, changed a little at the middle of each interval; exact to second order."""
    rng, m, layout = np.random.default_rng(2), 3, Layout(2, mount=True)
    draw = rng.standard_normal
    none, time = np.zeros((m, 0)), np.arange(m + 1.0)
    A, push, x = draw((m, 6, layout.size)), SMALL * draw((m, 6)), SMALL * draw(layout.size)
    A[:, :, layout.mount_at] = 0.0  # where a sensor sits moves nothing
    ad_half, half, up = draw((m, 6, 6)), np.full((m, 1, 1), 0.5), draw((m, 3))
    here = LinearDynamics(none, none, A, push, none, none, none, half, ad_half, draw((m, 6)), draw((m, 6)), up)
    da = push + A @ x
    twist, pose = x[TWIST_ERROR] + 0.5 * da, ad_half @ x[POSE_ERROR] + 0.5 * x[TWIST_ERROR]
    there = here._replace(
        acceleration=0.0 * A,
        push=0.0 * push,
        middle_twist=here.middle_twist + twist,
        middle_acceleration=here.middle_acceleration + da,
        up=np.array([pin.exp3(-turn) @ one for turn, one in zip(pose[:, 3:], up, strict=True)]),
    )
    place, turn, mount = draw(3), pin.exp3(draw(3)), x[layout.mount_at]
    still = NominalMotion(time, none, none, none, none)
    k, middles, values = np.arange(m), time[:-1] + 0.5, draw((m, 3))

    def rows(d: LinearDynamics, place: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        sensor = SensorSamples("accelerometer", middles, values, 1.0, place, turn)
        h, e, _ = ROWS_BY_SENSOR["accelerometer"](Sensed(sensor, layout, still, d, "none", k, middles, values))
        return h, e

    h, before = rows(here, place, turn)
    _, after = rows(there, place + mount[:3], turn @ pin.exp3(mount[3:]))
    np.testing.assert_allclose(before - after, h @ x - x[layout.accelerometer_bias], atol=1e3 * SMALL**2)


def test_joints_move_with_the_crank_as_their_derivatives_say() -> None:
    """Angles, rates and accelerations of the joints by those of the crank: difference quotients, to 1e-5."""
    series, crank = joint_series(load_aerobat().linkage), np.array([[0.7], [40.0], [900.0]])

    def joints(crank: np.ndarray) -> np.ndarray:
        return np.stack(wing_motion(wing_angles(series, crank[0]), *crank[1:, :, None]), axis=1).ravel()

    found = wings_by_crank(wing_angles(series, crank[0]), *crank[1:, :, None])[0]
    for column, step in enumerate((1e-5, 1e-3, 1e-3)):
        ahead, behind = (crank + sign * step * np.eye(3)[:, column : column + 1] for sign in (1.0, -1.0))
        slope = (joints(ahead) - joints(behind)) / (2.0 * step)
        np.testing.assert_allclose(found[:, column], slope, atol=1e-5 * np.abs(slope).max())
