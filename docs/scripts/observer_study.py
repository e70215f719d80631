"""Write the tables and the figure of docs/observer_results.md: every observer under the same conditions."""

from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure
from support.observer_conditions import TUNING, Condition, estimated, flown, worst
from support.pages import ROOT, Values, run, save, table

from aerobat_pin.observers import OBSERVERS
from aerobat_pin.visualization import style

CONDITIONS = (
    Condition("exact"),
    Condition("velocity noise", noise=1.0),
    Condition("mass +5 %", mass=1.05),
    Condition("air +20 %", air=1.2),
    Condition("all three", noise=1.0, mass=1.05, air=1.2),
    Condition("all three, left wing only", noise=1.0, mass=1.05, air=1.2, share=0.0),
    Condition("all three, right = -0.5 left", noise=1.0, mass=1.05, air=1.2, share=-0.5),
)

FILTERS = ("force_level", "second_order")  # `momentum` differs from `force_level` in the third digit


def cells(values: np.ndarray) -> str:
    """Write three R2."""
    return " / ".join(f"{value:.4f}" if value > 0.99 else f"{value:.2f}" for value in values)


def exact_rows() -> Iterator[list[str]]:
    """Yield R2 against the noisy truth for the exact model, per gain."""
    for name in ("momentum", "force_level", "second_order", "super_twisting"):
        yield [f"`{name}`", *(cells(worst(name, CONDITIONS[0], gain, noisy=True)) for gain in (1000.0, 2000.0))]


def condition_table() -> str:
    """Return R2 against the noise-free truth, per condition and observer."""
    columns = [(name, gain) for name in FILTERS for gain in (200.0, 1000.0)] + [(name, 1000.0) for name in TUNING]
    titles = [f"`{name}`, K = {gain:.0f}" if name in FILTERS else f"`{name}`" for name, gain in columns]
    rows = ([case.name, *(cells(worst(name, case, gain)) for name, gain in columns)] for case in CONDITIONS)
    return table(" | ".join(["condition", *titles]), rows)


def squeeze_rows() -> Iterator[tuple[object, ...]]:
    """Yield what each observer says of the squeeze when the base rows alone are believed, seed 1."""
    for name in OBSERVERS:
        estimate = estimated(name, 1, CONDITIONS[1], rows="base")
        rank = estimate.identifiability
        at, deviation = rank.components.index("left_force_point.Fy"), estimate.standard_deviation
        fy = "infinite" if deviation is None else f"{np.median(deviation[:, at]):.1f}"
        yield f"`{name}`", rank.rank, "; ".join(rank.describe()), fy


def comparison() -> Figure:
    """Draw every observer on the paper's signal, with everything wrong, left wing along z."""
    condition, part, flight = CONDITIONS[4], slice(900, 1200), flown(1, 1.0)
    time, truth, colour = flight.inputs.time[:-1][part], flight.clean[:, 0, 2], style.ESTIMATES[1]
    figure = Figure(figsize=(9.0, 7.2), layout="constrained", dpi=110)
    axes = figure.subplots(3, 2, sharex=True, sharey=True)
    for axis, name in zip(axes.flat, OBSERVERS, strict=True):
        estimate = estimated(name, 1, condition)
        force = estimate.force[:, 0, 2]
        axis.plot(time, truth[part], color=style.TRUTH, linewidth=1.6, label="true, noise-free")
        axis.plot(time, force[part], color=colour, linewidth=0.9, label="estimated")
        if estimate.standard_deviation is not None:
            low, high = (force[part] + sign * estimate.standard_deviation[part, 2] for sign in (-2.0, 2.0))
            axis.fill_between(time, low, high, color=colour, alpha=0.2, linewidth=0.0)
        axis.set_title(f"{name}: R2 {1.0 - np.mean((force - truth) ** 2) / np.var(truth):.3f}")
    axes[0, 0].set_ylim(-0.6, 0.6)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    figure.supxlabel("time [s]")
    figure.supylabel("Fz, left wing [N]")
    return figure


def quick() -> Values:
    """Return what the observers say of the squeeze."""
    head = "observer | rank | cannot be seen | deviation of the left Fy [N]"
    return {"docs/observer_results.md": {"squeeze": table(head, squeeze_rows())}}


def find() -> Values:
    """Draw the figure, and return the tables of R2."""
    save({"observers": comparison()}, ROOT / "docs" / "figures")
    exact = table("observer | K = 1000 1/s | K = 2000 1/s", exact_rows())
    return {"docs/observer_results.md": {"exact": exact, "conditions": condition_table()}}


if __name__ == "__main__":
    run(find, quick)
