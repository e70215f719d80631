"""What `aerobat estimate` does with a recording of any robot, read by a map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from aerobat_pin.cli.console import write_results

if TYPE_CHECKING:
    from aerobat_pin.estimation import Calibration
    from aerobat_pin.records import Map, Record


def chosen_map(file: Path | None, urdf: Path | None, points: str | None, observers: list[str]) -> tuple[Map, Path]:
    """Return the map of a file, with the options laid over it, and the folder where its paths begin."""
    from aerobat_pin.records import load_map, parse_map, with_options

    said, names = None if urdf is None else str(urdf), option_names(points)
    if file is not None:
        return with_options(load_map(file), said, names, observers), file.absolute().parent
    return with_options(parse_map({"robot": {}}, "of the options"), said, names, observers), Path.cwd()


def option_names(words: str | None) -> list[str]:
    """Return the names that an option lists, with commas between them."""
    return [word.strip() for word in (words or "").split(",") if word.strip()]


def _print_self_check(record: Record, calibration: Calibration | None) -> None:
    """Play known forces into a recording, and print how well each is recovered."""
    from aerobat_pin.estimation import check_record

    checks = check_record(record, calibration)
    for check in checks:
        typer.echo(str(check))
    passed = sum(check.ok for check in checks)
    others = "" if passed == len(checks) else "; what no measured row shows cannot be recovered"
    typer.echo(f"self-check: {passed} of {len(checks)} known forces are recovered within 2 %{others}")


def estimate_by_map(
    log: Path,
    chosen: Map,
    folder: Path,
    target: Path,
    mcap: Path | None,
    calibration: Path | None,
    *,
    force: bool,
    trust: bool,
    self_check: bool,
) -> None:
    """Estimate, after a self-check if it is wanted; print what was found, and write the results."""
    from aerobat_pin.errors import check_file
    from aerobat_pin.estimation import estimate, read_calibration
    from aerobat_pin.experiments import write_mcap
    from aerobat_pin.records import open_record

    if mcap is not None:
        check_file(mcap, force=force)
    learnt = None if calibration is None else read_calibration(calibration)
    record = open_record(log, chosen, folder) if self_check else None  # else only once the folder is known to be free
    if record is not None:
        _print_self_check(record, learnt)
    write_results(
        lambda show: estimate(
            record or open_record(log, chosen, folder),
            progress=lambda share: show("estimating", share),
            trust=trust,
            calibration=learnt,
        ),
        target,
        force=force,
        also=None if mcap is None else lambda result: write_mcap(result, mcap),
    )
    if mcap is not None:
        typer.echo(f"  {mcap}")
