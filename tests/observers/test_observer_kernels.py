"""The kernels of the observers equal their numpy twins on any model, in stream and batch."""

import numpy as np
import pytest
from support import observer_twins as twins
from support.kernel_cases import KINDS, MODELS, assert_equal, record, streamed

from aerobat_pin.observers import Observer
from aerobat_pin.observers.kernels.filters import FIRST_ORDER
from aerobat_pin.observers.rows import ROWS, Rows


@pytest.mark.parametrize("gain", ["one", "each"])
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
@pytest.mark.parametrize(
    ("name", "rows"), [("arm", "all"), ("humanoid", "all"), *(("aerobat, turned frame", rows) for rows in ROWS)]
)
def test_observers_equal_their_twins_in_stream_and_batch(
    name: str, rows: Rows, kind: type[Observer], gain: str
) -> None:
    """Random record, uneven stamps, one repeated; one gain for all or each its own; every choice of believed rows."""
    model, frames = MODELS[name]
    frames = frames if rows == "all" else frames[-1:]  # six or seven rows tell no more than one point apart
    size = 3 * len(frames) if kind.project_first else model.nv
    K = 300.0 if gain == "one" else np.random.default_rng(4).uniform(50.0, 2000.0, size)
    time, q, v, tau, known = record(model)
    twin = twins.ObserverTwin(kind.name, model, frames, K, rows)
    residual, points = twin.run(time, q, v, tau, known)
    near = 1e-12 if kind.kind == FIRST_ORDER else 1e-9  # the other twins go by expm and bisection
    observer = kind(model, frames, K, rows)
    estimate = observer.run(time, q, v, tau, known)
    assert_equal(estimate.residual, residual, near)
    assert_equal(estimate.force, points, near)
    stream = list(streamed(observer, time, q, v, tau, known))
    assert_equal([sample.residual for sample in stream], estimate.residual)
    assert_equal([sample.force for sample in stream], estimate.force)
