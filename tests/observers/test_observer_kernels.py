"""The kernels of the observers equal their numpy twins on any model, in stream and batch."""

import numpy as np
import pytest
from support import observer_twins as twins
from support.kernel_cases import KINDS, MODELS, assert_equal, record, streamed

from aerobat_pin.numerics import fields_of, new_state
from aerobat_pin.observers import Observer, Rows
from aerobat_pin.observers.kernels.filters import FIRST_ORDER
from aerobat_pin.observers.kernels.observer_state import ObserverSizes, ObserverState
from aerobat_pin.observers.kernels.projection import project
from aerobat_pin.observers.momentum_equations import Projection
from aerobat_pin.observers.rows import ROWS, BelievedRows


@pytest.mark.parametrize("gain", ["one", "each"])
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
@pytest.mark.parametrize(
    ("name", "rows"), [("arm", "all"), ("humanoid", "all"), *(("aerobat, turned frame", rows) for rows in ROWS)]
)
def test_observers_equal_twins_in_stream_and_batch(name: str, rows: Rows, kind: type[Observer], gain: str) -> None:
    """Random record, uneven stamps, one repeated; one gain for all or each its own; every choice of believed rows."""
    model, frames = MODELS[name]
    frames = frames if rows == "all" else frames[-1:]  # six or seven rows tell no more than one point apart
    size = 3 * len(frames) if kind.project_first else model.nv
    K = 300.0 if gain == "one" else np.random.default_rng(4).uniform(50.0, 2000.0, size)
    residual, points, _ = twins.observed(kind.name, (model, frames), K, record(model), rows)
    near = 1e-12 if kind.kind == FIRST_ORDER else 1e-9  # the other twins go by expm and bisection
    observer = kind(model, frames, K, rows)
    estimate = observer.run(*record(model))
    assert_equal(estimate.residual, residual, near)
    assert_equal(estimate.force, points, near)
    stream = list(streamed(observer, *record(model)))
    assert_equal([sample.residual for sample in stream], estimate.residual)
    assert_equal([sample.force for sample in stream], estimate.force)


@pytest.mark.parametrize("moving", [True, False])
@pytest.mark.parametrize(("points", "rows"), [(1, "all"), (2, "all"), (3, "all"), (1, "base"), (1, "base+power")])
def test_the_projection_is_weighted_damped_least_squares(points: int, rows: Rows, moving: bool) -> None:
    """By Cholesky against an orthogonal factorisation; at rest the row of the joints' power is empty, six remain."""
    model = MODELS["humanoid"][0]
    rng, nv = np.random.default_rng(points), model.nv
    before, after = rng.standard_normal((2, 3 + 3 * points, nv)) * np.where(np.arange(nv) < 6, 1.0, 0.1)
    before[2], after[2] = moving * before[2], moving * after[2]
    phi, mean = rng.standard_normal(nv), 0.5 * (before + after)
    weight = np.diag(twins.believed(model, "all", mean[2]))
    none = ObserverSizes(**dict.fromkeys(ObserverSizes._fields, 0))
    sizes = none._replace(nv=nv, components=3 * points, filtered=nv, rows=ROWS.index(rows), believed=nv)
    memory = new_state(ObserverState, **sizes._asdict())
    observer, found = fields_of(memory, ObserverState), np.full(3 * points, np.nan)
    observer.weight[:], observer.jacobian[:] = weight, mean[3:]
    project(observer, before, after, phi, found)
    W = twins.believed(model, rows, mean[2])
    assert_equal(found, twins.project(mean[3:], W, phi))
    believed, one = BelievedRows(model, rows), np.newaxis
    projection = Projection.of(believed, mean[one, 3:], mean[2][one], after[one, 3:], after[2][one])
    assert_equal(projection.components(believed.of(phi[one], mean[2][one]))[0], twins.project(mean[3:], W, phi))
