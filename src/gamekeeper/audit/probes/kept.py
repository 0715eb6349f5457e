"""What was handed out is kept and looked at again later: did the environment write into it?"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from operator import methodcaller
from typing import Any, Final

from gamekeeper.audit.lab import Lab, Saw
from gamekeeper.run.episode import Play
from gamekeeper.run.handed import arrays, is_same, share_memory, snapshot

SHARE: Final = 0.8
LEAST_AGE: Final = 8
"""Turns after which something is looked at again; two rounds where there are more agents."""
PARTS: Final = ("observations", "rewards", "terminations", "truncations", "infos")
"""What a Parallel environment's step returns; its reset returns the first and the last."""
AT_ONCE: Final = 12
"""Turns at which what agents were given at once is compared."""
NEIGHBOURS: Final = 8
"""Agents after it with whom one is compared."""


def plays(lab: Lab) -> Iterator[Play]:
    """Most buffers are used again soon, some only when something rare happens."""
    return lab.plays(8, most_turns=200)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """Keeps everything for some turns, beside a copy.

    Facts:
        `kept`: of one kind of thing (the field: `observations`, `infos`, `state`, or one of the
            dictionaries `rewards`, `terminations`, `truncations`): `looks`, and `changed`: None, or
            the `given` turn and the `agent` of the first that changed; the fact's turn is the one
            at which that was seen.
        `shared`: of `observations` or `infos` of agents at one turn: `looks` at pairs, and `pair`:
            None or the first two who were given the same memory.
    """
    shelf = Shelf(max(2 * len(lab.agents) + 2, LEAST_AGE))

    def watch(turn: int, env: Any, out: Any) -> None:
        shelf.look(turn)
        for name, agent, value in _given(lab, shelf, env, out):
            shelf.put(turn, name, agent, value)

    def watch_pairs(turn: int, env: Any, out: Any) -> None:
        shelf.look_at_pairs(turn, _together(lab, env, out))

    played = lab.play(play, watch=watch, state=False)
    actions = played.play.actions or ()
    shelf.look(len(actions), at_all=True)
    # a play of its own, as asking for everybody's observation may write into those that were kept
    lab.play(replace(played.play, actions=actions[:AT_ONCE]), watch=watch_pairs, state=False)
    for name, count in shelf.looks.items():
        changed = shelf.changed.get(name)
        turn, agent = (None, None) if changed is None else (changed["seen"], changed["agent"])
        value = {"looks": count, "changed": changed}
        yield lab.fact("kept", value, turn=turn, agent=agent, field=name)
    for name, count in shelf.pairs.items():
        turn, pair = shelf.shared.get(name, (None, None))
        yield lab.fact("shared", {"looks": count, "pair": pair}, turn=turn, field=name)


@dataclass(slots=True)
class Shelf:
    """What was handed out lately, each thing with a way to ask whether it still is what it was."""

    age: int
    looks: dict[str, int] = field(default_factory=dict)
    changed: dict[str, dict[str, Any]] = field(default_factory=dict)
    pairs: dict[str, int] = field(default_factory=dict)
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
                self.changed[name] = {"given": given, "seen": turn, "agent": agent}
        while self._things and self._things[0][0] <= oldest:
            self._things.popleft()

    def look_at_pairs(self, turn: int, given: Mapping[str, Mapping[Any, Any]]) -> None:
        """Looks whether two agents were given the same memory at one turn."""
        for name, by_agent in given.items():
            items = [(agent, value) for agent, value in by_agent.items() if _can_change(value)]
            for place, (one, mine) in enumerate(items):
                for other, theirs in items[place + 1 : place + 1 + NEIGHBOURS]:
                    self.pairs[name] = self.pairs.get(name, 0) + 1
                    if name not in self.shared and _is_one(mine, theirs):
                        self.shared[name] = turn, (one, other)


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


def _given(lab: Lab, shelf: Shelf, env: Any, out: Any) -> Iterator[tuple[str, Any, Any]]:
    """Everything that was just handed out: what it is, whose, the very object."""
    if lab.api == "parallel":
        yield from _returned(out)
    elif env.agents:
        agent = env.agent_selection
        last = lab.call("last", env.last).value
        if isinstance(last, tuple) and len(last) == 5:
            yield "observations", agent, last[0]
            yield "infos", agent, last[4]
    if shelf.has_state and env.agents:
        state = lab.call("state", methodcaller("state"), env)
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


def _together(lab: Lab, env: Any, out: Any) -> dict[str, Mapping[Any, Any]]:
    """Observations and infos of all agents at one turn."""
    if lab.api == "parallel":
        return {name: part for name, part in _parts(out).items() if name in (PARTS[0], PARTS[4])}
    seen = {}
    for agent in list(env.agents):
        called = lab.call("observe", env.observe, agent)
        if called.failed is None:
            seen[agent] = called.value
    infos = getattr(env, "infos", None)
    return {"observations": seen, "infos": infos if isinstance(infos, Mapping) else {}}
