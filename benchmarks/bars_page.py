"""The table of bars as Markdown, out of what is wanted and what was measured."""

from collections.abc import Iterator, Mapping
from typing import Any, Final

BEGIN: Final = "<!-- bars: written by benchmarks/bars.py -->"
END: Final = "<!-- bars: end -->"
HEAD: Final = (
    "| bar | wanted | measured | reached | run | date | load |",
    "|---|---|---|---|---|---|---|",
)
Results = Mapping[str, Mapping[str, Any]]


def page_with(page: str, runs: list[dict[str, Any]], results: Results) -> str:
    """The page with the table of now between its two marks.

    Raises:
        ValueError: a mark is missing.
    """
    before, _, rest = page.partition(BEGIN)
    _, mark, after = rest.partition(END)
    if not mark:
        raise ValueError(f"the page has no {BEGIN} with {END} after it")
    return "\n".join([before + BEGIN, "", *table(runs, results), "", END]) + after


def table(runs: list[dict[str, Any]], results: Results) -> Iterator[str]:
    """Counts, the bars by room, then the command behind each name."""
    told = [verdict(run, bar, results) for run in runs for bar in run["bar"]]
    wanted = [each for each in told if each is not None]
    yield (
        f"{len(wanted)} bars: {wanted.count('yes')} reached, {wanted.count('no')} not reached, "
        f"{wanted.count('')} not measured."
    )
    yield ""
    yield from HEAD
    room = None
    for run in runs:
        if run["room"] != room:
            room = run["room"]
            yield f"| **{room}** | | | | | | |"
        for bar in run["bar"]:
            yield row(run, bar, results)
    yield ""
    yield "| run | command | minutes | quiet machine |"
    yield "|---|---|---|---|"
    for run in runs:
        command = f"`{run['command']}`"
        if "whole" in run:
            command += f"; whole: `{run['whole']}`, {run.get('whole_minutes', '?')} min"
        if "note" in run:
            command += f". {run['note']}"
        quiet = "yes" if run.get("clock") else "no"
        yield f"| {run['name']} | {command} | {_minutes(run, results)} | {quiet} |"


def _minutes(run: Mapping[str, Any], results: Results) -> str:
    """How long the short form took; before it ran, how long it is thought to take."""
    seconds = results.get(run["name"], {}).get("usual", {}).get("seconds")
    return f"{run.get('minutes', 1):g}" if seconds is None else f"{seconds / 60:.1f}"


def row(run: Mapping[str, Any], bar: Mapping[str, Any], results: Results) -> str:
    """The line of one bar; where a whole run is kept beside the usual one, both stand there."""
    entries = list(_entries(run, bar, results))
    said = verdict(run, bar, results)
    measured = "; ".join(
        ("whole run: " if kind == "whole" and len(entries) > 1 else "") + shown(bar, found)
        for kind, _, found in entries
    )
    dates = "; ".join(dict.fromkeys(entry["date"] for _, entry, _ in entries))
    loads = "; ".join(_load(entry) for _, entry, _ in entries)
    verdicts = {"no": "**no**", None: "no bar"}
    cells = [
        bar["what"],
        text_of(bar),
        measured or "not measured",
        verdicts.get(said, said or ""),
        run["name"],
        dates,
        loads,
    ]
    return f"| {' | '.join(cells)} |"


def verdict(run: Mapping[str, Any], bar: Mapping[str, Any], results: Results) -> str | None:
    """`yes`, `no`, empty where nothing was measured; None where nothing was wanted.

    Where a run says `judge = "whole"`, its short form is too little to judge by, once there is a
    whole one; elsewhere both have to be as wanted.
    """
    if not _is_bar(bar):
        return None
    told = {kind: reached(bar, found) for kind, _, found in _entries(run, bar, results)}
    if run.get("judge") == "whole" and "whole" in told:
        return "yes" if told["whole"] else "no"
    if not told:
        return ""
    return "yes" if all(told.values()) else "no"


def _entries(
    run: Mapping[str, Any], bar: Mapping[str, Any], results: Results
) -> Iterator[tuple[str, Mapping[str, Any], Mapping[str, Any]]]:
    kept = results.get(run["name"], {})
    for kind in ("usual", "whole"):
        found = kept.get(kind, {}).get("bars", {}).get(bar["name"], {})
        if found.get("value") is not None:
            # A figure that a later run didn't find stands under the date of its own run.
            yield kind, found if "date" in found else kept[kind], found


def _load(entry: Mapping[str, Any]) -> str:
    others = entry.get("others")
    return f"{entry['load']}" + ("" if others is None else f", others {others:g}")


def _is_bar(bar: Mapping[str, Any]) -> bool:
    return any(kind in bar for kind in ("most", "least", "within", "all", "equal"))


def reached(bar: Mapping[str, Any], found: Mapping[str, Any]) -> bool | None:
    """Whether a figure is as wanted; None where nothing is wanted or nothing was found."""
    value = found.get("value")
    if value is None or not _is_bar(bar):
        return None
    if isinstance(value, list):
        hits, looks = value
        if looks < bar.get("looks", 0):
            return False
        if "all" in bar:
            return bool(hits == looks)
        value = 100 * hits / looks if looks else 0.0
    if "equal" in bar:
        return bool(value == bar["equal"])
    if "within" in bar:
        ends = (found.get("low", value), found.get("high", value))
        return all(bar["within"][0] <= each <= bar["within"][1] for each in ends)
    return bool(value <= bar["most"] if "most" in bar else value >= bar["least"])


def text_of(bar: Mapping[str, Any]) -> str:
    """What is wanted, in a few signs."""
    if "wanted" in bar:
        return str(bar["wanted"])
    if "all" in bar:
        return "all"
    if "equal" in bar:
        return _plain(bar["equal"], "")
    unit = _unit(bar)
    if "within" in bar:
        low, high = bar["within"]
        return f"{_number(low)} to {_number(high)}{unit}"
    for kind, sign in (("most", "≤"), ("least", "≥")):
        if kind in bar:
            return f"{sign} {_number(bar[kind])}{unit}"
    return ""


def shown(bar: Mapping[str, Any], found: Mapping[str, Any]) -> str:
    """A figure with its unit and its spread."""
    value = found["value"]
    text = _plain(value, _unit(bar))
    if "low" in found:
        text += f" ({_number(found['low'])} to {_number(found['high'])})"
    return text


def _plain(value: Any, unit: str) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return f"{value[0]:,} of {value[1]:,}"
    return f"{_number(value)}{unit}"


def _unit(bar: Mapping[str, Any]) -> str:
    return f" {bar['unit']}" if bar.get("unit") else ""


def _number(value: float) -> str:
    """Three digits, whole ones whole."""
    if isinstance(value, int) or abs(value) >= 1000:
        return f"{value:,.0f}"
    return f"{value:.3g}"
