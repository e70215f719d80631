"""The tables of a result: scores and sizes, as rows of cells, and as text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from aerobat_pin.estimation.observer_scores import ObserverScores
from aerobat_pin.estimation.scores import Score, short_label
from aerobat_pin.estimation.stored_estimate import StoredEstimate

ScoreTable = tuple[tuple[str, ...], list[tuple[str, ...]]]  # header and rows
TEXT_COLUMNS = ("observer", "point", "axis", "component")  # which begin at the left
SIZE_HEADER = ("observer", "component", "mean", "rms", "least", "largest", "deviation", "seen")


def score_table(observers: Mapping[str, ObserverScores]) -> ScoreTable:
    """Return the table of scores, without columns that say nothing, and rows of a truth that is no force."""
    some = any(score.tells for found in observers.values() for score in found.scored.values())
    rows = []
    for name, found in observers.items():
        sizes = {short_label(size.name): size for size in found.components}
        for point, axes in found.points.items():
            for axis, score in axes.items():
                if some and not score.tells:
                    continue
                own = sizes[f"{point}.{axis}"]
                cells = {"observer": name, "point": point, "axis": axis, **_score_cells(score, own.unit)}
                rows.append({**cells, "deviation": own.certainty})
    always = all(row.get("rms where seen") == row["error rms"] for row in rows)
    hidden = {"R2 where seen", "rms where seen"} if always else set()
    header = tuple(dict.fromkeys(key for row in rows for key, cell in row.items() if cell != "-" and key not in hidden))
    header = (*(key for key in header if key != "deviation"), *(key for key in header if key == "deviation"))
    return header, [tuple(row.get(key, "-") for key in header) for row in rows]


def _score_cells(score: Score, unit: str) -> dict[str, str]:
    """Return the cells of a score, without those that have no meaning."""

    def r2(value: float | None) -> str:
        return "no signal" if value is None else f"{value:.5f}"

    def size(value: float) -> str:
        return f"{1e3 * value:.2f} m{unit}"

    cells = {"R2": r2(score.r2)}
    if score.factor is None and score.offset is None:
        cells["R2 noise-free"] = r2(score.r2_noise_free)
    cells["error rms"] = size(score.rmse)
    if score.rmse_seen is not None:
        cells |= {"R2 where seen": r2(score.r2_seen), "rms where seen": size(score.rmse_seen)}
    if score.rmse_outside_fit is not None:
        cells |= {"R2 unfitted": r2(score.r2_outside_fit), "unfitted rms": size(score.rmse_outside_fit)}
    if score.offset is not None:
        cells["factor"] = "-" if score.factor is None else f"{score.factor:.4f}"
        cells["offset"] = size(score.offset)
    return {**cells, "lag": "-" if score.lag_s is None else f"{1e3 * score.lag_s:.2f} ms"}


def size_table(stored: Mapping[str, StoredEstimate]) -> list[tuple[str, ...]]:
    """Return the header, and a row for each component."""
    rows: list[tuple[str, ...]] = [SIZE_HEADER]
    for name, estimate in stored.items():
        least, most = estimate.extremes
        sizes = zip(estimate.component_sizes(), estimate.mean, least, most, strict=True)
        for size, mean, low, high in sizes:
            numbers = ("" if size.rms is None else f"{value:.4g} {size.unit}" for value in (mean, size.rms, low, high))
            rows.append((name, size.name, *numbers, size.certainty, "-" if size.seen is None else f"{size.seen:.0%}"))
    return rows


def text_table(cells: Sequence[tuple[str, ...]]) -> list[str]:
    """Return a table, its header first, as lines of text with columns as wide as they need to be."""
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return [
        " ".join(
            cell.ljust(width) if name in TEXT_COLUMNS else cell.rjust(width + 1)
            for name, cell, width in zip(cells[0], row, widths, strict=True)
        )
        for row in cells
    ]
