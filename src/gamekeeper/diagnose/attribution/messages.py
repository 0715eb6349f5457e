"""What was said, heard and done: the looks behind signalling and listening.

Only declared fields carry messages (`roles.X.messages`).
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.core.contract import Contract
from gamekeeper.core.layout import agent_name
from gamekeeper.core.message_field import MessageField, message_field, path_in
from gamekeeper.diagnose.attribution.bench import Bench
from gamekeeper.diagnose.attribution.film import Film, Paper, fingerprint
from gamekeeper.run.stress.part import MISSING, Part, message_parts, seen_parts

LISTENS: Final = 2
"""Decisions of each listener and episode at which it is shown another message."""
MOST_NUMBERS: Final = 64
"""Numbers of an observation that a message is compared with."""
STRANGE: Final = 1_000_003
"""Added to an episode's number: the episode that lends its messages."""


@dataclass(slots=True)
class Hearing(Film):
    """A film that keeps what was given as it was, and may show an agent another message.

    Attributes:
        seen: what was given, by turn and agent.
        told: at a turn, to an agent, these parts as they are in another observation.
    """

    seen: dict[tuple[int, str], Any] = field(default_factory=dict)
    told: tuple[int, str, tuple[Part, ...], Any] | None = None

    def act(self, agent: Any, observation: Any, info: Any) -> Any:
        """What an agent does, given another message where that is to be."""
        self.seen[self.turn, agent_name(agent)] = copy.deepcopy(observation)
        if self.told is not None and self.told[:2] == (self.turn, agent_name(agent)):
            observation = with_message(observation, self.told[3], self.told[2])
        return Film.act(self, agent, observation, info)


def with_message(observation: Any, other: Any, parts: tuple[Part, ...]) -> Any:
    """An observation with the messages of another one."""
    for part in parts:
        lent, own = part.of(other), part.of(observation)
        if lent is MISSING or own is MISSING:
            continue
        if part.numbers is not None:
            changed = np.array(own)
            changed.reshape(-1)[part.numbers] = np.asarray(lent).reshape(-1)[part.numbers]
            lent = changed
        observation = part.put(observation, lent)
    return observation


def heard_parts(contract: Contract, env: Any, agent: Any) -> tuple[Part, ...]:
    """The parts of an observation that carry messages; none where that is all of it."""
    space = env.observation_space(agent)
    parts = message_parts(contract, agent, space)
    named = {(part.path, str(part.numbers)) for part in parts}
    whole = {(part.path, "None") for part in seen_parts(contract, agent, space)}
    return () if named >= whole else parts


def spoken_fields(contract: Contract, env: Any, agent: Any) -> tuple[MessageField, ...]:
    """The parts of an action that carry messages."""
    role = contract.roles.get(contract.role_of(agent) or "")
    fields = [message_field(name) for name in (() if role is None else role.messages or ())]
    space = env.action_space(agent)
    return tuple(
        each for each in fields if each.side == "action" and path_in(space, each) is not None
    )


# -- what was said


def said(bench: Bench, paper: Paper) -> Iterator[dict[str, Any]]:
    """By speaker: its messages, the numbers it saw, and what others did at their next turn."""
    speakers = [
        agent
        for agent in getattr(bench.env, "possible_agents", ())
        if agent_name(agent) in paper.actions and spoken_fields(bench.contract, bench.env, agent)
    ]
    if not speakers:
        return
    film = bench.watched(
        Hearing(bench.env, bench.contract, paper=paper), paper
    )  # fmt: skip
    deeds: dict[str, list[tuple[int, str]]] = {}
    counts: dict[str, int] = {}
    for turn, name, _ in film.moves:
        place = counts.get(name, 0)
        counts[name] = place + 1
        deeds.setdefault(name, []).append((turn, word(film.actions[name][place])))
    for agent in speakers:
        name, fields = agent_name(agent), spoken_fields(bench.contract, bench.env, agent)
        turns = [turn for turn, _ in deeds.get(name, ())]
        yield {
            "from": name,
            "messages": [message(action, fields) for action in film.actions.get(name, ())],
            "seen": [numbers(film.seen[turn, name]) for turn in turns],
            "next": {
                other: [_after(theirs, turn) for turn in turns]
                for other, theirs in deeds.items()
                if other != name
            },
        }


def _after(deeds: list[tuple[int, str]], turn: int) -> str:
    return next((deed for at, deed in deeds if at > turn), "")


def message(action: Any, fields: tuple[MessageField, ...]) -> str:
    """The words in an action, as a text that is equal for equal messages."""
    words = []
    for each in fields:
        value = action
        for key in each.keys:
            value = value[int(key) if isinstance(value, tuple | list) else key]
        value = np.asarray(value).reshape(-1)[each.numbers or slice(None)]
        words.append(word(value))
    return " ".join(words)


def word(value: Any) -> str:
    """A value as a category: of several real numbers, which is the largest."""
    if isinstance(value, Mapping):
        return " ".join(word(each) for each in value.values())
    if isinstance(value, tuple | list):
        return " ".join(word(each) for each in value)
    array = np.asarray(value)
    if array.dtype.kind == "f" and array.size > 1:
        return f"#{int(array.argmax())}"
    if array.dtype.kind == "f":
        return f"{float(array.reshape(-1)[0]):.1f}"
    return " ".join(map(str, array.reshape(-1).tolist()))


def numbers(observation: Any) -> list[float]:
    """The first numbers of an observation."""
    return [float(number) for number in _flat(observation)[:MOST_NUMBERS]]


def _flat(value: Any) -> NDArray[np.float64]:
    if isinstance(value, Mapping):
        parts = [_flat(value[key]) for key in value]
        return np.concatenate(parts) if parts else np.empty(0)
    if isinstance(value, tuple | list):
        return np.concatenate([_flat(each) for each in value]) if value else np.empty(0)
    array = np.asarray(value)
    return array.astype(np.float64).reshape(-1) if array.dtype.kind in "biuf" else np.empty(0)


# -- what was heard


def listened(bench: Bench, paper: Paper, *, seed: int) -> Iterator[dict[str, Any]]:
    """Looks at whether a listener, shown another message at one decision, decides otherwise.

    Its policy, its random stream and all else that it sees stay as they were. `sham`: it decides
    otherwise though it is shown the same.
    """
    listeners = [
        (agent_name(agent), parts)
        for agent in getattr(bench.env, "possible_agents", ())
        if agent_name(agent) in paper.actions
        and (parts := heard_parts(bench.contract, bench.env, agent))
    ]
    if not listeners or bench.own is None:
        return
    rng = np.random.default_rng([seed, paper.number, 3])
    base, strange = (
        bench.reacting(Hearing(bench.env, bench.contract, cast=bench.own), number)
        for number in (paper.number, paper.number + STRANGE)
    )
    for name, parts in listeners:
        for turn, other in _pairs(base, strange, name, parts, rng):
            told, same = (
                bench.reacting(
                    Hearing(bench.env, bench.contract, cast=bench.own, told=(turn, name, parts, x)),
                    paper.number,
                    turns=turn + 1,
                )
                for x in (other, base.seen[turn, name])
            )
            was = _decision(base, name, turn)
            yield {
                "to": name, "changed": _decision(told, name, turn) != was,
                "sham": _decision(same, name, turn) != was,
            }  # fmt: skip


def _pairs(
    base: Hearing, strange: Hearing, name: str, parts: tuple[Part, ...], rng: Generator
) -> Iterator[tuple[int, Any]]:
    """Turns, and observations whose message differs from the one given then."""
    turns = [turn for turn, agent in base.seen if agent == name]
    lent = [value for (_, agent), value in strange.seen.items() if agent == name]
    if not lent:
        return
    for place in rng.permutation(len(turns))[:LISTENS].tolist():
        own = base.seen[turns[place], name]
        for k in rng.permutation(len(lent))[:8].tolist():
            if fingerprint(with_message(own, lent[k], parts)) != fingerprint(own):
                yield turns[place], lent[k]
                break


def _decision(film: Hearing, name: str, turn: int) -> Any:
    """What an agent did at a turn."""
    turns = [at for at, agent, _ in film.moves if agent == name]
    return fingerprint(film.actions[name][turns.index(turn)]) if turn in turns else None
