"""Figures out of the JSON lines that benchmarks print, as benchmarks/wanted/*.toml says how."""

import statistics
from collections.abc import Iterator, Mapping
from functools import reduce
from typing import Any

Lines = list[dict[str, Any]]


def figure_of(every: list[Lines], bar: Mapping[str, Any]) -> dict[str, Any]:
    """What several runs say of one bar: the median, the least and the most."""
    try:
        values = [read(lines, bar["read"]) for lines in every]
    except LookupError as error:
        return {"value": None, "why": str(error.args[0])}
    if isinstance(values[0], list):
        return {"value": reduce(lambda a, b: [a[0] + b[0], a[1] + b[1]], values)}
    if isinstance(values[0], bool):
        return {"value": all(values)}
    low, high, scale = min(values), max(values), bar.get("scale", 1)
    if "spread" in bar:
        ends = [
            read(lines, {**bar["read"], "take": take, "fold": fold})
            for lines in every
            for take, fold in zip(bar["spread"], ("min", "max"), strict=True)
        ]
        low, high = min(low, *ends), max(high, *ends)
    found: dict[str, Any] = {"value": _short(scale * statistics.median(values))}
    if low == high:
        return found
    return {**found, "low": _short(scale * low), "high": _short(scale * high)}


def _short(value: float) -> float:
    return float(f"{value:.4g}")


def read(lines: Lines, how: Mapping[str, Any]) -> Any:
    """A figure out of JSON lines.

    Args:
        lines: what a script printed.
        how: `where` chooses lines by equal fields (a list: any of these), `take` is a dotted path
            in them (`*`: all that stands there), `fold` makes one of many (max, min, all, last,
            median, count, share_in with `between`), `of` counts out of another field, `over` and
            `plus` are other figures, read alike, by which it is divided and that are added to it.

    Raises:
        LookupError: the lines don't hold it.
    """
    chosen = [line for line in lines if _matches(line, how.get("where", {}))]
    found = [value for line in chosen for value in _at(line, how["take"].split("."))]
    found = [value for value in found if value is not None]
    if how.get("fold") == "count":
        return len(found)
    if not found:
        raise LookupError(f"no line has {how['take']} where {how.get('where', {})}")
    if "of" in how:
        return [sum(found), sum(v for line in chosen for v in _at(line, how["of"].split(".")))]
    value = _folded(found, how)
    for other in how.get("plus", ()):
        value += read(lines, other)
    return value if "over" not in how else value / read(lines, how["over"])


def _matches(line: Mapping[str, Any], where: Mapping[str, Any]) -> bool:
    return all(
        line.get(name) in (wanted if isinstance(wanted, list) else [wanted])
        for name, wanted in where.items()
    )


def _at(value: Any, path: list[str]) -> Iterator[Any]:
    if not path:
        yield value
    elif path[0] == "*":
        parts = value.values() if isinstance(value, dict) else value
        for part in parts:
            yield from _at(part, path[1:])
    elif isinstance(value, dict) and path[0] in value:
        yield from _at(value[path[0]], path[1:])


def _folded(found: list[Any], how: Mapping[str, Any]) -> Any:
    match how.get("fold", "last"):
        case "max":
            return max(found)
        case "min":
            return min(found)
        case "median":
            return statistics.median(found)
        case "all":
            return [sum(map(bool, found)), len(found)]
        case "share_in":
            low, high = how["between"]
            return [sum(low <= each <= high for each in found), len(found)]
        case "last":
            return found[-1]
    raise ValueError(f"unknown fold {how['fold']}")
