"""Some 60 bad inputs at all doors, drawn from a seed, and wrong arguments: no traceback, hang, result, wrong answer."""

from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest
from support.bad_inputs import CLASSES, RUNS, Doors, drawn_classes
from support.further import further
from support.wrong_values import EXCLUDED, WRONG, api_case, calls, fault, public_callables

from aerobat_pin import load_aerobat
from aerobat_pin.errors import ArgumentError, ShapeError
from aerobat_pin.numerics import guarded

COUNTS = dict.fromkeys(CLASSES, 5) | {2: 8, 13: 8}  # files and maps can be bad in most ways


@pytest.fixture(scope="module")
def doors(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Doors]:
    """Return the doors, with a flight, a run and a sweep behind them."""
    with Doors(tmp_path_factory.mktemp("doors"), patience=180.0) as made:  # the machine may be busy
        yield made


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("number", "times"),
    [*((number, 1) for number in CLASSES if number not in RUNS), *further(*((number, 4) for number in CLASSES))],
)
def test_bad_inputs_are_refused_or_told(number: int, times: int, doors: Doors) -> None:
    """Each with the fault that it found, if any; runs that are broken have tests/errors/test_files.py."""
    rng = np.random.default_rng(number)
    attempts = (doors.attempt(rng, number) for _ in range(times * COUNTS[number]))
    assert [(one.name, one.fault) for one in attempts if one.fault] == []


def test_every_class_is_tried_often_enough() -> None:
    """As evidence, and in a run of 2,000: each class at least 20 times."""
    assert 4 * sum(COUNTS.values()) >= 300
    assert 4 * min(COUNTS.values()) >= 20
    drawn = Counter(drawn_classes(np.random.default_rng(1), 2000))
    assert sum(drawn.values()) == 2000
    assert set(drawn) == set(CLASSES)
    assert min(drawn.values()) >= 20


@pytest.fixture(autouse=True)
def elsewhere(here: Path) -> None:
    """Write where a wrong path may lead."""


def test_every_public_function_has_its_wrong_calls() -> None:
    """Or stands on a list that says why not."""
    assert set(public_callables()) - {name.strip().partition(".")[0] for name in calls()} - EXCLUDED == set()
    assert [name for name, call in calls().items() if not call.arguments] == []


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("half", [0, *further(1)])
def test_every_wrong_argument_is_refused_by_name(half: int) -> None:
    """Each argument of each public function, with values of some twenty kinds that do not belong there."""
    arguments = [(name, argument) for name, call in calls().items() for argument in call.arguments]
    cases = [(*one, kind) for n, one in enumerate(arguments) for k, kind in enumerate(WRONG) if (n + k) % 2 == half]
    assert len(cases) > 2500
    assert [said for case in cases if (said := fault(*case))] == []


@pytest.mark.filterwarnings("ignore")
def test_a_drawn_case_is_one_of_them() -> None:
    """What the generator of bad inputs calls."""
    rng = np.random.default_rng(3)
    assert [said for _ in range(50) if (said := api_case(rng)[1])] == []


def test_arguments_reach_the_function_as_they_are_needed() -> None:
    """Lists as arrays, iterables as lists, numbers as floats; sizes that share a name must agree."""

    @guarded(size="positive", free="free")
    def call(a: Iterable[float], size: float, free: int = 0, *rest: int, **named: int) -> tuple[object, ...]:
        return a, size, free, rest, named

    found = call(iter([1.0]), np.float32(0.5), "x", 1, 2, c=3)  # type: ignore[arg-type]
    assert found == ([1.0], 0.5, "x", (1, 2), {"c": 3})
    with pytest.raises(ShapeError, match=r"size = -1\.0: a finite number, positive, was expected"):
        call([1.0], -1.0)
    with pytest.raises(ArgumentError, match=r"a = 'abc': a list was expected"):
        call("abc", 1.0)  # type: ignore[arg-type]
    robot = load_aerobat()
    with pytest.raises(ShapeError, match=r"theta_s has shape \(2,\): \(\) or \(3,\) was expected"):
        robot.configuration(np.tile(robot.q0[:7], (3, 1)), [0.1, 0.2], 0.0)
