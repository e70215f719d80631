"""Weigh what a UR10e carries, in recordings of a clone of shamilmamedov/dynamic_calibration.

    python ur10e.py CLONE

No licence was found for these data: read them, do not pass them on. Friction and the constants of the motors are learnt
from one recording with a load of 2.805 kg (`estimate_drive_gains.m`); the others are weighed with them.
"""

from __future__ import annotations

import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from aerobat_pin import calibrate, estimate, open_record
from aerobat_pin.errors import MapError
from aerobat_pin.records import Record, parse_map

COLUMNS = ["timestamp", *(f"{name}_{k}" for name in ("q", "qd", "current", "wanted", "torque") for k in range(6))]
KNOWN = "ur-20_02_19_14harm50secLoad"
WEIGHED = {  # recording -> what its authors say that it carries
    "ur-20_02_19_15harm50secLoad": "2.805 kg, as that of the same day",
    "ur-20_01_13-load_2600": "2.600 kg, by its name",
    "ur-20_01_31-load": "a load that nobody tells",
    "ur-20_01_31-unload": "nothing",
    "ur-20_02_19_14harm50sec": "nothing",
    "ur-20_02_19_15harm50sec": "nothing",
}


def opened(clone: Path, name: str, folder: Path, **changes: Any) -> Record:
    """Open a recording by a table whose columns have names."""
    rows = np.genfromtxt(clone / "dataset_ur10e" / "identification_data" / f"{name}.csv", delimiter=",", skip_footer=1)
    rows = rows[np.abs(rows[:, 0] - np.median(rows[:, 0])) < 100.0]  # [s]: one begins with rows of another time
    np.savetxt(folder / f"{name}.csv", rows, "%.15g", ",", header=",".join(COLUMNS), comments="")
    values = tomllib.loads(Path(__file__).with_suffix(".toml").read_text())
    for table, keys in changes.items():
        values[table] |= keys
    return open_record(folder / f"{name}.csv", parse_map(values, "ur10e.toml"), clone)


def weighed(clone: Path) -> dict[str, str]:
    """Return a table of what each recording carries and what is found, and the constants of the motors [N m/A]."""
    rows = ["| recording | carries | found |", "|---|---|---|"]
    with tempfile.TemporaryDirectory() as place:
        law = {"law": "coulomb+viscous", "scale": True}
        known = opened(clone, KNOWN, Path(place), payload={"mass": 2.805}, joints={"friction": law})
        calibration = calibrate([known])
        for name, carried in WEIGHED.items():
            try:
                fit = estimate(opened(clone, name, Path(place)), calibration=calibration).fits[-1]
            except MapError as error:  # it says how little the record shows
                found = f"refused: {str(error).rpartition(': ')[2]}"
            else:
                found = f"{fit.values['mass']:.3f} kg with a deviation of {fit.values['deviation of mass']:.3f} kg"
            rows.append(f"| {name} | {carried} | {found} |")
    effort = known.map.joints.effort
    assert effort is not None
    told = [effort.torque_per_unit[joint] for joint in calibration.fitted.joints]
    constants = ", ".join(f"{constant:.2f}" for constant in calibration.fitted.scale * told)
    return {"ur10e": "\n".join(rows), "ur10e motors": constants}


if __name__ == "__main__":
    print(*weighed(Path(sys.argv[1])).values(), sep="\n")
