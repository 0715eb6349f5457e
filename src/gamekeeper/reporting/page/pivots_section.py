"""Pivots on a page: their section, and on the timeline of an episode marks and the curve."""

from collections.abc import Mapping
from typing import Any, Final

from gamekeeper.reporting.page.packed_episode import Mark
from gamekeeper.reporting.page.page_data import Cell, Chart, PageBlock, PageSection, PageTable, name
from gamekeeper.reporting.pivots_text import kept_by, loss_sentence, share_text

Document = Mapping[str, Any]

MOST: Final = 12
"""Most episodes that are drawn; their pivots stand in the table."""
NOTE: Final = (
    "From a turn the policies go on, on fresh draws: the share that succeeds, with its 95 % "
    "interval, corrected for the number of turns. A mark is a turn at which it falls beyond chance."
)


def pivots_section(document: Document | None, *, key: str) -> PageSection | None:
    """Turns that lost failed episodes; None where they weren't looked for, or none failed."""
    episodes = (document or {}).get("episodes") or ()
    if not episodes:
        return None
    curves = tuple(_curve(each) for each in episodes if each["curve"])
    missed = [
        f"Episode {each['episode']}: {text}." for each in episodes for text in each["not_tried"]
    ]
    drawn = f"The first {MOST} of {len(curves)} curves are drawn." if len(curves) > MOST else ""
    block = PageBlock(
        notes=tuple(filter(None, [NOTE if curves else "", drawn])),
        charts=curves[:MOST],
        tables=(_table(document or {}, key),),
    )
    left = PageBlock(title=f"Not tried: {len(missed)}", notes=tuple(missed), folded=True)
    return PageSection("pivots", "Turns that lost it", (block, *([left] if missed else [])))


def _curve(each: Document) -> Chart:
    points = each["curve"]
    line = {"name": "success", "values": [point["share"] for point in points]}
    line |= {bound: [point[bound] for point in points] for bound in ("low", "high")}
    marks = [{"x": pivot["turn"], "text": f"turn {pivot['turn']}"} for pivot in each["pivots"]]
    return {
        "id": f"pivots-{each['episode']}",
        "kind": "line",
        "title": f"Success from each turn of episode {each['episode']}",
        "x": {"label": "turn", "values": [point["turn"] for point in points]},
        "y": {"label": "share that succeeds"},
        "series": [line],
        "marks": marks,
        "note": "",
    }


def _table(document: Document, key: str) -> PageTable:
    rows = tuple(
        (
            Cell(f"episode {each['episode']}"),
            Cell(f"turn {pivot['turn']}", link=f"{key}/{each['episode']}/{pivot['turn']}"),
            Cell("-" if is_last else share_text(pivot["before"])),
            Cell("-" if is_last else share_text(pivot["after"])),
            name(", ".join(pivot["agents"]) or "-"),
            Cell("; ".join(filter(None, [loss_sentence(pivot), *kept_by(pivot)])) or "-"),
        )
        for each in document["episodes"]
        for is_last in [each["question"] == "last action"]
        for pivot in each["pivots"]
    )
    columns = ("episode", "turn", "success before", "after", "agents", "what would have kept it")
    return PageTable("Turns that lost it", columns, rows)


# -- on the timeline


def pivots_of(document: Document | None, episode: int) -> Document | None:
    """The part of `gamekeeper pivots --json` about an episode; None where there is none."""
    every = (document or {}).get("episodes") or ()
    return next((each for each in every if each["episode"] == episode), None)


def pivot_marks(found: Document) -> list[Mark]:
    """A mark for each pivot, of the agent whose action would have kept the success if it is one."""
    is_last = found["question"] == "last action"
    marks = []
    for pivot in found["pivots"]:
        agents = pivot["agents"]
        fall = f"success falls from {pivot['before']['share']:.0%} to {pivot['after']['share']:.0%}"
        text = "last turn at which another action succeeds" if is_last else fall
        if len(agents) > 1:
            text += f"; actions of {', '.join(agents)} would have kept it"
        elif pivot["loss"] == "draws":
            text += "; chance lost it"
        marks.append(Mark(pivot["turn"], "pivot", text, agents[0] if len(agents) == 1 else None))
    return marks


def success_curve(found: Document) -> list[list[float]]:
    """[turn, share, low, high] of each turn whose continuations were played."""
    return [[each[key] for key in ("turn", "share", "low", "high")] for each in found["curve"]]
