"""A robot that has changed since its calibration: noticed, named, corrected; `benchmarks/learnt_error.py` counts more.

One pushed flight of each kind, with exact sensors, and the calibration of two free flights.
"""

from __future__ import annotations

import numpy as np
import pytest
from support.changed_flights import CHANGES, CONTACTS, HIGH, LOW, PUSH, Verdict, corrected, estimated, learnt, somewhere

from aerobat_pin.estimation import Calibration


def seen(name: str, calibration: Calibration) -> Verdict:
    """Fly with a change, and estimate."""
    return estimated((*PUSH, *somewhere(1001), *CHANGES[name].settings), calibration, ["force_level"])


def test_a_robot_that_has_not_changed_is_not_called_changed() -> None:
    """At a speed, frequency and pitch between those of the calibration; all its pushes are found."""
    found = seen("none", learnt(LOW, HIGH))
    assert found.verdict == "unchanged"
    assert found.cause is None
    assert found.contacts[0] == CONTACTS


def test_a_slipped_encoder_is_noticed_named_and_corrected() -> None:
    """By 2 degrees, as `plant.crank_zero_deg` says; corrected, the forces are better and no push is lost."""
    found, better = (seen("encoder 2 deg", one) for one in (learnt(LOW, HIGH), corrected(learnt(LOW, HIGH))))
    assert found.verdict == "changed"
    assert found.cause is not None
    assert found.cause["name"] == "crank_zero"
    assert found.cause["estimate"] == pytest.approx((-2.0,), abs=0.5)
    assert np.max(better.error["force_level"]) < 0.6 * np.max(found.error["force_level"])
    assert better.contacts[0] == CONTACTS


def test_an_elbow_that_bends_is_noticed() -> None:
    """Its name is not asked for here: how often it is the right one stands in docs/learnt_error.md."""
    assert seen("elbow 5 rad/(N m)", learnt(LOW, HIGH)).verdict == "changed"
