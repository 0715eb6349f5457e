"""Probes of what stands on the outside of an environment: rosters, counts, books, metadata."""

import inspect
import operator
import re
import sys
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from types import FunctionType, MethodType, ModuleType
from typing import Any, Final

from gymnasium.spaces import Space

from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import RESET_STEPS, ProbeSession, Saw
from gamekeeper.auditing.probes.moves import cut
from gamekeeper.checks.ended_agents import is_up
from gamekeeper.checks.facts.surface_facts import (
    AgentCounts,
    BookEntries,
    FlaggedAgents,
    LaterMetadata,
    LiveRosters,
    Metadata,
    PossibleAgents,
    ReturnedForms,
    RosterKinds,
    TimeLimits,
    TurnBooks,
)
from gamekeeper.episodes.canonical import to_json, type_name
from gamekeeper.episodes.layout import agent_name
from gamekeeper.rollouts.episode_loop import EpisodePlan, EpisodeResult

LIMIT: Final = re.compile(
    r"(^|_)(max|limit|horizon|cutoff|timeout|deadline|closing|duration|(n|num)_(steps|cycles|ticks))"
    r"(_|$)",
    re.IGNORECASE,
)
"""Names of limits of time."""
NO_LIMIT: Final = re.compile(
    r"round|turn|move|hand|card|score|point|size|width|height|agent|player|speed|reward|health",
    re.IGNORECASE,
)
"""Words for units of which a game's rules may have a last one, or that are no time."""
TIME: Final = re.compile(
    r"step|cycle|tick|time|frame|iter|episode|len|horizon|cutoff|deadline|closing|duration",
    re.IGNORECASE,
)
"""Words for units of time, of which a limit is one."""
TURNS: Final = re.compile(r"_?(round|turn|move|hand)s?", re.IGNORECASE)
"""Words for units of a game, of which a rule may allow no more."""
LIMITS: Final = range(5, 1_000_000)
_NO_SETTINGS: Final = (type, ModuleType, FunctionType, MethodType, Space)


def limits_of(env: Any) -> dict[str, int]:
    """Such numbers by name; the nearer one where two have the same name.

    They are looked for in the instance, in what it holds (a dictionary or an object of settings),
    in its classes, in its constructors' defaults and in the modules that the classes stand in.
    """
    inner = getattr(env, "unwrapped", env)
    own = dict(getattr(inner, "__dict__", {}))
    found: dict[str, int] = {}
    for named in (own, *map(_settings, own.values()), *_of_classes(type(inner))):
        for name, value in named.items():
            if _is_limit(name, value):
                found.setdefault(name, value)
    return found


def _is_limit(name: object, value: object) -> bool:
    return (
        type(value) is int
        and value in LIMITS
        and isinstance(name, str)
        and LIMIT.search(name) is not None
        and NO_LIMIT.search(name) is None
        and (TIME.search(name) is not None or not LIMIT.sub("", name))
    )


def far_limits(env: Any, given: Mapping[str, Any], least: int) -> list[str]:
    """Arguments of an environment's constructors that are called like a limit, of time or turns.

    Args:
        env: its classes are looked at.
        given: arguments that it was built with, in place of defaults.
        least: a limit is larger, or None.
    """
    found: dict[str, None] = {}
    for each in type(getattr(env, "unwrapped", env)).__mro__:
        for name, default in {**_defaults(vars(each).get("__init__")), **given}.items():
            value, rest = given.get(name, default), TURNS.sub("", name)
            is_far = value is None or (type(value) is int and value > least)
            if is_far and (_is_limit(name, least) or (rest != name and _is_limit(rest, least))):
                found.setdefault(name)
    return list(found)


def _settings(value: Any) -> Mapping[Any, Any]:
    """Items of a dictionary, or attributes of an object."""
    if isinstance(value, dict):
        return value
    held = None if isinstance(value, _NO_SETTINGS) else getattr(value, "__dict__", None)
    return held if isinstance(held, dict) else {}


def _of_classes(kind: type) -> Iterator[Mapping[Any, Any]]:
    for each in kind.__mro__:
        if each.__module__.partition(".")[0] in sys.stdlib_module_names:
            continue  # Python's own limits are no environment's
        yield vars(each)
        yield _defaults(vars(each).get("__init__"))
        yield getattr(sys.modules.get(each.__module__), "__dict__", {})


def _defaults(function: Any) -> Mapping[str, Any]:
    """The defaults of a constructor's parameters."""
    try:
        parameters = inspect.signature(function).parameters
    except (TypeError, ValueError):  # none of Python's, or none of its own
        return {}
    return {name: each.default for name, each in parameters.items()}


PLAYS: Final = 3
"""Episodes at least, however long."""
SHORT_PLAYS: Final = 6
"""Further episodes, where the first ones ended early and left steps to spend."""
BOOKS: Final = ("rewards", "_cumulative_rewards", "terminations", "truncations", "infos")
"""Dictionaries that an AEC environment keeps by agent, in the order `last` reads them."""
FLAGS: Final = ("terminations", "truncations")
PARTS: Final = {2: "observations infos", 5: "observations rewards terminations truncations infos"}
"""Parts that reset and step of a Parallel environment return."""
LAST: Final = 5
"""Values that `last()` of an AEC environment returns."""


@probe(
    "surface",
    share=1.5,
    plays=lambda session: session.plays_of(
        [max(session.ration // PLAYS, 20)] * (PLAYS + SHORT_PLAYS)
    ),
)
def surface(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """`agents`, num_agents, rewards and flags as attributes, turn by turn.

    The episode; attributes before a reset, after it, after each step, after another reset.

    Facts, each with names of agents as texts:
        `PossibleAgents`, `LiveRosters`, `RosterKinds`, `AgentCounts`, `ReturnedForms`,
        `BookEntries`, `TimeLimits`, `FlaggedAgents`.
    """
    env = session.env()
    before, first = _names(session, env, "possible_agents"), _reset(session, env, play)
    flagged = [_flagged(env)] if session.api == "aec" else []
    limits = limits_of(env)
    seen = _Seen(session)
    played = session.play(play, env, watch=seen.watch)
    limits = {name: value for name, value in limits_of(env).items() if limits.get(name) == value}
    yield played.episode
    again = _reset(session, env, play)
    possible = PossibleAgents(
        session.can_make, before, seen.possible, _names(session, env, "possible_agents")
    )
    midway = _midway(session, env, played, seen.rosters)
    rosters = LiveRosters(first, seen.rosters, again, midway)
    yield session.fact(possible, field="possible_agents")
    yield session.fact(rosters, field="agents")
    yield session.fact(RosterKinds(seen.kinds), field="agents")
    yield session.fact(TimeLimits(limits), field="terminations")
    yield session.fact(AgentCounts(seen.counts), field="num_agents")
    returned = [_wrong_last(session, env)] if session.api == "aec" else seen.returned
    yield session.fact(ReturnedForms(returned, seen.infos_answer), field="returned")
    if session.api == "aec":
        yield session.fact(BookEntries(seen.books), field="books")
        flagged += [seen.flagged, _flagged(env)]
        yield session.fact(FlaggedAgents(flagged), field="terminations")


class _Seen:
    """Roster and dictionaries at the start of each turn of an episode."""

    def __init__(self, session: ProbeSession) -> None:
        self.rosters: list[Any] = []
        self.possible: list[Any] = []
        self.counts: list[list[Any]] = []
        self.returned: list[str] = []
        self.books: list[TurnBooks] = []
        self.kinds: list[tuple[int, list[str]]] = []
        self.flagged: list[str] = []
        self.infos_answer = False
        self._session = session
        self._last: dict[str, tuple[Any, Any]] = {}
        self._dead_in_turn = ""
        self._left: set[str] = set()

    def watch(self, turn: int, env: Any, out: Any) -> None:
        """One turn's start."""
        self.rosters.append(self._names(env, "agents"))
        self.possible.append(self._names(env, "possible_agents"))
        counted = [_count(env, name) for name in ("num_agents", "max_num_agents")]
        named = self.rosters[-1], self.possible[-1]
        sizes = [None if names is None else len(names) for names in named]
        self.counts.append([*counted, *sizes])
        if self._session.api == "parallel":
            self.returned.append(_wrong(out, 5 if turn else 2))
            self.infos_answer |= isinstance(out, tuple) and isinstance(out[-1], defaultdict)
        else:
            self._note_left(env)
            self.books.append(_books(env, self._left))
        kinds = [_kind(env, name) for name in ("agents", "possible_agents")]
        if not self.kinds or kinds != self.kinds[-1][1]:
            self.kinds.append((turn, kinds))
        if not turn:
            self.flagged = _flagged(env) if self._session.api == "aec" else []

    def _note_left(self, env: Any) -> None:
        """Notes the agent whose None step was made last: it has left, whatever `agents` says."""
        self._left |= {self._dead_in_turn} - {""}
        name = agent_name(getattr(env, "agent_selection", ""))
        self._dead_in_turn = name if name in _flagged(env) else ""

    def _names(self, env: Any, attribute: str) -> Any:
        """The names, spelt anew only where they have changed."""
        value = getattr(env, attribute, None)
        known = self._last.get(attribute)
        if known is not None and value.__class__ is list and value == known[0]:
            return known[1]
        names = _names(self._session, env, attribute)
        if value.__class__ is list:
            self._last[attribute] = list(value), names
        return names


def _reset(session: ProbeSession, env: Any, play: EpisodePlan) -> Any:
    """The roster after a reset with the play's seed; None where it raised."""
    session.meter.count(RESET_STEPS)
    failed = session.reset(env, play).failed
    return _names(session, env, "agents") if failed is None else None


def _midway(
    session: ProbeSession, env: Any, played: EpisodeResult, rosters: Sequence[Any]
) -> tuple[int, list[str] | None] | None:
    """After the first turns of an episode, until somebody has left, a reset: its roster."""
    for turn, names in enumerate(rosters):
        if names and rosters[0] and not set(rosters[0]) <= set(names):
            if turn and len(played.play.actions or ()) >= turn:
                session.play(cut(played.play, turn), env)
                return turn, _reset(session, env, played.play)
            return None
    return None


def _names(session: ProbeSession, env: Any, attribute: str) -> list[str] | None:
    """The names in a roster, however it is kept; None where there is none."""
    called = session.call(attribute, lambda: list(getattr(env, attribute)))
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
    """Fault in the form of a returned value; empty if there is none."""
    if not isinstance(out, tuple | list):
        return f"a {type(out).__name__}"
    if len(out) != count:
        return f"a {type(out).__name__} of {len(out)}"
    nonconforming = [
        f"{name}: {type(part).__name__}"
        for name, part in zip(PARTS[count].split(), out, strict=True)
        if not isinstance(part, Mapping)
    ]
    return ", ".join(nonconforming)


def _wrong_last(session: ProbeSession, env: Any) -> str:
    """Fault in the value of `last()`; empty if there is none, or if it raised."""
    if not getattr(env, "agents", None):
        return ""
    called = session.call("last", env.last)
    if called.failed is not None or (isinstance(called.value, tuple) and len(called.value) == LAST):
        return ""
    return _wrong(called.value, LAST) or f"a {type(called.value).__name__}"


def _books(env: Any, left: Collection[str]) -> TurnBooks:
    """Agents without an entry in the AEC dictionaries, and entries without an agent.

    Those that have left need no entry, though they stand in `agents` yet.
    """
    missing: dict[str, list[str]] = {}
    strangers: dict[str, list[str]] = {}
    agents: Sequence[Any] = list(getattr(env, "agents", None) or ())
    staying = [agent for agent in agents if agent_name(agent) not in left]
    for name in BOOKS:
        book = getattr(env, name, None)
        if not isinstance(book, Mapping):
            missing[name] = [agent_name(agent) for agent in staying]
            continue
        if book.keys() == set(agents):
            continue
        missing[name] = [agent_name(agent) for agent in staying if agent not in book]
        strangers[name] = [agent_name(agent) for agent in book if agent not in agents]
    return TurnBooks(
        {name: names for name, names in missing.items() if names},
        {name: names for name, names in strangers.items() if names},
    )


def _renders(env: Any) -> bool:
    """Tells whether a constructor takes a render mode, and `render` calls or reads anything."""
    kind = type(getattr(env, "unwrapped", env))
    code = getattr(getattr(kind, "render", None), "__code__", None)
    names = set(getattr(code, "co_names", ())) - {"NotImplementedError"}
    takes = any("render_mode" in _defaults(vars(each).get("__init__")) for each in kind.__mro__)
    return takes and bool(names)


def _flagged(env: Any) -> list[str]:
    """Agents in `agents` that an AEC environment says have ended."""
    found: dict[str, None] = {}
    live = set(map(agent_name, getattr(env, "agents", ()) or ()))
    for name in FLAGS:
        book = getattr(env, name, None)
        if isinstance(book, Mapping):
            found.update((agent_name(agent), None) for agent, flag in book.items() if is_up(flag))
    return [agent for agent in found if agent in live]


MOST_TURNS: Final = 20
MOST_MODES: Final = 3


@probe("metadata", share=0.2, plays=lambda session: session.plays(1, most_turns=MOST_TURNS))
def metadata(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """Metadata, before and after the environment was used.

    Metadata before and after an episode, a render and further instances.

    Facts:
        `Metadata`, `LaterMetadata`.
    """
    env = session.env()
    metadata = getattr(env, "metadata", None)
    before = to_json(metadata)
    after: list[tuple[str, str | None, str]] = []

    def note(done: str, mode: str | None = None) -> None:
        after.append((done, mode, to_json(getattr(env, "metadata", None))))

    session.play(play, env)
    note("play")
    own = getattr(env, "render_mode", None)
    fields = dict(metadata) if isinstance(metadata, dict) else {}
    yield session.fact(
        Metadata(type(metadata).__name__, fields, own, _renders(env)), field="metadata"
    )
    if own is not None and own != "human":
        session.call("render", env.render)
        note("render")
    if session.can_make:
        session.call("make", session.make)
        note("make")
        for mode in modes(fields)[:MOST_MODES]:
            session.call("make", session.make, render_mode=mode)
            note("make", mode)
    yield session.fact(LaterMetadata(before=before, after=after), field="metadata")


def modes(metadata: Any) -> list[str]:
    """The declared render modes without "human", which needs a screen."""
    declared = metadata.get("render_modes") if isinstance(metadata, dict) else None
    listed = declared if isinstance(declared, list | tuple) else ()
    return [mode for mode in listed if isinstance(mode, str) and mode != "human"]
