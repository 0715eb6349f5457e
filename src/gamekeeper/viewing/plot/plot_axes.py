"""Axes of matplotlib as the pages draw: an agent's own colour, thin lines, a source below."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from os import PathLike
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from gamekeeper.episodes.evidence import Evidence
from gamekeeper.errors import not_installed
from gamekeeper.runs.load_run import load

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Run: TypeAlias = Evidence | str | PathLike[str]
"""Evidence, or the folder of a run."""

COLORS: Final = (
    *("#0072b2", "#d55e00", "#009e73", "#b0578d"),
    *("#b87d00", "#2a9fd6", "#6b5b95", "#4d4d4d"),
)
"""Colours of agents by their place, as in the player in light."""
DARK_COLORS: Final = (
    *("#56b4e9", "#f28e4b", "#2fc79a", "#e39cc8"),
    *("#e6b422", "#9ad4ff", "#b3a4e0", "#c2c8ce"),
)
"""The same in the dark."""
MIDDLE_GREY: Final = 1.5
"""Sum of red, green and blue below which a ground is dark."""
RAMP: Final = "cividis"
"""Shades that read the same without red or green."""
ROW: Final = 0.34
"""Height of a row, in inches."""
WIDTH: Final = 6.4
MOST_ROWS: Final = 64
"""Most rows of a plot; its title says how many there are."""
DIGITS: Final = 12


def evidence_of(run: Run) -> Evidence:
    """The evidence itself, or that in a folder."""
    return run if isinstance(run, Evidence) else load(run)


def axes(ax: Axes | None, *, rows: int | None = None) -> Axes:
    """The axes that were given, or new ones, as high as their rows need.

    Raises:
        DependencyError: matplotlib isn't installed.
    """
    if ax is not None:
        return ax
    try:
        pyplot: Any = import_module("matplotlib.pyplot")
    except ImportError as error:
        raise not_installed(error, "matplotlib", "plot", "gk.plot") from error
    height = 4.0 if rows is None else 1.4 + ROW * max(rows, 2)
    made: Axes = pyplot.subplots(figsize=(WIDTH, height), layout="constrained")[1]
    return made


def color(place: int) -> str:
    """The colour of an agent or policy by its place; a bright one in a dark style of matplotlib."""
    params, colors = import_module("matplotlib").rcParams, import_module("matplotlib.colors")
    is_dark = sum(colors.to_rgb(params["axes.facecolor"])) < MIDDLE_GREY
    return (DARK_COLORS if is_dark else COLORS)[place % len(COLORS)]


def finish(ax: Axes, title: str, *, x: str, y: str = "", legend: bool = False) -> Axes:
    """The same axes with title, labels and legend."""
    ax.set_title(title, loc="left", fontsize="medium")
    ax.set_xlabel(x)
    ax.set_ylabel(y)
    ax.spines[["top", "right"]].set_visible(False)
    if legend:
        ax.legend(frameon=False, fontsize="small", loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return ax


def name_rows(ax: Axes, names: Sequence[str]) -> None:
    """Names the rows of a plot, the first on top."""
    ax.set_yticks(range(len(names)), names)
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.tick_params(axis="y", length=0)
    ax.grid(axis="x", linewidth=0.4, alpha=0.6)
    ax.set_axisbelow(True)


def run_title(evidence: Evidence, what: str) -> str:
    """Title of a plot: its subject, the environment, the number of episodes, the fingerprint."""
    environment = (evidence.manifest.get("environment") or {}).get("name")
    level, _, digits = evidence.fingerprint.partition(":")
    source = f"fingerprint {level}:{digits[:DIGITS]}" if digits else "no fingerprint yet"
    return f"{what}, {evidence.episode_table.num_rows} episodes of {environment}\n{source}"
