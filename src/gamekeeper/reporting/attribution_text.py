"""An attribution as text: what the recorded run shows, and what replaced agents and actions do."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from gamekeeper.reporting.crowd import CROWD_LEGEND, crowd_rows
from gamekeeper.reporting.influence_text import influence_text
from gamekeeper.reporting.results_text import UNDEFINED, table_lines
from gamekeeper.reporting.text_columns import INDENT, indented, item_lines, items_text, wrapped
from gamekeeper.statistics.significance import p_text

SHOWN_FROM: Final = 0.05
"""Share of actions from which an influence is shown."""
RECORDED: Final = (
    "own return: mean, over the episodes that the agent was in, of the sum of its rewards",
    "share: its part of the team's return, the sum of all agents' returns; a reward that agents "
    "share counts once for each of them",
    "idle: part of its actions that are the declared noop",
)
REPLACED: Final = (
    "difference: mean team return that is lost if the baseline plays for this agent, and "
    "the policies of the others react",
    "Shapley value: what the agent adds to the team's mean return, on average over all orders in "
    "which the agents could join; the values sum to what all agents with a value add together",
)
REPEATED: Final = (
    "one action: mean team return that is lost if {stand_in} replaces one of the agent's actions, "
    "drawn at random; as the others don't react, it may be more than the difference above",
    "all actions: the same if all of them are replaced",
    "where a repeated action is no longer legal, a legal one takes its place",
)
HARMFUL: Final = "Harmful: the team has more where it does nothing"
LAZY: Final = (
    "Lazy: brings significantly less than half of what others of its role bring on average (a "
    "tenth of what the others bring, where no other agent has its role)"
)
WIDE: Final = 100_000
"""Columns of a table that is never broken; names of agents decide its width."""


def attribution_text(document: Mapping[str, Any], *, width: int) -> str:
    """The text that `gamekeeper attribute` shows: three groups of figures, then what they say."""
    blocks = [
        _recorded(document, width),
        _replaced(document, width),
        _repeated(document, width),
        _verdict(document, width, "harmful", HARMFUL),
        _verdict(document, width, "lazy", LAZY),
        influence_text(document["influence"], width=width, least=SHOWN_FROM, lag="steps"),
        _messages(document, width),
        _penalties(document, width),
        _not_tested(document, width),
    ]
    return "\n\n".join(block for block in blocks if block)


def _recorded(document: Mapping[str, Any], width: int) -> str:
    """Figures of the recorded run itself, in which nothing was replaced."""
    agents = document["agents"]
    has_team = document.get("rivals") is None
    rows = [["agent", "own return", *(["share"] if has_team else []), "idle"]]
    for name, part in agents.items():
        shares = [_percent(part["share"])] if has_team else []
        rows.append([name, _number(part["return"]), *shares, _percent(part["idle"])])
    legend = [each for each in RECORDED if has_team or not each.startswith("share")]
    legend += [
        why
        for name, why in UNDEFINED.items()
        if name in rows[0] and any(part[name] is None for part in agents.values())
    ]
    title = f"Recorded run: {_episodes(document['recorded'])}, nothing replaced"
    return _group(title, rows, [part["return"] for part in agents.values()], legend, width)


def _replaced(document: Mapping[str, Any], width: int) -> str:
    """Figures of new episodes in which a baseline plays for agents."""
    if document["team"]["all"] is None:
        return "\n".join(wrapped(team_sentence(document), width))
    agents = document["agents"]
    rows = [["agent", "difference", "Shapley value"]]
    rows += [
        [name, _measured(part["difference"]), _measured(part["shapley"])]
        for name, part in agents.items()
    ]
    parts = [part[key] for part in agents.values() for key in ("difference", "shapley")]
    is_sample = any("were drawn" in each["why"] for each in document["not_tested"])
    absent = f"-: not measured: the agent joins late{', or was not drawn' * is_sample}"
    played = f"{_episodes(document['fresh'], 'new')}{_named(document)}"
    title = f"Agents replaced, several sets of them in each: {played}"
    legend = [*REPLACED, *_signs(parts, absent)]
    values = [(part["difference"] or {}).get("value") for part in agents.values()]
    return _group(title, rows, values, legend, width, above=team_sentence(document))


def _named(document: Mapping[str, Any]) -> str:
    """The policies that new episodes play in place of the recorded ones."""
    named = [f"{name} = {policy}" for name, policy in document["policies"].items()]
    return f", with {', '.join(named)} in place of what was recorded" if named else ""


def _repeated(document: Mapping[str, Any], width: int) -> str:
    """Figures of episodes that are played again with other actions."""
    turns = {name: part["turn"] for name, part in document["agents"].items()}
    parts = [turn[key] for turn in turns.values() for key in ("one", "all")]
    if not any(parts):
        return ""
    rows = [["agent", "one action", "all actions"]]
    rows += [[name, _measured(t["one"]), _measured(t["all"])] for name, t in turns.items()]
    recorded, every = document["episodes"], document["replayed"]
    which = _episodes(recorded, "recorded")
    if every > recorded:
        which = f"{recorded:,} recorded and {_episodes(every - recorded, 'new')}{_named(document)}"
    title = f"Actions of one agent replaced, while the others repeat theirs: {which}"
    absent = "-: the agent had no action to replace"
    repeated = [each.format(stand_in=_stand_in(parts)) for each in REPEATED]
    legend = [*repeated, *_signs(parts, absent)]
    values = [(turn["one"] or {}).get("value") for turn in turns.values()]
    return _group(title, rows, values, legend, width)


def _group(
    title: str,
    rows: Sequence[Sequence[str]],
    values: Sequence[float | None],
    legend: Sequence[str],
    width: int,
    *,
    above: str = "",
) -> str:
    """A table of agents, by the values of its first column, with its title and a legend."""
    lines = wrapped(title, width, rest=INDENT)
    lines += indented(above, width)
    shown = crowd_rows(rows[1:], values, _number)
    if len(shown) < len(rows) - 1:
        legend = [*legend, CROWD_LEGEND]
    below = [line for each in legend for line in item_lines(each, width)]
    return "\n".join([*lines, *table_lines([rows[0], *shown], width=WIDE), *below])


def _signs(parts: Sequence[Mapping[str, Any] | None], absent: str) -> list[str]:
    """Meaning of an interval, of n and of a dash, each where it occurs."""
    known = [part for part in parts if part is not None]
    found = []
    if any(part["low"] is not None for part in known):
        found.append("(low to high): 95 % confidence interval")
    if any(part["low"] is None for part in known):
        found.append("n: number of episodes; a confidence interval needs at least 50")
    if len(known) < len(parts):
        found.append(absent)
    return found


def _episodes(count: int, kind: str = "") -> str:
    return f"{count:,} {kind} episode{'' if count == 1 else 's'}".replace("  ", " ")


def team_sentence(document: Mapping[str, Any]) -> str:
    """The team's mean return with and without its agents, or the reason why it is missing."""
    team = document["team"]
    if document.get("rivals") is not None:
        return (
            f"Agents compete: {document['rivals']}. A sum of their returns says nothing of any of "
            "them, so that no part of a team's return is given."
        )
    if team["all"] is None:
        is_closed = document["loop"] == "closed"
        why = "--episodes is 0" if is_closed else "the run names no policies that could react"
        return f"No agents were replaced: {why}."
    return (
        f"The team's mean return is {_number(team['all'])} with all policies as they are; with "
        f"all agents replaced by the baseline ({_baseline(document)}) it is "
        f"{_number(team['none'])}."
    )


def _baseline(document: Mapping[str, Any]) -> str:
    """The baseline that was played; not the requested one where an agent has no declared noop."""
    parts = [part["difference"] for part in document["agents"].values() if part["difference"]]
    played = sorted({part["baseline"] for part in parts})
    asked = str(document["baseline"])
    if not played or played == [asked]:
        return asked
    lacking = "no" if asked not in played else "not for every agent a"
    return f"{' or '.join(played)}, as {lacking} {asked} is declared"


def _stand_in(parts: Sequence[Mapping[str, Any] | None]) -> str:
    """The action that replaces others: the noop, or where none is declared the first legal one."""
    played = {part["baseline"] for part in parts if part is not None}
    if "first-legal" not in played:
        return "the noop"
    if len(played) == 1:
        return "the agent's first legal action (no noop is declared)"
    return "the noop (where none is declared, the first legal action)"


def _verdict(document: Mapping[str, Any], width: int, key: str, title: str) -> str:
    """The agents that are lazy, or harmful, each with its reason."""
    agents = document["agents"].items()
    texts = [f"{name}: {part[f'{key}_why']}" for name, part in agents if part.get(key)]
    return items_text("\n".join(wrapped(title, width, rest=INDENT)), texts, width)


def _messages(document: Mapping[str, Any], width: int) -> str:
    texts = []
    for row in document["messages"]:
        if row["kind"] == "listening":
            text = f"{row['to']} {listening_text(row)}"
        elif row["kind"] == "signalling":
            text = (
                f"{row['from']}'s messages have {row['bits']:.2f} bits of information about its "
                f"observations ({_tested(row)})"
            )
        else:
            text = (
                f"the next action of {row['to']} has {row['bits']:.2f} bits of information about "
                f"{row['from']}'s messages ({_tested(row)})"
            )
        texts.append(text)
    return items_text("Messages", texts, width)


def _tested(row: Mapping[str, Any]) -> str:
    return f"permutation test, {p_text(row['p'])}, {row['n']} episodes"


def listening_text(row: Mapping[str, Any]) -> str:
    """The share of decisions that another message changes, with its interval."""
    return (
        f"acts differently in {row['p']:.0%} of {row['n']} tests with another message "
        f"({row['low']:.0%} to {row['high']:.0%}; {row['unchanged']:.0%} with the same message)"
    )


def _penalties(document: Mapping[str, Any], width: int) -> str:
    texts = [
        f"{row['agent']} gets {row['term']} for actions of {', '.join(row['by'])}: "
        f"{row['p']:.0%} of {row['n']} penalties ({row['low']:.0%} to {row['high']:.0%}), "
        f"first in episode {first['episode']} (seed {first['seed']}), turn {first['turn']}: "
        f"{first['paid']:g}"
        for row in document["penalties"]
        if (first := row["first"]) is not None
    ]
    return items_text("Penalties caused by another agent", texts, width)


def _not_tested(document: Mapping[str, Any], width: int) -> str:
    texts = (f"{each['what']}: {each['why']}" for each in document["not_tested"])
    return items_text("Not tested", texts, width)


def _measured(part: Mapping[str, Any] | None) -> str:
    if part is None:
        return "-"
    if part["low"] is None:
        return f"{_number(part['value'])} (n = {part['n']})"
    return f"{_number(part['value'])} ({_number(part['low'])} to {_number(part['high'])})"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{value:.0%}"
