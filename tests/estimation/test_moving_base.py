"""An arm on a base that something else moves, as a ship does: by an IMU at the base its forces are right; an orbit."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from support.recorded import edited, recorded
from support.robot_parts import by_axis, channels, joint, link
from support.six_joints import SIX, six_joints, six_map

from aerobat_pin import estimate

AXES = "xyz"


def on_a_ship(folder: Path) -> None:
    """Write six seconds of an arm that nothing touches, on a deck that accelerates by up to 1 m/s2, and its URDF."""
    (folder / "six.urdf").write_text(six_joints())
    model, rng, time = pin.buildModelFromXML(six_joints()), np.random.default_rng(1), np.arange(1200) / 200.0
    data, speed, size = model.createData(), rng.uniform(1.0, 2.8, 6), np.array([0.5, 0.3, 0.35, 0.4, 0.5, 0.6])
    angle = speed * time[:, None]
    q, v, a = size * np.sin(angle) + [0.0, 0.6, 0.9, -0.5, 0.4, 0.0], size * speed * np.cos(angle), -size * speed**2
    a = a * np.sin(angle)
    deck = np.stack([np.sin(0.9 * time), 0.8 * np.cos(0.7 * time), 0.8 * np.sin(1.1 * time)], axis=1)
    torque = np.empty_like(q)
    for k, moved in enumerate(deck):
        model.gravity.linear = np.array([0.0, 0.0, -9.81]) - moved
        torque[k] = pin.rnea(model, data, q[k], v[k], a[k])
    columns = {"t": time, "qx": 0.0 * time, "qy": 0.0 * time, "qz": 0.0 * time, "qw": 0.0 * time + 1.0}
    columns |= {f"w{axis}": 1e-3 * rng.standard_normal(len(time)) for axis in AXES}
    felt = deck + [0.0, 0.0, 9.81] + 0.02 * rng.standard_normal(deck.shape)
    columns |= {f"a{axis}": felt[:, k] for k, axis in enumerate(AXES)}
    for k, name in enumerate(SIX):
        columns |= {f"{name}_q": q[:, k], f"{name}_v": v[:, k] + 1e-3 * rng.standard_normal(len(time))}
        columns[f"{name}_i"] = torque[:, k] + 0.05 * rng.standard_normal(len(time))
    pd.DataFrame(columns).to_csv(folder / "ship.csv", index=False)


def test_an_arm_on_a_ship_needs_its_imu(tmp_path: Path) -> None:
    """Fixed, it is wrong by newtons; by the IMU it is not, and no weight is asked for. A map without is told so."""
    on_a_ship(tmp_path)
    fixed = edited(six_map(), {"log.time.column": "t", "observer.gain": 50.0, "joints.friction": None})
    names = {"quaternion": ("qx", "qy", "qz", "qw"), "rate": ("wx", "wy", "wz"), "acceleration": ("ax", "ay", "az")}
    base = {"from": "imu", **{name: {"columns": list(columns)} for name, columns in names.items()}}
    free = edited(fixed, {"robot.root": "free_flyer", "robot.rows.ignore": ["base"], "base": base})
    errors = []
    for chosen in (fixed, free):
        result = estimate(recorded(tmp_path / "ship.csv", chosen))
        found = result.estimates["force_level"]
        errors.append(np.sqrt(np.mean(found.components[100:] ** 2)))
    assert errors[0] > 1.0
    assert errors[1] < 0.3 * errors[0]
    assert np.mean(np.abs(found.components[100:]) < 2.0 * found.standard_deviation[100:]) > 0.95
    assert not any(finding.check == "mean force" for finding in result.findings)
    result = estimate(recorded(tmp_path / "ship.csv", edited(free, {"robot.rows": None})), trust=True)
    (finding,) = (one for one in result.findings if one.check == "mean force")
    assert 'robot.rows = {ignore = ["base"]}' in finding.text


@pytest.mark.parametrize("gravity", [0.0, 1e-3])
def test_nothing_is_compared_with_gravity_in_an_orbit(gravity: float, tmp_path: Path) -> None:
    """A body with an accelerometer tumbles head down and is pushed for half of the time: no word of its weight."""
    rng, time, mass, push = np.random.default_rng(2), np.arange(800) / 100.0, 10.0, np.array([0.6, 0.0, -0.9])
    turns = Rotation.from_rotvec([2.6, 0.0, 0.0]) * Rotation.from_rotvec(0.1 * time[:, None] * [1.0, -2.0, 0.5])
    force = push * (time > 4.0)[:, None]
    place = 0.5 * push / mass * np.maximum(time - 4.0, 0.0)[:, None] ** 2
    felt = turns.inv().apply(force / mass)
    columns = {"t": time} | {f"q{axis}": turns.as_quat()[:, k] for k, axis in enumerate("xyzw")}
    for name, values, noise in (("p", place, 1e-5), ("w", 0.0 * place + [0.1, -0.2, 0.05], 1e-4), ("a", felt, 0.01)):
        noisy = values + noise * rng.standard_normal(values.shape)
        columns |= {f"{name}{axis}": noisy[:, k] for k, axis in enumerate(AXES)}
    pd.DataFrame(columns).to_csv(tmp_path / "orbit.csv", index=False)
    values = {
        "robot": {"body": {"mass": mass, "inertia": [0.4, 0.4, 0.4]}, "points": ["body"], "gravity": gravity},
        "log": {"time": {"column": "t"}},
        "base": by_axis(position="p{}", rate="w{}", quaternion="q{}") | {"velocity": {"from": "pose", "window": 0.2}},
        "check": {"specific_force": {"columns": ["ax", "ay", "az"]}},
        "observer": {"names": ["force_level"], "gain": 10.0},
    }
    result = estimate(recorded(tmp_path / "orbit.csv", values))
    assert not any(finding.warns for finding in result.findings)
    np.testing.assert_allclose(result.estimates["force_level"].force[600:, 0].mean(axis=0), push, atol=0.05)


def ball_in_orbit(tumbles: bool = True, jets: float = 1.0) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Return table and map of a ball that tumbles or spins, nobody knows why, moved by jets, logged in its axes."""
    time, mass, rates, spin = np.arange(800) / 100.0, 10.0, np.array([1.3, 0.9, 1.7]), np.array([0.3, -0.6, 0.2])
    other = spin[::-1] * tumbles
    first, then = (Rotation.from_rotvec(time[:, None] * axis) for axis in (spin, other))
    turns, size = first * then, jets * np.array([6.0, 5.0, 8.0])
    felt = size * np.sin(rates * time[:, None])
    columns = {"t": time} | {f"q{axis}": turns.as_quat()[:, k] for k, axis in enumerate("xyzw")}
    for name, values in (
        ("p", -felt / (mass * rates**2)),
        ("v", -size * np.cos(rates * time[:, None]) / (mass * rates)),
        ("w", then.inv().apply(spin) + other),
        ("f", turns.inv().apply(felt)),
    ):
        columns |= {f"{name}{axis}": values[:, k] for k, axis in enumerate(AXES)}
    return pd.DataFrame(columns), {
        "robot": {"body": {"mass": mass, "inertia": [0.4, 0.4, 0.4]}, "points": ["body"], "gravity": 0.0},
        "log": {"time": {"column": "t"}},
        "base": channels(AXES, position="p{}", velocity="v{}", rate="w{}") | channels([*AXES, "w"], quaternion="q{}"),
        "known": {"jets": {"columns": ["fx", "fy", "fz"], "law": "wrench", "frame": "body", "axes": "frame"}},
        "observer": {"names": ["force_level"], "gain": 10.0},
    }


@pytest.mark.parametrize(
    ("key", "value", "told"),
    [
        ("known.jets.sign", 1, []),
        ("known.jets.sign", -1, [r"known forces against motion: known forces of the other sign .*known.NAME.sign"]),
        ("base.velocity.axes", "body", [r"position against velocity: velocity seems .*base\.velocity\.axes"]),
        ("base.rate.axes", "world", [r"gyro against attitude: gyro seems .*base\.rate\.axes"]),
    ],
)
def test_forces_of_another_sign_and_rates_in_other_axes(key: str, value: Any, told: list[str], tmp_path: Path) -> None:
    table, values = ball_in_orbit()
    found = estimate(recorded(tmp_path / "orbit.csv", edited(values, {key: value}), table=table), trust=True).findings
    warned = [str(finding) for finding in found if finding.warns]
    assert len(warned) == len(told)
    assert all(re.match(*pair) for pair in zip(told, warned, strict=True)), warned


def test_a_push_of_a_fiftieth_of_what_a_ball_weighs_on_earth_is_found_in_an_orbit(tmp_path: Path) -> None:
    """2 N for a second beside jets of 0.8 N: none stood out; what errors there are, the record itself shows."""
    table, values = ball_in_orbit(tumbles=False, jets=0.1)
    time, rng, mass = table["t"].to_numpy(), np.random.default_rng(4), 10.0
    force = 2.0 * ((time > 3.0) & (time < 4.0))
    gained = np.concatenate([[0.0], np.cumsum(force[:-1])]) * 0.01 / mass
    table["vz"] += gained
    table["pz"] += np.concatenate([[0.0], np.cumsum(0.5 * (gained[1:] + gained[:-1]))]) * 0.01
    for axis in AXES:
        table[f"v{axis}"] += 1e-3 * rng.standard_normal(len(time))
        table[f"w{axis}"] += 1e-3 * rng.standard_normal(len(time))
    result = estimate(recorded(tmp_path / "orbit.csv", edited(values, {"observer.names": ["smoother"]}), table=table))
    found = result.estimates["smoother"]
    error = found.force[:, 0] - np.outer(force[:-1], [0.0, 0.0, 1.0])
    assert np.sqrt(np.mean(error**2)) < 0.25, "0.96 N before"
    assert np.mean(np.abs(error) < 2.0 * found.standard_deviation) > 0.93
    assert re.search(r"finds a push at body \(up to .* N upward, at 3\.\d+ s\)", result.verdict), result.verdict


def test_a_weight_whose_parts_are_not_seen_is_not_missed(tmp_path: Path) -> None:
    """A head above two wheels may carry it as well: what is not seen counted as 0, and the weight was expected."""
    wheels, time, rng = ("left", "right"), np.arange(400) / 100.0, np.random.default_rng(3)
    parts = [link("body", 6.0, "0 0 0.3", (0.2, 0.2, 0.05)), link("head"), joint("neck", "fixed", "body", "head")]
    for name, y in zip(wheels, (0.2, -0.2), strict=True):
        parts += [link(name, 0.5, "0 0 0", 3 * [2e-3]), joint(f"{name}_j", "revolute", "body", name, f"0 {y} 0")]
    (tmp_path / "cart.urdf").write_text(f'<robot name="cart">{"".join(parts)}</robot>')
    table = {"t": time, "x": 0.1 * np.sin(time), "vx": 0.1 * np.cos(time), "qw": np.ones(len(time))}
    table |= dict.fromkeys(("y", "z", "qx", "qy", "qz", "vy", "vz", "wx", "wy", "wz"), np.zeros(len(time)))
    for name in wheels:
        table |= {f"{name}_q": np.sin(time), f"{name}_v": np.cos(time)}
        table[f"{name}_e"] = -2e-3 * np.sin(time) + 0.01 * rng.standard_normal(len(time))
    pd.DataFrame(table).to_csv(tmp_path / "log.csv", index=False)
    chosen = {
        "robot": {"urdf": "cart.urdf", "root": "free_flyer", "points": [*wheels, "head"]},
        "log": {"time": {"column": "t"}},
        "base": channels(AXES, position="{}", velocity="v{}", rate="w{}") | channels([*AXES, "w"], quaternion="q{}"),
        "joints": channels(wheels, position="{}_q", velocity="{}_v", effort="{}_e"),
        "observer": {"gain": 20.0},
    }
    chosen["joints"]["names"] = [f"{name}_j" for name in wheels]
    result = estimate(recorded(tmp_path / "log.csv", chosen), trust=True)
    assert [each.verdict for each in result.findings if each.check == "mean force"] == ["good"]
