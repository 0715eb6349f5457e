"""A diagnosis or an attribution as text: answers by agent, tests that were made, and the others."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from gamekeeper.reporting.results_text import table_lines
from gamekeeper.reporting.text_columns import columns_of, filled, wrapped

INDENT: Final = "  "
MOST: Final = 12
"""Interventions that are shown for an agent; the document has all of them."""


def diagnosis_text(document: Mapping[str, Any], *, width: int) -> str:
    """The team first, then every agent; agents with the same answer are shown together.

    Args:
        document: a diagnosis as plain data.
        width: columns that no line exceeds.
    """
    blocks = [*_contradictions(document, width), _head(document, width)]
    if document["team"] is not None:
        blocks.append(_one("team", document["team"], width))
    groups: dict[str, list[str]] = {}
    for name, found in document["agents"].items():
        groups.setdefault(_key(found), []).append(name)
    for names in groups.values():
        found = document["agents"][names[0]]
        if document["team"] is not None and _key(found) == _key(document["team"]):
            title = f"{', '.join(names)}  {_verdict(found)}, like the team"
            blocks.append("\n".join(wrapped(title, width, rest=INDENT)))
        else:
            blocks.append(_one(", ".join(names), found, width))
    if document["counterfactuals"]:
        blocks.append(_counterfactuals(document["counterfactuals"], width))
    return "\n\n".join(blocks)


def _contradictions(document: Mapping[str, Any], width: int) -> Iterator[str]:
    """Names new episodes that contradict the recorded ones, before any answer."""
    for scope, each in document["contradictions"].items():
        text = f"Contradiction  {scope}: {each['why']}."
        yield "\n".join(wrapped(text, width, rest=INDENT))


def _head(document: Mapping[str, Any], width: int) -> str:
    counts = [
        f"{each['failed']} of {each['episodes']} episodes failed for {scope}"
        for scope, each in document["recorded"].items()
    ]
    text = (
        f"Diagnosed  {document['run']}: {'; '.join(counts)}. {document['episodes']} new episodes "
        f"played, seed {document['seed']}."
    )
    return "\n".join(wrapped(text, width, rest=INDENT))


def _key(found: Mapping[str, Any]) -> str:
    """Equal for agents that are shown together, as their results are the same."""
    own = [each for each in found["tested"] if each["kind"] == "perturbation"]
    return repr((found["answer"], found["labels"], found["why"], found["scope"], own and id(found)))


def _one(name: str, found: Mapping[str, Any], width: int) -> str:
    lines = wrapped(f"{name}  {_verdict(found)}", width, rest=INDENT)
    share = found["success"]
    lines += wrapped(
        f"{found['why']}. Successful unchanged episodes: {share['share']:.0%} "
        f"(95 % interval {share['low']:.0%} to {share['high']:.0%}).",
        width,
        first=INDENT,
        rest=INDENT,
    )
    lines += _tested(found["tested"], width)
    why: dict[str, list[str]] = {}
    for each in found["not_tested"]:
        why.setdefault(each["why"], []).append(each["label"])
    for reason, labels in why.items():
        text = f"not tested: {', '.join(labels)}: {reason}"
        lines += wrapped(text, width, first=INDENT, rest=INDENT * 2)
    return "\n".join(lines)


def _verdict(found: Mapping[str, Any]) -> str:
    return f"{found['answer']}: {' and '.join(found['labels']) or 'no cause named'}"


def _tested(tested: list[Mapping[str, Any]], width: int) -> Iterator[str]:
    shown = [each for each in tested if each["kind"] == "ideal"]
    shown += [each for each in tested if each["kind"] == "perturbation" and each.get("depends")]
    for each in shown[:MOST]:
        figures = f"{each['effect']:+.2f} ({each['low']:+.2f} to {each['high']:+.2f})"
        tail = f" {figures}  {each['measure']}  {effect_word(each)}".rstrip()
        room = max(width - len(INDENT) - len(tail), 20)
        name = f"{each['kind']} {each['intervention']}"
        name = name if len(name) <= room else name[: room - 3] + "..."
        yield f"{INDENT}{filled(name, room)}{tail}"
    rest = len(tested) - len(shown[:MOST])
    if rest > 0:
        yield f"{INDENT}{rest} more interventions were played (--json shows them)"


def effect_word(tested: Mapping[str, Any]) -> str:
    """The effect of an intervention: `restores`, `helps`, `hurts`, or empty."""
    if tested.get("restores"):
        return "restores"
    if tested.get("depends"):
        return "helps" if tested["effect"] > 0 else "hurts"
    return ""


def _counterfactuals(rows: list[Mapping[str, Any]], width: int) -> str:
    lines = ["First difference of each counterfactual from its episode"]
    for each in rows:
        ends = "restored" if each["restored"] else "still fails"
        ends += ", restored" if each["restored_open"] else ", still fails"
        ends += " if the others repeat their actions"
        where = difference_place(each) or "no difference"
        text = f"episode {each['episode']}  {each['intervention']}: {where}; {ends}"
        lines += wrapped(text, width, first=INDENT, rest=INDENT * 2)
    return "\n".join(lines)


def difference_place(counterfactual: Mapping[str, Any]) -> str:
    """Turn, field and agent of the first difference; empty where there is none."""
    if counterfactual["turn"] is None:
        return ""
    agent = counterfactual["agent"]
    of_agent = "" if agent is None else f" of {agent}"
    return f"turn {counterfactual['turn']}, {counterfactual['field']}{of_agent}"


MOST_ROWS: Final = 8
"""Pairs that are shown; the JSON document has all of them."""
RECORDED: Final = 4
"""Columns of agents' rows that come from the recorded run; the others come from replacements."""
SHOWN_FROM: Final = 0.05
"""Share of actions from which an influence is shown."""
CONTRIBUTIONS: Final = (
    "share: of the team's return; idle: noops among its actions; difference: team return that is "
    "lost if a baseline replaces the agent; one action: return that is lost if a noop replaces a "
    "single action and the others act as recorded"
)
WIDE: Final = 100_000
"""Columns of a table that is never broken; names of agents decide its width."""


def attribution_text(document: Mapping[str, Any], *, width: int) -> str:
    """The text that `gamekeeper attribute` shows.

    Args:
        document: as `Attribution.to_json` gives it.
        width: columns that no line exceeds, as far as names allow.
    """
    blocks = [
        "\n".join(wrapped(team_sentence(document), width)),
        _agents(document, width),
        _lazy(document, width),
        _influence(document),
        _messages(document, width),
        _penalties(document, width),
        _not_tested(document, width),
    ]
    return "\n\n".join(block for block in blocks if block)


def team_sentence(document: Mapping[str, Any]) -> str:
    """The team's mean return with and without its agents, or the reason why it is missing."""
    team = document["team"]
    if team["all"] is None:
        is_closed = document["loop"] == "closed"
        why = "--episodes is 0" if is_closed else "the run names no policies that could react"
        return f"Only single actions were replaced: {why}."
    return (
        f"In {document['fresh']} new episodes the team's mean return is {_number(team['all'])}; "
        f"with all agents replaced by the baseline ({_baseline(document)}) it is "
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


def _agents(document: Mapping[str, Any], width: int) -> str:
    rows = [["agent", "own return", "share", "idle", "difference", "Shapley", "one action"]]
    for name, part in document["agents"].items():
        rows.append(
            [
                name,
                _number(part["own"]),
                _percent(part["share"]),
                _percent(part["idle"]),
                _measured(part["difference"]),
                _measured(part["shapley"]),
                _measured(part["turn"]["all"]),
            ]
        )
    table = _table(rows)
    if max(map(columns_of, table.splitlines())) > width:
        first = _table([row[:RECORDED] for row in rows])
        table = f"{first}\n\n{_table([[row[0], *row[RECORDED:]] for row in rows])}"
    legend = wrapped(CONTRIBUTIONS, width, first=INDENT, rest=INDENT)
    return "\n".join(["Agents", table, *legend, *_stand_ins(document, width)])


def _stand_ins(document: Mapping[str, Any], width: int) -> list[str]:
    """Names agents without a declared noop, whose first legal action is played in its place."""
    names = [
        name
        for name, part in document["agents"].items()
        if (part["turn"]["all"] or {}).get("baseline") == "first-legal"
    ]
    if not names:
        return []
    text = f"one action: for {', '.join(names)}, which declare no noop, the first legal action"
    return wrapped(text, width, first=INDENT, rest=INDENT * 2)


def _lazy(document: Mapping[str, Any], width: int) -> str:
    lazy = {name: part for name, part in document["agents"].items() if part["lazy"]}
    lines = [
        line
        for name, part in lazy.items()
        for line in wrapped(f"{name}: {part['lazy_why']}", width, first=INDENT, rest=INDENT * 2)
    ]
    return "\n".join(["Lazy", *lines]) if lines else ""


def _influence(document: Mapping[str, Any]) -> str:
    best: dict[tuple[str, str, str], Mapping[str, Any]] = {}
    for row in document["influence"]:
        key = (row["from"], row["to"], row["on"])
        is_other = row["from"] != row["to"] and row["low"] > SHOWN_FROM
        if is_other and (key not in best or row["p"] > best[key]["p"]):
            best[key] = row
    shown = sorted(best.values(), key=lambda row: -float(row["p"]))
    rows = [["from", "to", "on", "turns later", "changed"]]
    for row in shown[:MOST_ROWS]:
        interval = f"{row['p']:.0%} ({row['low']:.0%} to {row['high']:.0%} of {row['n']})"
        rows.append([row["from"], row["to"], row["on"], str(row["lag"]), interval])
    if not shown:
        return ""
    more = len(shown) - MOST_ROWS
    title = "Influence: share of an agent's replaced actions that changed something of another"
    return f"{title}\n{_table(rows)}" + (f"\n  and {more} more" * (more > 0))


def _messages(document: Mapping[str, Any], width: int) -> str:
    lines = []
    for row in document["messages"]:
        if row["kind"] == "listening":
            text = f"{row['to']} {listening_text(row)}"
        elif row["kind"] == "signalling":
            text = (
                f"{row['from']}'s messages have {row['bits']:.2f} bits of information about its "
                f"observations (p = {row['p']:.3f}, {row['n']} episodes)"
            )
        else:
            text = (
                f"the next action of {row['to']} has {row['bits']:.2f} bits of information about "
                f"{row['from']}'s messages (p = {row['p']:.3f}, {row['n']} episodes)"
            )
        lines += wrapped(text, width, first=INDENT, rest=INDENT * 2)
    return "\n".join(["Messages", *lines]) if lines else ""


def listening_text(row: Mapping[str, Any]) -> str:
    """The share of decisions that another message changes, with its interval."""
    return (
        f"acts differently in {row['p']:.0%} of {row['n']} tests with another message "
        f"({row['low']:.0%} to {row['high']:.0%}; {row['unchanged']:.0%} with the same message)"
    )


def _penalties(document: Mapping[str, Any], width: int) -> str:
    lines = []
    for row in document["penalties"]:
        first = row["first"]
        if first is None:
            continue
        text = (
            f"{row['agent']} gets {row['term']} for actions of {', '.join(row['by'])}: "
            f"{row['p']:.0%} of {row['n']} penalties ({row['low']:.0%} to {row['high']:.0%}), "
            f"first in episode {first['episode']} (seed {first['seed']}), turn {first['turn']}: "
            f"{first['paid']:g}"
        )
        lines += wrapped(text, width, first=INDENT, rest=INDENT * 2)
    return "\n".join(["Penalties caused by another agent", *lines]) if lines else ""


def _not_tested(document: Mapping[str, Any], width: int) -> str:
    lines = [
        line
        for each in document["not_tested"]
        for line in wrapped(f"{each['what']}: {each['why']}", width, first=INDENT, rest=INDENT * 2)
    ]
    return "\n".join(["Not tested", *lines]) if lines else ""


def _table(rows: Sequence[Sequence[str]]) -> str:
    return "\n".join(table_lines(rows, width=WIDE))


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
