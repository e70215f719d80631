"""Write a table from a recording of the hopper in a clone of machines-in-motion/mim_estimation (BSD 3-Clause).

    python hopper.py CLONE hopper.csv [FOLDER]

FOLDER is `demos/2019-07-04_16-25-06` unless given. In the other recording, `config/demos_and_tests/hopper_data`, the
leg hops; it has the height of the hip, too. Then `aerobat estimate hopper.csv --map hopper.toml`, or for the hop
`--map hopper_hop.toml`.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

CHANNELS = {
    "joint_positions": ("q_hip", "q_knee"),
    "joint_torques": ("tau_hip", "tau_knee"),
    "ati_force": ("fx", "fy", "fz"),
}
HEIGHT = {"height_sensors": ("height",)}  # of the hip above the floor; in the second recording alone


def convert(clone: Path, table: Path, folder: str = "demos/2019-07-04_16-25-06") -> None:
    """Write the samples that all channels have; the first column of each file counts milliseconds."""
    files = {name: clone / folder / f"dg_hopper_teststand-{name}.dat" for name in (*CHANNELS, *HEIGHT)}
    channels = {name: names for name, names in (CHANNELS | HEIGHT).items() if name in CHANNELS or files[name].is_file()}
    parts = {name: np.loadtxt(files[name]) for name in channels}
    first, last = max(part[0, 0] for part in parts.values()), min(part[-1, 0] for part in parts.values())
    kept = [part[(part[:, 0] >= first) & (part[:, 0] <= last)] for part in parts.values()]
    columns = [1e-3 * (kept[0][:, 0] - first)]
    columns += [part[:, 1 + k] for part, names in zip(kept, channels.values(), strict=True) for k in range(len(names))]
    header = ",".join(["time", *(name for names in channels.values() for name in names)])
    np.savetxt(table, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.7g")


if __name__ == "__main__":
    convert(Path(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:4])
