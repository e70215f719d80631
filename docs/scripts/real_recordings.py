"""Write what docs/real_recordings.md finds, and its figures, if the recordings are here; else say so and leave it.

The folder AEROBAT_RECORDINGS must hold clones of the repositories that examples/recordings/README.md names.
"""

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
from support.pages import ROOT, Values, run, save, table

sys.path.insert(0, str(ROOT / "examples" / "recordings"))
import hopper
import tiago
import ur10e

from aerobat_pin import open_record
from aerobat_pin.errors import LogError
from aerobat_pin.estimation import Calibration, Result, calibrate, estimate
from aerobat_pin.records import load_map, parse_map
from aerobat_pin.visualization import draw_all

MAPS = ROOT / "examples" / "recordings"
PHASES = {"before it": (0.1, 1.3), "push-off": (1.35, 1.5), "in the air": (1.53, 1.64), "after it": (1.7, 2.9)}
WINDS = {"nowind": 0.0, "35wind": 4.2, "70wind": 8.5, "100wind": 12.1}
NOTED = {  # joint -> residual without and with friction [N m], of an independent reading of the same files
    "arm_1_joint": (3.4, 0.97),
    "arm_2_joint": (9.5, 2.0),
    "arm_3_joint": (3.7, 1.26),
    "arm_4_joint": (3.0, 1.32),
}
MOTORS = {"motors": [f"motor_motor_m{k}" for k in range(1, 5)], "supply": ["pwr_pm_vbat"], "up": ["imu_acc_z"]}


def read(
    log: Path, name: str, friction: dict[str, Any] | None = None, calibration: Calibration | None = None, **robot: Any
) -> Result:
    """Estimate a log by a map of examples/recordings, with friction fitted or given, or changed keys of its robot."""
    values = tomllib.loads((MAPS / f"{name}.toml").read_text())
    values["robot"] |= robot
    if friction is not None:
        values["joints"]["friction"] = friction
    return estimate(open_record(log, parse_map(values, name), MAPS), calibration=calibration)


def hopper_text(folder: Path, work: Path) -> dict[str, str]:
    """Return table, fits and figures of the hopper's two recordings; draw the figures of the first."""
    first, hop = work / "hopper.csv", work / "hop.csv"
    hopper.convert(folder / "mim_estimation", first)
    hopper.convert(folder / "mim_estimation", hop, "config/demos_and_tests/hopper_data")
    fitted, plain = read(first, "hopper_friction"), read(hop, "hopper_hop")
    learnt = calibrate([open_record(first, load_map(MAPS / "hopper_friction.toml"), MAPS)])
    all_of_it = read(hop, "hopper_hop", friction={"fit": [0.0, 3.0], "to": "check.wrench", "scale": True})
    carried = read(hop, "hopper_hop", calibration=learnt)
    wrong, here, there = read(hop, "hopper"), "2019-07-04_16-25-06, 23 s", "hopper_data, 3 s"
    rows = [
        hopper_row(here, "none", read(first, "hopper")),
        hopper_row(here, "fitted on the first half; scored on the second", fitted),
        hopper_row(f"{there}, hip held (wrong)", "none", wrong),
        hopper_row(f"{there}, hip at its height", "none", plain),
        hopper_row(f"{there}, hip at its height", "those of the first recording", carried),
        hopper_row(f"{there}, hip at its height", "fitted on all of it: nothing tests the fit", all_of_it),
    ]
    save({"hopper_forces": draw_all(fitted)["estimation"]}, ROOT / "docs" / "figures" / "recordings")
    start, force, sensor, _ = next(plain.compared["force_level"][0].pieces())
    phases = []
    for name, (begin, end) in PHASES.items():
        inside = (start >= begin) & (start < end)
        error = force[inside, 2] - sensor[inside, 2]
        sizes = f"{sensor[inside, 2].mean():.2f} N", f"{error.mean():+.2f} N", f"{np.sqrt(np.mean(error**2)):.2f} N"
        phases.append([f"{name}, {begin:g} to {end:g} s", *sizes])
    head = "recording | friction and torque scale | Fx: R2, error rms | Fz: R2, error rms | Fz offset"
    return {
        "hopper": table(head, rows),
        "fits": "\n".join(f"* {fit}." for fit in fitted.forces.fits),
        "phases": table(" | mean Fz of the sensor | mean error | rms error", phases),
        "fits of the hop": "\n".join(f"* {fit}." for fit in all_of_it.forces.fits),
        "held": "    " + next(str(one) for one in wrong.findings if one.check == "held still"),
    }


def hopper_row(name: str, words: str, result: Result) -> list[str]:
    """Return a row of the hopper's table: scores outside what a fit has seen, where there is one."""
    [side] = result.observers["force_level"].points.values()
    cells = []
    for score in (side["Fx"], side["Fz"]):
        inside = score.r2_outside_fit is None
        r2, error = (score.r2, score.rmse) if inside else (score.r2_outside_fit, score.rmse_outside_fit)
        cells.append(f"{r2:.3f}, {error:.2f} N")
    return [name, words, *cells, f"{side['Fz'].offset:+.2f} N"]


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
        estimate, flown = found.estimates["force_level"], pd.read_csv(log)
        middle = 0.5 * (estimate.time[1:] + estimate.time[:-1]) - 0.05
        v = np.stack([np.interp(middle, flown.t, flown[f"v{axis}"]) for axis in "xyz"], axis=1)
        if len(found.record.parts) > 1 or len(middle) < 1000 or min(v[:, 0].std(), v[:, 1].std()) < 0.15:
            short += 1
            continue
        first, last = (int(np.searchsorted(flown.t, middle[k])) for k in (0, -1))
        force = plain_force(flown, MOTORS, inside=slice(first, last))
        inner = slice(first + 100, last - 100)
        follows = not any(one.check == "gyro against attitude" and one.verdict == "warning" for one in found.findings)
        lost.append("" if follows else log.stem)
        ours.append(drag_slopes(estimate.force[100:-100, 0], v[100:-100]))
        plain.append(drag_slopes(force[inner], flown[["vx", "vy"]].to_numpy()[inner]))
    a, b = 1e3 * np.array(ours), 1e3 * np.array(plain)
    rows = [
        [name, *(f"{values[:, k].mean():.1f} +- {values[:, k].std():.1f}" for k in (0, 1))]
        for name, values in (("by the map", a), ("by a plain script of forty lines", b))
    ]
    slopes = table("drag of force on velocity [mN per m/s] | x | y", rows)
    off = np.abs(a - b)
    good = np.array([not name for name in lost])
    worst = int(np.argmax(off.max(axis=1)))
    return (
        f"{slopes}\n\nMean and scatter over {len(a)} flights. Flight by flight the two differ by {np.median(off):.2f} (median) and at most "
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
    rows = []
    for wind, speed in WINDS.items():
        ours, plain = [], []
        for log in sorted((folder / "neural-fly" / "data" / "experiment").glob(f"custom_figure8_*_{wind}.csv")):
            found = read(log, "neural_fly")
            force = found.estimates["force_level"].force[:, 0, 0]
            ours.append(float(force[25:].mean()))
            flown = pd.read_csv(log, usecols=["t", "v", "q", "T_sp", "hover_throttle"])
            v, q, T, hover = (
                np.array([np.ravel(eval(cell)) for cell in flown[name]])
                for name in ("v", "q", "T_sp", "hover_throttle")
            )
            thrust = 25.997 * (T / hover)[:, 0] * Rotation.from_quat(q).as_matrix()[:, 0, 2]
            seconds = flown.t.iloc[-1] - flown.t.iloc[25]
            plain.append(2.65 * (v[-1, 0] - v[25, 0]) / seconds - float(thrust[25:].mean()))
        rows.append([f"{speed:g}", f"{np.mean(ours):.2f}", f"{np.mean(plain):.2f}", len(ours)])
    return table("wind [m/s] | mean Fx by the map [N] | plain mean [N] | flights", rows)


def tiago_text(folder: Path, work: Path) -> str:
    """Return what friction and the rotors' inertia leave of the arm's torques."""
    log = work / "tiago.csv"
    tiago.convert(folder / "figaroh-examples", log)
    urdf = folder / "figaroh-examples" / "examples" / "tiago" / "urdf" / "tiago_48_schunk.urdf"
    found = read(log, "tiago", urdf=str(urdf.absolute()))
    rows = []
    fits = {fit.name.removeprefix("friction of "): fit for fit in found.forces.fits}
    for joint, noted in NOTED.items():
        before, after = noted
        rows.append([joint, f"{fits[joint].before:.2f}, {fits[joint].outside:.2f}", f"{before:g}, {after:g}"])
    head = "joint | by the map: without, with | noted before"
    return table(head, rows)


def find() -> Values:
    """Return what is found, or say why the page stays as it is."""
    folder = Path(os.environ.get("AEROBAT_RECORDINGS", ""))
    if not (folder / "mim_estimation").is_dir():
        print("docs/real_recordings.md stays as it is: AEROBAT_RECORDINGS names no folder with the recordings")
        return {}
    with tempfile.TemporaryDirectory() as place:
        values = hopper_text(folder, Path(place)) | {"tiago": tiago_text(folder, Path(place))}
    values |= {"nanobench": nanobench_text(folder), "neural-fly": neural_fly_text(folder)}
    values |= ur10e.weighed(folder / "dynamic_calibration")
    return {"docs/real_recordings.md": values}


if __name__ == "__main__":
    run(find)
