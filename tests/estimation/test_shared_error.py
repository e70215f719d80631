"""Errors that all rows share, as of masses or of drifting efforts, and look like a force at a hand or at feet."""

# Masses off by a tenth put 68 to 90 % of Fz beyond five deviations, efforts that drift by a tenth 40 to 49 %.

import re
import sysconfig
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from support.further import further
from support.recorded import edited, recorded
from support.robot_parts import channels, efforts, joint, link
from support.walking_log import table, table_map, urdf, walk

from aerobat_pin.estimation import Result, estimate
from aerobat_pin.forces.row_errors import SharedError, shown_without_any_quarter
from aerobat_pin.numerics import Array

ROBOTS = Path(sysconfig.get_path("purelib"), "cmeel.prefix", "share", "example-robot-data", "robots")
URDF, HAND = ROBOTS / "panda_description" / "urdf" / "panda.urdf", "panda_hand"
JOINTS = [f"panda_joint{k}" for k in range(1, 8)]
MIDDLE, COULOMB = np.array([0.0, 0.2, 0.0, -1.7, 0.0, 1.8, 0.5]), np.array([0.9, 0.9, 0.75, 0.75, 0.36, 0.3, 0.24])
SECONDS, RATE = 20.0, 250.0
with_robots = pytest.mark.skipif(not URDF.is_file(), reason="pip install 'aerobat-pinocchio[robots]' brings the arm")


def pushed(
    folder: Path, seed: int, masses: float = 1.0, hand: float = 1.0, drift: float = 0.0, rotors: float = 0.0
) -> tuple[Result, Array]:
    """Return what is found of a Panda pushed twice, and the true force: masses, hand, drifting efforts, rotors."""
    rng, model = np.random.default_rng(seed), pin.buildModelFromUrdf(str(URDF))
    time, n = np.arange(round(SECONDS * RATE)) / RATE, len(JOINTS)
    q, v, a = np.zeros((3, len(time), model.nv))
    q[:, :n] = MIDDLE
    for pace, share in ((1.3, 0.45), (0.48, 0.4), (2.5, 0.12)):
        rate, size = pace * rng.uniform(0.75, 1.3, n), share * rng.uniform(0.5, 0.9, n)
        angle = rate * time[:, None] + rng.uniform(0.0, 6.28, n)
        q[:, :n] += size * np.sin(angle)
        v[:, :n] += size * rate * np.cos(angle)
        a[:, :n] -= size * rate**2 * np.sin(angle)
    force = np.zeros((len(time), 3))
    for begin, length in ((4.0, 2.5), (15.0, 2.0)):
        rises = np.sin(np.pi * np.clip((time - begin) / length, 0.0, 1.0)) ** 2
        force += 20.0 * rises[:, None] * (way := rng.standard_normal(3)) / np.linalg.norm(way)
    true = model.copy()
    for k in range(1, model.njoints):
        factor = masses * (hand if k == model.getJointId(JOINTS[-1]) else 1.0)
        true.inertias[k] = pin.Inertia.FromDynamicParameters(factor * model.inertias[k].toDynamicParameters())
    tau = efforts(true, HAND, q, v, a, force)[:, :n]
    tau += COULOMB * (np.tanh(v[:, :n] / 0.01) + 0.4 * v[:, :n]) + rotors * a[:, :n]
    tau = tau * (1.0 + drift * time / SECONDS)[:, None] + 0.03 * rng.standard_normal(tau.shape)
    rates = v[:, :n] + 1e-3 * rng.standard_normal(tau.shape)
    table = {f"{part}{k}": x[:, k] for part, x in {"q": q, "v": rates, "tau": tau}.items() for k in range(n)}
    pd.DataFrame({"t": time, **table}).to_csv(folder / "arm.csv", index=False)
    chosen = {
        "robot": {"urdf": str(URDF), "root": "fixed", "points": [HAND]},
        "log": {"time": {"column": "t", "unit": "s"}},
        "joints": {"names": JOINTS, "held": {"*": 0.0}}
        | channels(range(n), position="q{}", velocity="v{}", effort="tau{}"),
        "observer": {"gain": 100.0},
    }
    return estimate(recorded(folder / "arm.csv", chosen)), 0.5 * (force[1:] + force[:-1])


def beyond(result: Result, force: Array, deviations: float) -> float:
    """Return the largest share of the samples of an axis whose error is beyond so many deviations."""
    found = next(iter(result.estimates.values()))
    assert found.standard_deviation is not None
    ratio = np.abs(found.components - force) / found.standard_deviation
    return float(np.mean(ratio[found.time[:-1] > 0.5] > deviations, axis=0).max())


@with_robots
@pytest.mark.parametrize(
    "wrong", [{"masses": 1.1}, {"drift": 0.1}, *further({"masses": 0.9}, {"drift": -0.1})], ids=str
)
def test_masses_and_efforts_that_are_off_by_a_tenth_are_in_deviations(wrong: dict[str, float], tmp_path: Path) -> None:
    """At most one sample in a hundred of any axis is beyond five deviations: 36 to 52 before."""
    result, force = pushed(tmp_path, 1, **wrong)
    assert beyond(result, force, 5.0) < 0.01


@with_robots
def test_a_hand_that_is_heavier_than_its_file_is_said_to_be_untested(tmp_path: Path) -> None:
    """Nothing tells a tenth of it from a force: three of five samples are beyond three deviations, and it is said."""
    result, force = pushed(tmp_path, 2, hand=1.1)
    assert beyond(result, force, 3.0) > 0.5
    said = re.search("masses of all links: .* would look like (.*?) N of panda_hand.Fz, where [+]-0[.]", result.verdict)
    assert said is not None
    assert 0.8 < float(said[1]) < 1.5  # what it does


@with_robots
def test_an_arm_that_is_as_its_file_says_states_what_it_did(tmp_path: Path) -> None:
    """Its deviations are those of before, and nothing is beyond three of them."""
    result, force = pushed(tmp_path, 1)
    found = next(iter(result.stored.values()))
    assert found.deviation == pytest.approx([0.419, 0.397, 0.442], rel=0.02)
    assert beyond(result, force, 3.0) < 0.01
    assert not [finding for finding in result.findings if finding.warns]


@with_robots
def test_rotors_are_no_errors_of_masses(tmp_path: Path) -> None:
    """Of masses that are off by 3 % they made many times as much: a deviation of 4.4 N along z, where 1.7 is wrong."""
    result, force = pushed(tmp_path, 1, masses=1.03, rotors=0.3)
    assert max(next(iter(result.stored.values())).deviation) < 1.7
    assert beyond(result, force, 3.0) < 0.01


def test_masses_that_err_one_by_one_are_in_the_deviations_of_feet(tmp_path: Path) -> None:
    """At most one sample in thirty of an axis is beyond five deviations, 29 in 100 before; good logs keep theirs."""
    walked, rng, errors = walk(6.0), np.random.default_rng(3), np.random.default_rng(1003)
    log, found = table(walked), dict[str, Result]()

    def wrong(link: re.Match[str]) -> str:
        factor = 1.0 + 0.1 * errors.standard_normal()
        return re.sub('(ixx|iyy|izz|mass value)="(.*?)"', lambda one: f'{one[1]}="{factor * float(one[2])}"', link[0])

    noise = rng.standard_normal(walked.tau.shape)
    for k, name in enumerate(walked.joints):
        log[f"{name}_tau"] += 0.1 * noise[:, k] + 0.2 * np.tanh(walked.v[:, 6 + k] / 0.02)
        log[f"{name}_vel"] += 1e-3 * rng.standard_normal(len(log))
    log.to_csv(tmp_path / "walk.csv", index=False)
    changes = {"check": None, "log.time.column": "t", "observer.gain": 100.0}
    force = walked.force.reshape(len(log), -1)
    for name, text in (("right", urdf()), ("wrong", re.sub("<inertial>.*?</inertial>", wrong, urdf()))):
        (tmp_path / f"{name}.urdf").write_text(text)
        chosen = edited(table_map(Path(f"{name}.urdf")), changes)
        found[name] = estimate(recorded(tmp_path / "walk.csv", chosen), ["force_level"])
        assert beyond(found[name], 0.5 * (force[1:] + force[:-1]), 5.0) < 0.03
    right, wrong_ones = (next(iter(one.stored.values())).component_sizes()[2].deviation for one in found.values())
    assert right == pytest.approx(0.60, rel=0.05)
    assert wrong_ones is not None
    assert wrong_ones > 1.4


def found_beside_forces(c: Array, rng: np.random.Generator, push: float = 0.0) -> SharedError:
    """Return what five rows that a force moves show of errors c (3,) of links, the last of which looks like a force."""
    m, k = 400, 5
    weights = np.array([8.0, 20.0, 5.0, 2.0, 1.0])[:, None] * (1.0 + 0.3 * rng.standard_normal((m, k, 3)))
    force = 30.0 * rng.standard_normal((m, 3, k))
    weights[..., 2] = 0.1 * force[:, 0]
    friction = np.sign(rng.standard_normal((m, k, 1))) * np.eye(k)
    y = np.einsum("mck,mc->mk", force, 0.3 * rng.standard_normal((m, 3))) + friction @ np.full(k, 0.5)
    y += weights @ c + 0.1 * rng.standard_normal((m, k))
    y[: m // 4] += push * rng.standard_normal(k)
    columns = np.concatenate([weights, friction], axis=2)
    return shown_without_any_quarter(columns, y, force, np.full((m, k), 0.01), np.eye(3)[None])


def test_how_far_masses_are_off_follows_from_those_that_forces_do_not_hide() -> None:
    """They are found as they are, hidden ones as large; nothing is where there are none, or a push lasts a quarter."""
    rng = np.random.default_rng(6)
    found = found_beside_forces(np.array([0.1, -0.05, 0.08]), rng)
    np.testing.assert_allclose(found.deviation[:2], [0.1, 0.05], rtol=0.05)
    assert 0.05 < found.deviation[2] < 0.12
    np.testing.assert_allclose(found.untested, [0.0, 0.0, 0.1], atol=0.01)
    far = replace(found_beside_forces(np.array([0.3, -0.4, 0.3]), rng), carried=50.0)
    assert far.size > 0.2
    of_weight = np.sqrt(far.by_weight**2 - far.deviation**2)
    np.testing.assert_allclose(of_weight, 0.1 * 50.0, rtol=1e-9, err_msg="nobody is a third wrong of a robot's weight")
    for push in (0.0, 5.0):
        assert not found_beside_forces(np.zeros(3), rng, push).deviation.any()


def test_what_wheels_bear_is_no_error_of_their_masses(tmp_path: Path) -> None:
    """A pendulum between two wheels: its moment needs nothing, so such a row has the error of its noise."""
    parts, mass, low, inertia = [link("base", 8.0, "0 0 -0.3", 3 * [0.1])], 8.0, 0.3, 0.1
    for name, y in (("left", 0.2), ("right", -0.2)):
        parts += [link(name, 1.0, "0 0 0", 3 * [2e-3]), joint(f"{name}_axle", "revolute", "base", name, f"0 {y} 0")]
    (tmp_path / "hung.urdf").write_text(f'<robot name="hung">{"".join(parts)}</robot>')
    rng, dt, theta, rate, swing = np.random.default_rng(4), 2e-3, 0.6, 0.0, list[list[float]]()
    for _ in range(4000):  # by the leapfrog rule
        half = rate - 0.5 * dt * mass * 9.81 * low * np.sin(theta) / (inertia + mass * low**2)
        swing.append([theta, rate])
        theta += dt * half
        rate = half - 0.5 * dt * mass * 9.81 * low * np.sin(theta) / (inertia + mass * low**2)
    angle, speed = np.array(swing).T
    spin = -mass * 9.81 * low * np.sin(angle) / (inertia + mass * low**2)
    zero, ahead = 0.0 * angle, low * (np.sin(angle) * speed**2 - np.cos(angle) * spin)
    upward = low * (np.cos(angle) * speed**2 + np.sin(angle) * spin)
    table = {"t": dt * np.arange(4000), "qx": zero, "qy": np.sin(0.5 * angle), "qz": zero, "qw": np.cos(0.5 * angle)}
    values = {"x": zero, "y": zero, "z": zero, "vx": zero, "vy": zero, "vz": zero, "wx": zero, "wy": speed, "wz": zero}
    table |= {name: one + (2e-4 if name in "xyz" else 3e-3) * rng.standard_normal(4000) for name, one in values.items()}
    for name in ("left", "right"):
        noise = 1e-3 * rng.standard_normal((3, 4000))
        table |= {f"{name}_q": -angle + noise[0], f"{name}_v": -speed + noise[1], f"{name}_e": noise[2]}
    pd.DataFrame(table).to_csv(tmp_path / "log.csv", index=False)
    names = ["left_axle", "right_axle"]
    chosen = {
        "robot": {"urdf": "hung.urdf", "root": "free_flyer", "points": ["left", "right"]},
        "log": {"time": {"column": "t"}},
        "base": channels("xyz", position="{}", velocity="v{}", rate="w{}") | channels("xyzw", quaternion="q{}"),
        "joints": {"names": names, **channels(["left", "right"], position="{}_q", velocity="{}_v", effort="{}_e")},
        "observer": {"gain": 100.0},
    }
    result = estimate(recorded(tmp_path / "log.csv", chosen))
    assert not [one for one in result.findings if one.warns]
    assert result.observers["force_level"].k < 1.5
    half = 0.5 * np.column_stack([mass * ahead, mass * upward + 10.0 * 9.81])  # of each wheel, along x and z
    middle = 0.5 * (half[1:] + half[:-1])
    found = result.estimates["force_level"]
    late = found.time[:-1] > 0.1
    for one in ("left", "right"):
        for axis, truth in zip("xz", middle.T, strict=True):
            error = found.component(f"{one}.F{axis}") - truth
            k = found.identifiability.components.index(f"{one}.F{axis}")
            assert found.standard_deviation[late, k].mean() < 7.0
            assert np.mean(np.abs(error) < 2.0 * found.standard_deviation[:, k], where=late) > 0.95
