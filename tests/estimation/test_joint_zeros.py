"""The zero of a joint that is off is named, with how far; nothing is said of good logs."""

from pathlib import Path

import pandas as pd
import pytest
from support.recorded import edited, recorded
from support.strange_arm import JOINTS, arm_map, nothing, pushed, write_log

from aerobat_pin.estimation import Result, estimate


def found(folder: Path, seed: int, rubs: float, joint: int = 0, turn: float = 0.0) -> Result:
    """Estimate a log of a UR5 of which a joint seems to stand farther by a turn [rad]."""
    write_log(folder / "log.csv", seed, pushed if seed % 2 else nothing, rubs=rubs)
    log = pd.read_csv(folder / "log.csv")
    log[f"q{joint}"] += turn
    log.to_csv(folder / "log.csv", index=False)
    return estimate(recorded(folder / "log.csv", edited(arm_map(["tool0"]), {"check": None})), ["force_level"])


@pytest.mark.parametrize(
    ("seed", "rubs", "joint", "turn"),
    [(7, 0.0, 1, 0.1), (13, 0.3, 1, 0.1), (14, 0.0, 2, -0.1), (99, 1.0, 2, -0.15), (19, 0.3, 2, 0.2)],
)
def test_a_zero_that_is_off_is_named(tmp_path: Path, seed: int, rubs: float, joint: int, turn: float) -> None:
    """Within a fifth, beside friction that nobody knows and a push of 20 N; the verdict doubts the record."""
    result = found(tmp_path, seed, rubs, joint, turn)
    [told] = [one for one in result.findings if one.check in {"joint zero", "mounting"}]
    assert told.text.startswith(JOINTS[joint])
    assert told.value == pytest.approx(-turn, rel=0.2)
    assert "joint zero" in result.verdict


@pytest.mark.parametrize(("seed", "rubs"), [(1, 0.3), (3, 1.0), (5, 0.0), (15, 1.0)])
def test_nothing_is_said_of_a_good_log(tmp_path: Path, seed: int, rubs: float) -> None:
    """Nor of a push elsewhere, as its joints stop all at once and stick; nor of efforts that hold as it stands."""
    told = {one.check for one in found(tmp_path, seed, rubs).findings if one.warns}
    assert not told & {"joint zero", "mounting", "push elsewhere", "held channel"}
