"""Write docs/real_recordings.md and its figures, if the recordings are here; else say so and leave the page.

The folder AEROBAT_RECORDINGS must hold clones of the repositories that examples/recordings/README.md names.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation
from support.drone import drag_slopes, plain_force
from support.pages import ROOT

sys.path.insert(0, str(ROOT / "examples" / "recordings"))
import hopper
import tiago
from plain_arm import arm_residuals

from aerobat_pin.errors import LogError
from aerobat_pin.estimation import Calibration, Result, calibrate, estimate
from aerobat_pin.records import load_map, open_record, parse_map
from aerobat_pin.visualization import draw_all, save_figure

PAGE, FIGURES, MAPS = (
    ROOT / "docs" / "real_recordings.md",
    ROOT / "docs" / "figures" / "recordings",
    ROOT / "examples" / "recordings",
)
WINDS = {"nowind": 0.0, "35wind": 4.2, "70wind": 8.5, "100wind": 12.1}
NOTED = {  # joint -> residual without and with friction [N m], of an independent reading of the same files
    "arm_1_joint": (3.4, 0.97),
    "arm_2_joint": (9.5, 2.0),
    "arm_3_joint": (3.7, 1.26),
    "arm_4_joint": (3.0, 1.32),
}
MOTORS = {
    "motors": [f"motor_motor_m{k}" for k in range(1, 5)],
    "supply": ["pwr_pm_vbat"],
    "up": ["imu_acc_z"],
}


def read(
    log: Path,
    name: str,
    friction: dict[str, Any] | None = None,
    calibration: Calibration | None = None,
    **robot: Any,
) -> Result:
    """Estimate a log by a map of examples/recordings, with friction fitted or given, or changed keys of its robot."""
    values = tomllib.loads((MAPS / f"{name}.toml").read_text())
    values["robot"] |= robot
    if friction is not None:
        values["joints"]["friction"] = friction
    return estimate(open_record(log, parse_map(values, name), MAPS), calibration=calibration)


def hopper_text(folder: Path, work: Path) -> dict[str, str]:
    """Return table, fits and figures of the hopper's two recordings; draw the figures of the first."""
    lines = [
        "| recording | friction and torque scale | Fx: R2, error rms | Fz: R2, error rms | Fz offset |",
        "|---|---|---|---|---|",
    ]
    table, hop = work / "hopper.csv", work / "hop.csv"
    hopper.convert(folder / "mim_estimation", table)
    hopper.convert(folder / "mim_estimation", hop, "config/demos_and_tests/hopper_data")
    fitted = read(table, "hopper_friction")
    learnt = calibrate([open_record(table, load_map(MAPS / "hopper_friction.toml"), MAPS)])
    whole = {"fit": [0.0, 3.0], "to": "check.wrench", "scale": True}
    all_of_it = read(hop, "hopper_hop", friction=whole)
    first, second = "2019-07-04_16-25-06, 23 s", "hopper_data, 3 s"
    plain = read(hop, "hopper_hop")
    rows = [
        (first, "none", read(table, "hopper")),
        (first, "fitted on the first half; scored on the second", fitted),
        (f"{second}, hip held (wrong)", "none", read(hop, "hopper")),
        (f"{second}, hip at its height", "none", plain),
        (f"{second}, hip at its height", "those of the first recording", read(hop, "hopper_hop", calibration=learnt)),
        (f"{second}, hip at its height", "fitted on all of it: nothing tests the fit", all_of_it),
    ]
    for name, words, found in rows:
        [side] = found.observers["force_level"].points.values()
        cells = []
        for axis in ("Fx", "Fz"):
            score = side[axis]
            r2, error = (
                (score.r2, score.rmse)
                if score.r2_outside_fit is None
                else (score.r2_outside_fit, score.rmse_outside_fit)
            )
            cells.append(f"{r2:.3f}, {error:.2f} N")
        lines.append(f"| {name} | {words} | {' | '.join(cells)} | {side['Fz'].offset:+.2f} N |")
    save_figure(draw_all(fitted)["estimation"], FIGURES / "hopper_forces")
    (FIGURES / "hopper_forces.pdf").unlink()
    start, found, sensor, _ = next(plain.compared["force_level"][0].pieces())
    phases = []
    for name, begin, end in (
        ("before it", 0.1, 1.3),
        ("push-off", 1.35, 1.5),
        ("in the air", 1.53, 1.64),
        ("after it", 1.7, 2.9),
    ):
        inside = (start >= begin) & (start < end)
        error = found[inside, 2] - sensor[inside, 2]
        phases.append(
            f"| {name}, {begin:g} to {end:g} s | {sensor[inside, 2].mean():.2f} N | {error.mean():+.2f} N | "
            f"{np.sqrt(np.mean(error**2)):.2f} N |"
        )
    return {
        "hopper": "\n".join(lines),
        "fits": "\n".join(f"* {fit}." for fit in fitted.forces.fits),
        "phases": "\n".join(phases),
        "hop_fits": "\n".join(f"* {fit}." for fit in all_of_it.forces.fits),
        "held": next(str(one) for one in rows[2][2].findings if one.check == "held still"),
    }


def nanobench_text(folder: Path) -> str:
    """Return the drag of the Crazyflie over all flights, beside the plain script's."""
    seen: dict[str, str] = {}
    ours, plain, refused, twins, unfit, lost, short = [], [], [], [], [], [], 0
    for log in sorted((folder / "nanobench" / "datasets" / "dataset").glob("*.csv")):
        key = hashlib.sha256(log.read_bytes()).hexdigest()
        if key in seen:
            twins.append(log.stem)
            continue
        seen[key] = log.stem
        try:
            found = read(log, "nanobench")
        except LogError as error:
            refused.append(f"`{log.stem}` ({str(error).partition(': ')[2].partition(';')[0][:110]})")
            continue
        if any(finding.check == "fit" and finding.verdict == "warning" for finding in found.findings):
            unfit.append(f"`{log.stem}`")
            continue
        estimate, table = found.estimates["force_level"], pd.read_csv(log)
        middle = 0.5 * (estimate.time[1:] + estimate.time[:-1]) - 0.05
        v = np.stack([np.interp(middle, table.t, table[f"v{axis}"]) for axis in "xyz"], axis=1)
        if len(found.record.parts) > 1 or len(middle) < 1000 or min(v[:, 0].std(), v[:, 1].std()) < 0.15:
            short += 1
            continue
        first, last = (int(np.searchsorted(table.t, middle[k])) for k in (0, -1))
        force = plain_force(table, MOTORS, inside=slice(first, last))
        inner = slice(first + 100, last - 100)
        follows = not any(one.check == "gyro against attitude" and one.verdict == "warning" for one in found.findings)
        lost.append("" if follows else log.stem)
        ours.append(drag_slopes(estimate.force[100:-100, 0], v[100:-100]))
        plain.append(drag_slopes(force[inner], table[["vx", "vy"]].to_numpy()[inner]))
    a, b = 1e3 * np.array(ours), 1e3 * np.array(plain)
    rows = [
        f"| {name} | {values[:, 0].mean():.1f} +- {values[:, 0].std():.1f} | {values[:, 1].mean():.1f} +- {values[:, 1].std():.1f} |"
        for name, values in (("by the map", a), ("by a plain script of forty lines", b))
    ]
    off = np.abs(a - b)
    good = np.array([not name for name in lost])
    worst = int(np.argmax(off.max(axis=1)))
    return (
        "| drag of force on velocity [mN per m/s] | x | y |\n|---|---|---|\n" + "\n".join(rows) + "\n\n"
        f"Mean and scatter over {len(a)} flights. Flight by flight the two differ by {np.median(off):.2f} (median) and at most "
        f"{off.max():.2f} mN per m/s; their means by {abs(a[:, 0].mean() - b[:, 0].mean()):.2f} and "
        f"{abs(a[:, 1].mean() - b[:, 1].mean()):.2f}. In {np.sum(~good)} of the flights the gyro does not follow the pose, as the "
        f"command warns; in the others the two differ by at most {off[good].max():.2f}. The largest difference is that of "
        f"{lost[worst] or 'another flight'}. Left out: {short} flights in several parts, shorter than 10 s or slower than "
        f"0.15 m/s rms; {len(twins)} files that repeat another one under a second name (the command names them); those whose fit "
        f"of the thrust does not hold on the second half, as the command warns ({', '.join(unfit) or 'none'}); and what it refused: "
        f"{'; '.join(refused) or 'nothing'}."
    )


def neural_fly_text(folder: Path) -> str:
    """Return the mean force along the wind by wind speed, beside the plain mean of the equation of motion."""
    lines = ["| wind [m/s] | mean Fx by the map [N] | plain mean [N] | flights |", "|---|---|---|---|"]
    for wind, speed in WINDS.items():
        ours, plain = [], []
        for log in sorted((folder / "neural-fly" / "data" / "experiment").glob(f"custom_figure8_*_{wind}.csv")):
            found = read(log, "neural_fly")
            force = found.estimates["force_level"].force[:, 0, 0]
            ours.append(float(force[25:].mean()))
            table = pd.read_csv(log, usecols=["t", "v", "q", "T_sp", "hover_throttle"])
            v, q, T, hover = (
                np.array([np.ravel(eval(cell)) for cell in table[name]])
                for name in ("v", "q", "T_sp", "hover_throttle")
            )
            thrust = 25.997 * (T / hover)[:, 0] * Rotation.from_quat(q).as_matrix()[:, 0, 2]
            seconds = table.t.iloc[-1] - table.t.iloc[25]
            plain.append(2.65 * (v[-1, 0] - v[25, 0]) / seconds - float(thrust[25:].mean()))
        lines.append(f"| {speed:g} | {np.mean(ours):.2f} | {np.mean(plain):.2f} | {len(ours)} |")
    return "\n".join(lines)


def tiago_text(folder: Path, work: Path) -> str:
    """Return what friction and the rotors' inertia leave of the arm's torques."""
    table = work / "tiago.csv"
    tiago.convert(folder / "figaroh-examples", table)
    urdf = folder / "figaroh-examples" / "examples" / "tiago" / "urdf" / "tiago_48_schunk.urdf"
    found = read(table, "tiago", urdf=str(urdf.absolute()))
    lines = [
        "| joint | by the map: without, with | means, 0.02 rad/s | single samples, 0.01 rad/s | noted before |",
        "|---|---|---|---|---|",
    ]
    plain = arm_residuals(table, urdf, tomllib.loads((MAPS / "tiago.toml").read_text()), list(NOTED))
    fits = {fit.name.removeprefix("friction of "): fit for fit in found.forces.fits}
    for joint, noted in NOTED.items():
        means, single = (", ".join(f"{size:.2f}" for size in pair) for pair in plain[joint])
        before, after = noted
        own = f"{fits[joint].before:.2f}, {fits[joint].outside:.2f}"
        lines.append(f"| {joint} | {own} | {means} | {single} | {before:g}, {after:g} |")
    return "\n".join(lines)


def page(folder: Path) -> str:
    """Return the page."""
    with tempfile.TemporaryDirectory() as place:
        work = Path(place)
        return TEXT.format(
            **hopper_text(folder, work),
            nanobench=nanobench_text(folder),
            neural_fly=neural_fly_text(folder),
            tiago=tiago_text(folder, work),
        )


TEXT = """# Real recordings

What [`aerobat estimate --map`](recordings.md) finds in recordings that others have published. **No recording of theirs, nor
any excerpt, is part of this project.** [examples/recordings](../examples/recordings/README.md) has the maps, and for each
recording its licence and the one line that fetches it. `AEROBAT_RECORDINGS=FOLDER make docs` writes this page again.

## A leg over a force sensor

The hopper of [machines-in-motion/mim_estimation](https://github.com/machines-in-motion/mim_estimation) (commit 7f1b68f2, BSD
3-Clause): a leg of two joints on a rail; joint angles and torques (currents times a
constant) at 1 kHz, and an ATI force sensor under the foot. The map ([hopper.toml](../examples/recordings/hopper.toml)) names the
columns, holds the rail and so does not believe its row, and has the sensor as `[check] wrench`: compared, never used, both
behind one zero-phase low-pass of 30 Hz. Observer `force_level`, K = 200 1/s.

{hopper}

With [hopper_friction.toml](../examples/recordings/hopper_friction.toml) friction and a factor of each effort are fitted to the
sensor on the first 11.7 s. What was found:

{fits}

![Estimated and measured force of the hopper](figures/recordings/hopper_forces.png)

What remains unexplained: Fy, which two joints with parallel axes cannot show at all (the report says so), and the loops of Fz
against the sensor, above.

### The leg hops

In the second recording the leg stands, pushes off, flies for 0.14 s and lands. The foot stands and the hip moves along the
rail, as its height sensor shows (height and leg's length correlate by 0.997). With the map of the first recording, which
holds the hip still, everything seems to be error of the hip's torque: Fx has an R2 of 0.01. The command asks about it:

    {held}

With the height in the map ([hopper_hop.toml](../examples/recordings/hopper_hop.toml)) Fx is explained, and both are better
still with friction and torque scale from the first recording, of which the second knows nothing (`aerobat calibrate`,
`--calibration`). Rates are the slopes over 0.04 s in place of 0.02 s there, because the height has steps of 0.24 mm; in the
first recording this makes Fx 0.924 in place of 0.919, and Fz the same.

Two things let the friction of one recording help in another. Coulomb friction sets in at a rate that the fit finds, by
predicting each quarter of its stretch from the others: 0.2 rad/s here. At 0.02 rad/s it would take a part for viscous, which
is too large where the knee moves faster, and Fz of the hop would be 0.63. And the offset of a fit to a sensor is not kept: it
is the sensor's tare and friction at rest as much as an error of the effort, and with it Fz would be 0.65 (with both, 0.41).
Without the offset Fx gives back a part of its gain: 0.66 in place of 0.72.

Where the error of Fz is, without any fit:

| | mean Fz of the sensor | mean error | rms error |
|---|---|---|---|
{phases}

Most of it is the push-off, where the knee's torque reaches 2.6 N m, of which 1.9 N m arrive. A fit to all of it says

{hop_fits}

A fit to the first half finds 0.85 of the knee's torque, one to the second half 1.2: less arrives while the motor drives, more
while it brakes. Gears whose friction grows with the load do that. The law of the fit has no such term. One was tried,
proportional to the torque that the gear hands on: Fz of the second half of the first recording becomes 0.986 in place of
0.984, that of the hop 0.90 in place of 0.87 (friction of the first recording, no offset; by a plain script), and TIAGo's
arm_2 keeps 8 % less. But within the half to which it is fitted, each quarter predicted from the others, the knee's error
grows from 0.141 to 0.149 N m: a user without the second recording would not choose it, so it is not offered. Proportional to the
measured effort it would seem to help far more where an effort is mostly friction (arm_1 below: 0.56 N m are left in place of
0.87), because the effort then explains itself; an observer would no longer see a push. Not explained: an error of Fx
that goes with Fy (a sensor that is turned, or its cross-talk). In the first recording no height was measured: whether the hip
was held or the foot was, makes 0.001 of R2 there.

## A nano quadrotor's drag

[NanoBench](https://github.com/NanoBench-iros-2026/nanobench) (commit a3a76577): a Crazyflie, 100 Hz, motion capture, IMU, motor
commands and battery voltage. Its README says BSD 3-Clause, but the licence file is absent: read the data, do not pass them on.
The map ([nanobench.toml](../examples/recordings/nanobench.toml)) fits the thrust to the accelerometer on the first half of each
flight. There is no force sensor; what is left over should oppose the velocity:

{nanobench}

In `B5_helix_rep1` the pose turns by up to 320 deg/s between 32 and 36 s while the gyro shows at most 10 deg/s (63 at the end): motion
capture lost the body. A tilt that is off by 10 deg is 46 mN, and the two ways smooth such jumps differently. Until then, in
stretches of 4 s, the slopes of the difference on the velocity along x are at most 0.21 mN per m/s.

## A quadrotor in a wind tunnel

[Neural-Fly](https://github.com/aerorobotics/neural-fly) (commit 0ed50246): 50 Hz, thrust set point and hover throttle. The data are for
personal and educational use: download them yourself. The map
([neural_fly.toml](../examples/recordings/neural_fly.toml)) takes thrust as weight times set point over hover throttle, with 2.65 kg.

{neural_fly}

## An arm without contact

TIAGo's arm in [figaroh-examples](https://github.com/thanhndv212/figaroh-examples) (commit c0b5c7f0): angles and motor currents at
100 Hz. No licence was found for the data: read them, do not pass them on. Currents become torques by the constants of that
repository; friction and the rotors' inertia are fitted on the first half ([tiago.toml](../examples/recordings/tiago.toml)). Rates
come from the angles, because the velocity columns are late by 0.15 s. Root mean squares of the torque that is left over on the second
half [N m], without and with friction:

{tiago}

The last column was noted before this command existed. The two columns in the middle are those of a plain script
(`docs/scripts/plain_arm.py`) with the same law of friction, the same parabolas, and the table at even times by straight lines
between its rows, as `aerobat estimate` reads it. They tell what made the noted figures. The command uses means over
intervals, since an observer needs impulses; single samples have noise of their own in their current, which no friction
explains. With single samples, and Coulomb friction that sets in at 0.01 rad/s in place of 0.02, all noted figures come out
within 3 %. The rows of the table themselves, whose steps are 8 to 12 ms, would leave 2 to 4 % more: straight lines between them
average a little. The rate matters to arm_1, which turns slowly: at 0.01 rad/s the means leave it 0.80 N m, and the
others 1 to 2 % more. The command stays at 0.02 rad/s, because the fitted half is predicted best by it.
"""


def main() -> None:
    """Write the page, or say why it stays as it is."""
    folder = os.environ.get("AEROBAT_RECORDINGS")
    if not folder or not Path(folder, "mim_estimation").is_dir():
        print("docs/real_recordings.md stays as it is: AEROBAT_RECORDINGS names no folder with the recordings")
        return
    FIGURES.mkdir(parents=True, exist_ok=True)
    PAGE.write_text(page(Path(folder)), encoding="utf-8")


if __name__ == "__main__":
    main()
