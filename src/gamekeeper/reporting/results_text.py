"""Results as plain text for a terminal: headings at the margin, their text indented."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from gamekeeper.contract.validation import one_line
from gamekeeper.episodes.canonical import from_json, to_json
from gamekeeper.episodes.plain_json import legible
from gamekeeper.reporting.card import card_text
from gamekeeper.reporting.crowd import CROWD_LEGEND, crowd_rows
from gamekeeper.reporting.text_columns import (
    GAP,
    INDENT,
    block_text,
    columns_of,
    filled,
    indented,
    one_cell,
    wrapped,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gamekeeper.contract import Contract
    from gamekeeper.episodes.agent_spec import AgentSpec
    from gamekeeper.episodes.divergence import Divergence
    from gamekeeper.episodes.evidence import Evidence
    from gamekeeper.episodes.summary import Summary

NUMBERS: Final = range(1, 5)
"""Columns of a summary that hold numbers."""
BRIEF: Final = ("Agents", "Rewards", "Endings")
"""Sections of a card that a first look needs."""
MOST_NAMES: Final = 4
"""Agents that are named of those with the same policy."""
FEW: Final = 8
"""Elements of an array that is shown whole; of a larger one the first that differs is shown."""
SUMMARY_LEGEND: Final = (
    "return, length in actions: mean over the episodes that the agent was in; "
    "share: of the team's return over all episodes; idle: share of noops in its actions; "
    "endings: number of episodes"
)
UNDEFINED: Final = {
    "share": "share -: undefined, as a return is negative or their sum is 0",
    "idle": "idle -: no noop is declared",
}
"""Reasons of columns that hold no number."""
LEAST_ROOM: Final = 16
"""Columns that the last column of a table needs beside the others."""
LONGEST_VALUE: Final = 240
"""Characters of a value that a text shows; the JSON document has all of it."""


def brief_card(contract: Contract, agents: Iterable[AgentSpec], *, name: str, width: int) -> str:
    """Name, API and reason, then agents with their spaces, rewards and endings."""
    named = contract if contract.name else replace(contract, name=name)
    title, *sections = card_text(named, agents, width=width, questions=()).rstrip().split("\n\n")
    blocks = [title, *(text for text in sections if text.partition("\n")[0] in BRIEF)]
    return "\n\n".join(blocks)


def summary_text(summary: Summary, *, width: int) -> str:
    """A row for each agent: return, length, share, idle, endings. No average over agents.

    Of a crowd those whose return is furthest from the median come first, the others in one row.

    """
    head, *rows = summary.rows()
    if not rows:
        return f"{INDENT}no agent has acted"
    returns = [agent.return_mean for agent in summary.agents.values()]
    shown = crowd_rows(rows, returns, lambda value: f"{value:.3f}")
    lines = list(table_lines([head, *shown], width=width, right=NUMBERS))
    blank = [why for name, why in UNDEFINED.items() if "-" in (r[head.index(name)] for r in shown)]
    legend = "; ".join(
        [SUMMARY_LEGEND, *blank, *([CROWD_LEGEND] if len(shown) < len(rows) else [])]
    )
    return "\n".join([*lines, *indented(legend, width)])


def counted(summary: Summary, *, api: str) -> str:
    """Formats `20 episodes, 269 ticks, 538 actions`.

    Args:
        api: "aec", whose env steps are turns of one agent; or "parallel": ticks of all agents.
    """
    parts = (
        (summary.episodes, "episode"),
        (summary.turns, {"aec": "turn", "parallel": "tick"}.get(api, "step")),
        (summary.agent_steps, "action"),
    )
    return ", ".join(f"{number:,} {word}{'' if number == 1 else 's'}" for number, word in parts)


def facts_text(evidence: Evidence, *, width: int) -> str:
    """The facts of a run: environment, status, seeds, policies, fingerprints."""
    environment: Mapping[str, Any] = evidence.manifest.get("environment") or {}
    facts = [
        ("environment", f"{environment.get('name')} ({environment.get('api')})"),
        ("opened as", _opened_as(environment)),
        ("arguments", to_json(environment.get("kwargs") or {})),
        ("status", _status(evidence)),
        (
            "episodes",
            f"{counted(evidence.summary, api=str(environment.get('api')))}; {_ends(evidence)}",
        ),
        ("policies", _policies(evidence)),
        *origin_facts(evidence),
    ]
    return "\n".join(table_lines([(name, one_line(text)) for name, text in facts], width=width))


def origin_facts(evidence: Evidence) -> list[tuple[str, str]]:
    """Contract, seed, level, versions and digests of a run."""
    manifest = evidence.manifest
    environment: Mapping[str, Any] = manifest.get("environment") or {}
    versions: Mapping[str, str] = environment.get("versions") or {}
    contract = "none" if manifest.get("contract") is None else evidence.contract.name or "unnamed"
    return [
        ("contract", contract),
        ("level", evidence.kept_text or str(manifest.get("level"))),
        *([("retained", evidence.retained_text)] if evidence.retained_text else []),
        ("seed", "none" if manifest.get("seed") is None else str(manifest["seed"])),
        ("versions", ", ".join(f"{name} {versions[name]}" for name in sorted(versions))),
        ("fingerprint", evidence.fingerprint or "none yet"),
        ("of infos", str(manifest.get("info_fingerprint") or "none yet")),
        ("root digest", evidence.root or "none yet"),
    ]


def digests_text(evidence: Evidence) -> str:
    """The fingerprint of a run and its root digest, a line each, and what they are hashes of."""
    root = evidence.root or "none yet"
    return (
        f"  fingerprint  {evidence.fingerprint or 'none yet'}\n  root digest  {root}\n"
        "  fingerprint: hash of what happened; root digest: of every file of the run"
    )


def errors_text(errors: Sequence[Mapping[str, Any]], *, width: int) -> str:
    """The errors that ended episodes, the last line of each traceback."""
    rows = [
        (
            "run" if each["episode"] is None else f"episode {each['episode']}",
            one_line(last_line(each["error"])),
        )
        for each in errors
    ]
    return "\n".join(table_lines(rows, width=width))


def divergence_text(
    divergence: Divergence, *, sides: tuple[str, str] = ("recorded", "replayed"), width: int
) -> str:
    """The place on the first line, then both values under one another, unless these are digests."""
    place, field = divergence.place_text, divergence.field_text
    lines = [one_line(f"{place}: {field}" if place else field)]
    if divergence.begun_text:
        lines += indented(divergence.begun_text, width)
    if divergence.are_digests:
        return "\n".join([*lines, f"{INDENT}the digests differ"])
    rows = list(zip(sides, _values(divergence), strict=True))
    whole = max(map(columns_of, sides))  # two runs are told apart by the ends of their paths
    return "\n".join([*lines, *table_lines(rows, width=width, most=whole)])


def diverged_text(divergence: Divergence, *, width: int) -> str:
    """`diverged at ...`; of a difference that may have begun earlier, the place it was noticed."""
    at = "diverged; first noticed at" if divergence.begun_text else "diverged at"
    return f"{at} {divergence_text(divergence, width=width)}"


def change_text(divergence: Divergence) -> str:
    """A divergence on one line: `episode 2, turn 14, reward of picker_1: 1.0 → 0.0`."""
    then, now = _values(divergence)
    places = [f"episode {divergence.episode}"]
    places += [] if divergence.turn is None else [f"turn {divergence.turn}"]
    whose = "" if divergence.agent is None else f" of {divergence.agent}"
    values = "the digests differ" if divergence.are_digests else f"{then} → {now}"
    return one_line(f"{', '.join(places)}, {divergence.field_text}{whose}: {values}")


def cause_text(cause: str | None, *, width: int) -> str:
    """The cause of a divergence; empty where it isn't known."""
    return block_text("Cause", indented(one_line(cause or ""), width))


def versions_text(versions: Mapping[str, Sequence[str | None]], *, width: int) -> str:
    """Versions that differ between a recording and its replay; empty if all are the same."""
    rows = [
        (name, f"{then or 'none'} when recorded, {now or 'none'} now")
        for name, (then, now) in versions.items()
    ]
    return table_text("Versions that differ", rows, width)


def table_text(title: str, rows: Sequence[Sequence[str]], width: int) -> str:
    """A heading and its rows; empty where there are none."""
    return block_text(title, table_lines(rows, width=width))


def table_lines(
    rows: Sequence[Sequence[str]], *, width: int, right: Sequence[int] = (), most: int | None = None
) -> Iterator[str]:
    """Rows in aligned, indented columns; the last one is broken where it doesn't fit.

    Where the others leave too little room, texts of the last column stand below, indented.

    Args:
        rows: equally many cells in each.
        width: columns that no line exceeds, as far as the other columns and numbers leave room.
        right: numbers of the columns that stand at the right.
        most: most columns of a cell, except the last one's; None: half a line.
    """
    most = width // 2 if most is None else most
    rows = [[*(one_cell(cell, most) for cell in row[:-1]), row[-1]] for row in rows]
    widths = [max(map(columns_of, column)) for column in zip(*rows, strict=True)]
    before = sum(widths[:-1]) + len(GAP) * (len(widths) - 1) + len(INDENT)
    is_below = width - before < LEAST_ROOM and len(widths) - 1 not in right
    if is_below:
        before = 3 * len(INDENT)
    room = max(width - before, LEAST_ROOM)
    for row in rows:
        cells = [
            filled(cell, columns, right=place in right)
            for place, (cell, columns) in enumerate(zip(row[:-1], widths[:-1], strict=True))
        ]
        first, *more = wrapped(row[-1], room) or [""]
        if is_below:
            more, first = [first, *more] if first else [], ""
        if len(row) - 1 in right:
            first = filled(first, widths[-1], right=True)
        yield (INDENT + GAP.join([*cells, first])).rstrip()
        yield from (" " * before + line for line in more)


def _values(divergence: Divergence) -> tuple[str, str]:
    """Both values as text, cut around the place where they differ."""
    one, two = _plain(divergence.recorded), _plain(divergence.replayed)
    are_arrays = isinstance(one, np.ndarray) and isinstance(two, np.ndarray)
    if are_arrays and (one.shape, one.dtype) == (two.shape, two.dtype) and one.size > FEW:
        return _elements(one, two)
    return _cut(_shown(one), _shown(two))


def _plain(value: Any) -> Any:
    """Decodes a value that is canonical JSON."""
    is_tagged = isinstance(value, Mapping) and "$" in value
    return from_json(json.dumps(value)) if is_tagged else value


def _shown(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {list(value.shape)}: {value.tolist()}"
    if isinstance(value, np.generic):
        return f"{value.dtype}: {value.item()!r}"
    return to_json(value)


def _elements(one: NDArray[Any], two: NDArray[Any]) -> tuple[str, str]:
    """The first element that differs, of arrays that are too large to be shown."""
    same = (one == two) | ((one != one) & (two != two))
    places = np.argwhere(~same)
    first = tuple(places[0].tolist()) if len(places) else (0,) * one.ndim
    where = f"{one.dtype} {list(one.shape)} at {list(first)}"
    count = f"{len(places):,} of {one.size:,} elements differ"
    return f"{where}: {one[first].item()!r}  ({count})", f"{where}: {two[first].item()!r}"


def _cut(one: str, two: str) -> tuple[str, str]:
    """Both texts, without the parts far from the first character in which they differ."""
    if max(len(one), len(two)) <= LONGEST_VALUE:
        return one, two
    pairs = zip(one, two, strict=False)
    same = next((i for i, (a, b) in enumerate(pairs) if a != b), min(len(one), len(two)))
    start = max(same - LONGEST_VALUE // 4, 0)
    end = start + LONGEST_VALUE
    before, after = "..." * (start > 0), "..."
    return (
        f"{before}{one[start:end]}{after * (end < len(one))}",
        f"{before}{two[start:end]}{after * (end < len(two))}",
    )


def _opened_as(environment: Mapping[str, Any]) -> str:
    """The name that opens the environment again: a file with its path, or a former object."""
    entry = str(environment.get("entry_point"))
    if environment.get("kind") == "object":
        return f"{entry}, an object in memory"
    path = environment.get("path")
    return entry if path is None else f"{path}:{entry.rpartition(':')[2]}"


def _status(evidence: Evidence) -> str:
    status = str(evidence.manifest.get("status", "in memory"))
    recover = f" If it was killed: `gamekeeper recover {evidence.path}`" * (status == "open")
    return f"{status}. {evidence.not_whole}{recover}" if evidence.not_whole else status


def _ends(evidence: Evidence) -> str:
    ends = [end or "open" for end in evidence.episode_table["end"].to_pylist()]
    return ", ".join(f"{ends.count(end)} {end}" for end in sorted(set(ends))) or "none"


@legible
def _policies(evidence: Evidence) -> str:
    """The policies of agents; agents with the same policy are named together."""
    texts = [text for text in evidence.episode_table["policies"].to_pylist() if text]
    chosen: Mapping[str, Mapping[str, str]] = json.loads(texts[0]) if texts else {}
    agents: dict[str, list[str]] = {}
    for agent, entry in chosen.items():
        agents.setdefault(entry["policy"], []).append(agent)
    if len(agents) < 2:
        return next(iter(agents), "not named")
    return "; ".join(f"{policy}: {few(names, most=MOST_NAMES)}" for policy, names in agents.items())


def few(texts: Iterable[object], *, most: int = 6) -> str:
    """Lists the first texts, and the number of others."""
    every = [str(text) for text in texts]
    more = len(every) - most
    return ", ".join(every[:most]) + (f" and {more} more" if more > 0 else "")


def last_line(text: str | None) -> str:
    """The last line of a traceback: type and text of the exception."""
    lines = (text or "").strip().splitlines()
    return lines[-1] if lines else "no text"


def labels_text(rows: Sequence[Mapping[str, Any]], *, width: int) -> str:
    """A paragraph for each label: its name, agent, place, author and reason."""
    if not rows:
        return "No labels. One is added with: gamekeeper label RUN LABEL [--episode N] [--agent A]"
    lines: list[str] = []
    for row in rows:
        subject = row["agent"] or "the team"
        where = "the run" if row["episode"] is None else f"episode {row['episode']}"
        where += "" if row["turn"] is None else f", turn {row['turn']}"
        lines += wrapped(f"{row['label']}: {subject}, {where}", width, rest="  ")
        author = f"{'proposed by' if row['proposed'] else 'by'} {row['by']}, {row['at']}"
        lines += wrapped(author, width, first="  ", rest="  ")
        if row["why"]:
            lines += wrapped(row["why"], width, first="  ", rest="  ")
    return "\n".join(lines)
