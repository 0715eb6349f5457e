"""What stands on the outside of an environment: rosters, counts, whom its books speak of."""

from __future__ import annotations

import operator
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

from gamekeeper.audit.lab import RESET_STEPS, Lab, Saw
from gamekeeper.audit.probes._limits import limits_of
from gamekeeper.core.canon import type_name
from gamekeeper.core.layout import agent_name
from gamekeeper.run.episode import Play, Played

SHARE: Final = 1.5
PLAYS: Final = 3
"""Episodes at least, however long."""
SHORT_PLAYS: Final = 6
"""Further episodes, where the first ones ended early and left steps to spend."""
BOOKS: Final = ("rewards", "_cumulative_rewards", "terminations", "truncations", "infos")
"""What an AEC environment keeps by agent, in the order in which `last` reads it."""
FLAGS: Final = ("terminations", "truncations")
PARTS: Final = {2: "observations infos", 5: "observations rewards terminations truncations infos"}
"""What reset and step of a Parallel environment return."""
LAST: Final = 5
"""Values that `last()` of an AEC environment returns."""


def plays(lab: Lab) -> Iterator[Play]:
    """First a few that may be long, then more while there are steps left."""
    turns = max(lab.ration // PLAYS, 20)
    for k in range(PLAYS + SHORT_PLAYS):
        yield Play(seed=lab.seed + k, stream=k, most_turns=turns)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """The trace; attributes before a reset, after it, after each crossing, after another reset.

    Facts, each with names of agents as texts:
        `possible_agents`: {"fresh", "before", "turns", "again"}: whether the instance was; what it
            named before the reset, at the start of each turn, and after the play and one more
            reset; None where it isn't there.
        `agents`: {"first", "turns", "again", "midway"}: the roster after a reset, the same after a
            reset with the same seed and at the start of each turn, and after the play and a third
            one; and where somebody left before the others, [turns played until then, the roster
            after a reset at once].
        `kinds`: [turn, types of `agents` and `possible_agents`] after the reset, and wherever they
            are others.
        `counts`: for each turn [num_agents, max_num_agents, agents, possible agents], the first two
            as the environment says it, or None where it doesn't.
        `returned`: for each call what reset and step (Parallel), or `last` after the third reset
            (AEC) returned, in words; empty if as it should be.
        `books`: (AEC) for each turn {"missing": {book: agents}, "strangers": {book: agents}}.
        `limits`: whole numbers that the environment holds from the reset to the end of the play, by
            their names, where these sound like a limit of time.
        `flagged`: (AEC) agents whose flags are up right after the first, second and third reset.
    """
    env = lab.env()
    possible: dict[str, Any] = {"fresh": lab.can_make}
    possible["before"] = _names(lab, env, "possible_agents")
    rosters: dict[str, Any] = {"first": _reset(lab, env, play)}
    flagged = [_flagged(env)] if lab.api == "aec" else []
    limits = limits_of(env)
    seen = _Seen(lab)
    played = lab.play(play, env, watch=seen.watch)
    limits = {name: value for name, value in limits_of(env).items() if limits.get(name) == value}
    yield played.trace
    rosters["turns"], possible["turns"] = seen.rosters, seen.possible
    rosters["again"] = _reset(lab, env, play)
    possible["again"] = _names(lab, env, "possible_agents")
    rosters["midway"] = _midway(lab, env, played, seen.rosters)
    yield lab.fact("possible_agents", possible, field="possible_agents")
    yield lab.fact("agents", rosters, field="agents")
    yield lab.fact("kinds", seen.kinds, field="agents")
    yield lab.fact("limits", limits, field="terminations")
    yield lab.fact("counts", seen.counts, field="num_agents")
    returned = [_wrong_last(lab, env)] if lab.api == "aec" else seen.returned
    yield lab.fact("returned", returned, field="returned")
    if lab.api == "aec":
        yield lab.fact("books", seen.books, field="books")
        flagged += [seen.flagged, _flagged(env)]
        yield lab.fact("flagged", flagged, field="terminations")


class _Seen:
    """What was there at the start of each turn of a play."""

    def __init__(self, lab: Lab) -> None:
        self.rosters: list[Any] = []
        self.possible: list[Any] = []
        self.counts: list[list[Any]] = []
        self.returned: list[str] = []
        self.books: list[dict[str, Any]] = []
        self.kinds: list[tuple[int, list[str]]] = []
        self.flagged: list[str] = []
        self._lab = lab
        self._last: dict[str, tuple[Any, Any]] = {}

    def watch(self, turn: int, env: Any, out: Any) -> None:
        """One turn's start."""
        self.rosters.append(self._names(env, "agents"))
        self.possible.append(self._names(env, "possible_agents"))
        counted = [_count(env, name) for name in ("num_agents", "max_num_agents")]
        named = self.rosters[-1], self.possible[-1]
        sizes = [None if names is None else len(names) for names in named]
        self.counts.append([*counted, *sizes])
        if self._lab.api == "parallel":
            self.returned.append(_wrong(out, 5 if turn else 2))
        else:
            self.books.append(_books(env))
        kinds = [_kind(env, name) for name in ("agents", "possible_agents")]
        if not self.kinds or kinds != self.kinds[-1][1]:
            self.kinds.append((turn, kinds))
        if not turn:
            self.flagged = _flagged(env) if self._lab.api == "aec" else []

    def _names(self, env: Any, attribute: str) -> Any:
        """The names, spelt anew only where they have changed."""
        value = getattr(env, attribute, None)
        known = self._last.get(attribute)
        if known is not None and value.__class__ is list and value == known[0]:
            return known[1]
        names = _names(self._lab, env, attribute)
        if value.__class__ is list:
            self._last[attribute] = list(value), names
        return names


def _reset(lab: Lab, env: Any, play: Play) -> Any:
    """The roster after a reset with the play's seed; None where it raised."""
    lab.meter.count(RESET_STEPS)
    given: dict[str, Any] = {} if play.seed is None else {"seed": play.seed}
    if play.options is not None:
        given["options"] = dict(play.options)
    failed = lab.call("reset", env.reset, **given).failed
    return _names(lab, env, "agents") if failed is None else None


def _midway(lab: Lab, env: Any, played: Played, rosters: Sequence[Any]) -> list[Any] | None:
    """After the first turns of a play, until somebody has left, a reset: its roster."""
    for turn, names in enumerate(rosters):
        if names and rosters[0] and not set(rosters[0]) <= set(names):
            paper = (played.play.actions or ())[:turn]
            if turn and len(paper) == turn:
                lab.play(replace(played.play, actions=paper, most_turns=turn), env)
                return [turn, _reset(lab, env, played.play)]
            return None
    return None


def _names(lab: Lab, env: Any, attribute: str) -> list[str] | None:
    """The names in a roster, however it is kept; None where there is none."""
    called = lab.call(attribute, lambda: list(getattr(env, attribute)))
    return None if called.failed is not None else [agent_name(agent) for agent in called.value]


def _count(env: Any, name: str) -> Any:
    try:
        count: Any = getattr(env, name, None)
    except Exception:  # where it counts what isn't there yet
        return None
    if count is None:
        return None
    return operator.index(count) if hasattr(count, "__index__") else repr(count)


def _kind(env: Any, name: str) -> str:
    value = getattr(env, name, None)
    return "" if value is None else type_name(value)


def _wrong(out: Any, count: int) -> str:
    """What is wrong with the form of what was returned; empty if nothing is."""
    if not isinstance(out, tuple | list):
        return f"a {type(out).__name__}"
    if len(out) != count:
        return f"a {type(out).__name__} of {len(out)}"
    odd = [
        f"{name}: {type(part).__name__}"
        for name, part in zip(PARTS[count].split(), out, strict=True)
        if not isinstance(part, Mapping)
    ]
    return ", ".join(odd)


def _wrong_last(lab: Lab, env: Any) -> str:
    """What is wrong with what `last()` returned; empty if nothing is, or if it raised."""
    if not getattr(env, "agents", None):
        return ""
    called = lab.call("last", env.last)
    if called.failed is not None or (isinstance(called.value, tuple) and len(called.value) == LAST):
        return ""
    return _wrong(called.value, LAST) or f"a {type(called.value).__name__}"


def _books(env: Any) -> dict[str, Any]:
    """Of whom an AEC environment's books don't speak, and of whom they speak without reason."""
    missing: dict[str, list[str]] = {}
    strangers: dict[str, list[str]] = {}
    agents: Sequence[Any] = list(getattr(env, "agents", None) or ())
    for name in BOOKS:
        book = getattr(env, name, None)
        if not isinstance(book, Mapping):
            missing[name] = [agent_name(agent) for agent in agents]
            continue
        if book.keys() == set(agents):
            continue
        missing[name] = [agent_name(agent) for agent in agents if agent not in book]
        strangers[name] = [agent_name(agent) for agent in book if agent not in agents]
    return {
        "missing": {name: names for name, names in missing.items() if names},
        "strangers": {name: names for name, names in strangers.items() if names},
    }


def _flagged(env: Any) -> list[str]:
    """Agents that an AEC environment says have ended."""
    found: dict[str, None] = {}
    for name in FLAGS:
        book = getattr(env, name, None)
        if isinstance(book, Mapping):
            found.update((agent_name(agent), None) for agent, flag in book.items() if _is_up(flag))
    return list(found)


def _is_up(flag: Any) -> bool:
    try:
        return bool(flag)
    except Exception:  # an array of flags says nothing
        return False
