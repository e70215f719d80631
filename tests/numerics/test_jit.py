"""The kernels and Pinocchio's memory, copies, the compiler and its cache; states of kernels as tables of fields."""

import gc
import itertools
import os
import re
import subprocess
import sys
import weakref
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any, NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from support.kernel_cases import COPIES, KINDS, MODELS, PACKAGE, assert_equal, compiled_only, record

from aerobat_pin.flight import Plant
from aerobat_pin.flight.plant import kernels as plant_kernels
from aerobat_pin.numerics import (
    ELSEWHERE,
    Array,
    Integers,
    directory_size,
    fields_of,
    fill,
    inner,
    jit,
    kernel,
    new_state,
    pinocchio_views,
    small_matrices,
)
from aerobat_pin.observers import Observer, SmootherObserver
from aerobat_pin.observers.kalman import kernels as kalman_kernels
from aerobat_pin.observers.kalman import smoother_kernels


def views_of(data: pin.Data) -> list[np.ndarray]:
    """Return views of a data's placements oMi and liMi, and of its velocities."""
    placements = [pinocchio_views.placements(vector) for vector in (data.oMi, data.liMi)]
    return [*placements, pinocchio_views.motions(data.v)]


@pytest.mark.parametrize("name", MODELS)
def test_views_share_memory_with_pinocchio_and_change_with_it(name: str) -> None:
    model, _ = MODELS[name]
    data, rng = model.createData(), np.random.default_rng(6)
    oMi, liMi, v = views_of(data)
    M = pinocchio_views.doubles_at(int(pinocchio_views.addresses(data.M)[0]), model.nv, model.nv)
    assert np.shares_memory(M, data.M)
    for _ in range(2):
        q = pin.integrate(model, pin.neutral(model), rng.uniform(-0.5, 0.5, model.nv))
        pin.forwardKinematics(model, data, q, rng.standard_normal(model.nv))
        pin.crba(model, data, q)
        np.testing.assert_array_equal(M, data.M)
        for joint in range(1, model.njoints):
            assert np.shares_memory(v, data.v[joint].vector)
            np.testing.assert_array_equal(v[joint], data.v[joint].vector)
            for view, placement in ((oMi, data.oMi[joint]), (liMi, data.liMi[joint])):
                assert np.shares_memory(view, placement.rotation)
                assert np.shares_memory(view, placement.translation)
                np.testing.assert_array_equal(view[joint, :9].reshape(3, 3, order="F"), placement.rotation)
                np.testing.assert_array_equal(view[joint, 9:], placement.translation)


def test_a_matrix_by_address_is_read_by_columns() -> None:
    """As Eigen lays it out: C and the Jacobian are not symmetric."""
    matrix = np.asfortranarray(np.arange(6.0).reshape(2, 3))
    np.testing.assert_array_equal(pinocchio_views.doubles_at(int(pinocchio_views.addresses(matrix)[0]), 2, 3), matrix)


def test_views_that_do_not_follow_pinocchio_are_refused() -> None:
    """A copy, as after another memory layout, would go stale without a word."""
    model = MODELS["aerobat"][0]
    for copied in (None, 0, 1, 2):
        data = model.createData()
        views = views_of(data)
        if copied is None:
            pinocchio_views.check_views(model, data, *views)
            continue
        views[copied] = views[copied].copy()
        with pytest.raises(RuntimeError, match="do not lie in memory"):
            pinocchio_views.check_views(model, data, *views)


@pytest.mark.parametrize("way", COPIES)
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_a_copied_observer_estimates_like_a_new_one(kind: type[Observer], way: str) -> None:
    """Copied in mid-stream: it looks at data of its own, and neither disturbs the other."""
    model, frames = MODELS["aerobat"]
    time, q, v, tau, known = record(model)
    observer, expected = kind(model, frames, 400.0), kind(model, frames, 400.0).run(time, q, v, tau, known)
    observer.reset(q[0], v[0], time[0])
    copied = COPIES[way](observer)
    assert copied.data is not observer.data
    estimate = copied.run(time, q, v, tau, known)
    np.testing.assert_array_equal(estimate.residual, expected.residual)
    np.testing.assert_array_equal(estimate.force, expected.force)
    now = {channel: values[0] for channel, values in known.items()}
    assert_equal(observer.update(time[1], q[1], v[1], tau[0], now).residual, expected.residual[0])


@pytest.mark.parametrize("way", COPIES)
def test_a_copied_plant_flies_the_same_flight(way: str, paper_plant: Plant) -> None:
    """Its kernels look at the data that its Pinocchio calls fill, not at an array left behind by the copy."""
    held = np.zeros((2, len(paper_plant.forces), 5))
    expected = paper_plant.fly(5, 1e-3, held)
    copied = COPIES[way](paper_plant)
    assert copied.in_air.fields.results.M.ctypes.data == copied.data.M.ctypes.data != paper_plant.data.M.ctypes.data
    found = copied.fly(5, 1e-3, held)
    np.testing.assert_array_equal(found.q, expected.q)
    np.testing.assert_array_equal(found.v, expected.v)


INTERPRETED = """
import sys
import numba
import numpy as np
import pinocchio as pin
from aerobat_pin.observers import OBSERVERS
from aerobat_pin.scenario.scenario import load_scenario
from aerobat_pin.flight.simulate import simulate
from aerobat_pin.aerobat.flight_record import known_inputs

settings = ["simulation.duration=0.005", "air.warm_up_cycles=1", "air.strips=6"]
log = simulate(load_scenario("paper", settings))
found = {name: log.measured[name].values for name in ("q", "v", "motor_torque")}
found["force"], found["air"] = log.truth["force_W"].values, log.truth["air_state"].values
model = pin.buildSampleModelHumanoid()
model.addFrame(pin.Frame("point", model.njoints - 1, 0, pin.SE3.Random(), pin.FrameType.OP_FRAME))
model.frames[model.getFrameId("point")].placement = pin.SE3(np.eye(3), np.array([0.1, 0.2, 0.3]))
rng = np.random.default_rng(1)
q = np.array([pin.integrate(model, pin.neutral(model), step) for step in rng.uniform(-0.5, 0.5, (6, model.nv))])
v, tau = rng.uniform(-1.0, 1.0, (6, model.nv)), rng.uniform(-1.0, 1.0, (5, model.nv))
time = np.cumsum(rng.uniform(1e-3, 3e-3, 6))
for name, kind in OBSERVERS.items():
    observer = kind(model, ["point"], 400.0)
    estimate = observer.run(time, q, v, tau)
    found[name], found[name + "_residual"] = estimate.force, estimate.residual
    if name == "smoother":
        continue
    observer.reset(q[0], v[0], time[0])
    found[name + "_stream"] = np.array([observer.update(*now).force for now in zip(time[1:], q[1:], v[1:], tau)])
np.savez(sys.argv[1], compiled=not numba.config.DISABLE_JIT, **found)
"""


@compiled_only
def test_kernels_that_are_not_compiled_give_the_same_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """NUMBA_DISABLE_JIT=1, for debugging and coverage: a short flight and every observer, batch and stream."""
    command = [sys.executable, "-c", INTERPRETED, str(tmp_path / "interpreted.npz")]
    plainly = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(PACKAGE.parent)}
    done = subprocess.run(command, env=plainly, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    monkeypatch.setattr(sys, "argv", ["", str(tmp_path / "compiled.npz")])
    exec(INTERPRETED, {})
    compiled, interpreted = (dict(np.load(tmp_path / f"{name}.npz")) for name in ("compiled", "interpreted"))
    assert compiled.pop("compiled")
    assert not interpreted.pop("compiled")
    for name, expected in compiled.items():
        sensitive = name.startswith(("super_twisting", "kalman", "smoother"))  # roots and inverses of small differences
        assert_equal(interpreted[name], expected, 1e-9 if sensitive else 1e-12)


AFTER = """
import hashlib
import sys
import numba
import numpy as np
import pinocchio as pin
from aerobat_pin.observers import KalmanObserver
from aerobat_pin.observers.kalman import kernels
from aerobat_pin.aerobat.aerobat import FORCE_POINTS, load_aerobat

model, rng = load_aerobat().model, np.random.default_rng(1)
q = np.array([pin.integrate(model, pin.neutral(model), step) for step in rng.uniform(-0.5, 0.5, (50, model.nv))])
v, tau = rng.uniform(-1.0, 1.0, (50, model.nv)), rng.uniform(-1.0, 1.0, (49, model.nv))
observer = KalmanObserver(model, FORCE_POINTS, 400.0)
if sys.argv[1] == "compiled":
    ours = kernels.record_noisy_sample, kernels.filter_all
    kernels.record_noisy_sample, kernels.filter_all = (numba.njit(one.py_func) for one in ours)
    observer.run(np.arange(50) * 1e-3, q, v, tau)
    kernels.record_noisy_sample, kernels.filter_all = ours
print(hashlib.sha256(observer.run(np.arange(50) * 1e-3, q, v, tau).force.tobytes()).hexdigest())
"""


@compiled_only
def test_a_record_that_cannot_be_written_costs_no_compilation() -> None:
    """As xarray gives its times: the kernels would be compiled once more, for ten seconds."""
    model, frames = MODELS["aerobat"]
    time, q, v, tau, known = record(model)
    observer = SmootherObserver(model, frames, 400.0)
    expected = observer.run(time, q, v, tau, known)
    kernels = kalman_kernels.filter_all, smoother_kernels.smooth_all
    before = [len(one.signatures) for one in kernels]
    for one in (time, q, v, tau, *known.values()):
        one.setflags(write=False)
    np.testing.assert_array_equal(observer.run(time, q, v, tau, known).force, expected.force)
    assert [len(one.signatures) for one in kernels] == before


@compiled_only
def test_earlier_compiling_changes_nothing(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Other callers of the same kernels come first, and their copies of them are then everybody's: design note 4."""
    done = subprocess.run([sys.executable, "-c", AFTER, "compiled"], capture_output=True, text=True, check=True)
    monkeypatch.setattr(sys, "argv", ["", "nothing"])
    exec(AFTER, {})
    assert done.stdout == capsys.readouterr().out


def test_every_file_that_kernels_are_made_of_is_in_the_cache_stamp() -> None:
    """A file that is missing could change without outdating the kernels that its own are compiled into."""
    stamped = {name for name, _, _ in jit.sources_stamp()}
    mark = re.compile(r"^@(jit\.)?(kernel|inner|inlined)\b|: Annotated\[(Array|Integers), ", re.MULTILINE)
    made = [path for path in PACKAGE.rglob("*.py") if mark.search(path.read_text())]
    assert len(made) > 35
    assert {path.relative_to(PACKAGE).as_posix() for path in made} <= stamped
    assert {"numerics/jit.py", "observers/rows.py", "aerodynamics/lifting_line.py"} <= stamped  # for their constants
    assert {"records/record.py", "records/resample.py", "records/channels.py"} <= stamped  # whose door has them
    assert not any(name.startswith(("cli/", "visualization/", "experiments/")) for name in stamped)


@compiled_only
def test_a_change_in_any_kernel_file_changes_the_stamp(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each file counts, and the stamp is the one that numba compares."""
    assert small_matrices.solve_positive._cache._cache_file._source_stamp == jit.sources_stamp()
    assert plant_kernels.advance_stage._cache._cache_file._source_stamp == jit.sources_stamp()
    names = [name for name, _, _ in jit.sources_stamp()]
    for name in names:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("before\n@kernel\n")
    monkeypatch.setattr(jit, "__file__", str(tmp_path / "numerics" / "jit.py"))
    stamps = [jit.sources_stamp.__wrapped__()]
    for name in names:
        (tmp_path / name).write_text("after it was changed\n@kernel\n")
        stamps.append(jit.sources_stamp.__wrapped__())
    assert len(set(stamps)) == len(stamps)


def test_a_compilation_is_announced_once(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Not of a kernel that was called before: its cache, a file, is not even opened."""
    opened = []
    monkeypatch.setattr(jit, "is_compiled", lambda entry: bool(opened.append(entry)))
    for signatures, said in (([], 1), (["float64(float64)"], 0)):
        entry = SimpleNamespace(signatures=signatures)
        jit.announce_compilation(entry)
        assert capsys.readouterr().err.count("compiling the kernels: once per installation") == said
        assert opened.count(entry) == said


class Part(NamedTuple):
    """A table in a table."""

    table: Annotated[Integers, "k, 3"]
    block: Annotated[Array, "2, n, 2 * k"]


class Whole(NamedTuple):
    """Fields of all kinds."""

    n: int
    first: Annotated[Array, "n"]
    part: Part
    last: Annotated[Array, "empty, empty"]
    number: Annotated[Array, ""]
    linked: Annotated[Part, ELSEWHERE]
    given: Annotated[Array, "2, 3", ELSEWHERE]


@inner
def write_part(part: Part, number: int) -> None:
    """Write a table that is a part of another, or lies elsewhere."""
    part.table[:] = number
    part.block[:] = float(number)


@kernel
def write_all(memory: Array) -> float:
    """Write every field, and return what one of them held."""
    whole = fields_of(memory, Whole)
    before = whole.first[0]
    whole.first[:] = 1.0
    write_part(whole.part, 2)
    whole.last[:] = 4.0
    whole.number[()] = whole.n
    write_part(whole.linked, 5)
    whole.given[1, 2] = 6.0
    return float(before)


def made(n: int = 4, k: int = 2, empty: int = 3) -> tuple[Array, Array, Array]:
    """Return a state, and the state and the array that it looks at."""
    linked, given = new_state(Part, n=1, k=1), np.zeros((2, 3))
    return new_state(Whole, n=n, k=k, empty=empty, linked=linked, given=given), linked, given


@pytest.mark.parametrize("empty", [0, 3])
def test_fields_lie_one_behind_the_other_and_fill_the_state(empty: int) -> None:
    """No gap, no overlap, nothing over the end; a kernel sees what Python sees."""
    memory, linked, given = made(empty=empty)
    whole = fields_of(memory, Whole)
    assert [field.shape for field in (whole.first, *whole.part, whole.last)] == [(4,), (2, 3), (2, 4, 4), (empty,) * 2]
    own = [field for field in (whole.first, *whole.part, whole.last, whole.number) if field.size]
    spans = [(field.ctypes.data, field.nbytes) for field in own]
    assert spans[0][0] == memory.ctypes.data + 8 * directory_size(Whole)
    assert all(start + size == after for (start, size), (after, _) in itertools.pairwise(spans))
    assert sum(spans[-1]) == memory.ctypes.data + memory.nbytes
    assert not any(field.any() for field in own)
    whole.first[0] = 7.0
    assert write_all(memory) == 7.0
    for field, number in zip((whole.first, *whole.part, whole.last), (1, 2, 2, 4), strict=True):
        np.testing.assert_array_equal(field, number)
    assert whole.n == whole.number == 4
    np.testing.assert_array_equal(fields_of(linked, Part).block, np.full((2, 1, 2), 5.0))
    np.testing.assert_array_equal(whole.linked.table, [[5, 5, 5]])
    assert given[1, 2] == whole.given[1, 2] == 6.0


def test_a_copy_of_a_state_is_a_state_of_its_own() -> None:
    """As a record is filtered on a copy while a stream goes on; also in the rows of a table of states."""
    memory = new_state(Part, n=4, k=2)
    rows = np.tile(memory, (3, 1))
    fill(fields_of(rows[1], Part), (7, np.full((2, 4, 4), 3.0)))
    assert np.shares_memory(fields_of(rows[1], Part).block, rows)
    assert not any(field.any() for part in (memory, rows[0], rows[2]) for field in fields_of(part, Part))
    np.testing.assert_array_equal(fields_of(rows[1].copy(), Part).table, np.full((2, 3), 7))


def test_what_a_state_looks_at_lives_as_long_as_the_state_or_a_view_of_it() -> None:
    """Else a kernel would read and write what has been given back."""

    class Owner:
        """Holds an array as `pin.Data` does."""

        def __init__(self) -> None:
            self.values = np.zeros((2, 3))

    def looked_at() -> tuple[Any, list[weakref.ref[Any]]]:
        owner, linked = Owner(), new_state(Part, n=1, k=1)
        memory = new_state(Whole, n=4, k=2, empty=0, linked=linked, given=owner.values)
        return memory, [weakref.ref(owner.values), weakref.ref(linked), weakref.ref(memory)]

    memory, alive = looked_at()
    gc.collect()
    assert all(one() is not None for one in alive)
    write_all(memory)
    field = fields_of(memory, Whole).given
    del memory
    gc.collect()
    assert all(one() is not None for one in alive)
    assert field[1, 2] == 6.0
    del field
    gc.collect()
    assert not any(one() is not None for one in alive)


def test_only_doubles_in_a_row_can_lie_elsewhere() -> None:
    """A kernel would read anything else as if it were."""
    for wrong in (np.zeros((2, 3), int), np.zeros((4, 6))[::2, ::2]):
        with pytest.raises(RuntimeError, match="contiguous arrays of doubles"):
            new_state(Whole, n=1, k=1, empty=0, linked=new_state(Part, n=1, k=1), given=wrong)


def test_one_compilation_serves_all_sizes() -> None:
    """A compilation for each size would take seconds."""
    for sizes in ((1, 1, 1), (5, 0, 2), (9, 9, 9)):
        write_all(made(*sizes)[0])
    assert len(getattr(write_all, "signatures", [0])) == 1
