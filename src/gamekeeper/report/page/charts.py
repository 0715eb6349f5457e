"""Charts as plain data: lines with bands, forests of intervals, matrices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.report.page.data import Chart

FloatArray = NDArray[np.float64]

MOST_POINTS: Final = 400
"""Along a line; of more, neighbours are put together."""
DIGITS: Final = 6


def finite(value: Any) -> float | None:
    """A number for a chart; None where there is none, or it isn't finite."""
    if value is None or isinstance(value, bool) or not isinstance(value, int | float | np.number):
        return None
    return float(f"{float(value):.{DIGITS}g}") if np.isfinite(value) else None


def binned_line(
    id: str,  # the word that the page uses for it
    title: str,
    x: Sequence[int],
    series: Mapping[str, FloatArray],
    *,
    x_label: str = "episode",
    y_label: str = "return",
    note: str = "",
    marks: Sequence[Mapping[str, Any]] = (),
) -> Chart:
    """A line for each series; of many points, means of neighbours with their 5 to 95 % range.

    Args:
        id: its address.
        title: what it shows.
        x: [points].
        series: by name, [points]; NaN where there is none.
        x_label, y_label: of the axes.
        note: what must be known to read it.
        marks: places along x.
    """
    size = -(-len(x) // MOST_POINTS) if len(x) else 1
    starts = range(0, len(x), size)
    lines = []
    for name, values in series.items():
        parts = [values[start : start + size] for start in starts]
        line: dict[str, Any] = {"name": name, "values": [_mean(part) for part in parts]}
        if size > 1:
            line["low"] = [_quantile(part, 0.05) for part in parts]
            line["high"] = [_quantile(part, 0.95) for part in parts]
        lines.append(line)
    if size > 1:
        note = f"Means of {size} episodes each, with their 5 to 95 % range. {note}".strip()
    chart = {
        "id": id, "kind": "line", "title": title, "series": lines,
        "x": {"label": x_label, "values": [x[start] for start in starts]},
        "y": {"label": y_label}, "note": note,
    }  # fmt: skip
    return {**chart, "marks": list(marks)} if marks else chart


def forest(
    id: str,  # the word that the page uses for it
    title: str,
    rows: Sequence[Mapping[str, Any]],
    *,
    label: str,
    note: str = "",
) -> Chart:
    """Values with their intervals, one under another; rows without a value are shown as text."""
    plain = [
        {**row, **{key: finite(row.get(key)) for key in ("value", "low", "high", "p")}}
        for row in rows
    ]
    return {
        "id": id, "kind": "forest", "title": title, "x": {"label": label}, "zero": 0,
        "rows": plain, "note": note,
    }  # fmt: skip


def matrix(
    id: str,  # the word that the page uses for it
    title: str,
    rows: Sequence[str],
    columns: Sequence[str],
    values: Sequence[Sequence[Any]],
    *,
    labels: tuple[str, str],
    texts: Sequence[Sequence[str | None]] | None = None,
    bounds: tuple[float, float] | None = None,
    note: str = "",
) -> Chart:
    """Numbers by row and column, shaded.

    Args:
        id: its address.
        title: what it shows.
        rows, columns: their names.
        values: [rows, columns].
        labels: what rows and columns are.
        texts: shown in place of the numbers.
        bounds: of the shades; None: the least and the most value.
        note: what must be known to read it.
    """
    cells = [[finite(value) for value in row] for row in values]
    seen = [value for row in cells for value in row if value is not None]
    low, high = bounds or (min(seen, default=0.0), max(seen, default=1.0))
    chart = {
        "id": id, "kind": "matrix", "title": title, "row_label": labels[0],
        "column_label": labels[1], "rows": list(rows), "columns": list(columns), "values": cells,
        "low": low, "high": high, "middle": 0.0 if low < 0 < high else None, "note": note,
    }  # fmt: skip
    return chart if texts is None else {**chart, "texts": [list(row) for row in texts]}


def _mean(values: FloatArray) -> float | None:
    known = values[np.isfinite(values)]
    return finite(known.mean()) if len(known) else None


def _quantile(values: FloatArray, part: float) -> float | None:
    known = values[np.isfinite(values)]
    return finite(np.quantile(known, part)) if len(known) else None
