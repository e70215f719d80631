"""Join positions, velocities and efforts of TIAGo's arm, in a clone of thanhndv212/figaroh-examples, to one table.

    python tiago.py CLONE tiago.csv

No licence was found for these data: read them, do not pass them on. The map needs the robot's URDF beside it:
`examples/tiago/urdf/tiago_48_schunk.urdf` of the clone.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd


def convert(clone: Path, table: Path) -> None:
    """Write one table with the columns t, arm_1_joint_position, arm_1_joint_velocity, arm_1_joint_effort, ..."""
    folder = clone / "examples" / "tiago" / "data" / "identification" / "dynamic"
    parts = [pd.read_csv(folder / f"tiago_{name}.csv") for name in ("position", "velocity", "effort")]
    whole = pd.concat([parts[0]["t"], *(part.drop(columns="t") for part in parts)], axis=1)
    whole.columns = [name.lstrip("- ") for name in whole.columns]
    whole.to_csv(table, index=False)


if __name__ == "__main__":
    convert(Path(sys.argv[1]), Path(sys.argv[2]))
