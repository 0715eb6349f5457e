"""Probes of values that are handed out or handed over, kept and compared later."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from operator import methodcaller
from typing import Any, Final

from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import ProbeSession, Saw
from gamekeeper.auditing.probes.moves import affordable
from gamekeeper.checks.facts.handed_facts import (
    ChangedArgument,
    ChangedValue,
    HandedActions,
    HandedOptions,
    KeptValues,
    SharedValues,
)
from gamekeeper.rollouts.episode_loop import EpisodePlan
from gamekeeper.rollouts.interventions.environment_calls import ActionsOverwritten
from gamekeeper.rollouts.snapshots import arrays, is_same, share_memory, snapshot

LEAST_AGE: Final = 8
"""Turns after which something is looked at again; two rounds where there are more agents."""
PARTS: Final = ("observations", "rewards", "terminations", "truncations", "infos")
"""Parts that a Parallel environment's step returns; its reset: the first and the last."""
AT_ONCE: Final = 12
"""Turns at which what agents were given at once is compared."""
NEIGHBOURS: Final = 8
"""Agents after it with whom one is compared."""


# most buffers are used again soon, some only when something rare happens
@probe("kept", share=0.8, plays=lambda session: session.plays(8, most_turns=200))
def kept(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """Returned observations, infos and states, read again later: has the environment changed them?

    Keeps everything for some turns, beside a copy.

    Facts:
        `KeptValues`, `SharedValues`.
    """
    shelf = HeldValues(affordable(session, max(2 * len(session.agents) + 2, LEAST_AGE)))

    def watch(turn: int, env: Any, out: Any) -> None:
        shelf.look(turn)
        for name, agent, value in _given(session, shelf, env, out):
            shelf.put(turn, name, agent, value)

    def watch_pairs(turn: int, env: Any, out: Any) -> None:
        shelf.look_at_pairs(turn, _together(session, env, out))

    played = session.play(play, watch=watch, state=False)
    actions = played.play.actions or ()
    shelf.look(len(actions), at_all=True)
    # in another episode, as asking for all observations may write into those that are held
    session.play(replace(played.play, actions=actions[:AT_ONCE]), watch=watch_pairs, state=False)
    for name, count in shelf.looks.items():
        changed = shelf.changed.get(name)
        turn, agent = (None, None) if changed is None else (changed.seen, changed.agent)
        kept_values = KeptValues(looks=count, changed=changed)
        yield session.fact(kept_values, turn=turn, agent=agent, field=name)
    for name, count in shelf.pairs.items():
        turn, pair = shelf.shared.get(name, (None, None))
        value = SharedValues(looks=count, shared=shelf.alike.get(name, 0), pair=pair)
        yield session.fact(value, turn=turn, field=name)


@dataclass(slots=True)
class HeldValues:
    """Values returned lately, each with a test whether it still is the same."""

    age: int
    looks: dict[str, int] = field(default_factory=dict)
    changed: dict[str, ChangedValue] = field(default_factory=dict)
    pairs: dict[str, int] = field(default_factory=dict)
    alike: dict[str, int] = field(default_factory=dict)
    shared: dict[str, tuple[int, tuple[Any, Any]]] = field(default_factory=dict)
    has_state: bool = True
    _things: deque[tuple[int, str, Any, Callable[[], bool]]] = field(default_factory=deque)

    def put(self, turn: int, name: str, agent: Any, value: Any) -> None:
        """Keeps a thing that was handed out at `turn`."""
        if name not in self.changed:
            self._things.append((turn, name, agent, _asking(value, name, agent)))

    def look(self, turn: int, *, at_all: bool = False) -> None:
        """Looks at what was handed out a turn ago, and at what is old enough to be let go."""
        oldest = turn - self.age
        for given, name, agent, is_as_it_was in self._things:
            if name in self.changed or not (at_all or given in (turn - 1, oldest)):
                continue
            self.looks[name] = self.looks.get(name, 0) + 1
            if not is_as_it_was():
                self.changed[name] = ChangedValue(given, turn, agent)
        while self._things and self._things[0][0] <= oldest:
            self._things.popleft()

    def look_at_pairs(self, turn: int, given: Mapping[str, Mapping[Any, Any]]) -> None:
        """Looks whether two agents were given the same memory at one turn."""
        for name, by_agent in given.items():
            items = [(agent, value) for agent, value in by_agent.items() if _can_change(value)]
            for place, (one, mine) in enumerate(items):
                for other, theirs in items[place + 1 : place + 1 + NEIGHBOURS]:
                    self.pairs[name] = self.pairs.get(name, 0) + 1
                    if _is_one(mine, theirs):
                        self.alike[name] = self.alike.get(name, 0) + 1
                        self.shared.setdefault(name, (turn, (one, other)))


def _asking(value: Any, name: str, agent: Any) -> Callable[[], bool]:
    """Says, whenever it is asked, whether `value` is what it is now."""
    if agent is None and name in ("observations", "infos"):  # its entries are kept one by one
        held = dict(value)
        return lambda: value.keys() == held.keys() and all(value[a] is held[a] for a in held)
    copy = snapshot(value)
    return lambda: is_same(value, copy)


def _can_change(value: Any) -> bool:
    return isinstance(value, dict | list) or any(True for _ in arrays(value))


def _is_one(one: Any, other: Any) -> bool:
    return (one is other and isinstance(one, dict | list)) or share_memory(one, other)


def _given(
    session: ProbeSession, shelf: HeldValues, env: Any, out: Any
) -> Iterator[tuple[str, Any, Any]]:
    """Everything that was just handed out: what it is, whose, the very object."""
    if session.api == "parallel":
        yield from _returned(out)
    elif env.agents:
        agent = env.agent_selection
        last = session.call("last", env.last).value
        if isinstance(last, tuple) and len(last) == 5:
            yield "observations", agent, last[0]
            yield "infos", agent, last[4]
    if shelf.has_state and env.agents:
        state = session.call("state", methodcaller("state"), env)
        shelf.has_state = state.failed is None and _can_change(state.value)
        if shelf.has_state:
            yield "state", None, state.value


def _returned(out: Any) -> Iterator[tuple[str, Any, Any]]:
    for name, part in _parts(out).items():
        if name in ("observations", "infos"):
            for agent, value in part.items():
                yield name, agent, value
        yield name, None, part


def _parts(out: Any) -> dict[str, dict[Any, Any]]:
    """The dictionaries that reset or step returned, by name."""
    if not isinstance(out, tuple | list) or len(out) not in (2, 5):
        return {}
    names = PARTS if len(out) == 5 else (PARTS[0], PARTS[4])
    pairs = zip(names, out, strict=True)
    return {name: part for name, part in pairs if isinstance(part, dict)}


def _together(session: ProbeSession, env: Any, out: Any) -> dict[str, Mapping[Any, Any]]:
    """Observations and infos of all agents at one turn."""
    if session.api == "parallel":
        return {name: part for name, part in _parts(out).items() if name in (PARTS[0], PARTS[4])}
    seen = {}
    for agent in list(env.agents):
        called = session.call("observe", env.observe, agent)
        if called.failed is None:
            seen[agent] = called.value
    infos = getattr(env, "infos", None)
    return {"observations": seen, "infos": infos if isinstance(infos, Mapping) else {}}


@probe("handed_over", share=0.6, plays=lambda session: session.plays(1, runs=4, most_turns=200))
def handed_over(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """Actions and options: does the environment change them, or read them again later?

    Plays, plays again with actions that are compared after the step, and with overwritten ones.

    Facts:
        `HandedActions`, `HandedOptions`.
    Counterfactuals:
        with the change `ActionsOverwritten`, where actions are more than plain numbers.
    """
    base = session.play(play, state=False)
    actions = [dict(each) for each in base.play.actions or ()]
    can_change = session.api == "parallel" or any(map(_is_writable, actions))
    yield from _options(session, play)
    if can_change and actions and base.failed is None:
        yield _compared(session, play, actions)
        unchanged_rerun = session.play(base.play, state=False)
        yield session.counterfactual(base, unchanged_rerun, ActionsOverwritten(), state=False)


def _is_writable(actions: Mapping[Any, Any]) -> bool:
    """Tells whether an action is an object that could be written into."""
    plain = bool | int | float | str | bytes
    return any(
        each is not None and not isinstance(each, plain) and hasattr(each, "__setitem__")
        for each in actions.values()
    )


def _compared(session: ProbeSession, play: EpisodePlan, script: list[dict[Any, Any]]) -> Saw:
    """Steps with actions of its own and compares them after each step."""
    env = session.env()
    looks, changed = 0, None
    session.reset(env, play)
    for each in script:
        own = {agent: _again(action) for agent, action in each.items()}
        if session.api == "aec":
            if not env.agents:
                break
            session.call("last", env.last)
        before = snapshot(each)
        stepped = session.step(env, session.handed(own))
        looks += 1
        changed = _first_changed(own, before)
        if changed is not None or stepped.failed is not None:
            break
    agent = None if changed is None else changed.agent
    value = HandedActions(looks=looks, changed=changed)
    seen_at = None if changed is None else looks - 1
    return session.fact(value, turn=seen_at, agent=agent, field="actions")


def _again(action: Any) -> Any:
    """A copy that can be written to; a plain value is itself."""
    copy = getattr(action, "copy", None)
    return copy() if callable(copy) and hasattr(action, "__setitem__") else action


def _first_changed(own: dict[Any, Any], before: dict[Any, Any]) -> ChangedArgument | None:
    if own.keys() != before.keys():
        return ChangedArgument(None, sorted(map(str, before)), sorted(map(str, own)))
    for agent, action in own.items():
        if not is_same(action, before[agent]):
            return ChangedArgument(agent, before[agent], snapshot(action))
    return None


def _options(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """Resets with options: empty ones, which every environment must bear."""
    options: dict[str, Any] = dict(play.options or {})
    before = snapshot(options)
    env = session.env()
    done = session.call("reset", env.reset, seed=play.seed, options=options)
    if done.failed is None:
        now = None if is_same(options, before) else snapshot(options)
        changed = None if now is None else ChangedArgument(None, before, now)
        yield session.fact(HandedOptions(looks=1, changed=changed), turn=0, field="options")
