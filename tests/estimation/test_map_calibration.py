"""What one recording shows by a map (friction, thrust, mass, load) makes another one right; a pushed one is refused."""

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import tomli_w
from scipy.spatial.transform import Rotation
from support import swinging_arm
from support.commands import call
from support.drone import MAP as DRONE
from support.drone import MASS, POWERS, flight
from support.further import further
from support.recorded import edited, recorded
from support.six_joints import six_map, swing
from support.strange_arm import JOINTS, arm_map, nothing, pushed, write_log
from support.walking_log import table, table_map, urdf, walk

from aerobat_pin import open_record
from aerobat_pin.errors import AerobatError, CalibrationError, MapError
from aerobat_pin.estimation import (
    Calibration,
    OnlineEstimator,
    calibrate,
    calibration_bytes,
    estimate,
    read_calibration,
    stream_of,
)
from aerobat_pin.estimation.calibration.error_bar import bar_words
from aerobat_pin.experiments import check_record
from aerobat_pin.forces import FittedValues, taken_as_free, used_by_fits
from aerobat_pin.observers import SHOWN
from aerobat_pin.records import Block, Condition, PlainRobot, Record, parse_map, read_netcdf, robot_of_map

Patch, Said = pytest.MonkeyPatch, pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the arm, its free and its pushed recording, and their map."""
    folder = tmp_path_factory.mktemp("arms")
    (folder / "arm.urdf").write_text(swinging_arm.arm())
    (folder / "map.toml").write_text(tomli_w.dumps(swinging_arm.arm_map()))
    swinging_arm.recording(folder, "free", pushed=False, seed=1)
    swinging_arm.recording(folder, "pushed", pushed=True, seed=2)
    return folder


@pytest.fixture(scope="module")
def learnt(folder: Path) -> Calibration:
    """Return what the free recording shows, the mass too."""
    return calibrated(folder, "free", swinging_arm.arm_map(), "mass")


class GearedArm(PlainRobot):
    """The arm, whose first joint's gear has a phase: what a user writes for a robot that repeats itself."""

    def condition(self, block: Block) -> Condition:
        """Return the gear's angle, and its mean rate."""
        row, rate = self.q_index("turn"), block.v[:, [self.v_index("turn")]]
        angle, rates = (0.5 * (values[1:] + values[:-1]) for values in (block.q[:, row], rate))
        mean = np.full_like(rates, np.mean(rates))
        return Condition("the gear", angle, mean, {"rate": "rad/s"}, np.abs(mean[0]))


def calibrated(folder: Path, name: str, values: dict[str, Any], *parameters: str) -> Calibration:
    """Return what a recording of a folder shows by a map."""
    return calibrate([recorded(folder / f"{name}.csv", values)], parameters=parameters)


def test_a_reversed_effort_is_no_friction(folder: Path) -> None:
    """An offset of friction can take up most of it: it is looked for before friction is fitted."""
    free = pd.read_csv(folder / "free.csv", nrows=2500)
    free.assign(lift_i=-free["lift_i"]).to_csv(folder / "reversed.csv", index=False)
    law = edited(swinging_arm.arm_map(), {"joints.friction.law": "coulomb+viscous"})
    warnings = calibrated(folder, "reversed", law).warnings
    assert any("lift" in line and "reversed" in line for line in warnings)


def test_an_error_bar_says_what_was_not_seen() -> None:
    """One joint shows nothing of a force along its axis: `nan N` was its error."""
    bar = {"tip.Fx": (0.2, 0.1), "tip.Fy": (np.nan, np.nan)}
    assert bar_words(bar).endswith("nothing was fitted: tip.Fx 0.1 N (without 0.2), tip.Fy not seen")


def test_a_recording_too_short_for_an_error_bar_does_not_hide_that_of_another(folder: Path) -> None:
    """In either order: 20 ms had said "not seen", or "too short for one"."""
    free, plain = pd.read_csv(folder / "free.csv"), edited(swinging_arm.arm_map(), {"joints.friction": None})
    for name, rows in (("long", free[:600]), ("short", free[1000:1020])):
        rows.to_csv(folder / f"{name}.csv", index=False)
    long, short = (recorded(folder / f"{name}.csv", plain) for name in ("long", "short"))
    both = [long, short], [short, long]
    alone, *others = (bar_words(calibrate(each, parameters=(), trust=True).error_bar) for each in ([long], *both))
    assert "tool.Fx 2.9" in alone
    assert others == [alone, alone]


def test_joints_where_a_calibration_did_not_see_them_are_said(folder: Path, learnt: Calibration) -> None:
    """Of a belief that is wrong, it knows what is wrong where it was learnt; the same swing causes no word."""
    record = recorded(folder / "pushed.csv", swinging_arm.arm_map())
    ranges = {joint: (low - 2.0, high - 2.0) for joint, (low, high) in learnt.ranges.items() if joint == "lift"}
    for calibration, told in ((learnt, ()), (replace(learnt, ranges=ranges), ("lift",))):
        said = [one.text for one in estimate(record, calibration=calibration).findings if one.check == "postures"]
        assert [joint for one in said for joint in re.findall(r"(\w+) \d+ % of the time", one)] == [*told]
    assert learnt.ranges.keys() == {*swinging_arm.JOINTS}
    assert all(low < high for low, high in learnt.ranges.values())


@pytest.mark.usefixtures("unrendered")
def test_a_free_swing_makes_another_force_right(folder: Path, monkeypatch: Patch, capsys: Said) -> None:
    """By the two commands: 0.15 N rms where it was up to some newtons; friction, rotors and mass are found."""
    monkeypatch.chdir(folder)
    learn = ["calibrate", "free.csv", "--map", "map.toml", "--identify", "mass", "--out", "arm.nc"]
    assert call(*learn) == 0
    said = capsys.readouterr().out
    assert re.search(r"fit: mass: times 1\.06\d*, deviation 0\.0", said)
    assert re.search(r"error bar, rms where nothing was fitted: tool\.Fx \d\S* N \(without \d", said)
    learnt = read_calibration(Path("arm.nc"))
    assert learnt.fitted.mass == pytest.approx(swinging_arm.HEAVIER, abs=0.01)
    friction = learnt.fitted.friction
    for found, true in (
        (friction.coulomb, swinging_arm.COULOMB),
        (friction.viscous, swinging_arm.VISCOUS),
        (friction.inertia, swinging_arm.ROTOR),
        (friction.offset, swinging_arm.OFFSET),
    ):
        np.testing.assert_allclose(found, true, atol=0.05)
    words = ["estimate", "pushed.csv", "--map", "map.toml", "--calibration", "arm.nc", "--out", "out"]
    assert call(*words) == 0
    assert "calibration: learnt from free.csv; error bar" in capsys.readouterr().out
    stored = read_netcdf(folder / "out" / "estimate.nc", "estimate")[""]
    with_it, seen = (stored[key].values[0, :, 0] for key in ("force_W", "seen"))
    plain = estimate(recorded(Path("pushed.csv"), edited(swinging_arm.arm_map(), {"joints.friction": None})))
    time, log = plain.estimates["force_level"].time[:-1], pd.read_csv("pushed.csv")
    truth = np.column_stack([np.interp(time - 0.009, log.t, log[f"f{axis}"]) for axis in "xyz"])
    shown = seen[200:] > SHOWN
    wrong, right = (
        np.sqrt(np.mean((found - truth)[200:] ** 2, axis=0, where=shown))
        for found in (plain.estimates["force_level"].force[:, 0], with_it)
    )
    assert np.all(shown.mean(axis=0) > 0.95)
    assert np.all(right < 0.15)
    assert np.all(wrong > 5.0 * right)


def test_the_rate_at_which_coulomb_friction_sets_in_is_found(folder: Path) -> None:
    """Where it is ten times the usual one; with the usual one a viscous part would stand in for it."""
    swinging_arm.recording(folder, "late", pushed=False, seed=3, rate=0.2)
    found = calibrated(folder, "late", swinging_arm.arm_map(), "mass").fitted
    assert found.friction.rate == 0.2
    assert found.fits[1].values["rate"] == 0.2
    np.testing.assert_allclose(found.friction.coulomb, swinging_arm.COULOMB, atol=0.05)
    np.testing.assert_allclose(found.friction.viscous, swinging_arm.VISCOUS, atol=0.05)


def test_noise_of_rates_changes_neither_mass_nor_rotors(folder: Path) -> None:
    """By 0.03 rad/s, of which accelerations show half as much as of the motion; a plain regression finds no rotors."""
    log, rng = pd.read_csv(folder / "free.csv"), np.random.default_rng(1)
    rates = [f"{joint}_v" for joint in swinging_arm.JOINTS]
    log[rates] += rng.normal(0.0, 0.03, log[rates].shape)
    log.to_csv(folder / "rates.csv", index=False)
    found = calibrated(folder, "rates", swinging_arm.arm_map(), "mass").fitted
    deviation = next(fit for fit in found.fits if fit.name == "mass").values["deviation"]
    assert deviation < 0.003
    assert abs(found.mass - swinging_arm.HEAVIER) < 3.0 * deviation
    np.testing.assert_allclose(found.friction.inertia, swinging_arm.ROTOR, atol=0.004)


def test_a_rotor_heavier_than_the_robot_is_doubted(folder: Path, learnt: Calibration) -> None:
    """As positions and rates that are read as degrees, and are radians, make it."""
    assert not [line for line in learnt.warnings if "rotor" in line]
    warnings = calibrated(folder, "free", edited(swinging_arm.arm_map(), {"joints.factor": {"turn": 0.0174}})).warnings
    assert [line for line in warnings if line.startswith("fit: the rotor of turn would have")]


def test_a_thrust_is_fitted_in_axes_of_a_body_with_z_down(tmp_path: Path) -> None:
    """As PX4 writes logs: the thrust pointed down where the accelerometer was taken as it came."""
    flown, half = flight(20.0), np.diag([1.0, -1.0, -1.0])
    attitude = Rotation.from_quat(flown[["qx", "qy", "qz", "qw"]].to_numpy()).as_matrix()
    for names in ("p{}", "v{}", "imu_gyro_{}", "imu_acc_{}"):
        flown[[names.format(axis) for axis in "xyz"]] @= half
    flown[["qx", "qy", "qz", "qw"]] = Rotation.from_matrix(half @ attitude @ half).as_quat()
    flown.to_csv(tmp_path / "frd.csv", index=False)
    result = estimate(recorded(tmp_path / "frd.csv", edited(DRONE, {"log.world": "ned", "base.axes": "frd"})))
    [fit] = result.fits
    assert fit.outside < 0.1 * fit.before
    assert np.all(np.abs(result.estimates["force_level"].force[50:, 0].mean(axis=0)) < 0.01 * 0.27)  # [N] of its weight


def test_a_self_check_takes_a_calibration(folder: Path, learnt: Calibration) -> None:
    """In place of a fit of which the map does not say where; without either it is refused."""
    record = recorded(folder / "pushed.csv", swinging_arm.arm_map())
    with pytest.raises(MapError, match="--calibration FILE"):
        check_record(record)
    assert [one.axis for one in check_record(record, learnt) if one.ok]


def test_a_fit_that_explains_hardly_anything_is_named(folder: Path, learnt: Calibration) -> None:
    """A joint that counts the other way round, which friction cannot explain; noise that is left explains itself."""
    assert not [line for line in learnt.warnings if "hardly anything" in line]
    warnings = calibrated(folder, "free", edited(swinging_arm.arm_map(), {"joints.factor": {"bend": -1}})).warnings
    assert [line for line in warnings if "explains hardly anything" in line and "sign, order, zero" in line]
    log = pd.read_csv(folder / "free.csv")
    efforts = [f"{joint}_i" for joint in swinging_arm.JOINTS]
    log[efforts] += np.random.default_rng(4).normal(0.0, 2.0, log[efforts].shape)  # four times the friction
    log.to_csv(folder / "rough.csv", index=False)
    warnings = calibrated(folder, "rough", swinging_arm.arm_map()).warnings
    assert not [line for line in warnings if "hardly anything" in line]


def test_the_noise_of_rows_is_that_of_data_that_no_fit_used(folder: Path, learnt: Calibration) -> None:
    """The efforts' own behind the observer's filter; a push where nothing is known to be free does not count."""
    (folder / "noise.nc").write_bytes(calibration_bytes(learnt))
    assert read_calibration(folder / "noise.nc").row_noise == learnt.row_noise
    share = -np.expm1(-100.0 / swinging_arm.RATE)  # of the means of two samples that a low-pass takes on
    efforts = 0.01 * swinging_arm.CONSTANT * (share / (2.0 - share)) ** 0.5
    assert all(0.85 < learnt.row_noise[joint] / efforts < 1.5 for joint in swinging_arm.JOINTS)
    swinging_arm.recording(folder, "knocked_late", pushed=False, seed=1, knock=(8.5, 9.0))

    def noise(name: str, end: float) -> Mapping[str, float]:
        values = edited(swinging_arm.arm_map(), {"use.free": [0, 8], "joints.friction.fit": [0, end]})
        return estimate(recorded(folder / f"{name}.csv", values)).forces.values.row_noise

    found = noise("free", 5)
    assert noise("knocked_late", 5) == found
    assert all(found[joint] > learnt.row_noise[joint] for joint in swinging_arm.JOINTS)  # the mass is wrong
    assert noise("free", 8) == {}


def test_a_thrust_learnt_in_one_flight_is_used_in_another(tmp_path: Path) -> None:
    """The second flight needs no accelerometer, and its force is that of the fit to itself within 1 mN."""
    flight(seed=2, wind=0.03).to_csv(tmp_path / "second.csv", index=False)
    named = DRONE | {"known": {"all/four": DRONE["known"]["thrust"]}}
    learnt = calibrate([recorded(tmp_path / "first.csv", named, table=flight())])
    (tmp_path / "drone.nc").write_bytes(calibration_bytes(learnt))
    blind = recorded(tmp_path / "second.csv", edited(named, {"check": None}))
    found = estimate(blind, calibration=read_calibration(tmp_path / "drone.nc"))
    assert found.estimates["force_level"].force[100:, 0, 0].mean() == pytest.approx(0.03, abs=2e-3)
    assert found.forces.fits[0].log == "first.csv"
    other = edited(named, {"known.all/four.law": "polynomial 2"})
    with pytest.raises(CalibrationError, match=r"was learnt with known\.all/four = polynomial 1 2 of commands"):
        estimate(recorded(tmp_path / "second.csv", other), calibration=learnt)


def test_online_estimates_take_the_friction_of_a_calibration(folder: Path, learnt: Calibration) -> None:
    """Sample by sample the same forces as the recording as a whole, but for the first ones."""
    chosen = parse_map(swinging_arm.arm_map(), "of the test")
    whole = estimate(recorded(folder / "pushed.csv", chosen), calibration=learnt).estimates["force_level"]
    with pytest.raises(MapError, match="friction can come from a calibration"):
        OnlineEstimator(chosen, folder)
    online = OnlineEstimator(chosen, folder, calibration=learnt)
    table = pd.read_csv(folder / "pushed.csv").iloc[:400]
    heard = [one for row in table.to_dict("records") for one in online.push(row.pop("t"), row)]
    assert len(heard) == 399
    np.testing.assert_allclose(list(heard[-1].components.values()), whole.components[398], atol=1e-6)


@pytest.mark.usefixtures("unrendered")
def test_a_knock_is_found_by_free_swings(folder: Path, learnt: Calibration, monkeypatch: Patch, capsys: Said) -> None:
    """8 N from 1.5 to 1.7 s: found within a sample of 2 ms, with its size; nothing in another free swing."""
    monkeypatch.chdir(folder)
    swinging_arm.recording(folder, "knocked", pushed=False, seed=4, knock=(1.5, 1.7))
    swinging_arm.recording(folder, "still_free", pushed=False, seed=5)
    (folder / "knock.nc").write_bytes(calibration_bytes(learnt))
    words = ["--map", "map.toml", "--calibration", "knock.nc", "--out"]
    assert call("estimate", "knocked.csv", *words, "knocked") == 0
    assert "force_level: contact at tool from 1.498 s to 1.700 s" in capsys.readouterr().out
    metrics = json.loads((folder / "knocked" / "metrics.json").read_text())
    assert metrics["model"]["verdict"] == "unchanged"
    [event] = metrics["observers"]["force_level"]["events"]
    assert event["point"] == "tool"
    assert [event[key] for key in ("onset", "alarm", "end")] == pytest.approx([1.5, 1.5, 1.7], abs=2.1e-3)
    assert event["size"] == pytest.approx(8.0, abs=0.1)
    assert call("estimate", "still_free.csv", *words, "still") == 0
    metrics = json.loads((folder / "still" / "metrics.json").read_text())
    assert metrics["observers"]["force_level"]["events"] == []


def test_a_robot_with_a_phase_gets_a_series_over_it(tmp_path: Path) -> None:
    """A gear's ripple of 0.5 N m: a plug-in says what turns, and a fourteenth of it is left in another recording."""
    (tmp_path / "arm.urdf").write_text(swinging_arm.arm())
    for name, seed in (("free", 1), ("again", 2)):
        swinging_arm.recording(tmp_path, name, False, seed, turning=5.0, ripple=0.5)
    chosen = parse_map(swinging_arm.arm_map(), "of the test")
    plain = robot_of_map(chosen.robot, tmp_path)
    geared = GearedArm(plain.model, plain.free, plain.joints, plain.title)

    def opened(name: str, robot: PlainRobot) -> Record:
        return recorded(tmp_path / f"{name}.csv", chosen, robot)

    found = {robot: calibrate([opened("free", robot)], parameters=["mass"]) for robot in (plain, geared)}
    assert found[plain].series is None
    assert any("12 harmonics of the gear" in note for note in found[geared].notes)
    (tmp_path / "gear.nc").write_bytes(calibration_bytes(found[geared]))
    found[geared] = read_calibration(tmp_path / "gear.nc")
    without, with_it = (
        estimate(opened("again", robot), calibration=learnt).estimates["force_level"].residual[100:, 0]
        for robot, learnt in found.items()
    )
    assert np.std(without) > 0.35
    assert np.std(with_it) < 0.03
    for robot, bar in ((plain, 0.6), (geared, 0.04)):
        assert found[robot].error_bar["tool.Fx"][1] == pytest.approx(bar, rel=0.2)
    with pytest.raises(CalibrationError, match="this robot has none"):
        estimate(opened("again", plain), calibration=found[geared])


def test_samples_of_the_boot_do_not_move_what_is_fitted(folder: Path, tmp_path: Path) -> None:
    """Four samples a thousand seconds before the rest: three quarters of what is used are fitted, not of the clock."""
    rows = pd.read_csv(folder / "free.csv", nrows=2500)
    boot = rows[:4].assign(t=rows.t[:4] - 1000.0)
    (tmp_path / "arm.urdf").write_text(swinging_arm.arm())
    found = []
    for name, kept in (("clean", rows[4:]), ("boot", pd.concat([boot, rows[4:]]))):
        record = recorded(tmp_path / f"{name}.csv", swinging_arm.arm_map(), table=kept)
        found.append(calibrate([record]).fitted.friction)
    np.testing.assert_allclose(found[1].coulomb, found[0].coulomb, rtol=1e-3)  # type: ignore[union-attr]


def test_a_record_that_wants_a_negative_mass_is_refused(tmp_path: Path) -> None:
    """A walk: the ground pushes."""
    (tmp_path / "quadruped.urdf").write_text(urdf())
    table(walk()).to_csv(tmp_path / "walk.csv", index=False)
    with pytest.raises(MapError, match=r"the record wants -0\.\d\d times the mass: something pushes on the robot"):
        calibrate([recorded(tmp_path / "walk.csv", table_map(tmp_path / "quadruped.urdf"))], parameters=["mass"])


@pytest.mark.parametrize(("points", "why"), [(["tool"], "no row is to spare"), ([], "no force is sought")])
def test_a_model_that_nothing_checks_says_why(points: list[str], why: str, folder: Path, learnt: Calibration) -> None:
    """Residuals alone had `"model": null`, as if there were no calibration."""
    record = recorded(folder / "pushed.csv", edited(swinging_arm.arm_map(), {"robot.points": points}))
    told = estimate(record, calibration=learnt).metrics()["model"]
    assert (told["verdict"], told["ratio"]) == ("unverified", None)
    assert why in told["why"]
    assert why in told["words"]


def test_a_joint_that_another_recording_holds_says_nothing_of_its_current(folder: Path, learnt: Calibration) -> None:
    """It was refused: "learnt with the effort of bend = 1.6 N m per unit, but 1 N m per unit is believed"."""
    changes: dict[str, Any] = {"joints.names": swinging_arm.JOINTS[:2], "joints.held": {"bend": 0.8}}
    changes |= {
        f"joints.{part}.columns": swinging_arm.arm_map()["joints"][part]["columns"][:2]
        for part in ("position", "velocity", "effort")
    }
    record = recorded(folder / "pushed.csv", edited(swinging_arm.arm_map(), changes))
    assert learnt.forces(learnt.applied(record)).values.joints == tuple(swinging_arm.JOINTS)


def test_what_cannot_be_used_is_refused(folder: Path, learnt: Calibration, monkeypatch: Patch, capsys: Said) -> None:
    monkeypatch.chdir(folder)

    def said(change: dict[str, Any], identify: tuple[str, ...] = (), use: bool = False) -> str:
        chosen = edited(swinging_arm.arm_map(), change)
        try:
            if use:
                estimate(recorded(Path("pushed.csv"), chosen), calibration=learnt)
            else:
                calibrate([recorded(Path("free.csv"), chosen)], parameters=identify)
        except AerobatError as error:
            return str(error)
        return ""

    (folder / "heavy.urdf").write_text(swinging_arm.arm().replace('value="1.5"', 'value="1.6"'))
    assert "belongs to the robot 'arm', not to 'heavy'" in said({"robot.urdf": "heavy.urdf"}, use=True)
    told = "the effort of turn = 1.6 N m per unit, but 2 N m per unit is believed"
    assert told in said({"joints.effort.torque_per_unit": {"*": 2.0}}, use=True)
    assert "cannot be told apart" in said({"joints.friction": {"scale": True}}, ("mass",))
    assert "parameters has 'drag': of mass some were expected; joints.friction and" in said({}, ("drag",))
    with pytest.raises(MapError, match=r"joints\.friction\.fit: from and to .* or --calibration FILE"):
        estimate(recorded(Path("pushed.csv"), swinging_arm.arm_map()))
    for words, reason in (
        (["calibrate", "free.csv", "pushed.csv", "--map", "map.toml", "--out", "x.nc"], "2 recordings"),
        (["calibrate", "free.csv", "--map", "map.toml", "--morphology", "aerobat", "--out", "x.nc"], "--morphology is"),
        (["estimate", "pushed.csv", "--map", "map.toml", "--calibration", "arm.urdf"], "cannot be read as NetCDF-4"),
    ):
        assert call(*words) == 2
        assert reason in capsys.readouterr().err


FACTORS = np.array([0.85, 1.1, 0.95, 1.15, 0.9, 1.1])
LIGHT, HEAVY = (2.0, (0.03, 0.16, 0.05)), (3.0, (-0.05, 0.1, 0.02))  # [kg], [m]: what it carries
WRONG = 0.07  # of masses, and a third of it [m] of centres of the links, where they are wrong
ROTORS = 0.15  # [kg m2]: inertia of each rotor behind its gear, in no URDF
SOUGHT = {"frame": "tool"}
KNOWN = SOUGHT | {"mass": LIGHT[0], "com": list(LIGHT[1])}


@pytest.fixture(scope="module")
def swings(tmp_path_factory: pytest.TempPathFactory) -> Path:
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


def test_factors_of_five_joints_are_told_and_the_sixth_is_not(swings: Path) -> None:
    """The needed torque on the noisy effort makes factors too small; effort on what is needed gets them within 2 %."""
    found = calibrate([opened(swings, "alone")])
    np.testing.assert_allclose(found.fitted.scale[:5] / FACTORS[:5], 1.0, atol=0.02)
    assert found.fitted.scale[5] == 1.0
    [reason] = [fit.untold for fit in found.fitted.fits if fit.untold]
    assert reason.startswith("factor of wrist_3 cannot be told, it stays 1: its deviation would be 0.")
    assert any(reason in note for note in found.notes)
    assert any("only their ratio is seen" in note for note in found.notes)
    again = kept(swings, found)
    assert [str(fit) for fit in again.fitted.fits] == [str(fit) for fit in found.fitted.fits]
    result = estimate(opened(swings, "alone"), calibration=again)
    assert any(reason in str(finding) for finding in result.findings)
    with pytest.raises(AerobatError, match=r"payload\.fit: from and to \[s\], where nothing else touches"):
        estimate(opened(swings, "alone", payload=SOUGHT), calibration=again)


@pytest.mark.parametrize(("k", "joint", "factor", "told"), [(2, "elbow", 0.5, []), (1, "lift", -1.0, ["effort sign"])])
def test_a_fitted_factor_is_no_wrong_unit(k: int, joint: str, factor: float, told: list[str], swings: Path) -> None:
    """Of half an effort another factor than the fitted one was warned of, in each later estimate, too."""
    factors = FACTORS * np.where(np.arange(6) == k, factor, 1.0)
    swing(swings / "far.csv", 1, factors)
    found = calibrate([opened(swings, "far")])
    assert found.fitted.scale[k] == pytest.approx(factors[k], rel=0.02)
    assert [text.partition(":")[0] for text in found.warnings if f"effort of {joint}" in text] == told


@pytest.mark.parametrize("links", ["_wrong", *further("")])
def test_a_known_payload_tells_all_factors_and_they_tell_another_payload(swings: Path, links: str) -> None:
    """Within 2.5 deviations and 3 %, wrong links or not; the centre of the first payload may be sought beside them."""
    for payload in (KNOWN, SOUGHT | {"mass": LIGHT[0]}):
        found = kept(swings, calibrate([opened(swings, f"light{links}", payload=payload)]))
        off = np.abs(found.fitted.scale / FACTORS - 1.0)
        deviations = [fit.values["deviation of the factor"] for fit in found.fitted.fits[-6:]]
        assert np.all(off < 2.5 * np.array(deviations))
    result = estimate(opened(swings, f"heavy{links}", payload=SOUGHT, use={"free": [0, 45]}), calibration=found)
    values = next(fit.values for fit in result.forces.fits if fit.name == "payload at tool" and not fit.log)
    assert abs(values["mass"] - HEAVY[0]) < min(2.5 * values["deviation of mass"], 0.03 * HEAVY[0])
    for axis, true in zip("xyz", HEAVY[1], strict=True):
        assert abs(values[axis] - true) < 2.5 * values[f"deviation of {axis}"]
    own = result.forces.record.robot.own_model
    assert result.mass == pytest.approx(sum(own.inertias[k].mass for k in range(1, 7)) + values["mass"])


def test_a_stream_of_a_record_has_its_corrected_links(swings: Path) -> None:
    values = edited(six_map(payload=KNOWN), {"joints.friction.fit": [0, 30]})
    record = recorded(swings / "light_wrong.csv", values)
    whole, stream = estimate(record).estimates["force_level"], stream_of(record)
    rows = pd.read_csv(swings / "light_wrong.csv", nrows=300).to_dict("records")
    found = [[*one.components.values()] for row in rows for one in stream.push(row["t"], row)]
    np.testing.assert_allclose(found, whole.components[: len(found)], rtol=0.0, atol=1e-6)


def test_rotors_that_no_law_asks_for_leave_the_factors_right(swings: Path) -> None:
    """Their inertia moves with gravity's torque as joints swing: left out, it made factors 18 % too small."""
    swing(swings / "rotors.csv", 7, FACTORS, LIGHT, rotors=ROTORS)
    found = calibrate([opened(swings, "rotors", payload=KNOWN)])
    deviations = [fit.values["deviation of the factor"] for fit in found.fitted.fits[-6:]]
    assert np.all(np.abs(found.fitted.scale / FACTORS - 1.0) < 2.5 * np.array(deviations))


def test_a_payload_beside_friction_leaves_the_rest_to_tell_errors(swings: Path) -> None:
    """It is fitted where friction is; all that is free counted as used, and deviations were 2.3 times as large."""
    values = edited(six_map(payload=SOUGHT), {"joints.friction.fit": [0, 30], "use.free": [0, 45]})
    record = recorded(swings / "light.csv", values)
    used = used_by_fits(record, FittedValues(), record.start + np.array([10.0, 40.0, 50.0]))
    assert used.tolist() == [True, False, True]
    values = edited(values, {"joints.friction.scale": False, "payload.fit": [0, 20]})  # which went unheard
    with pytest.raises(AerobatError, match=r"payload\.fit = \[0\.0, 20\.0\]: the payload is sought with the friction"):
        estimate(recorded(swings / "light.csv", values))
    record = recorded(swings / "light.csv", edited(values, {"joints.friction.fit": None}))
    assert taken_as_free(record).map.joints.friction.fit == (0.0, 20.0)


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_known_gains_tell_a_payload_beside_friction(noise: float, swings: Path) -> None:
    """Within twice its deviation and 3 %, with noise of rates [rad/s], too; what the arm carried is not kept."""
    swing(swings / "right.csv", 6, payload=HEAVY)
    table, rng = pd.read_csv(swings / "right.csv"), np.random.default_rng(6)
    rates = [name for name in table if name.endswith("_v")]
    table[rates] += noise * rng.standard_normal((len(table), len(rates)))
    table.to_csv(swings / "right.csv", index=False)
    found = calibrate([opened(swings, "right", scale=False, payload=SOUGHT)])
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
    free = estimate(opened(swings, "unloaded"), calibration=found)
    assert free.mass == pytest.approx(opened(swings, "unloaded").robot.mass)
    assert abs(free.estimates["force_level"].force[200:, 0, 2].mean()) < 1.0
    loaded, seeking = (opened(swings, "light", payload=one).map for one in (KNOWN, SOUGHT))
    online = OnlineEstimator(loaded, swings, calibration=found)
    assert online.robot.mass == pytest.approx(opened(swings, "unloaded").robot.mass + LIGHT[0])
    with pytest.raises(AerobatError, match="fits need a whole record"):
        OnlineEstimator(seeking, swings, calibration=found)


@pytest.mark.parametrize(
    ("name", "scale", "more", "payload", "said"),
    [
        ("light", True, (), SOUGHT, "only their ratio is seen; payload.mass was expected, or factors by --calibration"),
        ("light", False, ("mass",), SOUGHT, "the mass of all bodies, and a payload .* one of them was expected"),
        ("unloaded", False, (), SOUGHT, r"the record does not show one at tool: .* kg with a deviation of"),
        ("light", True, (), {"frame": "hand", "mass": 2.0}, r"payload\.frame = hand: a moving frame of six was"),
        ("light", True, (), SOUGHT | {"com": [0, 0, 0]}, "com without mass: both were expected"),
    ],
)
def test_what_looks_alike_is_refused(swings: Path, name: str, scale: bool, more: Any, payload: Any, said: str) -> None:
    """A payload beside factors or masses, where there is none, at no frame of the robot; each with its reason."""
    with pytest.raises(AerobatError, match=said):
        calibrate([opened(swings, name, scale, payload=payload)], parameters=more)


def test_an_effort_that_shows_nothing_keeps_its_factor(swings: Path) -> None:
    """Of a joint that stands still, and of one whose effort is zero; the others are told as without them."""
    table = pd.read_csv(swings / "alone.csv")
    table[["wrist_3_q", "wrist_3_v", "wrist_2_i"]] = [0.3, 0.0, 0.0]
    table.to_csv(swings / "poor.csv", index=False)
    found = calibrate([opened(swings, "poor")], trust=True).fitted
    np.testing.assert_allclose(found.scale[:4] / FACTORS[:4], 1.0, atol=0.02)
    assert found.scale[4:].tolist() == [1.0, 1.0]
    assert [bool(fit.untold) for fit in found.fits] == [False] * 4 + [True] * 2


def test_a_drone_shows_what_it_carries_by_its_thrust(tmp_path: Path) -> None:
    """It has no efforts: 7 g of 27 g within their deviation; a map that knows them makes it as heavy."""
    changes = {"known.thrust.fit": None, "known.thrust.coefficients": list(POWERS), "robot.body.mass": MASS - 0.007}
    values = edited(DRONE, {**changes, "payload.frame": "body", "use.free": [0, 15]})
    sought = estimate(recorded(tmp_path / "drone.csv", values, table=flight(20.0)))
    told = sought.forces.fits[0].values
    assert abs(told["mass"] - 0.007) < told["deviation of mass"] < 0.1 * MASS
    values["payload"] |= {"mass": 0.007, "com": [0, 0, 0]}
    known = recorded(tmp_path / "drone.csv", values)
    assert known.robot.mass == pytest.approx(MASS)
    assert known.robot.fingerprint() == sought.forces.record.robot.fingerprint()
    assert all(check.ok for check in check_record(known))


HOSE = np.array([0.0, 0.0, -20.0])
PULLED = r"something pushed at tool0.* (19|2[012])(\.\d)? N"


def lasting(time: np.ndarray) -> np.ndarray:
    """Return the pull (n, 3) of a hose [N]."""
    return np.tile(HOSE, (len(time), 1))


def for_a_while(time: np.ndarray) -> np.ndarray:
    """Return the same pull (n, 3) [N], from 12 to 17 s."""
    return np.where(((time > 12.0) & (time < 17.0))[:, None], HOSE, 0.0)


def test_a_pull_is_not_learnt_as_friction(tmp_path: Path) -> None:
    """A hose of 20 N at the tool, all the time or for 5 s: offsets of the joints explain it worse; free it is taken."""
    chosen = arm_map(["tool0"], friction=True)
    for name, force in (("free", nothing), ("always", lasting), ("hose", for_a_while)):
        write_log(tmp_path / f"{name}.csv", 211, force, pace=1.6)
    assert not any("pushed" in line for line in calibrate([recorded(tmp_path / "free.csv", chosen)]).warnings)
    with pytest.raises(CalibrationError, match=rf"{PULLED} .*--trust"):
        calibrate([recorded(tmp_path / "always.csv", chosen)])
    trusted = calibrate([recorded(tmp_path / "hose.csv", chosen)], trust=True)
    assert any(re.search(PULLED, line) for line in trusted.warnings)


def test_what_a_short_recording_cannot_tell_is_no_push(tmp_path: Path) -> None:
    """Friction and offsets of 1.5 and 3 s are known badly, and what that makes of forces was told as a push."""
    swing(tmp_path / "swing.csv", 3)
    table, chosen = pd.read_csv(tmp_path / "swing.csv"), six_map(observer={"gain": 20.0})
    del chosen["joints"]["friction"]
    for begin, count in ((100, 150), (1500, 300), (2500, 300)):
        short = recorded(tmp_path / "short.csv", chosen, table=table.iloc[begin : begin + count])
        assert not any("pushed" in line for line in calibrate([short]).warnings)


def test_a_pull_is_not_normal_where_no_joint_rubs(tmp_path: Path) -> None:
    """Without friction to learn it was taken for what rows err by: 19 N at a hand for one second in eight."""
    write_log(tmp_path / "free.csv", 211, nothing, pace=1.6, rubs=0.0)
    write_log(tmp_path / "hose.csv", 211, for_a_while, pace=1.6, rubs=0.0)
    chosen = edited(arm_map(["tool0"]), {"check": None})
    free, hose = (recorded(tmp_path / f"{name}.csv", chosen) for name in ("free", "hose"))
    assert calibrate([free]).warnings == ()
    unsought = recorded(tmp_path / "free.csv", edited(chosen, {"robot.points": []}))
    assert not any("learnt as friction" in line for line in calibrate([unsought]).warnings)
    with pytest.raises(CalibrationError, match=rf"{PULLED} .*--trust"):
        calibrate([hose])


def test_noise_of_velocities_is_no_push(tmp_path: Path) -> None:
    """It is in all rows at once, through the inertia, as a force is: of 12 free swings 7 were refused."""
    write_log(tmp_path / "free.csv", 213, nothing, pace=1.6, rubs=0.2)
    table, rng = pd.read_csv(tmp_path / "free.csv"), np.random.default_rng(1)
    table[[f"v{k}" for k in range(6)]] += 0.02 * rng.standard_normal((len(table), 6))
    table.to_csv(tmp_path / "free.csv", index=False)
    chosen = edited(arm_map(["tool0"], friction=True), {"observer.gain": 100.0})
    assert not any("pushed" in line for line in calibrate([recorded(tmp_path / "free.csv", chosen)]).warnings)


def test_what_turns_rotors_is_no_push(tmp_path: Path) -> None:
    """Rotors that no file knows need torques of their own: of an arm that nobody touched they were a push of 36 N."""
    swing(tmp_path / "free.csv", 1, rotors=0.3)
    chosen = six_map(log={"time": {"column": "t"}}, observer={"gain": 20.0})
    free = recorded(tmp_path / "free.csv", edited(chosen, {"joints.friction": None}))
    assert not any("pushed" in line for line in calibrate([free]).warnings)


def test_rotors_are_learnt_where_no_joint_rubs(tmp_path: Path) -> None:
    """They were tried only where friction shows: up to 5.8 N rms at a hand that nobody touched, now 0.5."""
    write_log(tmp_path / "free.csv", 211, nothing, pace=1.6, rubs=0.0, rotors=0.5)
    learnt = calibrate([recorded(tmp_path / "free.csv", edited(arm_map(["tool0"]), {"check": None}))])
    assert learnt.fitted.friction.inertia[:3] == pytest.approx(0.5, rel=0.05)
    assert all(after < 0.15 * before for before, after in learnt.error_bar.values())


def test_contacts_are_not_told_where_a_moment_is_sought_beside_a_point(tmp_path: Path) -> None:
    """A calibration's contacts are those of points alone: its first estimate of such a map ended in a traceback."""
    chosen = edited(arm_map(["forearm_link"]), {"check": None, "robot.wrenches": ["tool0"]})
    for name, force in (("free", nothing), ("push", pushed)):
        write_log(tmp_path / f"{name}.csv", 211, force, pace=1.6, rubs=0.0)
    learnt = calibrate([recorded(tmp_path / "free.csv", chosen)])
    result = estimate(recorded(tmp_path / "push.csv", chosen), calibration=learnt)
    assert result.observers["force_level"].events is None
    assert "at tool0" in result.verdict


@pytest.mark.parametrize("rows", [20, 28])
def test_a_record_in_which_hardly_a_filter_settles_is_estimated(rows: int, folder: Path, learnt: Calibration) -> None:
    """Of intervals that begin 5/K = 50 ms after the first, 20 samples have none, and 28 have one."""
    table = pd.read_csv(folder / "pushed.csv")[:rows]
    result = estimate(recorded(folder / f"{rows}.csv", swinging_arm.arm_map(), table=table), calibration=learnt)
    assert np.all(np.isfinite(result.estimates["force_level"].standard_deviation))


def test_an_arm_without_a_row_to_spare_says_that_it_cannot_tell(tmp_path: Path) -> None:
    """Three joints, and a force of three components: friction with offsets explains any pull that lasts."""
    (tmp_path / "arm.urdf").write_text(swinging_arm.arm())
    (tmp_path / "map.toml").write_text(tomli_w.dumps(swinging_arm.arm_map()))
    swinging_arm.recording(tmp_path, "free", pushed=False, seed=1)
    warnings = calibrate([open_record(tmp_path / "free.csv", tmp_path / "map.toml")]).warnings
    assert [line for line in warnings if "no row is to spare" in line and "make sure that nothing pushed" in line]


def test_friction_that_a_calibration_did_not_see_is_found_as_without_one(tmp_path: Path) -> None:
    """Only the wrist moved: as zero, friction of the others made Fy of a pushed record 8 N wrong, with +-2 N."""
    write_log(tmp_path / "wrist.csv", 221, nothing, pace=1.6, still=3)
    moved = write_log(tmp_path / "push.csv", 222, pushed, pace=1.6)
    chosen = parse_map(arm_map(["tool0"], friction=True), "of the test")
    learnt = calibrate([recorded(tmp_path / "wrist.csv", chosen)])
    assert learnt.fitted.joints == tuple(JOINTS[3:])
    result = estimate(recorded(tmp_path / "push.csv", chosen), calibration=learnt)
    found, truth = result.estimates["force_level"], 0.5 * (moved[1:] + moved[:-1])
    inside = np.abs(found.components - truth) < 2.0 * found.standard_deviation
    assert inside[found.shown].mean() > 0.95
    assert result.model.verdict == "unverified"
    assert any("did not show friction of shoulder_pan_joint" in line for line in result.warnings)
