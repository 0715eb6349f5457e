"""An attribution as text: a row for each agent, then influence, messages, penalties."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from gamekeeper.report.columns import columns_of, filled, wrapped

INDENT: Final = "  "
MOST_ROWS: Final = 8
"""Pairs that are shown; the JSON document has all of them."""
SEEN: Final = 4
"""Columns of agents' rows that stand in the recorded run; the others come from replaying it."""
SURE: Final = 0.05
"""The share beyond which an influence is worth a line."""


def attribution_text(document: Mapping[str, Any], *, width: int) -> str:
    """What `gamekeeper attribute` shows.

    Args:
        document: as `Attribution.to_json` gives it.
        width: columns that no line exceeds, as far as names allow.
    """
    blocks = [
        _team(document, width), _agents(document, width), _lazy(document, width),
        _influence(document),
        _messages(document, width), _penalties(document, width), _not_tested(document, width),
    ]  # fmt: skip
    return "\n\n".join(block for block in blocks if block)


def why_no_team(document: Mapping[str, Any]) -> str:
    """Why no fresh episodes were played: nobody can react, or they weren't asked for."""
    if document["loop"] == "closed":
        return "no fresh episodes were asked for"
    return "the run names no policies that could react"


def _team(document: Mapping[str, Any], width: int) -> str:
    team, fresh = document["team"], document["fresh"]
    if team["all"] is None:
        told = f"Only single actions were replaced; {why_no_team(document)}."
    else:
        told = (
            f"In {fresh} fresh episodes the team's return is {_number(team['all'])}; with the "
            f"baseline ({_baseline(document)}) for everybody it is {_number(team['none'])}."
        )
    return "\n".join(wrapped(told, width))


def _baseline(document: Mapping[str, Any]) -> str:
    """What took agents' places: another than was asked for where none has a declared noop."""
    parts = [part["difference"] for part in document["agents"].values() if part["difference"]]
    played = sorted({part["baseline"] for part in parts})
    asked = str(document["baseline"])
    if not played or played == [asked]:
        return asked
    which = "no" if asked not in played else "not for every agent a"
    return f"{' or '.join(played)}: {which} {asked} is declared"


def _agents(document: Mapping[str, Any], width: int) -> str:
    head = ["agent", "own", "share", "idle", "lost without it", "Shapley", "still, others frozen"]
    rows = [head]
    for name, part in document["agents"].items():
        rows.append([
            name, _number(part["own"]), _percent(part["share"]), _percent(part["idle"]),
            _measured(part["difference"]), _measured(part["shapley"]),
            _measured(part["turn"]["all"]),
        ])  # fmt: skip
    table = _table(rows)
    if max(map(columns_of, table.splitlines())) > width:  # what was seen, then what was tried
        first = _table([row[:SEEN] for row in rows])
        table = f"{first}\n\n{_table([[row[0], *row[SEEN:]] for row in rows])}"
    return "\n".join(["Agents", table, *_stand_ins(document, width)])


def _stand_ins(document: Mapping[str, Any], width: int) -> list[str]:
    """Whose `still` is its first legal action, for want of a declared noop."""
    names = [
        name
        for name, part in document["agents"].items()
        if (part["turn"]["all"] or {}).get("baseline") == "first-legal"
    ]
    if not names:
        return []
    told = f"still: no noop is declared for {', '.join(names)}; its first legal action stands in"
    return wrapped(told, width, first=INDENT, rest=INDENT * 2)


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
        is_other = row["from"] != row["to"] and row["low"] > SURE
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
    return "Influence of one action\n" + _table(rows) + (f"\n  and {more} more" * (more > 0))


def _messages(document: Mapping[str, Any], width: int) -> str:
    lines = []
    for row in document["messages"]:
        if row["kind"] == "listening":
            told = (
                f"{row['to']} decides otherwise in {row['p']:.0%} of {row['n']} looks where it is "
                f"shown another message ({row['low']:.0%} to {row['high']:.0%}; "
                f"{row['sham']:.0%} where it is shown the same)"
            )
        elif row["kind"] == "signalling":
            told = f"{row['from']}'s messages tell {row['bits']:.2f} bits of what it sees"
            told += f" (p = {row['p']:.3f}, {row['n']} episodes)"
        else:
            told = f"what {row['to']} does next shares {row['bits']:.2f} bits with what "
            told += f"{row['from']} says (p = {row['p']:.3f}, {row['n']} episodes)"
        lines += wrapped(told, width, first=INDENT, rest=INDENT * 2)
    return "\n".join(["Messages", *lines]) if lines else ""


def _penalties(document: Mapping[str, Any], width: int) -> str:
    lines = []
    for row in document["penalties"]:
        first = row["first"]
        if first is None:
            continue
        told = (
            f"{row['agent']} pays {row['term']} for what {', '.join(row['by'])} did: {row['p']:.0%}"
            f" of {row['n']} payments ({row['low']:.0%} to {row['high']:.0%}), first in episode "
            f"{first['episode']} (seed {first['seed']}), turn {first['turn']}: {first['paid']:g}"
        )
        lines += wrapped(told, width, first=INDENT, rest=INDENT * 2)
    return "\n".join(["Penalties on the wrong participant", *lines]) if lines else ""


def _not_tested(document: Mapping[str, Any], width: int) -> str:
    lines = [
        line
        for each in document["not_tested"]
        for line in wrapped(
            f"{each['what']}: {each['why']}", width, first=INDENT, rest=INDENT * 2
        )
    ]  # fmt: skip
    return "\n".join(["Not tested", *lines]) if lines else ""


def _table(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(columns_of(row[k]) for row in rows) for k in range(len(rows[0]))]
    return "\n".join(_lines(rows, widths))


def _lines(rows: Sequence[Sequence[str]], widths: Sequence[int]) -> Iterator[str]:
    for row in rows:
        cells = (filled(text, width) for text, width in zip(row, widths, strict=True))
        yield (INDENT + "  ".join(cells)).rstrip()


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
