"""A walking robot whose legs are misread: in another order, the other way round, or from another zero."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from support.further import further
from support.recorded import recorded
from support.walking_log import LEGS, table, table_map, urdf, walk

from aerobat_pin.estimation import estimate

PLACES = ("HAA", "HFE", "KFE")
JOINTS = [f"{leg}_{place}" for leg in LEGS for place in PLACES]
COLUMNS = ("pos", "vel", "tau")


@pytest.fixture(scope="module")
def noisy() -> pd.DataFrame:
    """Return a walk with friction of 20 % of the efforts and noise of all channels."""
    log, rng = table(walk()), np.random.default_rng(3)
    for joint in JOINTS:
        q, v, tau = (log[f"{joint}_{column}"] for column in COLUMNS)
        size = np.sqrt(np.mean(tau**2))
        log[f"{joint}_tau"] = tau + size * (0.2 * np.tanh(v / 0.05) + 0.01 * rng.standard_normal(len(log)))
        log[f"{joint}_pos"] = q + 1e-4 * rng.standard_normal(len(log))
        log[f"{joint}_vel"] = v + 5e-3 * rng.standard_normal(len(log))
    return log


def legs(*order: str) -> dict[str, str]:
    """Return whose columns each joint has, of legs in another order."""
    return dict(zip(JOINTS, (f"{leg}_{place}" for leg in order for place in PLACES), strict=True))


def of_legs(*names: str) -> list[str]:
    """Return joints at some places, of all legs."""
    return [f"{leg}_{name}" for leg in LEGS for name in names]


RIGHT = [f"{leg}_{place}" for leg in ("FR", "RR") for place in ("HFE", "KFE")]
WITHIN = {joint: joint.replace("HAA", "x").replace("HFE", "HAA").replace("x", "HFE") for joint in JOINTS}
BY_PLACE = dict(zip(JOINTS, (f"{leg}_{place}" for place in PLACES for leg in LEGS), strict=True))
MISTAKES = [  # whose columns joints have; joints that turn the other way; where joints stand, when they say 0 [deg]
    ("order", legs("FR", "FL", "RR", "RL"), [], {}),
    ("sense", {}, RIGHT, {}),
    ("zero", {}, [], dict.fromkeys(of_legs("KFE"), 90.0)),
    *further(
        ("order", legs("FR", "FL", "RL", "RR"), [], {}),
        ("order", legs("RL", "RR", "FL", "FR"), [], {}),
        ("order", legs("FR", "RR", "FL", "RL"), [], {}),
        ("order", BY_PLACE, [], {}),
        ("order", WITHIN, [], {}),
        ("sense", {}, ["RR_HFE"], {}),
        ("sense", {}, ["FR_HAA", "RR_HAA"], {}),
        ("sense", {}, of_legs("HFE"), {}),
        ("sense", {}, JOINTS, {}),
        ("zero", {}, [], {"FL_HFE": 45.0}),
        ("zero", {}, [], {"FL_HAA": 20.0}),
        ("zero", {}, [], dict.fromkeys(of_legs("HFE"), -10.0)),
        ("zero", {}, [], dict.fromkeys(of_legs("HFE"), 180.0)),
    ),
]


@pytest.mark.parametrize(("kind", "order", "senses", "zeros"), MISTAKES)
def test_a_misread_walk_says_how_to_read_it(
    noisy: pd.DataFrame, tmp_path: Path, kind: str, order: dict[str, str], senses: list[str], zeros: dict[str, float]
) -> None:
    """It names each joint that is misread, no other, and the key that mends it; read right, nothing is said."""
    log = noisy.copy()
    for joint, other in order.items():
        log[[f"{joint}_{column}" for column in COLUMNS]] = noisy[[f"{other}_{column}" for column in COLUMNS]]
    for joint in senses:
        log[[f"{joint}_{column}" for column in COLUMNS]] *= -1.0
    for joint, zero in zeros.items():
        log[f"{joint}_pos"] -= np.radians(zero)
    log.to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "quadruped.urdf").write_text(urdf())
    values = table_map(tmp_path / "quadruped.urdf")
    del values["check"]
    found = [one for one in estimate(recorded(tmp_path / "log.csv", values), ["force_level"]).findings if one.warns]
    [said] = [one for one in found if one.check != "mean force"]  # which wrong forces may show besides
    assert said.check == {"order": "swapped joints", "sense": "joint sense", "zero": "joint zero"}[kind]
    named = {joint for joint in JOINTS if joint in said.text.partition(", which leaves")[0]}
    assert named == {joint for joint, other in order.items() if joint != other} | {*senses, *zeros}
    keys = {"sense": dict.fromkeys(senses, -1.0), "zero": {joint: np.radians(zero) for joint, zero in zeros.items()}}
    for joint, value in keys.get(kind, {}).items():
        assert float(said.text.partition(f"{joint} = ")[2].partition(",")[0].rstrip("}")) == pytest.approx(
            value, abs=0.03
        )
