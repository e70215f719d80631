"""Whatever befalls a run, its folder holds the old result or the new one, all of it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from support.broken_runs import Bench, random_case


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    """Return the bench on which the cases are played."""
    with Bench(tmp_path_factory.mktemp("bench")) as made:
        yield made


@pytest.mark.parametrize("kind", ["replaced", "disk", "signals", "diverged"])
def test_random_cases(bench: Bench, kind: str) -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        case = random_case(rng, kind)
        import time

        t = time.time()
        wrong = case.play(bench, bench.new_folder())
        print(f"{case.name}: {time.time() - t:.2f}", wrong)
        assert wrong == [], case.name
