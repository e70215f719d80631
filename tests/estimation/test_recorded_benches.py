"""Whole recordings through the one door: a quadrotor's drag and wind, a hopper with friction, a force plate."""

import re
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from support.drone import DRAG, MAP, drag_slopes, flight, plain_force
from support.recorded import edited, recorded
from support.robot_parts import efforts, joint, link

from aerobat_pin.errors import LogError
from aerobat_pin.estimation import calibrate, estimate
from aerobat_pin.estimation.checks.result import fit_findings
from aerobat_pin.forces.fit_known_forces import fitted_forces
from aerobat_pin.forces.known_forces import Fit, FittedValues, KnownForces


def test_drag_by_a_map_is_that_of_a_plain_script(tmp_path: Path) -> None:
    """Within 0.5 mN per m/s of it; and within 1 of the truth. The command's lead is found."""
    table = flight()
    found = estimate(recorded(tmp_path / "flight.csv", MAP, table=table))
    level = found.estimates["force_level"]
    middle = 0.5 * (level.time[1:] + level.time[:-1]) - 1 / 20.0  # 1/K late
    velocity = np.stack([np.interp(middle, table.t, table[f"v{axis}"]) for axis in "xyz"], axis=1)
    inside = slice(100, len(middle) - 100)
    ours = drag_slopes(level.force[inside, 0], velocity[inside])
    plain = drag_slopes(plain_force(table)[inside], table[["vx", "vy", "vz"]].to_numpy()[inside])
    np.testing.assert_allclose(ours, plain, atol=0.5e-3)
    np.testing.assert_allclose(ours, -DRAG[:2], atol=1.0e-3)
    fit = found.forces.fits[0]
    assert fit.outside < 0.02 * fit.before + 4e-3
    said = estimate(recorded(tmp_path / "flight.csv", edited(MAP, {"known.thrust.delay": 0.0}))).warnings
    assert any(re.search(r"known\.thrust leads the acceleration by (3[6-9]|4\d) ms", text) for text in said), said


@pytest.mark.parametrize(("push", "worn", "told"), [(0.5, 0.0, 0), (0.0, 0.6, 1)])
def test_a_push_is_no_fit_that_does_not_hold(push: float, worn: float, told: int, tmp_path: Path) -> None:
    """For seven of the fifteen seconds that test the fit; another size of thrusts in all of them is told."""
    table = flight()
    time = table.t - table.t[0]
    table["imu_acc_z"] += push * time.between(17.0, 24.0)
    table["m1"] *= 1.0 + worn * (time > 15.0)
    found = [*fit_findings(fitted_forces(recorded(tmp_path / "flight.csv", MAP, table=table)))]
    assert len(found) == told


@pytest.mark.parametrize(("outside", "told"), [(0.99, False), (1.01, False), (1.03, True)])
def test_a_fit_of_next_to_nothing_does_no_harm(outside: float, told: bool, tmp_path: Path) -> None:
    """Friction of 0 that left .0495 N m where none left .0495 was said not to hold; 3 % more than without is told."""
    record = recorded(tmp_path / "flight.csv", MAP, table=flight())
    fit = Fit("friction of elbow", {}, "N m", before=1.0, inside=1.0, outside=outside)
    forces = cast(KnownForces, SimpleNamespace(record=record, fits=(fit,), values=FittedValues()))
    assert any("does not hold" in one.text for one in fit_findings(forces)) == told


def test_a_misread_attitude_makes_two_weights_of_force(tmp_path: Path) -> None:
    """Without gyro and accelerometer the quaternion cannot be checked; the mean force still says so, and is refused."""
    flight().to_csv(tmp_path / "flight.csv", index=False)
    thrust = {"known.thrust.coefficients": [0.0067, 0.00132], "known.thrust.fit": None}
    values = edited(MAP, {"check": None, "base.rate": {"from": "pose"}, **thrust})
    estimate(recorded(tmp_path / "flight.csv", values))
    faint = edited(values, {"known.thrust.coefficients": [7e-5, 1.4e-5]})  # as of another unit
    assert any("little was expected" in text for text in estimate(recorded(tmp_path / "flight.csv", faint)).warnings)
    misread = edited(values, {"base.quaternion.columns": ["qw", "qx", "qy", "qz"]})
    with pytest.raises(LogError, match=r"mean force over weight is .*, 2\.0\d+ .*about 2 if the attitude is misread"):
        estimate(recorded(tmp_path / "flight.csv", misread))


def leg(rail: str) -> str:
    """Return a leg of two joints below a base, which slides on a rail (`prismatic`) or is screwed to it (`fixed`)."""
    parts = [
        link("root"),
        link("base_link", 0.5, moments=(1e-3, 1e-3, 1e-3)),
        link("upper", 0.15, "0 0 -0.08", (4e-4, 4e-4, 3e-5)),
        link("lower", 0.04, "0 0 -0.09", (1e-4, 1e-4, 1e-5)),
        link("contact"),
        joint("rail", rail, "root", "base_link", axis="0 0 1", limit=9),
        joint("hip", "revolute", "base_link", "upper", limit=9),
        joint("knee", "revolute", "upper", "lower", "0 0 -0.16", limit=9),
        joint("foot", "fixed", "lower", "contact", "0 0 -0.16"),
    ]
    return f'<robot name="leg">{"".join(parts)}</robot>'


def hopper(folder: Path, moves: float = 0.0) -> None:
    """Write leg.urdf, hopper.csv: a leg on a rail over a force sensor, friction, torque scale; moved [m]: `height`."""
    (folder / "leg.urdf").write_text(leg("prismatic"))
    model = pin.buildModelFromXML(leg("prismatic"))
    time = np.arange(8000) * 1e-3
    hip, knee = 0.6 + 0.25 * np.sin(2.6 * time), -1.2 + 0.4 * np.sin(2.6 * time + 0.4)
    height = moves * np.sin(9.0 * time)
    q = np.column_stack([height, hip, knee])
    v = np.gradient(q, 1e-3, axis=0)
    a = np.gradient(v, 1e-3, axis=0)
    force = np.column_stack([2.0 * np.sin(1.9 * time), 0 * time, 12.0 + 8.0 * np.sin(3.1 * time)])
    tau = efforts(model, "contact", q, v, a, force)[:, 1:]
    friction = np.array([0.05, 0.12]) * np.tanh(v[:, 1:] / 0.02) + 0.02 * v[:, 1:]
    shown = (tau + friction) / 0.9 + 0.002 * np.random.default_rng(0).standard_normal(tau.shape)
    columns = {"time": time, "height": height, "q_hip": hip, "q_knee": knee}
    columns |= {"tau_hip": shown[:, 0], "tau_knee": shown[:, 1]}
    columns |= {f"f{axis}": force[:, k] for k, axis in enumerate("xyz")}
    pd.DataFrame(columns).to_csv(folder / "hopper.csv", index=False)


HOPPER = {
    "robot": {"urdf": "leg.urdf", "root": "fixed", "points": ["contact"]},
    "joints": {
        "names": ["hip", "knee"],
        "held": {"rail": 0.0},
        "position": {"columns": ["q_hip", "q_knee"]},
        "velocity": {"from": "position", "window": 0.02},
        "effort": {"columns": ["tau_hip", "tau_knee"], "unit": "N m"},
    },
    "check": {"wrench": {"columns": ["fx", "fy", "fz"], "filter": 30}},
}
RUBBING = edited(HOPPER, {"joints.friction": {"fit": [0, 4], "to": "check.wrench", "scale": True}})


def test_friction_and_torque_scale_of_a_hopper(tmp_path: Path) -> None:
    """Fitted on the first half against the sensor, they hold on the second; the rail's row is not believed."""
    hopper(tmp_path)
    plain, fitted = (estimate(recorded(tmp_path / "hopper.csv", values)) for values in (HOPPER, RUBBING))
    before, after = (one.observers["force_level"].points["contact"] for one in (plain, fitted))
    assert before["Fz"].r2 < 0.97
    assert after["Fz"].r2_outside_fit > 0.995
    assert any("contact.Fy: seen 0% of the time" in finding.text for finding in fitted.findings)
    knee = fitted.forces.fits[1].values
    assert knee["effort times"] == pytest.approx(0.9, abs=0.02)
    assert knee["coulomb"] == pytest.approx(0.12, abs=0.02)
    learnt = calibrate([fitted.record])
    assert not np.any(learnt.fitted.friction.offset)  # which is also the sensor's tare
    assert learnt.fitted.fits[1].values == {**knee, "offset": 0.0}
    assert learnt.detection is None  # it was pushed all the time
    assert any("offsets" in note for note in learnt.notes)


def test_a_rail_that_moves_though_the_map_holds_it(tmp_path: Path) -> None:
    """A note asks; with its place in the map, in m beside angles in degrees and without an effort, Fx is right."""
    hopper(tmp_path, moves=0.05)
    table = pd.read_csv(tmp_path / "hopper.csv")
    table[["q_hip", "q_knee"]] *= 180.0 / np.pi
    table.to_csv(tmp_path / "degrees.csv", index=False)
    values = edited(RUBBING, {"robot.rows": {"ignore": ["rail"]}, "joints.position.unit": "deg"})
    seen = {"joints.names": ["rail", "hip", "knee"], "joints.position.columns": ["height", "q_hip", "q_knee"]}
    moving, held = (
        estimate(recorded(tmp_path / "degrees.csv", chosen))
        for chosen in (edited(values, {**seen, "joints.held": None}), values)
    )
    right, wrong = (one.observers["force_level"].points["contact"]["Fx"].rmse_outside_fit for one in (moving, held))
    assert right < 0.15
    assert wrong > 2.0 * right
    assert any(re.search(r"contact at 0\.\d+ m/s.*move in its place \(rail\)", str(one)) for one in held.findings)
    assert not any(one.check == "held still" for one in moving.findings)


def bench(folder: Path) -> np.ndarray:
    """Write arm.urdf and bench.csv: a leg shaken on a force plate; return the true force at its tip."""
    text = leg("fixed")
    (folder / "arm.urdf").write_text(text)
    model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    time = np.arange(3000) * 1e-3
    joints = np.column_stack([0.5 * np.sin(9.0 * time), -0.8 + 0.4 * np.sin(11.0 * time)])
    rates = np.gradient(joints, 1e-3, axis=0)
    bends = np.gradient(rates, 1e-3, axis=0)
    tip = np.column_stack([0.6 * np.sin(5.0 * time), 0.3 * np.cos(4.0 * time), 0.5 + 0.4 * np.sin(7.0 * time)])
    q = np.column_stack([np.tile([0, 0, 0, 0, 0, 0, 1], (len(time), 1)), joints])
    v, a = (np.pad(values, ((0, 0), (6, 0))) for values in (rates, bends))
    plate = efforts(model, "contact", q, v, a, tip)[:, :6]
    columns = {"t": time, "hip": joints[:, 0], "knee": joints[:, 1]}
    names = ("fx", "fy", "fz", "mx", "my", "mz")
    columns |= {name: -plate[:, k] for k, name in enumerate(names)}  # a load cell shows the force on itself
    columns |= {f"tip_f{axis}": tip[:, k] for k, axis in enumerate("xyz")}
    pd.DataFrame(columns).to_csv(folder / "bench.csv", index=False)
    return tip


def test_a_load_cell_as_known_input_and_as_truth(tmp_path: Path) -> None:
    """Without any joint torque: the plate's wrench gives the force at the tip, and the force at the plate is found."""
    tip = bench(tmp_path)
    values = {
        "robot": {"urdf": "arm.urdf", "points": ["contact"]},
        "base": {"held": True},
        "joints": {"names": ["hip", "knee"], "position": {"columns": ["hip", "knee"]}},
        "known": {"plate": {"columns": ["fx", "fy", "fz", "mx", "my", "mz"], "sign": -1}},
        "check": {"wrench": {"columns": ["tip_fx", "tip_fy", "tip_fz"], "point": "contact"}},
        "observer": {"gain": 500},
    }
    found = estimate(recorded(tmp_path / "bench.csv", values))
    error = found.estimates["force_level"].force[50:, 0] - tip[50:-1]
    assert np.sqrt(np.mean(error**2)) < 0.02
    assert "rows of hip, knee are not believed" in " ".join(found.notes)
    truth = values | {
        "robot": {"urdf": "arm.urdf", "wrenches": ["base_link"]},
        "known": {"push": {"columns": ["tip_fx", "tip_fy", "tip_fz"], "frame": "contact", "axes": "world"}},
        "check": {"wrench": {"columns": ["fx", "fy", "fz", "mx", "my", "mz"], "sign": -1, "point": "base_link"}},
    }
    other = estimate(recorded(tmp_path / "bench.csv", truth))
    for score in other.observers["force_level"].points["base_link"].values():
        assert score.r2 is None or score.r2 > 0.985  # what nobody measured is believed to a tenth
