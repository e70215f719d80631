"""An arm below a quadrotor: thrusts of rotors at their own places, their order, and a calibration at rest."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation
from support.flying_arm import RATE, THRUST, fly, flying_map, pushed
from support.further import further
from support.recorded import edited, recorded
from support.robot_parts import by_axis

from aerobat_pin.errors import LogError, MapError
from aerobat_pin.estimation import calibrate, estimate
from aerobat_pin.forces import Contact, fitted_forces
from aerobat_pin.forces.contacts import found_contacts, joined_contacts
from aerobat_pin.forces.inverse_dynamics import accelerations, slope_noise


def believed(thrust: float) -> dict[str, Any]:
    """Return changes of a map: the thrust [N] at full speed is known of each rotor, and not fitted."""
    values = {"fit": None, "coefficients": [thrust]}
    return {f"known.rotor_{k}.{key}": value for k in range(1, 5) for key, value in values.items()}


@pytest.mark.parametrize("seed", [21, *further(22)])
def test_the_thrusts_of_several_rotors_are_fitted_together(seed: int, tmp_path: Path) -> None:
    """The accelerometer shows their sum: each by itself took all of it, and four made four times the thrust."""
    forces = fitted_forces(recorded(tmp_path / "free.csv", flying_map(tmp_path, ["tip"]), table=fly(seed)[0]))
    found = np.array([forces.values.coefficients[f"rotor_{k}"] for k in range(1, 5)])
    np.testing.assert_allclose(found, 1.07 * THRUST, rtol=0.03)
    assert len({float(c) for c in found.ravel()}) == 1  # hovering rotors turn alike
    assert [fit.name for fit in forces.fits] == [f"known.rotor_{k}" for k in range(1, 5)]


def test_a_thrust_that_the_map_knows_is_taken_off_the_fit_of_the_others(tmp_path: Path) -> None:
    """Three rotors are fitted beside one whose coefficient is known."""
    known = {"known.rotor_2.fit": None, "known.rotor_2.coefficients": [1.07 * THRUST]}
    chosen = edited(flying_map(tmp_path, ["tip"]), known)
    found = fitted_forces(recorded(tmp_path / "free.csv", chosen, table=fly(21)[0])).values.coefficients
    np.testing.assert_allclose([found[f"rotor_{k}"][0] for k in (1, 3, 4)], 1.07 * THRUST, rtol=0.04)


def test_thrusts_that_are_to_be_fitted_in_different_parts_are_refused(tmp_path: Path) -> None:
    """Where one is fitted, the sum is."""
    fly(21)[0].to_csv(tmp_path / "free.csv", index=False)
    chosen = edited(flying_map(tmp_path, ["tip"]), {"known.rotor_3.fit": {"part": [0.5, 1.0]}})
    with pytest.raises(MapError, match=r"known\.rotor_1\.fit\.part.*known\.rotor_3\.fit\.part.*same part was expected"):
        fitted_forces(recorded(tmp_path / "free.csv", chosen))


@pytest.mark.parametrize("seed", [24, *further(25, 26)])
def test_rotors_in_another_order_are_named(seed: int, tmp_path: Path) -> None:
    """Of two or of all, which made up to 12 N with no word; not said of the right one."""
    table = fly(seed, pushed)[0]
    columns = ["m1", "m2", "m3", "m4"]
    for order in ([0, 1, 2, 3], [1, 0, 2, 3], [2, 3, 1, 0]):
        log = table.copy()
        log[columns] = table[columns].to_numpy()[:, order]
        record = recorded(tmp_path / "log.csv", flying_map(tmp_path, ["tip", "base"]), table=log)
        told = [one for one in estimate(record).findings if one.check == "swapped thrusts"]
        wrong = [k for k in range(4) if order[k] != k]
        assert len(told) == bool(wrong)
        for one in told:
            for k in wrong:
                assert f"known.rotor_{order[k] + 1} of known.rotor_{k + 1}" in one.text


@pytest.mark.parametrize("seed", [24, *further(25, 26)])
@pytest.mark.parametrize(("turn", "says"), [("", ""), ("z down", "180 deg about (1"), ("y up", "90 deg about")])
def test_a_pose_in_other_axes_is_named_by_thrusts(turn: str, says: str, seed: int, tmp_path: Path) -> None:
    """Gyro and pose agree in any axes; thrusts then push against the motion, and rotors in another order were named."""
    table = fly(seed, pushed)[0].copy()
    for one in ("p", "q", "w"):
        y, z = table[f"{one}y"].copy(), table[f"{one}z"].copy()
        turned = {"": (y, z), "z down": (-y, -z), "y up": (z, -y)}[turn]
        table[f"{one}y"], table[f"{one}z"] = turned
    chosen = edited(flying_map(tmp_path, ["tip", "base"]), {"check": None, **believed(1.07 * THRUST)})
    found = estimate(recorded(tmp_path / "log.csv", chosen, table=table)).findings
    told = [each.text for each in found if each.check in {"known forces against motion", "swapped thrusts"}]
    assert len(told) == bool(turn)
    assert all(f"the body and the world turned by {says}" in text for text in told)


def test_thrusts_of_another_unit_are_named_where_the_pose_does_not_show_them(tmp_path: Path) -> None:
    """Coefficients for rad/s of speeds in rpm; what was too large for a point to be shown counted as no force."""
    fly(24, pushed)[0].to_csv(tmp_path / "log.csv", index=False)
    chosen = edited(flying_map(tmp_path, ["tip"]), {"check": None, **believed(THRUST * (30.0 / np.pi) ** 2)})
    [told] = [each for each in estimate(recorded(tmp_path / "log.csv", chosen)).findings if each.check == "mean force"]
    assert told.warns
    assert told.value is not None
    assert told.value > 50.0  # weights


def test_a_lighter_robot_and_larger_thrusts_are_the_same_to_a_flight(tmp_path: Path) -> None:
    """Thrusts that are believed 30 % too small were told as a base that weighs less, alone."""
    fly(21)[0].to_csv(tmp_path / "log.csv", index=False)
    small = believed(0.7 * 1.07 * THRUST)
    warned = estimate(recorded(tmp_path / "log.csv", edited(flying_map(tmp_path, ["tip"]), small))).warnings
    [told] = [text for text in warned if "believed mass of the base" in text]
    assert "or known forces of another size" in told


@pytest.mark.parametrize("seed", [13, *further(28)])
def test_a_calibration_in_which_the_arm_rests_knows_nothing_of_its_friction(seed: int, tmp_path: Path) -> None:
    """Noise of rates passed for motion, and errors of joints at rest for those of joints that move."""
    fly(seed, swings=False)[0].to_csv(tmp_path / "hover.csv", index=False)
    table, force = fly(24, pushed)
    table.to_csv(tmp_path / "pushed.csv", index=False)
    chosen = flying_map(tmp_path, ["tip", "base"])
    calibration = calibrate([recorded(tmp_path / "hover.csv", chosen)])
    assert calibration.row_noise.keys() == {f"base.{row}" for row in ("Fx", "Fy", "Fz", "Mx", "My", "Mz")}
    result = estimate(recorded(tmp_path / "pushed.csv", chosen), calibration=calibration)
    [found] = result.estimates.values()
    middle = 0.5 * (found.time[1:] + found.time[:-1])
    truth = np.column_stack([np.interp(middle, np.arange(len(force)) / RATE, axis) for axis in force.T])
    assert found.standard_deviation is not None
    assert found.seen is not None
    inside = np.abs(found.components[:, :3] - truth) < 2.0 * found.standard_deviation[:, :3]
    shown = (found.seen[:, :3] > 0.9) & (middle > middle[0] + 0.5)[:, None]
    assert shown.mean() > 0.85
    assert inside[shown].mean() > 0.93
    assert any(one.check == "calibration" and "friction" in one.text for one in result.findings)


@pytest.mark.parametrize("seed", [13, *further(29)])
def test_nothing_is_said_of_rotors_that_hover(seed: int, tmp_path: Path) -> None:
    """They differ by 2 %, which makes moments as other commands would; and each follows the acceleration no better."""
    fly(seed, swings=False)[0].to_csv(tmp_path / "hover.csv", index=False)
    findings = estimate(recorded(tmp_path / "hover.csv", flying_map(tmp_path, ["tip"]))).findings
    told = {one.check for one in findings if one.warns}
    assert not told & {"swapped thrusts", "lag of command", "fit"}


@pytest.mark.parametrize("seed", [42, *further(41)])
def test_a_faint_push_that_lasts_is_one_contact(seed: int, tmp_path: Path) -> None:
    """Single samples pass a threshold here and there: 0.7 N for 1.5 s were several, also before a hole of 1000 s."""
    pushes = ((2.0, 4.0), (5.5, 7.0))
    fly(21)[0].to_csv(tmp_path / "free.csv", index=False)
    table, _ = fly(seed, lambda t: np.array([1.5 * (2.0 < t < 4.0), -0.7 * (5.5 < t < 7.0), 0.0]))
    table.assign(t=table["t"] + 1000.0 * (table["t"] > 8.0)).to_csv(tmp_path / "pushed.csv", index=False)
    chosen = flying_map(tmp_path, ["tip"])
    calibration = calibrate([recorded(tmp_path / "free.csv", chosen)])
    result = estimate(recorded(tmp_path / "pushed.csv", chosen), calibration=calibration)
    contacts = found_contacts(result.stored["force_level"], result.calibration)
    np.testing.assert_allclose([(each.onset, each.end) for each in contacts or ()], pushes, atol=0.05)


def test_a_gyro_that_counts_the_other_way_about_an_axis_is_named_beside_the_quaternion(tmp_path: Path) -> None:
    """A hover turns about y alone: to it w, x, y, z is the same mistake, which was named alone, as certain."""
    table = fly(21)[0].copy()
    table["wy"] *= -1.0
    table.to_csv(tmp_path / "log.csv", index=False)
    with pytest.raises(LogError, match=r"the columns seem to be w, x, y, z.*; or gyro counts the other way about y"):
        estimate(recorded(tmp_path / "log.csv", flying_map(tmp_path, ["tip"])))


def test_one_axis_of_a_gyro_is_no_reading_of_a_quaternion(tmp_path: Path) -> None:
    """Where the others follow: of a body that turns about all three."""
    rng, time = np.random.default_rng(5), np.arange(2000) / 200.0
    vector = np.stack([0.05 * np.sin(2.0 * time), 0.3 * np.sin(1.3 * time + 1.0), 0.05 * np.sin(1.7 * time)], axis=1)
    turns = Rotation.from_rotvec(vector)
    rate = (turns[:-1].inv() * turns[1:]).as_rotvec() * 200.0
    still = dict.fromkeys(("px", "py", "pz"), 0.0)
    table = {"t": time[1:]} | dict(zip("xyzw", turns[1:].as_quat().T, strict=True)) | still
    table |= {f"w{axis}": rate[:, k] + 2e-3 * rng.standard_normal(len(rate)) for k, axis in enumerate("xyz")}
    table["wy"] = -table["wy"]
    chosen = {
        "robot": {"body": {"mass": 1.0, "inertia": [0.01, 0.01, 0.01]}, "points": ["body"]},
        "log": {"time": {"column": "t"}},
        "base": by_axis(position="p{}", rate="w{}", quaternion="{}") | {"velocity": {"from": "pose", "window": 0.05}},
    }
    record = recorded(tmp_path / "log.csv", chosen, table=pd.DataFrame(table))
    told = {one.check for one in estimate(record, trust=True).findings if one.warns}
    assert "gyro against attitude" in told
    assert "quaternion order" not in told


@pytest.mark.parametrize("every", [1, 4])
def test_noise_of_places_is_known_in_the_accelerations_that_follow_from_them(every: int, tmp_path: Path) -> None:
    """Slopes over 50 ms hide it from sample to sample: it was taken for a quarter, and what it leaves for a fault."""
    table = fly(21)[0]
    rough, rng = table.copy(), np.random.default_rng(0)
    rough[["px", "py", "pz"]] += 1e-3 * rng.standard_normal((len(table), 3))
    rough.loc[np.arange(len(table)) % every > 0, ["px", "py", "pz"]] = np.nan
    chosen = flying_map(tmp_path, ["tip"])
    clean, record = (recorded(tmp_path / f"{k}.csv", chosen, table=log) for k, log in enumerate((table, rough)))
    first, last = record.parts[0]
    blocks = [each.block(first, last) for each in (clean, record)]
    found = [accelerations(block, record)[:, :3] for block in blocks]
    told = slope_noise(blocks[1].v, record)[:3]
    np.testing.assert_allclose(told, np.std(found[1] - found[0], axis=0), rtol=0.25)


def test_contacts_at_one_point_that_overlap_are_one() -> None:
    """One half sine was told as two contacts, from 4.25 s to 4.78 s and from 4.59 s to 4.90 s."""
    tip, late, other = Contact("tip", 4.25, 4.3, 4.78), Contact("tip", 4.59, 4.6, 4.9), Contact("arm", 4.3, 4.4, None)
    last = Contact("tip", 6.0, 6.1, None)
    assert str(last) == "contact at tip from 6.000 s to the end"
    found = [(each.point, each.onset, each.end) for each in joined_contacts([last, late, other, tip])]
    assert found == [("tip", 4.25, 4.9), ("arm", 4.3, None), ("tip", 6.0, None)]


@pytest.mark.parametrize(("point", "unit"), [("Mtip", "N"), ("M.arm", "N"), ("elbow.M", "N m"), ("tip.Mx", "N m")])
def test_a_contact_is_a_moment_by_its_component_and_not_by_its_name(point: str, unit: str) -> None:
    assert Contact(point, 6.0, 6.1, None).unit == unit
