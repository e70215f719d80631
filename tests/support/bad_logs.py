"""Bad flight logs, one mistake each, drawn at random: files from strangers, damaged files, and contradictions.

`bad_log` writes one file. What a program must do with it follows from its class:

| class | a program must |
|---|---|
| 1 | refuse it with one message; kinds in `HARMLESS` must be read as the good log |
| 2 | refuse it with one message |
| 11 | read it, and warn; the name of the warning is the name of the kind |
"""

from __future__ import annotations

from pathlib import Path

from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.aerobat.tables import write_csv
from support import bad_files as bad_files  # importing it registers its kinds
from support.contradictory_logs import CONTRADICTIONS
from support.log_kinds import KINDS, Kind, Rng

HARMLESS = ("columns in another order", "dimensions in another order")


def bad_log(rng: Rng, log: FlightLog, folder: Path, numbers: tuple[int, ...] = (1, 2, 11)) -> tuple[Path, int, str]:
    """Write a bad log of a random kind.

    Args:
        rng: source of all random choices.
        log: a good simulated log of half a second or more, with its truth and exact sensors.
        folder: existing folder for the file, and for a second file where the mistake needs one.
        numbers: classes to choose from.

    Returns:
        The file, the number of its class, and what is wrong in a few words.
    """
    chosen = [kind for kind in KINDS if kind.number in numbers]
    kind = chosen[rng.integers(len(chosen))]
    return write_kind(kind, rng, log, folder)


def write_kind(kind: Kind, rng: Rng, log: FlightLog, folder: Path) -> tuple[Path, int, str]:
    """Write a bad log of one kind; arguments and result are those of `bad_log`."""
    path = folder / f"bad_{kind.number}_{rng.integers(10**9)}{kind.suffix}"
    kind.write(rng, log, path)
    return path, kind.number, kind.name


def _contradiction(name: str, suffix: str) -> Kind:
    def write(rng: Rng, log: FlightLog, path: Path) -> None:
        wrong = FlightLog(CONTRADICTIONS[name](rng, log.measured.copy(deep=True)))
        wrong.save(path) if suffix == ".nc" else write_csv(wrong, path)

    return Kind(11, name, suffix, write)


KINDS += [_contradiction(name, suffix) for name in CONTRADICTIONS for suffix in (".nc", ".csv")]
