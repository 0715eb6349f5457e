"""A diagnosis as text: for every agent what was found, what was tried, what wasn't and why."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from gamekeeper.report.columns import filled, wrapped

INDENT: Final = "  "
MOST: Final = 12
"""Changes that are shown for an agent; the document has all of them."""


def diagnosis_text(document: Mapping[str, Any], *, width: int) -> str:
    """The team first, then every agent; agents with one and the same answer stand together.

    Args:
        document: a diagnosis as plain data.
        width: columns that no line exceeds.
    """
    blocks = [_head(document, width)]
    if document["team"] is not None:
        blocks.append(_one("team", document["team"], width))
    groups: dict[str, list[str]] = {}
    for name, found in document["agents"].items():
        groups.setdefault(_key(found), []).append(name)
    for names in groups.values():
        found = document["agents"][names[0]]
        if document["team"] is not None and _key(found) == _key(document["team"]):
            title = f"{', '.join(names)}  {_verdict(found)}, as the team"
            blocks.append("\n".join(wrapped(title, width, rest=INDENT)))
        else:
            blocks.append(_one(", ".join(names), found, width))
    if document["partings"]:
        blocks.append(_partings(document["partings"], width))
    return "\n\n".join(blocks)


def _head(document: Mapping[str, Any], width: int) -> str:
    counts = [
        f"{each['failed']} of {each['episodes']} episodes failed for {scope}"
        for scope, each in document["recorded"].items()
    ]
    text = (
        f"Diagnosed  {document['run']}: {'; '.join(counts)}. {document['episodes']} fresh episodes "
        f"played, seed {document['seed']}."
    )
    return "\n".join(wrapped(text, width, rest=INDENT))


def _key(found: Mapping[str, Any]) -> str:
    """Agents with one key are told together: they have nothing of their own to tell."""
    own = [each for each in found["tested"] if each["kind"] == "stressor"]
    return repr((found["answer"], found["labels"], found["why"], found["scope"], own and id(found)))


def _one(name: str, found: Mapping[str, Any], width: int) -> str:
    lines = wrapped(f"{name}  {_verdict(found)}", width, rest=INDENT)
    share = found["success"]
    lines += wrapped(
        f"{found['why']}. Success as it is: {share['share']:.0%} "
        f"(95 %: {share['low']:.0%} to {share['high']:.0%}).",
        width, first=INDENT, rest=INDENT,
    )  # fmt: skip
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
    shown = [each for each in tested if each["kind"] == "remedy"]
    shown += [each for each in tested if each["kind"] == "stressor" and each.get("depends")]
    for each in shown[:MOST]:
        mark = "restores" if each.get("restores") else ("hurts" if each.get("depends") else "")
        if each.get("depends") and each["effect"] > 0:
            mark = "helps"
        figures = f"{each['effect']:+.2f} ({each['low']:+.2f} to {each['high']:+.2f})"
        tail = f" {figures}  {each['measure']}  {mark}".rstrip()
        room = max(width - len(INDENT) - len(tail), 20)
        name = f"{each['kind']} {each['change']}"
        name = name if len(name) <= room else name[: room - 3] + "..."
        yield f"{INDENT}{filled(name, room)}{tail}"
    rest = len(tested) - len(shown[:MOST])
    if rest > 0:
        yield f"{INDENT}{rest} more changes were played (--json has them)"


def _partings(partings: list[Mapping[str, Any]], width: int) -> str:
    lines = ["Where twins part"]
    for each in partings:
        if each["turn"] is None:
            where = "nowhere"
        else:
            whom = "" if each["agent"] is None else f" of {each['agent']}"
            where = f"turn {each['turn']}, {each['field']}{whom}"
        ends = "restored" if each["restored"] else "still fails"
        ends += ", restored" if each["restored_open"] else ", still fails"
        ends += " with the others' actions kept"
        text = f"episode {each['episode']}  {each['remedy']}: {where}; {ends}"
        lines += wrapped(text, width, first=INDENT, rest=INDENT * 2)
    return "\n".join(lines)
