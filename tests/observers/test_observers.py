"""All observers on any Pinocchio model: sign, gain, start, and clear refusals."""

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from support.arm import arm, push, rest
from support.without_coriolis import links

from aerobat_pin import observers
from aerobat_pin.aerobat import load_aerobat
from aerobat_pin.errors import FrameNotFoundError, ObserverError, ShapeError

KINDS = [kind for kind in observers.OBSERVERS.values() if kind is not observers.SmootherObserver]  # of whole records


def by_gain(kind: type[observers.Observer]) -> dict[str, Any]:
    """Return the setting with which an observer follows its gain; the Kalman filter does not as it comes."""
    return {"force_walk": "gain"} if issubclass(kind, observers.KalmanObserver) else {}


@pytest.mark.parametrize("kind", KINDS)
def test_a_step_has_risen_by_63_percent_at_one_over_the_gain(kind: type[observers.Observer]) -> None:
    """The gain means the same to every observer: 1 - 1/e of a step of 1 N at t = 1/K, and all of it ten times later."""
    model, frame = arm()
    q, v = np.random.default_rng(1).uniform(-1.0, 1.0, model.nq), np.zeros(model.nv)
    observer = kind(model, [frame], gain=50.0, **by_gain(kind))
    observer.reset(q, v)
    tau = rest(model, q) - push(model, frame, q, np.array([0.0, 0.0, 1.0]))
    rise = np.array([observer.update((k + 1) * 1e-4, q, v, tau).force[0, 2] for k in range(2000)])
    assert rise[199] == pytest.approx(1.0 - np.exp(-1.0), abs=0.05)
    assert rise[-1] == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_a_gain_far_beyond_the_sample_rate_is_stable(kind: type[observers.Observer]) -> None:
    """K dt = 50, where an explicit filter explodes: a noisy force is followed, within its own size."""
    model, frame = arm()
    q, v, rng = np.random.default_rng(1).uniform(-1.0, 1.0, model.nq), np.zeros(model.nv), np.random.default_rng(2)
    observer = kind(model, [frame], gain=50_000.0, **by_gain(kind))
    observer.reset(q, v)
    for k in range(200):
        force = rng.uniform(-1.0, 1.0, 3)
        sample = observer.update((k + 1) * 1e-3, q, v, rest(model, q) - push(model, frame, q, force))
        assert np.abs(sample.force[0] - force).max() < 0.1


@pytest.mark.parametrize("kind", KINDS)
def test_no_force_and_a_reset_in_flight_give_zero_without_a_spike(kind: type[observers.Observer]) -> None:
    """p0 is the momentum of the first sample: a tumbling robot without forces reads zero from the first interval."""
    robot = load_aerobat("aerobat_light")
    model = robot.model.copy()
    model.gravity.linear = np.zeros(3)
    data = model.createData()
    rng = np.random.default_rng(3)
    q, v = robot.q0, rng.normal(size=model.nv)
    observer = kind(model, ["left_force_point", "right_force_point"], gain=1000.0)
    observer.reset(q, v)
    largest = 0.0
    for k in range(50):
        middle = v + 0.5e-4 * pin.aba(model, data, q, v, np.zeros(model.nv))
        a = pin.aba(model, data, pin.integrate(model, q, 0.5e-4 * v), middle, np.zeros(model.nv))
        q, v = pin.integrate(model, q, 1e-4 * middle), v + 1e-4 * a
        sample = observer.update((k + 1) * 1e-4, q, v, np.zeros(model.nv))
        largest = max(largest, float(np.abs(sample.force).max()))
        if k == 25:
            observer.reset(q, v, time=(k + 1) * 1e-4)
            assert observer.update((k + 1) * 1e-4, q, v, np.zeros(model.nv)).force.max() == 0.0
    spike = np.abs(pin.crba(model, data, q) @ v).max() / 1e-4  # what a missing p0 would show first
    assert spike > 100.0
    assert largest < 1e-6


def test_results_stay_as_they_are_where_a_caller_uses_arrays_again() -> None:
    """The times of an estimate, the wrench of a line of action."""
    model, frame = arm()
    time, q, wrench = np.array([5.0, 5.1]), pin.neutral(model), np.array([0.0, 0.0, 1.0, 0.0, 0.1, 0.0])
    tau = rest(model, q)[None]
    estimate = observers.MomentumObserver(model, [frame]).run(time, np.array([q, q]), np.zeros((2, model.nv)), tau)
    line = observers.locate(wrench, 1e-6 * np.eye(6))
    time -= 5.0
    wrench *= [0.0, 0.0, 1.0, 0.0, 5.0, 0.0]
    np.testing.assert_array_equal(estimate.time, [5.0, 5.1])
    np.testing.assert_allclose(line.point, [-0.1, 0.0, 0.0])


@pytest.mark.parametrize("kind", KINDS)
def test_what_does_not_fit_is_refused_by_name(kind: type[observers.Observer]) -> None:
    """Bad frames, gains, shapes, NaN and time each raise their own error."""
    model, frame = arm()
    q, v, tau = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
    with pytest.raises(FrameNotFoundError, match=r"no frame named 'tol'.*tool"):
        kind(model, ["tol"])
    with pytest.raises(ObserverError, match="different names"):
        kind(model, [frame, frame])
    for gain in (-1.0, 0.0, np.nan, np.inf):
        with pytest.raises(ObserverError, match="positive gain"):
            kind(model, [frame], gain=gain)
    with pytest.raises(ObserverError, match=r"one number, \d numbers or a matrix"):
        kind(model, [frame], gain=np.ones(17))
    observer = kind(model, [frame])
    with pytest.raises(ObserverError, match="reset"):
        observer.update(0.1, q, v, tau)
    observer.reset(q, v, time=1.0)
    with pytest.raises(ObserverError, match="must not decrease"):
        observer.update(0.9, q, v, tau)
    with pytest.raises(ObserverError, match="must not decrease"):
        observer.update(float("nan"), q, v, tau)
    with pytest.raises(ShapeError, match="tau holds NaN"):
        observer.update(1.1, q, v, np.full(model.nv, np.nan))
    with pytest.raises(ShapeError, match=r"wind has shape \(2,\)"):
        observer.update(1.1, q, v, tau, {"wind": np.zeros(2)})
    for wind in ([0.1], 0.1):
        with pytest.raises(ShapeError, match="wind has shape"):
            observer.update(1.1, q, v, tau, {"wind": np.array(wind)})
    with pytest.raises(ShapeError, match="q has shape"):
        observer.update(1.1, q[:-1], v, tau)
    with pytest.raises(ShapeError, match="q has 1 rows"):
        observer.run([0.0, 1.0], q[None], np.zeros((2, model.nv)), tau[None])
    with pytest.raises(ShapeError, match=r"tau holds NaN, infinity or a number beyond 1e\+15"):
        observer.update(1.1, q, v, np.full(model.nv, 1e307))
    strict = observer.update(1.1, q, v, rest(model, q))
    np.testing.assert_allclose(strict.force, 0.0, atol=1e-9)
    loose = observer.update(1.2, list(q), v.astype(np.float32), rest(model, q).tolist())
    np.testing.assert_allclose(loose.force, 0.0, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_a_configuration_that_is_none_is_refused_and_the_stream_stays_as_it_was(kind: type[observers.Observer]) -> None:
    """Pinocchio would take any quaternion for some attitude; one of float32 is good enough."""
    robot = load_aerobat()
    model, q, v = robot.model, robot.q0, np.zeros(robot.model.nv)
    observer, other = (kind(model, ["left_force_point"], 200.0) for _ in range(2))
    for one in (observer, other):
        one.reset(q.astype(np.float32), v)
    far, wrong = q.copy(), {rf"q\[3:7\] of sample {{}} has length {length}": q.copy() for length in (0, 2, 3)}
    far[2] = -1e9
    for length, turned in zip((0, 2, 3), wrong.values(), strict=True):
        turned[3:7] *= length
    for message, refused in {**wrong, r"q\[2\] of sample {} = -1e\+09: at most 1e\+06 m or rad": far}.items():
        with pytest.raises(ShapeError, match=message.format(0)):
            observer.update(1e-3, refused, v, v)
        with pytest.raises(ShapeError, match=message.format(1)):
            observer.run([0.0, 1.0], np.array([q, refused]), np.zeros((2, model.nv)), np.zeros((1, model.nv)))
    np.testing.assert_array_equal(observer.update(1e-3, q, v, v).force, other.update(1e-3, q, v, v).force)
    for refused in (*wrong.values(), far):
        with pytest.raises(ShapeError, match="of sample 0"):
            observer.reset(refused, v)


@pytest.mark.parametrize(("joint", "pair"), [(pin.JointModelPlanar(), "2:4"), (pin.JointModelRUBZ(), "0:2")])
def test_wheels_and_planar_joints_stream_too(joint: pin.JointModel, pair: str) -> None:
    """Their pairs of cosine and sine are unit vectors as well."""
    model = links(joint)
    observer, q, v = observers.MomentumObserver(model), pin.neutral(model), np.zeros(model.nv)
    observer.reset(q, v)
    observer.update(1e-3, q, v, v)
    for size in (0.0, 2.0):
        with pytest.raises(ShapeError, match=rf"q\[{pair}\] of sample 0 has length {size:g}"):
            observer.update(2e-3, q * size, v, v)


def test_without_frames_momentum_gives_the_residual_alone_and_force_level_refuses() -> None:
    """The generalised residual needs no point of application; a force does."""
    model, frame = arm()
    q, v = np.random.default_rng(1).uniform(-1.0, 1.0, model.nq), np.zeros(model.nv)
    bare, full = observers.MomentumObserver(model, gain=50.0), observers.MomentumObserver(model, [frame], gain=50.0)
    for observer in (bare, full):
        observer.reset(q, v)
    stream = [observer.update(1e-3, q, v, np.zeros(model.nv)) for observer in (bare, full)]
    batch = [one.run([0.0, 1e-3], np.array([q, q]), np.array([v, v]), np.zeros((1, model.nv))) for one in (bare, full)]
    for without, points in (stream, batch):
        assert without.force.shape[-2:] == (0, 3)
        np.testing.assert_array_equal(without.residual, points.residual)
    with pytest.raises(ObserverError, match="one frame or more"):
        observers.ForceLevelObserver(model)
