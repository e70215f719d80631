"""What the commands print: progress and tables."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import Any

import typer

INTERRUPTED = 130  # exit code of a program that Ctrl-C ended


@contextmanager
def interruptible() -> Iterator[None]:
    """End on Ctrl-C with a line and exit code 130; for what writes everything at its end, or nothing."""
    try:
        yield
    except KeyboardInterrupt:
        typer.echo("interrupted: nothing was written", err=True)
        raise typer.Exit(INTERRUPTED) from None


def progress() -> Any:
    """Return a context that shows progress on a terminal and stays silent elsewhere."""
    if sys.stderr is None or not sys.stderr.isatty():
        return nullcontext(None)
    return _Bar()


class _Bar:
    """One rich progress bar whose label follows the stage."""

    def __enter__(self) -> Any:
        from rich.progress import Progress

        self._bar = Progress(transient=True)
        self._bar.start()
        self._task = self._bar.add_task("starting", total=1.0)
        return lambda stage, share: self._bar.update(self._task, description=stage, completed=share)

    def __exit__(self, *_: object) -> None:
        self._bar.stop()


def print_table(metrics: dict[str, Any], *, noisy: bool = False) -> None:
    """Print R2 per point and axis, with the absolute error beside it.

    Args:
        metrics: of a run.
        noisy: the sensors err; where an estimate drowns in that, say what helps.
    """
    drowned = False
    seed = "" if metrics["seed"] is None else f", seed {metrics['seed']}"
    typer.echo(f"\n{metrics['scenario']}{seed}: {metrics['note']}; motor torque {metrics['torque']}")
    if any(
        isinstance(value, dict) and "Fx" in value
        for scores in metrics["observers"].values()
        for value in scores.values()
    ):
        typer.echo(
            f"{'observer':<12} {'point':<12} {'axis':<4} {'R2':>9} {'R2 noise-free':>14} {'error rms':>10} {'lag':>9}"
        )
    for name, scores in metrics["observers"].items():
        for pattern in scores["unseen"]:
            typer.echo(f"{name}: rank {scores['rank']}; cannot be seen at all: {pattern}")
        for point, axes in scores.items():
            if not isinstance(axes, dict) or "Fx" not in axes:
                continue
            for axis, one in axes.items():
                r2, clean = (
                    f"{one[key]:.5f}" if one[key] is not None else "no signal" for key in ("r2", "r2_noise_free")
                )
                delay = f"{1e3 * one['lag_s']:.2f} ms" if one["lag_s"] is not None else "-"
                error = f"{1e3 * one['rmse']:.2f} mN"
                typer.echo(f"{name:<12} {point:<12} {axis:<4} {r2:>9} {clean:>14} {error:>10} {delay:>9}")
                drowned = drowned or (one["r2_noise_free"] is not None and one["r2_noise_free"] < 0.0)
    if drowned and noisy:
        typer.echo("R2 below 0 is worse than no estimate: a smaller observers.gain follows the sensors' noise less")
