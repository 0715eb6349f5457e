"""Plots of a run: returns by agent, and heatmaps of actions and places."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final, Literal, NoReturn

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gamekeeper.episodes.evidence import Evidence
from gamekeeper.errors import EvidenceError
from gamekeeper.reporting.page.agent_section import FEWEST, mean_of
from gamekeeper.reporting.page.episode_figures import figures_of
from gamekeeper.reporting.page.packed_episode import packed_agents
from gamekeeper.reporting.page.player_drawing import DeclaredScene, drawn
from gamekeeper.reporting.page.scene_drawing import scene_of
from gamekeeper.reporting.text_columns import APART
from gamekeeper.viewing.plot.plot_axes import (
    MOST_ROWS,
    RAMP,
    Run,
    axes,
    color,
    evidence_of,
    finish,
    name_rows,
    run_title,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SEED: Final = 0
"""Seed of the resamples of intervals, as in reports."""
GOLDEN: Final = 0.618
"""Dots of a row are spread by multiples of the golden ratio: evenly, and the same every time."""
BINS: Final = 32
"""Bins of a plane along its longer side."""
MOST_WRITTEN: Final = 16
"""Actions up to which a share is written into its cell."""
MOST_LETTERS: Final = 50
"""Letters of all names of actions in one line; longer ones are slanted."""
Track = list[list[float | None]]
Grid = tuple[NDArray[np.float64], tuple[float, float, float, float]]
"""[rows, columns] turns in each cell, and the edges: left, right, bottom, top."""


def returns(run: Run, *, ax: Axes | None = None) -> Axes:
    """Draws every episode's return of each agent, and their mean with its 95 % interval.

    With fewer episodes than an interval asks for the mean stands alone, and the label says so.

    Args:
        run: evidence, or a run's folder.
        ax: axes to draw on; None: new ones.
    Raises:
        DependencyError: matplotlib isn't installed.
        EvidenceError: no agent has a row.
    """
    evidence = evidence_of(run)
    figures = figures_of(evidence)
    agents = figures.agents[:MOST_ROWS] or _nothing(evidence, "returns")
    places = {member.name: place for place, member in enumerate(packed_agents(evidence))}
    rng = np.random.default_rng(SEED)
    ax, has_interval = axes(ax, rows=len(agents)), False
    ink = ax.title.get_color()  # black, but in a dark style of matplotlib's
    for row, agent in enumerate(agents):
        values = figures.returns[figures.present[:, row], row]
        spread = (np.arange(len(values)) * GOLDEN % 1 - 0.5) * 0.56
        own = color(places.get(agent, row))
        ax.scatter(values, row + spread, s=9, color=own, alpha=0.4, linewidths=0)
        mean = mean_of(values, rng)
        if mean.value is None:
            continue
        if mean.low is not None and mean.high is not None:
            ax.plot([mean.low, mean.high], [row, row], color=ink, linewidth=2.2)
            has_interval = True
        ax.plot([mean.value], [row], marker="D", markersize=5, color=own, markeredgecolor=ink)
    name_rows(ax, agents)
    short = f", without an interval: it needs {FEWEST} episodes that differ"
    mean_text = f"diamond: mean{', bar: its 95 % interval' if has_interval else short}"
    rest = len(figures.agents) - len(agents)
    what = f"Returns by agent{f' (first {len(agents)}, {rest} more)' if rest else ''}"
    label = f"return of an episode\ndot: episode; {mean_text}"
    return finish(ax, run_title(evidence, what), x=label)


def heatmap(
    run: Run,
    *,
    of: Literal["actions", "places"] = "actions",
    agent: str | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draws how often each agent chose each action, or how long agents were at each place.

    Args:
        run: evidence, or a run's folder.
        of: `actions`: shares of each agent's whole-number actions. `places`: turns at places, by
            the scene or by recorded positions.
        agent: the only agent whose places count; None: all.
        ax: axes to draw on; None: new ones.
    Raises:
        DependencyError: matplotlib isn't installed.
        EvidenceError: nothing of the kind was recorded.
    """
    evidence = evidence_of(run)
    return _actions(evidence, ax) if of == "actions" else _visits(evidence, agent, ax)


def _nothing(evidence: Evidence, what: str, fix: str = "record at least one turn") -> NoReturn:
    raise EvidenceError(
        f"the run has no {what} to draw",
        where=evidence.name,
        expected=f"{what} of at least one agent",
        actual="none",
        fix=fix,
    )


# -- actions


def _actions(evidence: Evidence, ax: Axes | None) -> Axes:
    counts = _action_counts(evidence)
    if not counts:
        _nothing(evidence, "whole-number actions", 'plot of="places"')
    roster = packed_agents(evidence)
    agents = [member.name for member in roster if member.name in counts][:MOST_ROWS]
    actions = sorted({action for agent in agents for action in counts[agent]})
    if len(actions) > MOST_ROWS:
        _nothing(evidence, f"heatmap of {len(actions)} different actions", 'plot of="places"')
    shares = np.zeros((len(agents), len(actions)))
    for row, agent in enumerate(agents):
        for action, count in counts[agent].items():
            shares[row, actions.index(action)] = count / counts[agent].total()
    ax = axes(ax, rows=len(agents) + 2)
    picture = ax.imshow(shares, cmap=RAMP, vmin=0.0, vmax=1.0, aspect="auto")
    _bar(ax, picture, "share of the agent's actions")
    names = {member.actions for member in roster if member.name in counts}
    words = next(iter(names)) if len(names) == 1 else ()
    labels = [words[k] if 0 <= k < len(words) else str(k) for k in actions]
    slanted = sum(map(len, labels)) > MOST_LETTERS
    ax.set_xticks(range(len(actions)), labels, rotation=45 if slanted else 0)
    ax.set_yticks(range(len(agents)), agents)
    if len(actions) <= MOST_WRITTEN:
        _write(ax, shares)
    return finish(ax, run_title(evidence, "Actions by agent"), x="action")


def _action_counts(evidence: Evidence) -> dict[str, Counter[int]]:
    """By agent, how often it chose each whole-number action."""
    found: dict[str, Counter[int]] = {}
    unread = tuple(kind for kind in APART if kind != "action")
    for steps in evidence.tables.all_parts("agent_steps", without=unread) or ():
        for field in steps.schema:
            if field.name.split("@")[0] != "action" or not pa.types.is_integer(field.type):
                continue
            rows = steps.select(["agent", field.name]).filter(pc.is_valid(steps[field.name]))
            pairs = rows.group_by(["agent", field.name]).aggregate([([], "count_all")])
            for agent, action, count in zip(*pairs.to_pydict().values(), strict=True):
                found.setdefault(agent, Counter())[action] += count
    return found


def _write(ax: Axes, shares: NDArray[np.float64]) -> None:
    for (row, column), share in np.ndenumerate(shares):
        ink = "white" if share < 0.6 else "black"
        ax.text(column, row, f"{share:.0%}", ha="center", va="center", fontsize=7, color=ink)


def _bar(ax: Axes, picture: Any, label: str) -> None:
    """The scale of shades; axes of a mosaic without a figure have none."""
    figure = ax.get_figure()
    if figure is not None:
        figure.colorbar(picture, ax=ax, label=label, shrink=0.9)


# -- places


def _visits(evidence: Evidence, agent: str | None, ax: Axes | None) -> Axes:
    episodes = list(_tracked(evidence))
    if not episodes:
        _nothing(evidence, "places", "declare a [scene], or record positions in infos")
    grid, edges = _turns_at(episodes, agent)
    if not grid.any():
        _nothing(evidence, f"places of {agent}", f"name one of {', '.join(episodes[0][1])}")
    ax, down = axes(ax), bool((episodes[0][0].get("scene") or {}).get("down"))
    shown = np.where(grid > 0, grid, np.nan)
    picture = ax.imshow(shown, cmap=RAMP, extent=edges, origin="lower", interpolation="nearest")
    if down:
        ax.invert_yaxis()
    _bar(ax, picture, "turns there")
    whose = "all agents" if agent is None else agent
    return finish(ax, run_title(evidence, f"Places of {whose}"), x="x", y="y")


def _tracked(evidence: Evidence) -> Iterator[tuple[Mapping[str, Any], dict[str, Track], int]]:
    """Drawing, tracks and last turn of each episode that has places."""
    roster = packed_agents(evidence)
    given = (evidence.manifest.get("environment") or {}).get("kwargs") or {}
    agents = [(member.name, member.role) for member in roster]
    declared = DeclaredScene(scene_of(evidence), agents, given)
    for episode in evidence.episodes:
        drawing, _ = drawn(episode, [name for name, _ in agents], declared=declared)
        if drawing is not None and drawing["kind"] == "map" and drawing["tracks"]:
            yield drawing, drawing["tracks"], int(pc.max(episode.steps["turn"]).as_py())


def _turns_at(
    episodes: list[tuple[Mapping[str, Any], dict[str, Track], int]], agent: str | None
) -> Grid:
    """Turns that agents were in each cell, over all episodes."""
    spans = np.array([drawing["extent"] for drawing, _, _ in episodes])
    x0, y0 = spans[:, 0].min(), spans[:, 2].min()
    x1, y1 = spans[:, 1].max(), spans[:, 3].max()
    is_grid = all((drawing.get("scene") or {}).get("grid") for drawing, _, _ in episodes)
    side = 1.0 if is_grid else max(x1 - x0, y1 - y0, 1e-9) / (BINS - 1)
    columns, rows = (round((high - low) / side) + 1 for low, high in ((x0, x1), (y0, y1)))
    grid = np.zeros((rows, columns))
    for _, tracks, last in episodes:
        for name, track in tracks.items():
            if agent is not None and name != agent:
                continue
            until = [int(point[0] or 0) for point in track[1:]] + [last + 1]
            for (turn, x, y), end in zip(track, until, strict=True):
                if turn is not None and x is not None and y is not None:
                    grid[round((y - y0) / side), round((x - x0) / side)] += end - turn
    left, bottom = x0 - side / 2, y0 - side / 2
    return grid, (left, left + columns * side, bottom, bottom + rows * side)
