"""What is expected of forces and rows: the posterior equals its twin, its limits are known, and it knows its errors."""

import pickle
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from support import observer_twins as twins
from support.arm import arm, push, rest
from support.kernel_cases import KINDS, MODELS, assert_equal, record, streamed
from support.without_coriolis import links

from aerobat_pin.errors import ObserverError
from aerobat_pin.observers import (
    OBSERVERS,
    Application,
    Applications,
    Estimate,
    Expected,
    ForceLevelObserver,
    KalmanObserver,
    Observer,
    Rows,
    SmootherObserver,
    momentum_equations,
    with_record,
)
from aerobat_pin.observers import rows as believed_rows
from aerobat_pin.observers.expected import CHANGES_TRIED, SIZES_TRIED
from aerobat_pin.observers.kernels.filters import FIRST_ORDER
from aerobat_pin.observers.momentum_equations import Equations, posterior
from aerobat_pin.observers.rows import ROWS, BelievedRows


def some(model: pin.Model, components: int, force: float = 3.0) -> Expected:
    """Return expectations with a number of its own in every place."""
    rng = np.random.default_rng(7)
    sizes = force * rng.uniform(0.5, 2.0, components)
    error, stiction, rate = rng.uniform([[0.1], [0.0], [0.02]], [[2.0], [3.0], [0.5]], (3, model.nv))
    return Expected(sizes, error, stiction, rate, 1.3)


CASES = [("arm", "all"), ("humanoid", "all"), *(("aerobat", rows) for rows in ROWS)]


@pytest.mark.parametrize(("name", "rows"), CASES)
def test_the_posterior_equals_its_twin(name: str, rows: Rows) -> None:
    """Forces, deviations and k of random rows and Jacobians, over uneven intervals."""
    (model, frames), rng, count = MODELS[name], np.random.default_rng(6), 40
    expected, believed = some(model, 3 * len(frames)), BelievedRows(model, rows)
    J, (v, y) = rng.normal(size=(count, 3 * len(frames), model.nv)), rng.normal(size=(2, count, model.nv))
    dt, twin = rng.uniform(2e-4, 5e-3, count), twins.PosteriorTwin(expected, 300.0)
    equations = Equations(True, FIRST_ORDER, np.full(1, 300.0), np.zeros((0, 0)), 0.0, believed, expected)
    for J_k, y_k, v_k, step, *found in zip(J, y, v, dt, *posterior(equations, dt, J, v, y), strict=True):
        force = twin.estimate(J_k, twins.believed(model, rows, v_k), y_k, v_k, step)
        for ours, theirs in zip(found, (force, twin.deviation, twin.k), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-7, atol=1e-10 * np.max(np.abs(theirs)))


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
@pytest.mark.parametrize(("name", "rows"), CASES)
def test_a_stream_with_sizes_is_the_record(name: str, rows: Rows, kind: type[Observer]) -> None:
    """Forces and deviations of the last interval; no deviation is larger than what is expected."""
    model, frames = MODELS[name]
    expected, near = some(model, 3 * len(frames)), 1e-10 if kind.kind == FIRST_ORDER else 1e-9
    observer = kind(model, frames, 300.0, rows, expected)
    estimate, (*_, sample) = observer.run(*record(model)), streamed(observer, *record(model))
    assert np.all(estimate.standard_deviation <= expected.force * (1.0 + 1e-12))
    assert_equal(sample.components, estimate.components[-1], near)
    assert_equal(sample.standard_deviation, estimate.standard_deviation[-1], near)


def test_tolerances_of_the_projection_do_not_touch_the_posterior(monkeypatch: pytest.MonkeyPatch) -> None:
    """Force, deviation and k with other constants, and another lever arm: the same to 1e-12."""
    model, frames = MODELS["humanoid"]
    found = []
    for changed in (False, True):
        if changed:
            for name, value in (("DAMPING", 1e-3), ("SUSPECT", 0.0), ("UNSEEN_EIGENVALUE", 0.1)):
                monkeypatch.setattr(momentum_equations, name, value)
            monkeypatch.setattr(believed_rows, "MOMENT_ARM", 0.3)
        observer = ForceLevelObserver(model, frames, 300.0, expected=some(model, 3 * len(frames)))
        found.append(observer.run(*record(model)))
    for name in ("components", "standard_deviation", "doubt"):
        assert_equal(getattr(found[1], name), getattr(found[0], name), 1e-12)


def held(
    model: pin.Model, point: str | Application, q: np.ndarray, tau: np.ndarray, expected: Expected, rows: Rows = "all"
) -> Estimate:
    """Return the estimate of three seconds in which joint torques hold a robot still."""
    observer, count = ForceLevelObserver(model, [point], 100.0, rows, expected), 300
    record = np.tile(q, (count + 1, 1)), np.zeros((count + 1, model.nv)), np.tile(tau, (count, 1))
    return observer.run(np.arange(count + 1) / 100, *record)


def test_a_straight_arm_does_not_show_the_force_along_it_and_says_so() -> None:
    """Two links in a line, pushed across and along: one is found, the other is zero with the expected deviation."""
    model = pin.Model()
    place = pin.SE3.Identity()
    for name in ("shoulder", "elbow"):
        joint = model.addJoint(model.njoints - 1, pin.JointModelRY(), place, name)
        model.appendBodyToJoint(joint, pin.Inertia(1.0, np.array([0, 0, 0.2]), 0.01 * np.eye(3)), pin.SE3.Identity())
        place = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.4]))
    model.addFrame(pin.Frame("tip", 2, 0, place, pin.OP_FRAME))
    expected = Expected(np.full(3, 6.0), np.array([0.05, 0.05]), np.zeros(2), np.ones(2))
    q, force = np.zeros(2), np.array([2.0, 0.0, 3.0])
    found = held(model, "tip", q, rest(model, q) - push(model, "tip", q, force), expected)
    assert found.force[-1, 0, 0] == pytest.approx(2.0, abs=0.01)
    assert found.force[-1, 0, 2] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(found.standard_deviation[-1, 1:], 6.0)
    assert found.shown[-1].tolist() == [True, False, False]


def test_what_a_deviation_says_is_true_of_errors_as_stated() -> None:
    """Of 400 draws of row errors and forces, 95 % of the errors lie within two deviations (Gaussian, exact)."""
    model, frame = arm()
    rng, q = np.random.default_rng(0), pin.neutral(model) + 0.4
    expected = Expected(np.full(3, 2.0), np.array([0.4, 0.5, 0.2, 0.1, 0.1, 0.05]), np.zeros(6), np.ones(6))
    inside, draws = np.zeros(3), 400
    observer = ForceLevelObserver(model, [frame], 1e6, "all", expected)
    for _ in range(draws):
        force = 2.0 * rng.standard_normal(3)
        tau = rest(model, q) - push(model, frame, q, force) + expected.row_error * rng.standard_normal(6)
        observer.reset(q, np.zeros(6))
        sample = observer.update(0.01, q, np.zeros(6), tau)
        inside = inside + (np.abs(sample.components - force) < 2.0 * sample.standard_deviation)
    assert np.all((inside / draws > 0.92) & (inside / draws <= 0.995))  # k, never below 1, errs to the safe side


def test_a_push_beside_the_point_makes_k_large() -> None:
    """A moment that no force at the point explains: squared errors tens of times as large as stated."""
    model, frame = arm()
    q, expected = pin.neutral(model) + 0.4, Expected(np.full(3, 5.0), np.full(6, 0.05), np.zeros(6), np.ones(6))
    for lever, above in ((0.0, False), (0.25, True)):
        wrench = np.array([0.0, 4.0, 0.0, 0.0, 0.0, 4.0 * lever])
        found = held(model, frame, q, rest(model, q) - push(model, frame, q, wrench), expected)
        assert (found.doubt[-1] > 10.0) == above


def test_friction_at_rest_is_no_force() -> None:
    """An arm stands on its stiction: known, it explains all; unknown, the rows' errors are tens of times as large."""
    model, frame = arm()
    q, stiction = pin.neutral(model) + 0.4, np.array([1.0, 1.0, 0.5, 0.2, 0.2, 0.2])
    tau = rest(model, q) + 0.5 * stiction * np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0])
    for known in (stiction, np.zeros(6)):
        found = held(model, frame, q, tau, Expected(np.full(3, 20.0), np.full(6, 0.02), known, np.full(6, 0.05)))
        assert np.all(np.abs(found.components[-1]) < 2.0 * found.standard_deviation[-1])
        assert (found.doubt[-1] < 3.0) == bool(known.any())


def test_the_smallest_robots_keep_their_memory() -> None:
    """One joint and one component, and a base without joints under `base+power`: a push is found, and all is finite."""
    slide, body = links(pin.JointModelPX()), links(pin.JointModelFreeFlyer())
    along = Application("tip0", direction=(1.0, 0.0, 0.0))
    for model, point, rows, force in ((slide, along, "all", [3.0]), (body, "tip0", "base+power", [3.0, -1.0, 2.0])):
        nv, q = model.nv, pin.neutral(model)
        expected = Expected(np.full(len(force), 1e4), np.full(nv, 0.01), np.zeros(nv), np.ones(nv))
        tau = rest(model, q) - Applications(model, [point]).jacobian(q).T @ force
        found = held(model, point, q, tau, expected, rows)
        np.testing.assert_allclose(found.components[-1], force, atol=1e-5)
        assert np.all(np.isfinite(found.standard_deviation))


@pytest.mark.parametrize("kind", [KalmanObserver, SmootherObserver])
def test_one_joint_that_swings_states_what_it_knows_of_a_point(kind: type[KalmanObserver]) -> None:
    """The direction that it shows turns with it: each force may be in what it does not, and is known so far."""
    model, time = links(pin.JointModelRY()), np.arange(0.0, 3.0, 0.005)
    q, v, a = np.sin(2.0 * time), 2.0 * np.cos(2.0 * time), -4.0 * np.sin(2.0 * time)
    force, data = np.array([3.0, 0.0, -2.0]), model.createData()
    J = Applications(model, ["tip0"]).jacobian(q[:, None])
    tau = np.array([pin.rnea(model, data, *(np.array([x]) for x in each)) for each in zip(q, v, a, strict=True)])
    tau = (tau - np.einsum("mcv,c->mv", J, force))[:-1]
    expected = Expected(np.full(3, 5.0), np.full(1, 0.05), np.zeros(1), np.ones(1))
    found = kind(model, ["tip0"], expected=expected).run(time, q[:, None], v[:, None], tau)
    deviation = found.standard_deviation
    assert np.all(deviation <= expected.force * (1.0 + 1e-9))
    assert deviation[100:].min() < 3.0
    assert np.all(np.abs(found.components - force)[100:] < 2.0 * deviation[100:])


def test_what_cannot_be_expected_is_refused() -> None:
    """Sizes of another robot, zero errors, numbers that are none; a copy by pickle keeps what is expected."""
    model, frame = arm()
    good = Expected(np.ones(3), np.ones(6), np.zeros(6), np.ones(6))
    copy = pickle.loads(pickle.dumps(ForceLevelObserver(model, [frame], 100.0, "all", good)))
    np.testing.assert_array_equal(copy.expected.force, good.force)
    for bad in (
        Expected(np.ones(6), np.ones(6), np.zeros(6), np.ones(6)),
        Expected(np.ones(3), np.zeros(6), np.zeros(6), np.ones(6)),
        Expected(np.ones(3), np.ones(6), -np.ones(6), np.ones(6)),
        Expected(np.ones(3), np.ones(6), np.zeros(6), np.ones(6), 0.5),
    ):
        with pytest.raises(ObserverError, match="expected"):
            OBSERVERS["force_level"](model, [frame], 100.0, "all", bad)


@pytest.mark.parametrize("worse", [0.5, 3.0])
def test_forces_have_the_likeliest_of_the_sizes_that_are_tried(worse: float) -> None:
    """By the density of the rows with all covariances written out; errors smaller than stated, and larger."""
    # One size for all first, then a factor for each in turn, at the k that is found; sizes move each other here.
    model = pin.buildSampleModelManipulator()
    before, still = some(model, 3, force=0.1), np.zeros((40, model.nv))
    R = before.row_deviation(still) ** 2
    for seed in range(6):
        rng = np.random.default_rng(seed)
        J = 0.3 * rng.normal(size=(40, 3, model.nv)) + rng.normal(size=(40, 1, model.nv))
        force = rng.normal(size=(40, 3)) * 10.0 ** rng.uniform(-1.0, 1.5, size=3)
        y = np.einsum("mc,mcn->mn", force, J) + worse * rng.normal(size=R.shape) * R**0.5
        found = with_record(before, "all", model, still, y, J)

        def density(factors: Any, y: Any = y, J: Any = J, k: float = found.doubt) -> float:
            V = k * np.eye(model.nv) * R[:, None] + np.swapaxes(J, 1, 2) * (factors * before.force) ** 2 @ J
            white = np.linalg.solve(V, y[..., None])[..., 0]
            return -float(np.sum(np.linalg.slogdet(V)[1]) + np.sum(y * white))

        factors = max((np.full(3, size) for size in SIZES_TRIED), key=density)
        for axis in np.eye(3):
            tried = (np.maximum(factors * np.where(axis, change, 1.0), 1.0) for change in CHANGES_TRIED)
            factors = max(tried, key=density)
        assert found.force == pytest.approx(factors * before.force, rel=1e-12)
