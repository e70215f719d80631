"""Forces on the feet of a trotting Go2 without motion capture: the tables of docs/legs.md. Some minutes."""

import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pinocchio as pin
from support.pages import Values, measured, run
from support.pages import table as laid_out
from trot import FAST_TROT, ROBOT, TROT, WALK, Gait, Walked, feet_of, walked

from aerobat_pin import estimate, load_robot, open_record
from aerobat_pin.forces.contacts import contact_probability, touching
from aerobat_pin.numerics import Array
from aerobat_pin.observers import low_passed
from aerobat_pin.records import parse_map

GAINS = (100.0, 200.0, 500.0, 1000.0)
BASES = {"measured": "motion capture", "imu": "IMU", "joints": "joint rows alone"}
DURATION = 42.0  # [s] of the trot; the other gaits have three tenths of it
SEEDS = range(31, 39)  # of other sensors: biases, factors and noise, by which deviations are judged
SETTLED = 1.0  # [s] after the start, in which the robot stands
LONGEST_LATE = 0.06  # [s] between a touchdown and the one that is found for it
PUSHES = (0.0, 12.0, 25.0)  # [N] on the trunk
# Standard deviations of what the sensors have beside the truth.
TORQUE, FACTOR = 0.1, 0.03  # white noise [N m], error of each joint's factor
JOINT = (2e-4, 0.02)  # white noise of angle [rad] and rate [rad/s]
GYRO, ACCELEROMETER = (3e-3, 2e-3), (0.06, 0.05)  # white noise and bias [rad/s], [m/s2]
TILT, TURN = np.radians(0.3), 3e-4  # [rad]: constant, of the IMU alone; white noise
MOCAP = (1e-4, 3e-4)  # white noise of position [m] and velocity [m/s]
TRUE_CONTACT = 0.02  # of the weight: a foot that carries more touches the ground; before that it scrapes


def sensed(walk: Walked, seed: int = 1) -> pd.DataFrame:
    """Return what the sensors show, one row each 2 ms; the accelerometer's samples are means of the interval before."""
    rng, count = np.random.default_rng(seed), len(walk.time)

    def white(size: float, columns: int = 3) -> Array:
        return np.asarray(size * rng.standard_normal((count, columns)))

    R = np.array([pin.Quaternion(q[3:7]).matrix() for q in walk.q])
    tilt = pin.exp3(TILT * np.array([*rng.choice([-1.0, 1.0], 2), 0.0]))
    seen = {"i": np.array([tilt @ one @ pin.exp3(turn) for one, turn in zip(R, white(TURN), strict=True)])}
    seen["m"] = np.array([one @ pin.exp3(turn) for one, turn in zip(R, white(TURN), strict=True)])
    columns: dict[str, Array] = {"t": walk.time}
    for name, attitude in seen.items():
        turns = np.array([pin.Quaternion(one).coeffs() for one in attitude])
        columns |= {f"{name}q{axis}": turns[:, k] for k, axis in enumerate("xyzw")}
    speed = np.einsum("nij,nj->ni", R, walk.v[:, :3]) + white(MOCAP[1])
    place = walk.q[:, :3] + white(MOCAP[0])
    gyro = walk.v[:, 3:6] + white(GYRO[0]) + GYRO[1] * rng.standard_normal(3)
    felt = walk.felt + white(ACCELEROMETER[0]) + ACCELEROMETER[1] * rng.standard_normal(3)
    for name, values in (("p", place), ("v", speed), ("w", gyro), ("a", felt)):
        columns |= {f"{name}{axis}": values[:, k] for k, axis in enumerate("xyz")}
    angle, rate = walk.q[:, 7:] + white(JOINT[0], 12), walk.v[:, 6:] + white(JOINT[1], 12)
    effort = walk.tau * (1.0 + FACTOR * rng.standard_normal(12)) + white(TORQUE, 12)
    for name, values in (("q", angle), ("dq", rate), ("tau", effort)):
        columns |= {f"{name}{k}": values[:, k] for k in range(12)}
    return pd.DataFrame(columns)


def mapped(base: str, gain: float) -> dict[str, Any]:
    """Return the map of the table, for a source of the base's motion."""
    model = load_robot(ROBOT).model

    def axes(name: str, letters: str = "xyz") -> dict[str, Any]:
        return {"columns": [f"{name}{letter}" for letter in letters]}

    parts = {
        "measured": {"position": axes("p"), "quaternion": axes("mq", "xyzw"), "velocity": axes("v"), "rate": axes("w")},
        "imu": {"quaternion": axes("iq", "xyzw"), "rate": axes("w"), "acceleration": axes("a") | {"delay": 0.001}},
        "joints": {"quaternion": axes("iq", "xyzw"), "rate": axes("w")},
    }
    names = {"position": "q", "velocity": "dq", "effort": "tau"}
    numbered = {part: {"columns": [f"{name}{k}" for k in range(12)]} for part, name in names.items()}
    return {
        "robot": {"name": ROBOT, "points": list(feet_of(model))},
        "log": {"time": {"column": "t"}},
        "base": {"from": base, "imu": {"tilt": 0.3}} | parts[base],
        "joints": {"names": model.names.tolist()[2:]} | numbered,
        "observer": {"gain": gain},
    }


Estimated = tuple[Array, Array, Array, bool]


def estimated(table: pd.DataFrame, base: str, gain: float) -> Estimated:
    """Return times (m + 1,), forces (m, 4, 3), their deviations, and whether a push elsewhere is said, of a table."""
    with tempfile.TemporaryDirectory() as name:
        table.to_csv(Path(name) / "log.csv", index=False)
        record = open_record(Path(name) / "log.csv", parse_map(mapped(base, gain), "of the trot"), Path(name))
        result = estimate(record, trust=True)
    found = result.estimates["force_level"]
    said = any("forces elsewhere, a moment, or a wrong model" in line for line in result.warnings)
    return found.time, found.force, found.standard_deviation.reshape(found.force.shape), said


def quasi_static(table: pd.DataFrame, walk: Walked, gain: float) -> Array:
    """Return F = (J^T)^-1 (g - tau) of each leg, low-passed like an observer: forces (m, 4, 3) of a robot at rest."""
    model = load_robot(ROBOT).model
    data, frames = model.createData(), [model.getFrameId(foot) for foot in feet_of(model)]
    q = np.column_stack([walk.q[:, :3], table[["iqx", "iqy", "iqz", "iqw"]], table[[f"q{k}" for k in range(12)]]])
    tau = table[[f"tau{k}" for k in range(12)]].to_numpy()
    found, step = np.zeros((len(q) - 1, 12)), float(walk.time[1] - walk.time[0])
    for k in range(len(found)):
        pin.computeJointJacobians(model, data, q[k + 1])
        pin.updateFramePlacements(model, data)
        gravity = pin.computeGeneralizedGravity(model, data, q[k + 1])
        for foot, frame in enumerate(frames):
            leg, rows = slice(3 * foot, 3 * foot + 3), slice(6 + 3 * foot, 9 + 3 * foot)
            J = pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)[:3, rows]
            found[k, leg] = np.linalg.solve(J.T, gravity[rows] - tau[k + 1, leg])
    return low_passed(found, 1.0 - np.exp(-gain * step)).reshape(-1, 4, 3)


def r_squared(true: Array, found: Array) -> Array:
    """Return R2 of each column of (m, ...) series."""
    return np.asarray(1.0 - np.sum((found - true) ** 2, axis=0) / np.sum((true - true.mean(axis=0)) ** 2, axis=0))


def contact_row(words: str, walk: Walked, force: Array, weight: float) -> list[str]:
    """Return a row of how contacts that are found agree with the true ones, over all feet."""
    delays: dict[bool, list[float]] = {True: [], False: []}  # of touchdowns, of lift-offs
    false = lost = events = 0
    agree, inside = [], walk.time[:-1] > SETTLED
    for foot in range(4):
        true = walk.force[:, foot, 2] > TRUE_CONTACT * weight
        on = touching(force[:, foot, 2], weight)
        agree.append(np.mean((true == on)[inside]))
        for down, kept in delays.items():
            real, seen = (walk.time[1:-1][np.diff((one == down).astype(int)) > 0] for one in (true, on))
            real, seen = real[real > SETTLED], seen[seen > SETTLED - LONGEST_LATE]
            near = [seen[np.argmin(np.abs(seen - t))] - t if len(seen) else np.inf for t in real]
            good = [late for late in near if abs(late) < LONGEST_LATE]
            kept += good
            if down:
                events += len(real)
                lost += len(real) - len(good)
                false += sum(np.min(np.abs(real - t), initial=np.inf) >= LONGEST_LATE for t in seen[seen > SETTLED])
    down, up = (1e3 * np.array(late) for late in delays.values())
    within, lift = np.percentile(np.abs(down), 90.0), np.median(up) if len(up) else np.nan
    late = [f"{np.median(down):+.0f}", f"{within:.0f}", f"{lift:+.0f}"]
    return [words, f"{events}", *late, f"{false}", f"{lost}", f"{np.mean(agree):.3f}"]


def cut(walk: Walked, time: Array) -> Walked:
    """Return a walk at the intervals of an estimate, by its times (m + 1,) [s]."""
    first = int(np.argmin(np.abs(walk.time - time[0])))
    return replace(walk, time=time, force=walk.force[first : first + len(time) - 1])


def force_rows(walk: Walked, table: pd.DataFrame, found: dict[tuple[str, float], Estimated]) -> Iterator[list[str]]:
    """Yield the rows of the table of R2: of each foot's Fz and of horizontal forces, and the rms error."""
    forces = [
        (f"{BASES[base]}, K {gain:g}", cut(walk, time), force) for (base, gain), (time, force, *_) in found.items()
    ]
    forces += [
        (f"quasi-static, low-pass {gain:g} 1/s", walk, quasi_static(table, walk, gain)) for gain in (500.0, 100.0)
    ]
    for words, true, force in forces:
        inside = true.time[:-1] > SETTLED
        r2 = r_squared(true.force[inside], force[inside])
        rms = np.sqrt(np.mean((force[inside] - true.force[inside]) ** 2, axis=(0, 1)))
        across = (f"{r2[:, k].mean():.2f}" for k in (0, 1))
        yield [words, *(f"{value:.4f}" for value in r2[:, 2]), *across, f"{rms[2]:.2f}"]


def cover(walk: Walked, base: str, seed: int) -> Array:
    """Return the share (3,) within two deviations, and how right the probability of contact is (2,)."""
    time, force, deviation, _ = estimated(sensed(walk, seed), base, 500.0)
    walk, weight, inside = cut(walk, time), load_robot(ROBOT).weight, time[:-1] > SETTLED
    within = np.mean(np.abs(force - walk.force)[inside] < 2.0 * deviation[inside], axis=(0, 1))
    likely = contact_probability(force[inside, :, 2], deviation[inside, :, 2], weight)
    true = walk.force[inside, :, 2] > TRUE_CONTACT * weight
    return np.array([*within, np.mean((likely - true) ** 2), np.mean(true[likely > 0.95])])


def gait_row(gait: Gait, walk: Walked) -> list[str]:
    """Return the row of another gait, by the IMU."""
    time, force, *_ = estimated(sensed(walk), "imu", 500.0)
    walk, weight = cut(walk, time), load_robot(ROBOT).weight
    inside = walk.time[:-1] > SETTLED
    r2 = r_squared(walk.force[inside], force[inside])[:, 2]
    _, events, touchdown, _, _, false, lost, _ = contact_row("", walk, force, weight)
    speeds = ", ".join(f"{speed:g}" for speed in gait.speeds)
    return [gait.name, speeds, f"{r2.min():.3f} to {r2.max():.3f}", touchdown, false, f"{lost} of {events}"]


def said_row(gait: Gait) -> list[str]:
    """Return how often a push at the trunk is said, in a line for its gait, of eight sets of sensors for each size."""
    cells = [gait.name]
    for push in PUSHES:
        walk = walked(replace(gait, push=push), 0.3 * DURATION)
        said = [[estimated(sensed(walk, seed), base, 500.0)[3] for seed in SEEDS] for base in ("imu", "measured")]
        cells.append(", ".join(f"{sum(one)} of {len(one)}" for one in said))
    return cells


def find() -> Values:
    """Return the tables of the page."""
    weight, pushed = load_robot(ROBOT).weight, replace(TROT, name="trot, trunk pushed", push=25.0)
    gaits, cases = (TROT, FAST_TROT, WALK, pushed), [("measured", 500.0), ("joints", 500.0)]
    cases += [("imu", gain) for gain in GAINS]
    with ProcessPoolExecutor(4, mp_context=get_context("spawn")) as pool:
        walks = list(pool.map(walked, gaits, [DURATION, *[0.3 * DURATION] * 3]))
        walk, table = walks[0], sensed(walks[0])
        found = dict(zip(cases, pool.map(estimated, repeat(table), *zip(*cases, strict=True)), strict=True))
        others = list(pool.map(gait_row, gaits[1:], walks[1:]))
        said = list(pool.map(said_row, (TROT, FAST_TROT, WALK)))
        draws = [(base, seed) for base in BASES for seed in SEEDS]
        covered = np.stack(list(pool.map(cover, repeat(walk), *zip(*draws, strict=True))))
    contacts, deviations = [], []
    for (base, words), shares in zip(BASES.items(), np.split(covered, len(BASES)), strict=True):
        time, force, *_ = found[base, 500.0]
        contacts.append(contact_row(words, cut(walk, time), force, weight))
        axes = [f"{one.mean():.0%} ({one.min():.0%} to {one.max():.0%})" for one in shares[:, :3].T]
        deviations.append([words, *axes, *(f"{one.mean():.3f}" for one in shares[:, 3:].T)])
    contacts.append(contact_row("quasi-static", walk, quasi_static(table, walk, 500.0), weight))
    onsets = "base | contacts | touchdown [ms] | 90 % within [ms] | lift-off [ms] | false | lost | agree"
    values = {
        "measured": measured(),
        "forces": laid_out("base | FL | FR | RL | RR | Fx | Fy | rms Fz [N]", force_rows(walk, table, found)),
        "contacts": laid_out(onsets, contacts),
        "deviations": laid_out("base | Fx | Fy | Fz | Brier | right above 0.95", deviations),
        "said": laid_out(" | ".join(["gait", *(f"{push:g} N" if push else "no push" for push in PUSHES)]), said),
        "gaits": laid_out("gait | speeds [m/s] | R2 of Fz | touchdown [ms] | false | lost", others),
    }
    return {"docs/legs.md": values}


if __name__ == "__main__":
    run(find)
