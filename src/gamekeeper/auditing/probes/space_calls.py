"""Probe of spaces: asked for before a reset, along an episode and after it."""

import inspect
import pickle
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Space

from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import Called, ProbeSession, Saw
from gamekeeper.checks.effects import changed_numbers, numbers_in
from gamekeeper.checks.facts.space_facts import (
    AskedSpace,
    ChangedSpace,
    NumpyFlag,
    OthersView,
    PickledInfo,
    SpaceEntry,
    SpaceFaults,
)
from gamekeeper.checks.probe_evidence import Fact
from gamekeeper.checks.spaces.observed_agents import unmasked
from gamekeeper.episodes.canonical import shown, type_name
from gamekeeper.episodes.spaces.misfit import faults, kept, misfits, same
from gamekeeper.interface.env_source import possible_agents_of
from gamekeeper.rollouts.episode_loop import EpisodePlan
from gamekeeper.rollouts.interventions.action_substitutes import Held

MOST_TURNS: Final = 60
EVERY: Final = 8
"""Turns from one look at the live agents' spaces and infos to the next."""
MOST_OBSERVED: Final = 240
"""Observations of others that are looked at in one episode."""
MOST_AGENTS: Final = 64
"""Live agents whose spaces are asked for again and again; of a crowd the first ones."""
HELD: Final = 1_000
"""Streams from here on are of plays in which each agent holds its action for a while."""
HELD_PLAYS: Final = 12
SIDES: Final = ("observation", "action")


def _spaces_plays(session: ProbeSession) -> Iterator[EpisodePlan]:
    """Two short ones, then some in which actions are held, as long as there are steps left."""
    yield from session.plays(2, most_turns=MOST_TURNS)
    turns = max(session.ration // 3, 20)
    for k in range(HELD_PLAYS):
        yield EpisodePlan(seed=session.seed + k, stream=HELD + k, most_turns=turns)


@probe("spaces", share=1.0, plays=_spaces_plays)
def spaces(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """Spaces before the reset, after it, during an episode and after another reset.

    What spaces are there and whether they stay the same; what others than the mover observe.

    Episodes of longer plays, in which actions are held: they come to the borders of what is
    observed.

    Facts:
        `AskedSpace`, `ChangedSpace`, `SpaceFaults`, `SpaceEntry`, `OthersView`, `PickledInfo`,
        `NumpyFlag`.
    """
    env = session.env()
    if play.stream >= HELD:
        yield from _held(session, play, env)
        return
    watch = _Watch(session, env)
    if session.can_make:
        watch.ask_all(possible_agents_of(env), "before reset", 0)
    played = session.play(play, env, watch=watch, state=False)
    watch.ask_all(possible_agents_of(env)[:MOST_AGENTS], "after the episode", None)
    if played.failed is None:
        after = None if play.seed is None else play.seed + 1
        if session.call("reset", env.reset, seed=after).failed is None:
            session.meter.count()
            possible = possible_agents_of(env) or list(env.agents)
            watch.ask_all(possible, "after another reset", None)
    yield from watch.facts


def _held(session: ProbeSession, play: EpisodePlan, env: Any) -> Iterator[Saw]:
    """A longer episode, with looks at the spaces; where masks forbid actions none is held."""
    change = None
    if play.actions is None:
        first = session.play(replace(play, most_turns=2), env, state=False)
        declared = [role.mask for role in session.contract.roles.values()]
        has_masks = any(turn.masks for turn in first.episode.turns)
        change = None if has_masks or set(declared) - {None, "none"} else Held()
        session.base = None  # what follows is what is to be seen again
    watch = _Watch(session, env)

    def look(turn: int, env: Any, out: Any) -> None:
        if turn % EVERY == 0:
            watch.ask_all(list(env.agents)[:MOST_AGENTS], "live", turn)

    played = session.play(play, env, change=change, watch=look, state=False)
    possible = possible_agents_of(env)
    watch.ask_all(possible[:MOST_AGENTS], "after the episode", None)
    yield played.episode
    yield from watch.facts


@dataclass(slots=True)
class _Watch:
    """Looks at the spaces now and then."""

    session: ProbeSession
    env: Any
    facts: list[Fact[Any]] = field(default_factory=list)
    _first: dict[tuple[str, Any], Any] = field(default_factory=dict)
    _sound: set[int] = field(default_factory=set)
    _roster: list[Any] = field(default_factory=list)
    _observed: int = 0
    _before: Any = None
    _has_numpy_flag: bool = False

    def __call__(self, turn: int, env: Any, out: Any) -> None:
        """After the reset and after every step."""
        roster = list(env.agents)
        if roster != self._roster or turn % EVERY == 0:
            gone = [agent for agent in self._roster if agent not in roster]
            self._roster = roster
            self.ask_all(gone[:MOST_AGENTS], "after it left", turn)
            self.ask_all(roster[:MOST_AGENTS], "live", turn)
            self._look_at_infos(turn, out, roster)
        if not self._has_numpy_flag:
            self._look_at_flags(turn, out)
        if self.session.api == "aec" and self._observed < MOST_OBSERVED:
            self._observe(turn, roster)

    def ask_all(self, agents: list[Any], when: str, turn: int | None) -> None:
        """Asks for both spaces of every agent, twice in a row."""
        for agent in agents:
            for which in SIDES:
                self._ask(agent, which, when, turn)

    def _ask(self, agent: Any, which: str, when: str, turn: int | None) -> None:
        name = f"{which}_space"
        own = getattr(self.env, name)
        one, other = (_quietly(self.session, name, own, agent) for _ in range(2))
        space = one.value if isinstance(one.value, Space) else None
        is_same = one.value is other.value
        is_space = one.said is not None and isinstance(own, Space)
        failed = f"{name} is a {type(own).__name__} and no method" if is_space else one.said
        asked = AskedSpace(which, when, space, failed, type_name(one.value), is_same)
        self._note(asked, turn, agent, name)
        if space is None:
            return
        first = self._first.setdefault((which, agent), kept(space))
        if first is not None and when != "before reset":
            alike = same(first, space)
            if alike is not None:
                changed = ChangedSpace(when, shown(first), shown(space), alike)
                self._note(changed, turn, agent, name)
        if id(space) not in self._sound:
            self._sound.add(id(space))
            self._note(
                SpaceFaults(faults=faults(space, sample=which == "action")), turn, agent, name
            )
            self._compare_attribute(agent, which, space, turn)

    def _compare_attribute(self, agent: Any, which: str, space: Any, turn: int | None) -> None:
        """The dictionary of spaces, where the environment itself has one that names the agent."""
        name = f"{which}_spaces"
        beside = inspect.getattr_static(self.env, name, None)
        if isinstance(beside, dict) and isinstance(beside.get(agent), Space):
            alike = same(beside[agent], space)
            if alike is not None:
                entry = SpaceEntry(shown(beside[agent]), shown(space), alike)
                self._note(entry, turn, agent, name)

    def _observe(self, turn: int, roster: list[Any]) -> None:
        chosen = getattr(self.env, "agent_selection", None)
        # taken at once: the next observation may stand in the same array
        one = numbers_in(unmasked(self.session.call("observe", self.env.observe, chosen).value))
        moved = frozenset() if self._before is None else changed_numbers(self._before, one)
        self._before = one
        for agent in roster:
            space = self._space(agent)
            if agent == chosen or space is None:
                continue
            self._observed += 1
            seen = self.session.call("observe", self.env.observe, agent)
            if seen.failed is not None:
                self._note(OthersView(failed=seen.said, misfits=[]), turn, agent, "observe")
                continue
            found = [
                [each.kind, each.path, each.expected, each.actual, each.test]
                for each in misfits(space, seen.value)
            ]
            other = numbers_in(unmasked(seen.value))
            size = len(one) if len(one) == len(other) else 0
            differs = changed_numbers(one, other)
            self._note(OthersView(None, found, size, differs, moved), turn, agent, "observe")

    def _space(self, agent: Any) -> Any:
        asked = _quietly(self.session, "observation_space", self.env.observation_space, agent)
        return asked.value if isinstance(asked.value, Space) else None

    def _look_at_infos(self, turn: int, out: Any, roster: list[Any]) -> None:
        infos = getattr(self.env, "infos", None) if self.session.api == "aec" else None
        if isinstance(out, tuple | list) and len(out) in (2, 5):
            infos = out[-1]
        if not isinstance(infos, dict):
            return
        for agent in roster:
            if isinstance(infos.get(agent), dict):
                done = self.session.call("pickle", pickle.dumps, infos[agent])
                self._note(PickledInfo(unpicklable=done.said), turn, agent, "infos")

    def _look_at_flags(self, turn: int, out: Any) -> None:
        """Notes the first flag that is a bool of NumPy's."""
        for place, name in enumerate(("terminations", "truncations"), 2):
            flags = getattr(self.env, name, None) if self.session.api == "aec" else None
            if isinstance(out, tuple | list) and len(out) == 5:
                flags = out[place]
            for agent, flag in flags.items() if isinstance(flags, dict) else ():
                if isinstance(flag, np.bool_) and not self._has_numpy_flag:
                    self._has_numpy_flag = True
                    self._note(NumpyFlag(), turn, agent, name)

    def _note(self, value: object, turn: int | None, agent: Any, place: str) -> None:
        self.facts.append(self.session.fact(value, turn=turn, agent=agent, field=place))


def _quietly(session: ProbeSession, name: str, function: Any, *arguments: Any) -> Called:
    """Calls without the warning of PettingZoo's own method, which reads the dictionaries."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return session.call(name, function, *arguments)
