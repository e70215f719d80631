"""A robot that has changed since its calibration: noticed, named, corrected; `benchmarks/learnt_error.py` counts more.

One pushed flight of each kind, with exact sensors, and the calibration of two free flights.
"""

from __future__ import annotations

import numpy as np
import pytest
from support.changed_flights import CHANGES, CONTACTS, HIGH, LOW, PUSH, Verdict, corrected, estimated, learnt, somewhere

from aerobat_pin.estimation import Calibration

SIZES = {"encoder 2 deg": ((-2.0,), 0.5), "elbow 5 rad/(N m)": ((0.0, 10.0), 5.0)}  # [deg], [rad/(N m)]


def seen(name: str, calibration: Calibration) -> Verdict:
    """Fly with a change, and estimate."""
    return estimated((*PUSH, *somewhere(1001), *CHANGES[name].settings), calibration, ["force_level"])


def test_a_robot_that_has_not_changed_is_not_called_changed() -> None:
    """At a speed, frequency and pitch between those of the calibration; all its pushes are found."""
    found = seen("none", learnt(LOW, HIGH))
    assert found.verdict == "unchanged"
    assert found.cause is None
    assert found.contacts[0] == CONTACTS


@pytest.mark.parametrize("name", SIZES)
def test_a_change_is_noticed_named_and_corrected(name: str) -> None:
    """An elastic elbow seems twice as soft, as it rings; corrected, the forces are better and no push is lost."""
    found, better = (seen(name, one) for one in (learnt(LOW, HIGH), corrected(learnt(LOW, HIGH))))
    assert found.verdict == "changed"
    assert found.cause is not None
    assert found.cause["name"] == CHANGES[name].cause
    expected, within = SIZES[name]
    assert found.cause["estimate"] == pytest.approx(expected, abs=within)
    assert np.max(better.error["force_level"]) < 0.6 * np.max(found.error["force_level"])
    assert better.contacts[0] == CONTACTS
