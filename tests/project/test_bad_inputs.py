"""Three hundred bad inputs at all doors, drawn from a seed: none costs a traceback, a hang, a result or a wrong answer.

`make reliability` tries thousands of the same kinds, and writes their counts to docs/reliability.md.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np
import pytest
from support.bad_inputs import CLASSES, Doors, drawn_classes

COUNTS = {1: 24, 2: 84, 3: 28, 4: 20, 5: 20, 6: 20, 7: 32, 8: 20, 9: 30, 10: 20, 11: 20}


@pytest.fixture(scope="module")
def doors(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Doors]:
    """Return the doors, with a flight, a run and a sweep behind them."""
    with Doors(tmp_path_factory.mktemp("doors"), patience=180.0) as made:  # the machine may be busy
        yield made


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("number", CLASSES)
def test_bad_inputs_are_refused_or_told(number: int, doors: Doors) -> None:
    """Each with the fault that it found, if any."""
    rng = np.random.default_rng(number)
    faults = [(one.name, one.fault) for one in (doors.attempt(rng, number) for _ in range(COUNTS[number])) if one.fault]
    assert faults == []


def test_every_class_is_tried_often_enough() -> None:
    """Here, and in a run of 2,000: each class at least 20 times."""
    assert sum(COUNTS.values()) >= 300
    assert min(COUNTS.values()) >= 20
    drawn = Counter(drawn_classes(np.random.default_rng(1), 2000))
    assert sum(drawn.values()) == 2000
    assert set(drawn) == set(CLASSES)
    assert min(drawn.values()) >= 20
