"""Cases that show once more what another shows: `make evidence` runs them, `make test` does not."""

from typing import Any

import pytest


def further(*cases: Any) -> list[Any]:
    """Return cases for `pytest.mark.parametrize`, a tuple for several arguments."""
    return [pytest.param(*(one if isinstance(one, tuple) else (one,)), marks=pytest.mark.evidence) for one in cases]
