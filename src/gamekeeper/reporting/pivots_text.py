"""Pivots as text: for each failed episode its curve, its pivots, and actions that would keep it."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from gamekeeper.reporting.text_columns import INDENT, sparkline, wrapped
from gamekeeper.statistics.significance import p_text

MOST_COLUMNS: Final = 48
"""Characters of a curve."""
SOURCES: Final = {
    "policy": "its policy, choosing again",
    "legal": "action {}",
    "sample": "the sample {}",
    "reference": "the reference policy's {}",
}
"""Sources of an action, in words."""
LOSSES: Final = {
    "draws": "most of it returns with the same actions and new random draws: chance lost it",
    "several": "no other action of one agent that was tried keeps it",
    "not tried": "other actions: not tried, the budget is spent",
}
"""The reason why success was lost, where no agent's other action keeps it."""
NO_ACTION: Final = "no other action of one agent that was tried at any turn succeeds"
LAST_TURN: Final = "the last turn from which another action of one agent succeeds"
LONGEST: Final = 60
"""Characters of an action."""
FALL: Final = "confirming the fall at turn "
"""Beginning of what the budget didn't reach, where a fall was found."""
FOUND: Final = "a fall at one turn was found"


def pivots_text(document: Mapping[str, Any], *, width: int, has_blocks: bool = True) -> str:
    """The text that `gamekeeper pivots` shows.

    Args:
        document: as `Pivots.to_json` gives it.
        has_blocks: the terminal can show block characters; otherwise ASCII is used.
    """
    count = document["failed"]
    if not document["episodes"]:
        return f"None of {count['episodes']} episodes failed: there is no pivot to look for."
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for each in document["episodes"]:
        groups.setdefault(_alike(each) or str(each["episode"]), []).append(each)
    blocks = [
        "\n".join(
            line
            for text, indent in (
                _episode(each[0], has_blocks) if len(each) == 1 else _several(why, each)
            )
            for line in wrapped(text, width, first=indent, rest=indent + INDENT)
        )
        for why, each in groups.items()
    ]
    end = (
        f"{len(document['episodes'])} of {count['failed']} failed episodes (of "
        f"{count['episodes']}), {document['steps']:,} env steps; budget {document['budget']:,}"
    )
    return "\n\n".join([*blocks, *wrapped(end, width)])


def _episode(each: Mapping[str, Any], has_blocks: bool) -> Iterator[tuple[str, str]]:
    """Lines of an episode, each with its indent."""
    who = "the team" if each["scope"] == "team" else each["scope"]
    yield f"Episode {each['episode']}: {who} failed after {each['turns']} turns", ""
    if each["question"] == "last action":
        yield from _last_action(each)
    else:
        yield from _falls(each, has_blocks)
    for text in each["not_tried"]:
        yield f"not tried: {text}", INDENT


def _alike(each: Mapping[str, Any]) -> str:
    """Sentence on an episode in which no turn is named; empty where there is more to say."""
    if each["pivots"]:
        return ""
    if each["question"] == "last action":
        return "" if each["not_tried"] else NO_ACTION
    return "; ".join([no_pivot_text(each), *(f"not tried: {text}" for text in each["not_tried"])])


def _several(why: str, episodes: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str, str]]:
    """Lines of episodes of which the same is said."""
    numbers = ", ".join(str(each["episode"]) for each in episodes)
    yield f"{len(episodes)} episodes failed without a pivot: {numbers}", ""
    yield why, INDENT
    played = sum(point["n"] for each in episodes for point in each["curve"])
    if played and why == NO_ACTION:
        yield f"all {played:,} continuations with new random draws failed", INDENT
    yield "next: gamekeeper diagnose, which looks for a fault in all episodes", INDENT


def _falls(each: Mapping[str, Any], has_blocks: bool) -> Iterator[tuple[str, str]]:
    curve = each["curve"]
    if curve:
        shares = _columns(curve, each["turns"])
        line = sparkline(shares, has_blocks=has_blocks, bounds=(0.0, 1.0))
        yield f"success (0 to 100%) from turn 0 to {each['turns']}: |{line}|", INDENT
        first = curve[0]
        if first["turn"] < each["turns"]:  # at the end of the episode it is known
            start = f"from turn {first['turn']}: {share_text(first)}"
            yield f"{start} continuations by the policies succeed", INDENT
    for pivot in each["pivots"]:
        yield from _pivot(pivot)
    if not each["pivots"]:
        yield no_pivot_text(each), INDENT


def no_pivot_text(each: Mapping[str, Any]) -> str:
    """The reason why no turn of an episode is named."""
    curve = each["curve"]
    seldom = "continued from the first turn, the policies seldom succeed"
    is_seldom = curve and curve[0]["turn"] == 0 and curve[0]["high"] <= 0.25
    if each["not_tried"]:
        turns = [x.removeprefix(FALL) for x in each["not_tried"] if x.startswith(FALL)]
        what = f"the fall at turn {turns[0].partition(':')[0]} was confirmed" if turns else FOUND
        shown = f"the budget ended before {what}"
        return f"{seldom}, and {shown}" if is_seldom else shown
    if is_seldom:
        return f"{seldom}: no turn of this episode lost it"
    return "no fall at one turn beyond chance: success was lost gradually, or before turn 0"


def _pivot(pivot: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    before, after = pivot["before"], pivot["after"]
    yield (
        f"turn {pivot['turn']} lost it: success falls from {share_text(before)} before to "
        f"{share_text(after)} after it (Fisher's exact test, {p_text(pivot['p'])}, Holm-corrected)",
        INDENT,
    )
    lost = loss_sentence(pivot)
    if lost:
        yield lost, INDENT * 2
    for text in kept_by(pivot):
        yield text, INDENT * 2


def loss_sentence(pivot: Mapping[str, Any]) -> str:
    """The reason why success was lost; empty where an agent's other action keeps it."""
    return LOSSES.get(pivot["loss"], "")


def kept_by(pivot: Mapping[str, Any]) -> Iterator[str]:
    """The best action of each agent that would have kept it, in sentences."""
    for agent in pivot["agents"]:
        best = next(each for each in pivot["tried"] if each["agent"] == agent and each["keeps"])
        yield f"{agent} would have kept it by {_action(best)}: {share_text(best)} succeed"


def _last_action(each: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    yield f"{_all_fail(each['curve'])}; looked for: {LAST_TURN}", INDENT
    for pivot in each["pivots"]:
        yield f"turn {pivot['turn']} is the last one", INDENT
        for text in kept_by(pivot):
            yield text, INDENT * 2
    if not each["pivots"]:
        so_far = "no other action of one agent that was tried so far succeeds"
        yield so_far if each["not_tried"] else NO_ACTION, INDENT


def _all_fail(curve: list[Mapping[str, Any]]) -> str:
    count = sum(point["n"] for point in curve)
    if count:
        return f"all {count} continuations with new random draws failed"
    return "no random draw was seen, and the policies fail again from every turn"


def _action(tried: Mapping[str, Any]) -> str:
    text = str(tried["action"])
    short = text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."
    return SOURCES[tried["source"]].format(short)


def share_text(point: Mapping[str, Any]) -> str:
    """A share with its number of continuations, and its interval where there is one."""
    text = f"{point['successes']} of {point['n']}"
    if "low" not in point:
        return text
    return f"{point['share']:.0%} ({text}; {point['low']:.0%} to {point['high']:.0%})"


def _columns(curve: list[Mapping[str, Any]], turns: int) -> list[float | None]:
    """Shares by column, on the straight line between those that are known."""
    count = min(MOST_COLUMNS, turns + 1)
    found: list[float | None] = []
    for column in range(count):
        at = column * turns / max(count - 1, 1)
        before = max((p for p in curve if p["turn"] <= at), key=lambda p: p["turn"], default=None)
        after = min((p for p in curve if p["turn"] >= at), key=lambda p: p["turn"], default=None)
        if before is None or after is None:
            found.append(None)
            continue
        span = after["turn"] - before["turn"]
        part = (at - before["turn"]) / span if span else 0.0
        found.append(before["share"] + part * (after["share"] - before["share"]))
    return found
