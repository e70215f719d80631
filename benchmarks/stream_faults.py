"""Random faults in a stream of samples: does anything raise, does memory grow? A million of them take some minutes.

PYTHONPATH=tests python benchmarks/stream_faults.py
"""

import tempfile
import tracemalloc
from pathlib import Path

import numpy as np
from support.stream_faults import Fault, faulty
from support.walking_log import table, table_map, urdf, walk

from aerobat_pin.estimation import OnlineEstimator
from aerobat_pin.records import parse_map

FAULTS = 1_000_000
SHARE = 0.5  # of the samples that have a fault
ROWS = 600  # samples that are played again and again, two milliseconds apart


def main() -> None:
    """Play faults until there were enough, and print what became of the samples."""
    rows = [(float(row["t"]), row) for row in table(walk()).head(ROWS).to_dict("records")]
    rng, faults, turn, samples = np.random.default_rng(1), 0, 0, 0
    with tempfile.TemporaryDirectory() as name:
        (folder := Path(name)).joinpath("quadruped.urdf").write_text(urdf(), encoding="utf-8")
        values = {key: part for key, part in table_map(folder / "quadruped.urdf").items() if key != "check"}
        stream = OnlineEstimator(parse_map(values, "-"), folder)
    settled = 0
    tracemalloc.start()
    while faults < FAULTS:
        for time, row, kind in faulty([(t + 1.2 * turn, row) for t, row in rows], rng, SHARE):
            stream.push(time, row)  # type: ignore[arg-type]
            faults, samples = faults + (kind is not Fault.NONE), samples + 1
        turn += 1
        settled = settled or (tracemalloc.get_traced_memory()[0] if turn > 20 else 0)
    grown = tracemalloc.get_traced_memory()[0] - settled
    health = stream.health
    print(f"{faults} faults in {samples} samples: no exception, {health.estimates} estimates, {health.starts} starts")
    print(f"memory grew by {grown / 1e3:.1f} kB since the twentieth of {turn} rounds")
    print({kind: health.count(kind) for kind in health.samples["base.rate"]})


if __name__ == "__main__":
    main()
