"""Two audits side by side: what changed between two versions of an environment. Pure."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

from gamekeeper.auditing.result import AuditResult

Kind = Literal["api", "roster", "spaces", "contract", "measured", "verdicts"]
"""In the order in which they are told."""
OF_THE_GAME: Final = frozenset({"api", "roster", "spaces", "measured"})
"""Kinds after which results of before can't be compared any more."""
NEAR: Final = 1e-9
"""Measured numbers that differ by no more, relatively, are the same."""


@dataclass(frozen=True, slots=True)
class Changed:
    """One thing that is other in the second version.

    Attributes:
        kind: `api`, `roster`, `spaces`, `contract`, `measured` or `verdicts`.
        where: its name: an agent's space, a measured field, a check.
        a: in the first version; None where it has no such thing.
        b: in the second one.
    """

    kind: Kind
    where: str
    a: Any
    b: Any

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)


def changes(a: AuditResult, b: AuditResult) -> tuple[Changed, ...]:
    """Differences between two audits of the same seed and budget, the form of the game first."""
    found = [Changed("api", "api", a.api, b.api)] if a.api != b.api else []
    found += [*_roster(a, b), *_spaces(a, b)]
    declared = _leaves(a.declared or {}, b.declared or {})
    found += [Changed("contract", *each) for each in declared]
    return (*found, *_measured(a, b), *_verdicts(a, b))


def is_other_game(found: tuple[Changed, ...]) -> bool:
    """Tells whether earlier results can't be compared any more."""
    return any(each.kind in OF_THE_GAME for each in found)


def _roster(a: AuditResult, b: AuditResult) -> Iterator[Changed]:
    if set(a.agents) == set(b.agents):
        if list(a.agents) != list(b.agents):
            yield Changed("roster", "order", list(a.agents), list(b.agents))
        return
    gone = [name for name in a.agents if name not in b.agents]
    new = [name for name in b.agents if name not in a.agents]
    yield Changed("roster", "agents", gone or None, new or None)


def _spaces(a: AuditResult, b: AuditResult) -> Iterator[Changed]:
    for name in a.agents:
        for key in a.agents[name] if name in b.agents else ():
            one, two = a.agents[name].get(key), b.agents[name].get(key)
            if one != two:
                yield Changed("spaces", f"{name}.{key}", one, two)


def _measured(a: AuditResult, b: AuditResult) -> Iterator[Changed]:
    one, two = dict(a.measured), dict(b.measured)
    yield from _influence(one.pop("influence", None) or [], two.pop("influence", None) or [])
    for each in (one, two):
        for words in ("why", "not_measured"):  # they follow from the rest
            each.pop(words, None)
    for path, left, right in _leaves(one, two):
        yield Changed("measured", path, left, right)


def _influence(a: list[Any], b: list[Any]) -> Iterator[Changed]:
    """Differences in influence, where the intervals have no value in common."""
    names = ("from", "to", "on", "lag")
    left, right = ({tuple(x[name] for name in names): x for x in side} for side in (a, b))
    for key in dict.fromkeys([*left, *right]):
        one, two = left.get(key), right.get(key)
        bounds = [(0.0, 1.0) if x is None else (x["low"], x["high"]) for x in (one, two)]
        if bounds[0][0] > bounds[1][1] or bounds[1][0] > bounds[0][1]:
            where = f"influence of {key[0]} on {key[1]}'s {key[2]}, lag {key[3]}"
            yield Changed("measured", where, one and one["p"], two and two["p"])


def _verdicts(a: AuditResult, b: AuditResult) -> Iterator[Changed]:
    """Checks whose outcome changed; what one version has no verdict on is left out."""
    before = {each.id: each for each in a.verdicts}
    for each in b.verdicts:
        was = before.get(each.id)
        if was is not None and was.outcome != each.outcome:
            yield Changed("verdicts", f"{each.id} {each.claim}", was.outcome, each.outcome)


def _leaves(a: Any, b: Any, path: str = "") -> Iterator[tuple[str, Any, Any]]:
    """The paths at which two pieces of plain data differ, with both values."""
    both = [{} if each is None else each for each in (a, b)]
    if isinstance(both[0], Mapping) and isinstance(both[1], Mapping):
        one, two = both
        for key in dict.fromkeys([*one, *two]):
            yield from _leaves(one.get(key), two.get(key), f"{path}.{key}" if path else str(key))
    elif not _same(a, b):
        yield path, a, b


def _is_nothing(value: Any) -> bool:
    """Tells whether a value is empty, however it is written: an empty list is as absent as None."""
    if isinstance(value, Mapping | list | tuple):
        return all(map(_is_nothing, value.values() if isinstance(value, Mapping) else value))
    return value is None or value == ""


def _same(a: Any, b: Any) -> bool:
    if _is_nothing(a) and _is_nothing(b):
        return True
    numbers = [isinstance(x, int | float) and not isinstance(x, bool) for x in (a, b)]
    if all(numbers):
        return math.isclose(a, b, rel_tol=NEAR, abs_tol=NEAR) or (a != a and b != b)
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    return bool(a == b)
