"""The readable equations: lines of the documentation, without a compiler; they and the kernels equal their twins."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from support import observer_twins as twins
from support.kernel_cases import KINDS, MODELS, assert_equal, record, streamed

import aerobat_pin
from aerobat_pin.numerics import fields_of, new_state
from aerobat_pin.observers import OBSERVERS, Observer, Rows, Sampled
from aerobat_pin.observers.kernels.filters import FIRST_ORDER
from aerobat_pin.observers.kernels.observer_state import ObserverSizes, ObserverState
from aerobat_pin.observers.kernels.projection import project
from aerobat_pin.observers.momentum_equations import Equations, Projection, filter_means
from aerobat_pin.observers.rows import ROWS, BelievedRows

PACKAGE = Path(aerobat_pin.__file__).parent
METHOD = PACKAGE.parent / "docs" / "method.md"
FIRST_ESTIMATE = """
import sys
from pathlib import Path
import numba.core.dispatcher as dispatcher
import numpy as np
import pinocchio as pin

def refuse(self, signature):
    raise AssertionError(f"{self.py_func.__module__}.{self.py_func.__name__} is compiled")

dispatcher.Dispatcher.compile = refuse

from support.small_recordings import write_drone
from aerobat_pin import estimate, open_record
from aerobat_pin.observers import OBSERVERS, Expected, KalmanObserver

model = pin.buildSampleModelManipulator()
frame = model.frames[-1].name
expected = Expected(np.full(3, 10.0), np.full(model.nv, 0.1), np.zeros(model.nv), np.ones(model.nv))
time, q = np.arange(20) * 1e-3, np.array([pin.neutral(model)] * 20)
v, tau = np.full((20, model.nv), 0.1), np.zeros((19, model.nv))
for name, kind in OBSERVERS.items():
    if not issubclass(kind, KalmanObserver):
        for expects in (None, expected):
            assert kind(model, [frame], 100.0, "all", expects).run(time, q, v, tau).force.shape == (19, 1, 3)
write_drone(Path(sys.argv[1]))
for map_name in ("drone.toml", "drone_known.toml"):
    record = open_record(Path(sys.argv[1], "drone.csv"), Path(sys.argv[1], map_name))
    print(list(estimate(record, ["force_level"]).stored))
"""


def test_the_lines_shown_beside_the_equations_stand_in_the_reference() -> None:
    """Every Python line of docs/method.md is one of theirs, and each of its sampled equations shows one."""
    code = {line.strip() for line in (PACKAGE / "observers" / "momentum_equations.py").read_text().splitlines()}
    shown = re.findall(r"```python\n(.*?)```", METHOD.read_text(), re.S)
    lines = [line for block in shown for line in block.splitlines()]
    assert len(lines) >= 8
    assert [line for line in lines if line not in code] == []


def test_the_first_estimate_of_a_record_waits_for_no_compiler(tmp_path: Path) -> None:
    """With an empty kernel cache: every observer but the filters on an arm, and a drone's log by its map."""
    paths = os.pathsep.join([str(PACKAGE.parent), str(PACKAGE.parent / "tests")])
    there = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": paths}
    command = [sys.executable, "-c", FIRST_ESTIMATE, str(tmp_path)]
    made = subprocess.run(command, capture_output=True, text=True, env=there, check=False)
    assert made.returncode == 0, made.stderr[-2000:]
    assert made.stdout.count("force_level") == 2, made.stdout


def test_observers_of_the_same_forces_sample_a_record_once() -> None:
    """To the bit what each finds alone; other forces, or another robot, are sampled by themselves."""
    model, rng = pin.buildSampleModelManipulator(), np.random.default_rng(3)
    heavier = model.copy()
    heavier.inertias[1] = pin.Inertia.Random()
    time, v, tau = np.arange(20) * 1e-3, rng.standard_normal((20, model.nv)), rng.standard_normal((19, model.nv))
    q = np.array([pin.integrate(model, pin.neutral(model), 1e-3 * k * v[0]) for k in range(20)])
    sampled: list[Sampled] = []
    frames = [model.frames[-1].name], [model.frames[-1].name], [model.frames[5].name], [model.frames[-1].name]
    kinds = "momentum force_level momentum momentum".split()
    for kind, points, of in zip(kinds, frames, [model] * 3 + [heavier], strict=True):
        observer = OBSERVERS[kind](of, points, 100.0)
        together, alone = observer.run(time, q, v, tau, None, sampled), observer.run(time, q, v, tau)
        np.testing.assert_array_equal(together.components, alone.components)
        np.testing.assert_array_equal(together.residual, alone.residual)
    assert len(sampled) == 3


ALONE = """
import sys

OURS = {"aerobat_pin", "aerobat_description"}
ALLOWED = OURS | {"pinocchio", "coal", "numpy", "numba", "llvmlite", "lazy_loader"} | sys.stdlib_module_names
LOADED = {name.partition(".")[0] for name in sys.modules}  # by the interpreter's own start


class Nothing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] not in ALLOWED | LOADED:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


sys.meta_path.insert(0, Nothing())

import numpy as np
import pinocchio as pin

from aerobat_pin import observers

for name in observers.__all__:
    getattr(observers, name)
model = pin.buildSampleModelManipulator()
frame = model.addFrame(pin.Frame("tool", model.njoints - 1, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
data, time = model.createData(), np.arange(201) * 1e-3
q, v = np.tile(np.linspace(0.2, 0.7, model.nq), (len(time), 1)), np.zeros((len(time), model.nv))
pin.computeJointJacobians(model, data, q[0])
pin.updateFramePlacements(model, data)
J = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)[:3]
push = np.array([1.0, -2.0, 3.0])
tau = np.tile(pin.rnea(model, data, q[0], v[0], v[0]) - J.T @ push, (len(time) - 1, 1))
for name, kind in observers.OBSERVERS.items():
    observer = kind(model, ["tool"], 200.0)
    found = observer.run(time, q, v, tau).force[-1, 0]
    assert np.abs(found - push).max() < 0.01, (name, found)
    if name != "smoother":
        observer.reset(q[0], v[0])
        sample = observer.update(1e-3, q[1], v[1], tau[0])
        assert np.isfinite(sample.components).all(), name
print(*observers.OBSERVERS)
"""


def test_observers_need_pinocchio_numpy_and_numba_alone() -> None:
    """Each finds a push on an arm that stands, record and stream, where importing anything else fails."""
    done = subprocess.run([sys.executable, "-c", ALONE], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["momentum", "force_level", "second_order", "super_twisting", "kalman", "smoother"]


@pytest.mark.parametrize("gain", ["one", "each"])
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
@pytest.mark.parametrize(
    ("name", "rows"), [("arm", "all"), ("humanoid", "all"), *(("aerobat, turned frame", rows) for rows in ROWS)]
)
def test_a_stream_by_kernels_is_the_record_by_equations(name: str, rows: Rows, kind: type[Observer], gain: str) -> None:
    """Random record, uneven stamps, one repeated; one gain for all or each its own; every choice of believed rows."""
    model, frames = MODELS[name]
    frames = frames if rows == "all" else frames[-1:]  # six or seven rows tell no more than one point apart
    size = 3 * len(frames) if kind.project_first else model.nv
    K = 300.0 if gain == "one" else np.random.default_rng(4).uniform(50.0, 2000.0, size)
    observer = kind(model, frames, K, rows)
    estimate, stream = observer.run(*record(model)), list(streamed(observer, *record(model)))
    assert_equal([sample.residual for sample in stream], estimate.residual)
    assert_equal([sample.force for sample in stream], estimate.force)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_filters_solve_their_differential_equations(kind: type[Observer]) -> None:
    """Of means over uneven intervals: by the exponential, that of a matrix, and bisection of implicit Euler's step."""
    advance = (twins.first_order, twins.second_order, twins.super_twisting)[kind.kind]
    rng, state = np.random.default_rng(5), np.zeros((3, 2))
    dt, values, gains = rng.uniform(2e-4, 5e-3, 40), rng.normal(size=(40, 3)), rng.uniform(50.0, 2000.0, 3)
    rows = BelievedRows(MODELS["arm"][0], "all")
    filtered = filter_means(Equations(True, kind.kind, gains, np.zeros((0, 0)), 1.0, rows, None), dt, values)
    for step, row, found in zip(dt, values, filtered, strict=True):
        state = np.array([advance(*one) for one in zip(gains, [step] * 3, row, state, strict=True)])
        assert_equal(found, state[:, 0], 1e-12 if kind.kind == FIRST_ORDER else 1e-9)


@pytest.mark.parametrize("moving", [True, False])
@pytest.mark.parametrize(("points", "rows"), [*((n, "all") for n in (1, 2, 3, 5)), (1, "base"), (1, "base+power")])
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
