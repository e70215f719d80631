"""Print what the logs of five arms show that nobody here has seen, if they are here; what is checked, if they are not.

    AEROBAT_RECORDINGS=FOLDER python docs/scripts/strange_arms.py

FOLDER holds clones of github.com/shamilmamedov/dynamic_calibration, github.com/liuyurong129/figaroh_kinova and
github.com/thanhndv212/figaroh-examples (no licence stated for these data: read them, do not pass them on),
github.com/aspectum/ur3-force-estimation (MIT) and github.com/marcocognetti/FrankaEmikaPandaDynModel (GPL 3).

A UR10E swings for 50 s, alone and with 2.805 kg that sit 0.165 m beside its tool. From one loaded log, of which the mass
is known, `calibrate` finds the torque per ampere of all joints and where the load sits. With them, and from nothing
else, `estimate` finds the load of the other log, which sits on the other side. It also seeks it as a force, with what
was learnt and with nothing but one torque per ampere for all joints. In logs of other days nothing touches the arm;
none of them served for any choice of this program.

Nothing touches a UR3, whose bags are those of ROS 1. It rests straight up and then swings; its efforts oppose its
velocities, and its last joint turns on and on, which the robot's file does not allow. One log ends as the arm is stopped
within 30 ms: its last 0.1 s do not count. Factors, friction and errors are learnt from one log and hold for the other.

An AIRBOT Play moves alone, twice, and with 0.48 kg; only angles and torques are recorded. A Staubli TX40 moves fast;
its log has angles and torques of the motors, of which two share a wrist. Its friction was identified by others. A Panda
moves alone, without the hand that its file has, by the stamps of a host that come late; rows repeat.
"""

import os
import sysconfig
import tempfile
from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pinocchio as pin
from scipy.signal import savgol_filter

from aerobat_pin import calibrate, estimate, open_record
from aerobat_pin.estimation import Calibration
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Estimate
from aerobat_pin.records import Record, parse_map

MASS, LIGHTEST, HEAVIEST = 2.805, 2.75, 2.86  # [kg]: weighed, and between which it must be found
LOGS = ("14harm50sec", "15harm50sec")
FREE = (  # in which nothing touches the arm
    *("19_12_23_free", "20_01_31-unload", "20_02_05-20sec_8harm", "20_02_05-20sec_12harm", "20_02_06-20sec_5harm"),
    *("20_02_06-20sec_10harm", "20_02_10-20sec_7harm", "20_02_10-30sec_12harm", "20_02_12-40sec_12harm"),
    *("20_02_12-50sec_12harm", "20_02_19_14harm50sec", "20_02_19_15harm50sec"),
)
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
NOMINAL = 10.0  # [N m/A]: of all joints, from which factors are found
CENTRES = {"14harm50sec": (0.03, 0.16, 0.04), "15harm50sec": (-0.04, -0.16, 0.04)}  # [m] of the load, from tool0
BAGS, UR3_NAMES = ("id1", "id2"), ("Base", "Shoulder", "Elbow", "Wrist 1", "Wrist 2", "Wrist 3")
MOST_SHOWN, STOP = 20.0, 0.1  # [N] where nothing touches, and [s] at the end that do not count
GRAVITY = np.array([0.0, 0.0, 9.81])
AIRBOT_LOGS, AIRBOT_LOAD = ("chirp_motion", "trapezoidal_motion", "chirp_motion_loaded"), 0.48  # [kg]
GEARS, OFFSETS = np.array([32.0, 32.0, 45.0, -48.0, 45.0, 32.0]), {"joint_2": -np.pi / 2, "joint_3": np.pi / 2}
TX40_FRICTION = {"coulomb": (7.14, 8.26, 6.34, 2.48), "viscous": (8.05, 5.53, 1.97, 1.11)}  # as identified by others
PANDA_LOG = Path("matlab", "data", "Exciting_Traj", "Trajectory_1", "rbt_log")
PANDA = Path(sysconfig.get_path("purelib"), "cmeel.prefix", "share", "example-robot-data", "robots") / (
    "panda_description/urdf/panda.urdf"
)
LETTERS = {"position": "q", "velocity": "v", "effort": "i"}


def table(clone: Path, name: str, folder: Path) -> Path:
    """Write a log with a head and without its damaged rows; its columns are time, q, v and i of six joints, and others."""
    rows = pd.read_csv(clone / "dataset_ur10e" / "identification_data" / f"ur-{name}.csv", header=None)
    rows = rows.iloc[:, :19].set_axis(["t", *(f"{letter}{k}" for letter in "qvi" for k in range(6))], axis=1)
    whole = np.isfinite(rows).all(axis=1) & rows.t.between(1.0, 1e6) & (rows.iloc[:, 1:7].abs().max(axis=1) < 2 * np.pi)
    out = folder / f"{name}.csv"
    rows[whole].to_csv(out, index=False)
    return out


def arm(clone: Path, folder: Path) -> Path:
    """Write the arm's file with a frame at the centre of each log's load, called like the log."""
    frames = "".join(
        f'<link name="{name}"/><joint name="{name}_joint" type="fixed"><parent link="tool0"/><child link="{name}"/>'
        f'<origin xyz="{x} {y} {z}"/></joint>'
        for name, (x, y, z) in CENTRES.items()
    )
    path = folder / "ur10e.urdf"
    path.write_text((clone / "URe" / "urdf" / "ur10e.urdf").read_text().replace("</robot>", f"{frames}</robot>"))
    return path


def swung(clone: Path, name: str, folder: Path, point: str = "tool0", **tables: dict[str, object]) -> Record:
    """Open a log by a map that seeks a force at a point, with more tables; those of `joints` are added."""
    channels = {key: {"columns": [f"{letter}{k}" for k in range(6)]} for key, letter in LETTERS.items()}
    channels["effort"] |= {"unit": "A", "torque_per_unit": {"*": NOMINAL}}
    joints = {"names": [f"{joint}_joint" for joint in JOINTS], **channels, **tables.pop("joints", {})}
    values = {
        "robot": {"urdf": str(arm(clone, folder)), "root": "fixed", "points": [point]},
        "log": {"time": {"column": "t"}},
        "joints": joints,
        "observer": {"gain": 20.0},
        **tables,
    }
    return open_record(table(clone, name, folder), parse_map(values, "of the UR10E"), clone)


def loaded(clone: Path, name: str, folder: Path, mass: float | None) -> Record:
    """Open a loaded log by a map that seeks where the load sits, and its mass unless it is given."""
    payload: dict[str, object] = {"frame": "tool0"} | ({} if mass is None else {"mass": mass})
    friction = {"friction": {"law": "coulomb+viscous+inertia", "scale": True}}
    use: dict[str, object] = {"free": [0.0, 100.0]}
    return swung(clone, f"20_02_19_{name}Load", folder, joints=friction, payload=payload, use=use)


def judged(found: Estimate, truth: Array | float, counts: Array) -> Array:
    """Return the rms error [N] of each axis of a point, and the share within two deviations (2, 3), where it counts."""
    error = np.abs(found.components - truth)
    axes = list(zip(error.T, (error < 2.0 * found.standard_deviation).T, counts.T, strict=True))
    return np.array([[np.sqrt(np.mean(e[at] ** 2)) for e, _, at in axes], [np.mean(held[at]) for _, held, at in axes]])


def force_lines(clone: Path, name: str, folder: Path, calibration: Calibration | None) -> None:
    """Print how well the load is found as a force at its centre, and what is said where it is sought at the tool."""
    for point in (name, "tool0"):
        record = swung(clone, f"20_02_19_{name}Load", folder, point)
        result = estimate(record, calibration=calibration)
        [found], [own] = result.estimates.values(), result.observers.values()
        model, block = record.robot.model, record.block(*max(record.parts, key=lambda part: part[1] - part[0]))
        data, frame = model.createData(), model.getFrameId(name)
        force, slope = np.empty((len(block.q), 3)), savgol_filter(block.v, 21, 2, 1, record.dt, axis=0)
        for k, state in enumerate(zip(block.q, block.v, slope, strict=True)):
            pin.forwardKinematics(model, data, *state)
            fall = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED).linear
            force[k] = -MASS * (fall + GRAVITY)
        inside = (found.time[:-1] >= block.time[0]) & (found.time[1:] <= block.time[-1])
        middle = 0.5 * (found.time[1:] + found.time[:-1])
        truth = np.column_stack([np.interp(middle, block.time, axis) for axis in force.T])
        rms, cover = judged(found, truth, found.shown & inside[:, None])
        print(
            f"load of {name} as a force at {'its centre' if point == name else point}, "
            f"{'nothing' if calibration is None else 'friction and factors'} learnt: {'/'.join(f'{x:.1f}' for x in rms)} N "
            f"rms where seen ({', '.join(f'{share:.0%}' for share in own.seen[point])} of the time), "
            f"{', '.join(f'{share:.0%}' for share in cover)} within two deviations, k {own.k:.2g}"
        )


def free_lines(clone: Path, folder: Path, calibration: Calibration) -> None:
    """Print which force is shown where nothing touches the UR10E, over all such logs."""
    results = [estimate(swung(clone, name, folder), calibration=calibration, trust=True) for name in FREE]
    every = [judged(result.estimates["force_level"], 0.0, result.estimates["force_level"].shown) for result in results]
    rms, cover = np.swapaxes(every, 0, 1)
    print(
        f"nothing touches the arm in {len(FREE)} logs of other days: {rms.min():.1f} to {rms.max():.1f} N rms where seen, each "
        f"axis of each; {cover.min():.0%} to {cover.max():.0%} within two deviations, {cover.mean():.1%} of all"
    )


def untouched(bags: Path, name: str, *, learnt: bool) -> Record:
    """Open a log of the UR3 by a map that seeks a force at its tool, or friction and factors."""
    joints: dict[str, object] = {
        "topic": "/arm",
        "names": dict(zip(UR3_NAMES, (f"{joint}_joint" for joint in JOINTS), strict=True)),
        "effort": {"unit": "N m", "torque_per_unit": {"*": -1.0}},
    }
    if learnt:
        joints["friction"] = {"law": "coulomb+viscous+inertia", "scale": True}
    robot = {"name": "ur3", "root": "fixed", "points": ["tool0"]}
    values = {"robot": robot, "joints": joints, "observer": {"gain": 20.0}}
    return open_record(bags / f"{name}.bag", parse_map(values, "of the UR3"), bags)


def nothing_lines(bags: Path) -> None:
    """Print which force is shown where nothing touches the UR3."""
    if not bags.is_dir():
        print(f"{bags}: no bags. Nothing touches the arm: at most {MOST_SHOWN:g} N shown, nine tenths covered")
        return
    for known, other in (BAGS, BAGS[::-1]):
        calibration = calibrate([untouched(bags, known, learnt=True)], trust=True)
        result = estimate(untouched(bags, other, learnt=False), calibration=calibration, trust=True)
        [found], [own] = result.estimates.values(), result.observers.values()
        counts = found.shown & (found.time[1:] < found.time[-1] - STOP)[:, None]
        rms, cover = judged(found, 0.0, counts)
        most, seen = np.abs(found.components[counts]).max(), ", ".join(f"{share:.0%}" for share in own.seen["tool0"])
        print(
            f"nothing touches {other}, learnt from {known}: {'/'.join(f'{x:.1f}' for x in rms)} N rms where seen ({seen} of "
            f"the time), at most {most:.1f} N{'' if most < MOST_SHOWN else ': not within'}, "
            f"{', '.join(f'{share:.1%}' for share in cover)} within two deviations, k {own.k:.2g}"
        )


def bare(files: Iterable[Path], rate: float, urdf: Path, point: str, place: Path, **joints: object) -> Record:
    """Open angles and torques of six joints, tables without times, by a map that seeks a force at a point."""
    q, tau = (pd.read_csv(file).to_numpy() for file in files)
    columns = {part: [f"{part}{k}" for k in range(6)] for part in ("q", "tau")}
    rows, names = np.column_stack([np.arange(len(q)) / rate, q, tau]), ["t", *columns["q"], *columns["tau"]]
    pd.DataFrame(rows, columns=names).to_csv(place / "log.csv", index=False)
    motion = {"position": {"columns": columns["q"]}, "velocity": {"from": "position", "window": 0.02}}
    values = {
        "robot": {"urdf": str(urdf), "root": "fixed", "points": [point]},
        "log": {"time": {"column": "t"}},
        "joints": motion | {"effort": {"columns": columns["tau"]}} | joints,
        "observer": {"gain": 20.0},
    }
    return open_record(place / "log.csv", parse_map(values, f"of {urdf.name}"), place)


def airbot_lines(folder: Path, place: Path) -> None:
    """Print which mean force is found on the AIRBOT, with its load and without."""
    names, calibration = [f"joint{k}" for k in range(1, 7)], None
    for learnt in ("nothing", AIRBOT_LOGS[0]):
        for log in AIRBOT_LOGS[0 if calibration is None else 1 :]:
            kind, loaded = log.removesuffix("_loaded"), "_loaded" * log.endswith("_loaded")
            there = folder / "identification" / kind
            files = [there / f"identification_{part}_real{loaded}.csv" for part in ("q", "tau")]
            record = bare(files, 100.0, folder / "urdf" / "airbot_play_v3_0_gripper.urdf", "link6", place, names=names)
            result = estimate(record, calibration=calibration)
            [found], truth = result.estimates.values(), np.array([0.0, 0.0, -9.81 * AIRBOT_LOAD * bool(loaded)])
            mean = [component[at].mean() for component, at in zip(found.components.T, found.shown.T, strict=True)]
            rms, cover = judged(found, truth, found.shown)
            print(
                f"AIRBOT, {log}, learnt from {learnt}: mean {np.round(mean, 2)} N where seen, {np.round(truth, 2)} pushes; "
                f"{'/'.join(f'{x:.1f}' for x in rms)} N rms, {', '.join(f'{share:.0%}' for share in cover)} within two deviations"
            )
            if learnt == "nothing" and log == AIRBOT_LOGS[0]:
                free = record
        calibration = calibrate([free], trust=True)


def friction_lines(folder: Path, place: Path) -> None:
    """Print which friction is found on the TX40, beside forces and by a calibration, and whether a push is made up."""
    names = [f"joint_{k}" for k in range(1, 7)]
    gears = {"factor": dict(zip(names, (1.0 / GEARS).tolist(), strict=True)), "offset": OFFSETS}
    gears["coupling"] = {"joint_6": {"joint_5": -1.0, "joint_6": 1.0}}
    files = folder / "data" / "pos_read_data.csv", folder / "data" / "curr_data.csv"
    record = bare(files, 5000.0, folder / "urdf" / "tx40_mdh_modified.urdf", "joint_6", place, names=names, **gears)
    result, learnt = estimate(record), calibrate([record], trust=True)
    print(f"TX40: {result.verdict}")
    for name, published in TX40_FRICTION.items():
        beside, alone = (getattr(one.friction, name)[:4].round(2) for one in (result.forces.values, learnt.fitted))
        print(f"TX40, {name} friction of joints 1 to 4: {beside} beside forces, {alone} learnt, {published} published")


def panda_lines(folder: Path, place: Path) -> None:
    """Print what is shown of a Panda that nobody touches, with the hand that its file has and without."""
    parts = {"t": "time", "q": "positions", "v": "velocity", "tau": "torques"}
    log = {key: np.loadtxt(folder / f"exciting_traj_{name}.txt") for key, name in parts.items()}
    rows = np.column_stack([log[key].reshape(len(log["t"]), -1) for key in parts])
    columns = {key: [f"{key}{k}" for k in range(1, 8)] for key in ("q", "v", "tau")}
    pd.DataFrame(rows, columns=["t", *(name for names in columns.values() for name in names)]).to_csv(
        place / "panda.csv", index=False
    )
    tree = ElementTree.parse(PANDA)
    for hand in (True, False):
        for link in tree.getroot().iter("link") if not hand else ():
            if link.get("name", "").startswith(("panda_hand", "panda_leftf", "panda_rightf")):
                link.remove(link.find("inertial"))
        tree.write(place / "panda.urdf")
        channels = zip(("position", "velocity", "effort"), columns.values(), strict=True)
        joints = {"names": [f"panda_joint{k}" for k in range(1, 8)], "held": {"*": 0.0}}
        values = {
            "robot": {"urdf": str(place / "panda.urdf"), "root": "fixed", "points": ["panda_link8"]},
            "log": {"time": {"column": "t"}},
            "joints": joints | {part: {"columns": names} for part, names in channels},
            "observer": {"gain": 200.0},
        }
        result = estimate(open_record(place / "panda.csv", parse_map(values, "of the Panda"), place))
        [found] = result.estimates.values()
        rms, cover = judged(found, 0.0, found.shown)
        sizes, shares = "/".join(f"{x:.1f}" for x in rms), ", ".join(f"{share:.0%}" for share in cover)
        print(
            f"Panda, {'with' if hand else 'without'} a hand: {sizes} N rms, {shares} within two deviations; {result.verdict}"
        )


def main() -> None:
    """Print gains and payload of both logs of the UR10E, each found with the other, and what the others show."""
    folder = Path(os.environ.get("AEROBAT_RECORDINGS", ""))
    with tempfile.TemporaryDirectory() as place:
        for lines, data in (
            (airbot_lines, folder / "figaroh_kinova" / "examples" / "airbot_play" / "data"),
            (friction_lines, folder / "figaroh-examples" / "examples" / "staubli_TX40"),
            (panda_lines, folder / "FrankaEmikaPandaDynModel" / PANDA_LOG),
        ):
            if data.is_dir():
                lines(data, Path(place))
    nothing_lines(folder / "ur3-force-estimation" / "experiment")
    clone = folder / "dynamic_calibration"
    if not (clone / "dataset_ur10e").is_dir():
        print(
            f"{clone}: no logs. Each payload, found with gains of the other log: {LIGHTEST} to {HEAVIEST} kg, covered"
        )
        return
    with tempfile.TemporaryDirectory() as place:
        for known, sought in (LOGS, LOGS[::-1]):
            found = calibrate([loaded(clone, known, Path(place), MASS)])
            fits = {fit.name: fit.values for fit in found.fitted.fits}
            print(f"torque per ampere by {known}, with {MASS} kg known [N m/A]:")
            for joint in JOINTS:
                one = fits[f"friction of {joint}_joint"]
                factor, deviation = one["effort times"], one.get("deviation of the factor", np.nan)
                print(f"  {joint:<14} {NOMINAL * factor:.2f} +- {NOMINAL * deviation:.2f}")
            free_lines(clone, Path(place), found)
            for calibration in (found, None):
                force_lines(clone, sought, Path(place), calibration)
            result = estimate(loaded(clone, sought, Path(place), None), calibration=found)
            load = next(fit.values for fit in result.forces.fits if fit.name == "payload at tool0" and not fit.log)
            mass, deviation = load["mass"], load["deviation of mass"]
            good = LIGHTEST <= round(mass, 2) <= HEAVIEST and abs(mass - MASS) < 2.0 * deviation
            centre = ", ".join(f"{load[axis]:.3f} +- {load[f'deviation of {axis}']:.3f}" for axis in "xyz")
            verdict = "" if good else ": not within"
            print(f"load of {sought}: {mass:.3f} +- {deviation:.3f} kg at ({centre}) m{verdict}\n")


if __name__ == "__main__":
    main()
