"""Factors of efforts and what an arm carries: found with deviations that hold, or refused with the reason."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from support.drone import MAP as DRONE
from support.drone import MASS, POWERS, flight
from support.further import further
from support.recorded import edited, recorded
from support.six_joints import six_map, swing

from aerobat_pin import calibrate, estimate
from aerobat_pin.errors import AerobatError
from aerobat_pin.estimation import Calibration, OnlineEstimator, calibration_bytes, read_calibration, stream_of
from aerobat_pin.experiments import check_record
from aerobat_pin.forces import FittedValues, taken_as_free, used_by_fits
from aerobat_pin.records import Record

FACTORS = np.array([0.85, 1.1, 0.95, 1.15, 0.9, 1.1])
LIGHT, HEAVY = (2.0, (0.03, 0.16, 0.05)), (3.0, (-0.05, 0.1, 0.02))  # [kg], [m]: what it carries
WRONG = 0.07  # of masses, and a third of it [m] of centres of the links, where they are wrong
ROTORS = 0.15  # [kg m2]: inertia of each rotor behind its gear, in no URDF
SOUGHT = {"frame": "tool"}
KNOWN = SOUGHT | {"mass": LIGHT[0], "com": list(LIGHT[1])}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with swings of an arm: alone, with two loads, `unloaded` of one with links unlike its URDF's."""
    folder = tmp_path_factory.mktemp("six")
    swing(folder / "alone.csv", 1, FACTORS)
    swing(folder / "unloaded.csv", 7)
    swing(folder / "light.csv", 2, FACTORS, LIGHT)
    swing(folder / "heavy.csv", 3, FACTORS, HEAVY)
    swing(folder / "light_wrong.csv", 4, FACTORS, LIGHT, WRONG)
    swing(folder / "heavy_wrong.csv", 5, FACTORS, HEAVY, WRONG)
    return folder


def opened(folder: Path, name: str, scale: bool = True, **tables: Any) -> Record:
    """Return a swing with the map of the arm and further tables."""
    values = six_map(**tables)
    values["joints"]["friction"]["scale"] = scale
    return recorded(folder / f"{name}.csv", values)


def kept(folder: Path, found: Calibration) -> Calibration:
    """Return a calibration as its file gives it back."""
    (folder / "kept.nc").write_bytes(calibration_bytes(found))
    return read_calibration(folder / "kept.nc")


def test_factors_of_five_joints_are_told_and_the_sixth_is_not(folder: Path) -> None:
    """The needed torque on the noisy effort makes factors too small; effort on what is needed gets them within 2 %."""
    found = calibrate([opened(folder, "alone")])
    np.testing.assert_allclose(found.fitted.scale[:5] / FACTORS[:5], 1.0, atol=0.02)
    assert found.fitted.scale[5] == 1.0
    [reason] = [fit.untold for fit in found.fitted.fits if fit.untold]
    assert reason.startswith("factor of wrist_3 cannot be told, it stays 1: its deviation would be 0.")
    assert any(reason in note for note in found.notes)
    assert any("only their ratio is seen" in note for note in found.notes)
    again = kept(folder, found)
    assert [str(fit) for fit in again.fitted.fits] == [str(fit) for fit in found.fitted.fits]
    result = estimate(opened(folder, "alone"), calibration=again)
    assert any(reason in str(finding) for finding in result.findings)
    with pytest.raises(AerobatError, match=r"payload\.fit: from and to \[s\], where nothing else touches"):
        estimate(opened(folder, "alone", payload=SOUGHT), calibration=again)


@pytest.mark.parametrize(("k", "joint", "factor", "told"), [(2, "elbow", 0.5, []), (1, "lift", -1.0, ["effort sign"])])
def test_a_fitted_factor_is_no_wrong_unit(k: int, joint: str, factor: float, told: list[str], folder: Path) -> None:
    """Of half an effort another factor than the fitted one was warned of, in each later estimate, too."""
    factors = FACTORS * np.where(np.arange(6) == k, factor, 1.0)
    swing(folder / "far.csv", 1, factors)
    found = calibrate([opened(folder, "far")])
    assert found.fitted.scale[k] == pytest.approx(factors[k], rel=0.02)
    assert [text.partition(":")[0] for text in found.warnings if f"effort of {joint}" in text] == told


@pytest.mark.parametrize("links", ["_wrong", *further("")])
def test_a_known_payload_tells_all_factors_and_they_tell_another_payload(folder: Path, links: str) -> None:
    """Within 2.5 deviations and 3 %, wrong links or not; the centre of the first payload may be sought beside them."""
    for payload in (KNOWN, SOUGHT | {"mass": LIGHT[0]}):
        found = kept(folder, calibrate([opened(folder, f"light{links}", payload=payload)]))
        off = np.abs(found.fitted.scale / FACTORS - 1.0)
        deviations = [fit.values["deviation of the factor"] for fit in found.fitted.fits[-6:]]
        assert np.all(off < 2.5 * np.array(deviations))
    result = estimate(opened(folder, f"heavy{links}", payload=SOUGHT, use={"free": [0, 45]}), calibration=found)
    values = next(fit.values for fit in result.forces.fits if fit.name == "payload at tool" and not fit.log)
    assert abs(values["mass"] - HEAVY[0]) < min(2.5 * values["deviation of mass"], 0.03 * HEAVY[0])
    for axis, true in zip("xyz", HEAVY[1], strict=True):
        assert abs(values[axis] - true) < 2.5 * values[f"deviation of {axis}"]
    own = result.forces.record.robot.own_model
    assert result.mass == pytest.approx(sum(own.inertias[k].mass for k in range(1, 7)) + values["mass"])


def test_a_stream_of_a_record_has_its_corrected_links(folder: Path) -> None:
    record = opened(folder, "light_wrong", payload=KNOWN)
    values = edited(six_map(payload=KNOWN), {"joints.friction.fit": [0, 30]})
    record = recorded(folder / "light_wrong.csv", values)
    whole, stream = estimate(record).estimates["force_level"], stream_of(record)
    rows = pd.read_csv(folder / "light_wrong.csv", nrows=300).to_dict("records")
    found = [[*one.components.values()] for row in rows for one in stream.push(row["t"], row)]
    np.testing.assert_allclose(found, whole.components[: len(found)], rtol=0.0, atol=1e-6)


def test_rotors_that_no_law_asks_for_leave_the_factors_right(folder: Path) -> None:
    """Their inertia moves with gravity's torque as joints swing: left out, it made factors 18 % too small."""
    swing(folder / "rotors.csv", 7, FACTORS, LIGHT, rotors=ROTORS)
    found = calibrate([opened(folder, "rotors", payload=KNOWN)])
    deviations = [fit.values["deviation of the factor"] for fit in found.fitted.fits[-6:]]
    assert np.all(np.abs(found.fitted.scale / FACTORS - 1.0) < 2.5 * np.array(deviations))


def test_a_payload_beside_friction_leaves_the_rest_to_tell_errors(folder: Path) -> None:
    """It is fitted where friction is; all that is free counted as used, and deviations were 2.3 times as large."""
    values = edited(six_map(payload=SOUGHT), {"joints.friction.fit": [0, 30], "use.free": [0, 45]})
    record = recorded(folder / "light.csv", values)
    used = used_by_fits(record, FittedValues(), record.start + np.array([10.0, 40.0, 50.0]))
    assert used.tolist() == [True, False, True]
    values = edited(values, {"joints.friction.scale": False, "payload.fit": [0, 20]})  # which went unheard
    with pytest.raises(AerobatError, match=r"payload\.fit = \[0\.0, 20\.0\]: the payload is sought with the friction"):
        estimate(recorded(folder / "light.csv", values))
    record = recorded(folder / "light.csv", edited(values, {"joints.friction.fit": None}))
    assert taken_as_free(record).map.joints.friction.fit == (0.0, 20.0)


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_known_gains_tell_a_payload_beside_friction(noise: float, folder: Path) -> None:
    """Within twice its deviation and 3 %, with noise of rates [rad/s], too; what the arm carried is not kept."""
    swing(folder / "right.csv", 6, payload=HEAVY)
    table, rng = pd.read_csv(folder / "right.csv"), np.random.default_rng(6)
    rates = [name for name in table if name.endswith("_v")]
    table[rates] += noise * rng.standard_normal((len(table), len(rates)))
    table.to_csv(folder / "right.csv", index=False)
    found = calibrate([opened(folder, "right", scale=False, payload=SOUGHT)])
    [values] = [fit.values for fit in found.fitted.fits if fit.name == "payload at tool"]
    assert abs(values["mass"] - HEAVY[0]) < min(2.0 * values["deviation of mass"], 0.03 * HEAVY[0])
    for axis, true in zip("xyz", HEAVY[1], strict=True):
        assert abs(values[axis] - true) < 2.0 * values[f"deviation of {axis}"]
    if noise > 0.0:
        return
    [lift] = [fit for fit in found.fitted.fits if fit.name == "friction of lift"]
    assert 5.0 < lift.before < 9.0  # what friction explains; 21 N m with what the payload does
    before, after = found.error_bar["tool.Fz"]
    assert after < 2.5
    assert not before < 5.0 * after  # NaN: without friction the rows err by so much that Fz is never seen
    free = estimate(opened(folder, "unloaded"), calibration=found)
    assert free.mass == pytest.approx(opened(folder, "unloaded").robot.mass)
    assert abs(free.estimates["force_level"].force[200:, 0, 2].mean()) < 1.0
    loaded, seeking = (opened(folder, "light", payload=one).map for one in (KNOWN, SOUGHT))
    online = OnlineEstimator(loaded, folder, calibration=found)
    assert online.robot.mass == pytest.approx(opened(folder, "unloaded").robot.mass + LIGHT[0])
    with pytest.raises(AerobatError, match="fits need a whole record"):
        OnlineEstimator(seeking, folder, calibration=found)


@pytest.mark.parametrize(
    ("name", "scale", "identify", "payload", "reason"),
    [
        ("light", True, (), SOUGHT, "only their ratio is seen; payload.mass was expected, or factors by --calibration"),
        ("light", False, ("mass",), SOUGHT, "the mass of all bodies, and a payload .* one of them was expected"),
        ("unloaded", False, (), SOUGHT, r"the record does not show one at tool: .* kg with a deviation of"),
        ("light", True, (), {"frame": "hand", "mass": 2.0}, r"payload\.frame = hand: a moving frame of six was"),
        ("light", True, (), SOUGHT | {"com": [0, 0, 0]}, "com without mass: both were expected"),
    ],
)
def test_what_cannot_be_told_apart_is_refused(
    folder: Path, name: str, scale: bool, identify: tuple[str, ...], payload: dict[str, Any], reason: str
) -> None:
    """A payload beside factors or masses, where there is none, at no frame of the robot; each with its reason."""
    with pytest.raises(AerobatError, match=reason):
        calibrate([opened(folder, name, scale, payload=payload)], parameters=identify)


def test_an_effort_that_shows_nothing_keeps_its_factor(folder: Path) -> None:
    """Of a joint that stands still, and of one whose effort is zero; the others are told as without them."""
    table = pd.read_csv(folder / "alone.csv")
    table[["wrist_3_q", "wrist_3_v", "wrist_2_i"]] = [0.3, 0.0, 0.0]
    table.to_csv(folder / "poor.csv", index=False)
    found = calibrate([opened(folder, "poor")], trust=True).fitted
    np.testing.assert_allclose(found.scale[:4] / FACTORS[:4], 1.0, atol=0.02)
    assert found.scale[4:].tolist() == [1.0, 1.0]
    assert [bool(fit.untold) for fit in found.fits] == [False] * 4 + [True] * 2


def test_a_drone_shows_what_it_carries_by_its_thrust(tmp_path: Path) -> None:
    """It has no efforts: 7 g of 27 g within their deviation; a map that knows them makes it as heavy."""
    flight(20.0).to_csv(tmp_path / "drone.csv", index=False)
    changes = {"known.thrust.fit": None, "known.thrust.coefficients": list(POWERS), "robot.body.mass": MASS - 0.007}
    values = edited(DRONE, {**changes, "payload.frame": "body", "use.free": [0, 15]})
    sought = estimate(recorded(tmp_path / "drone.csv", values))
    told = sought.forces.fits[0].values
    assert abs(told["mass"] - 0.007) < told["deviation of mass"] < 0.1 * MASS
    values["payload"] |= {"mass": 0.007, "com": [0, 0, 0]}
    known = recorded(tmp_path / "drone.csv", values)
    assert known.robot.mass == pytest.approx(MASS)
    assert known.robot.fingerprint() == sought.forces.record.robot.fingerprint()
    assert all(check.ok for check in check_record(known))
