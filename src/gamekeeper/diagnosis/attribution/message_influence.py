"""Messages between agents: what is said, and what those that hear it do otherwise."""

import copy
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal, TypeAlias

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.contract import Contract
from gamekeeper.diagnosis.attribution.recorded_actions import (
    ActionTrack,
    EpisodeActions,
    fingerprint,
)
from gamekeeper.diagnosis.attribution.replacement_runs import ReplacementRunner
from gamekeeper.episodes.layout import agent_name
from gamekeeper.episodes.message_field import MessageField, message_field, path_in
from gamekeeper.rollouts.interventions.value_parts import (
    MISSING,
    ValuePart,
    message_parts,
    seen_parts,
)
from gamekeeper.statistics.significance import Share, wilson

LISTENS: Final = 2
"""Decisions of each listener and episode at which it is shown another message."""
MOST_NUMBERS: Final = 64
"""Numbers of an observation that a message is compared with."""
STRANGE: Final = 1_000_003
"""Added to an episode's number: the episode that lends its messages."""


Told: TypeAlias = tuple[int, str, tuple[ValuePart, ...], Any]
"""Turn, agent, parts of its observation, and another observation that they are taken from."""


@dataclass(slots=True)
class Hearing(ActionTrack):
    """A track that keeps what was given as it was, and may show an agent another message.

    Attributes:
        seen: what was given, by turn and agent.
        told: the message that an agent is shown in place of its own.
    """

    seen: dict[tuple[int, str], Any] = field(default_factory=dict)
    told: Told | None = None

    def act(self, agent: Any, observation: Any, info: Any) -> Any:
        """Action of an agent, after another message where that is to be."""
        self.seen[self.turn, agent_name(agent)] = copy.deepcopy(observation)
        if self.told is not None and self.told[:2] == (self.turn, agent_name(agent)):
            observation = with_message(observation, self.told[3], self.told[2])
        return ActionTrack.act(self, agent, observation, info)


def with_message(observation: Any, other: Any, parts: tuple[ValuePart, ...]) -> Any:
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


def heard_parts(contract: Contract, env: Any, agent: Any) -> tuple[ValuePart, ...]:
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


def said(runner: ReplacementRunner, script: EpisodeActions) -> Iterator[dict[str, Any]]:
    """By speaker: its messages, the numbers it saw, and what others did at their next turn."""
    speakers = [
        agent
        for agent in getattr(runner.env, "possible_agents", ())
        if agent_name(agent) in script.actions and spoken_fields(runner.contract, runner.env, agent)
    ]
    if not speakers:
        return
    track = runner.watched(Hearing(runner.env, runner.contract, script=script), script)
    deeds: dict[str, list[tuple[int, str]]] = {}
    counts: dict[str, int] = {}
    for turn, name, _ in track.moves:
        place = counts.get(name, 0)
        counts[name] = place + 1
        deeds.setdefault(name, []).append((turn, word(track.actions[name][place])))
    for agent in speakers:
        name, fields = agent_name(agent), spoken_fields(runner.contract, runner.env, agent)
        turns = [turn for turn, _ in deeds.get(name, ())]
        yield {
            "from": name,
            "messages": [message(action, fields) for action in track.actions.get(name, ())],
            "seen": [numbers(track.seen[turn, name]) for turn in turns],
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


def listened(
    runner: ReplacementRunner, script: EpisodeActions, *, seed: int
) -> Iterator[dict[str, Any]]:
    """Looks at whether a listener, shown another message at one decision, decides otherwise.

    Its policy, its random stream and all else that it sees stay as they were. `unchanged`: it
    decides otherwise though it is shown the same.
    """
    listeners = [
        (agent_name(agent), parts)
        for agent in getattr(runner.env, "possible_agents", ())
        if agent_name(agent) in script.actions
        and (parts := heard_parts(runner.contract, runner.env, agent))
    ]
    if not listeners or runner.joint_policy is None:
        return
    rng = np.random.default_rng([seed, script.number, 3])

    def heard(number: int, turns: int | None = None, told: Told | None = None) -> Hearing:
        policy = runner.joint_policy
        track = Hearing(runner.env, runner.contract, joint_policy=policy, told=told)
        return runner.reacting(track, number, turns=turns)

    base, strange = heard(script.number), heard(script.number + STRANGE)
    for name, parts in listeners:
        for turn, other in _pairs(base, strange, name, parts, rng):
            shown = ((turn, name, parts, x) for x in (other, base.seen[turn, name]))
            told, same = (heard(script.number, turn + 1, each) for each in shown)
            was = _decision(base, name, turn)
            yield {
                "to": name,
                "changed": _decision(told, name, turn) != was,
                "unchanged": _decision(same, name, turn) != was,
            }


def _pairs(
    base: Hearing, strange: Hearing, name: str, parts: tuple[ValuePart, ...], rng: Generator
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


def _decision(track: Hearing, name: str, turn: int) -> Any:
    """Decision of an agent at a turn."""
    turns = [at for at, agent, _ in track.moves if agent == name]
    return fingerprint(track.actions[name][turns.index(turn)]) if turn in turns else None


ROUNDS: Final = 199
"""Permutations; the least p-value is then 1 / 200."""
FEWEST: Final = 10
"""Episodes with a message, below which nothing is said."""
BINS: Final = 4
"""Into which numbers with many values are cut, equally full."""
FEW_VALUES: Final = 8

Kind = Literal["signalling", "coordination", "listening"]


@dataclass(frozen=True, slots=True)
class Talk:
    """One finding on messages.

    Attributes:
        kind: `signalling`: messages depend on what their speaker was shown. `coordination`: what
            `to` does next goes with them. `listening`: `to` decides otherwise where it alone is
            shown another message.
        source: who says it; None where all messages are meant.
        to: who hears it; None for signalling.
        bits: mutual information beyond what unrelated episodes have; None for listening.
        p: of the permutation test; for listening the share of decisions that changed.
        share: of listening: changed decisions among the looks, with its interval.
        unchanged: of listening: changed decisions though nothing else was shown.
        n: episodes; for listening looks.
    """

    kind: Kind
    source: str | None
    to: str | None
    bits: float | None
    p: float
    share: Share | None
    unchanged: float | None
    n: int

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        data = {"kind": self.kind, "from": self.source, "to": self.to, "p": self.p, "n": self.n}
        if self.share is None:
            return data | {"bits": self.bits}
        return data | {"low": self.share.low, "high": self.share.high, "unchanged": self.unchanged}


def talk(
    said: Iterable[Mapping[str, Any]], listened: Iterable[Mapping[str, Any]], *, rng: Generator
) -> list[Talk]:
    """All findings on messages.

    Source: Lowe et al. 2019, "On the pitfalls of measuring emergent communication" (speaker
        consistency, instantaneous coordination, causal influence of communication); Jaques et al.
        2019, "Social influence as intrinsic motivation for multi-agent deep reinforcement learning"
        (counterfactual messages).
    """
    by_speaker: dict[str, list[Mapping[str, Any]]] = {}
    for each in said:
        if each["messages"]:
            by_speaker.setdefault(each["from"], []).append(each)
    found: list[Talk] = []
    for speaker, episodes in sorted(by_speaker.items()):
        if len(episodes) >= FEWEST:
            found += _of_speaker(speaker, episodes, rng)
    return [*found, *_listening(listened)]


def _of_speaker(
    speaker: str, episodes: Sequence[Mapping[str, Any]], rng: Generator
) -> Iterator[Talk]:
    length = min(len(each["messages"]) for each in episodes)
    words = _codes([each["messages"][:length] for each in episodes])
    width = min(len(row) for each in episodes for row in each["seen"][:length])
    seen = np.array([[row[:width] for row in each["seen"][:length]] for each in episodes])
    places = [binned(seen[:, :, k]) for k in range(width)]
    places = [each for each in places if each.max(initial=0) > 0]
    if places:
        bits, p = dependence(words, places, rng=rng)
        yield Talk("signalling", speaker, None, bits, p, None, None, len(episodes))
    listeners = sorted(set.intersection(*(set(each["next"]) for each in episodes)))
    for other in listeners:
        deeds = _codes([each["next"][other][:length] for each in episodes])
        bits, p = dependence(words, [deeds], rng=rng)
        yield Talk("coordination", speaker, other, bits, p, None, None, len(episodes))


def _listening(looks: Iterable[Mapping[str, Any]]) -> Iterator[Talk]:
    by_listener: dict[str, list[Mapping[str, Any]]] = {}
    for look in looks:
        by_listener.setdefault(look["to"], []).append(look)
    for name, mine in sorted(by_listener.items()):
        share = wilson(sum(look["changed"] for look in mine), len(mine))
        unchanged = sum(look["unchanged"] for look in mine) / len(mine)
        yield Talk("listening", None, name, None, share.p, share, unchanged, len(mine))


def dependence(
    words: NDArray[np.int64], places: Sequence[NDArray[np.int64]], *, rng: Generator
) -> tuple[float, float]:
    """Bits that messages tell of the place that they tell most of, and their p-value.

    Args:
        words: [episodes, turns] the messages as numbers from 0.
        places: each [episodes, turns], what they may tell of, as numbers from 0.
        rng: draws which episodes are paired.
    Returns:
        The largest mutual information less the mean of the largest ones of unrelated episodes, not
        below 0; and the share of these that are as large.
    """
    own = max(information(words, place) for place in places)
    others = np.array(
        [
            max(information(shuffled, place) for place in places)
            for shuffled in (words[rng.permutation(len(words))] for _ in range(ROUNDS))
        ]
    )
    p = float((1 + np.count_nonzero(others >= own - 1e-12)) / (ROUNDS + 1))
    return max(float(own - others.mean()), 0.0), p


def information(one: NDArray[np.int64], two: NDArray[np.int64]) -> float:
    """The mutual information of two series of categories, in bits."""
    width = int(two.max()) + 1
    table = np.bincount(
        (one * width + two).ravel(), minlength=(int(one.max()) + 1) * width
    ).reshape(-1, width)
    joint = table / table.sum()
    apart = joint.sum(axis=1, keepdims=True) * joint.sum(axis=0, keepdims=True)
    known = joint > 0
    return float((joint[known] * np.log2(joint[known] / apart[known])).sum())


def binned(values: NDArray[np.float64]) -> NDArray[np.int64]:
    """Numbers as categories: each value its own where there are few, else equally full bins."""
    kinds, codes = np.unique(values, return_inverse=True)
    if len(kinds) <= FEW_VALUES:
        return codes.reshape(values.shape).astype(np.int64)
    cuts = np.unique(np.quantile(values, np.linspace(0, 1, BINS + 1)[1:-1]))
    return np.searchsorted(cuts, values, side="right").astype(np.int64)


def _codes(texts: Sequence[Sequence[str]]) -> NDArray[np.int64]:
    """[episodes, turns] numbers from 0 for texts."""
    codes = np.unique(np.array(texts), return_inverse=True)[1]
    return codes.reshape(len(texts), -1).astype(np.int64)
