"""Faults planted in policies, and in arguments, of fresh_envs.py, for benchmarks/fresh.py.

They were written, and kept, before any of them was diagnosed. A set-up counts where plain rollouts
show that it is what it claims to be, by the rule of undo_causes.py: at most half of 24 episodes
succeed, and 22 or more without the fault; of a healthy one 22 or more.
"""

import copy
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from fresh_envs import LEVELS, QUAYS, WHISTLE, Glasshouse, Lock, glasshouse, lock

import gamekeeper as gk
from gamekeeper.episodes.outcome import outcome_of

EPISODES, SEED, FAILED = 24, 808_000, "return < 3"
Act = Callable[[Any, str], Any]


class Mind:
    """A policy with a fault inside; new at every reset.

    Attributes:
        sees: from the observation to what it computes with.
        does: from its choice, and the policy's stream, to its action.
        lag: turns that its actions wait.
        every: turns after which it chooses anew; it repeats itself in between.
        stale: part of the observation that it knows only as it was at its first turn.
    """

    def __init__(
        self,
        act: Act,
        *,
        sees: Callable[[Any], Any] | None = None,
        does: Callable[[Any, Any], Any] | None = None,
        lag: int = 0,
        every: int = 1,
        stale: Any = None,
    ) -> None:
        """Plants it."""
        self.act, self.sees, self.does = act, sees, does
        self.lag, self.every, self.stale = lag, every, stale
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Forgets."""
        self.queue, self.count, self.last, self.first = deque[Any](), 0, None, None

    def __call__(self, observation: Any, agent: str, info: Any, rng: Any) -> Any:
        """The action."""
        seen = copy.deepcopy(observation)
        if self.stale is not None:
            self.first = copy.deepcopy(seen) if self.first is None else self.first
            seen[self.stale] = self.first[self.stale]
        seen = seen if self.sees is None else self.sees(seen)
        if self.count % self.every == 0 or self.last is None:
            self.last = self.act(seen, agent)
        self.count += 1
        action = copy.copy(self.last)
        self.queue.append(action if self.does is None else self.does(action, rng))
        return self.queue.popleft() if len(self.queue) > self.lag else self.queue[0]


class Crossed:
    """Policies in one object, of which one agent is given what the other saw last."""

    def __init__(self, act: Act, wrong: str, other: str) -> None:
        """Plants it."""
        self.act, self.wrong, self.other = act, wrong, other
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Forgets."""
        self.seen: dict[str, Any] = {}

    def __call__(self, observation: Any, agent: str, info: Any, rng: Any) -> Any:
        """The action."""
        self.seen[agent] = copy.deepcopy(observation)
        given = self.seen.get(self.other, observation) if agent == self.wrong else observation
        return self.act(given, agent)


@dataclass(frozen=True)
class FreshCause:
    """A set-up, and what is wrong with it.

    Attributes:
        name: what it is.
        env: the environment.
        act: the policy without a fault.
        policies: by agent.
        kind: `agent`, `protocol` or `healthy`.
        agents: whose fault it is.
        labels: those that it may be given; others are wrong.
        kwargs: of the environment.
    """

    name: str
    env: Any
    act: Act
    policies: dict[str, Any]
    kind: str
    agents: tuple[str, ...] = ()
    labels: tuple[str, ...] = ()
    kwargs: dict[str, Any] = field(default_factory=dict)


def swapped(one: Any, two: Any) -> Callable[[Any], Any]:
    """Two entries exchanged."""

    def change(seen: Any) -> Any:
        seen[one], seen[two] = copy.copy(seen[two]), copy.copy(seen[one])
        return seen

    return change


def axes(key: str) -> Callable[[Any], Any]:
    """Two axes of an entry exchanged."""
    return lambda seen: seen | {key: np.array(seen[key])[::-1]}


def named(one: int, two: int) -> Callable[[Any, Any], Any]:
    """Two actions exchanged."""
    return lambda action, rng: {one: two, two: one}.get(action, action)


def drawn(share: float, count: int) -> Callable[[Any, Any], Any]:
    """Any action in place of the chosen one, with a probability."""
    return lambda action, rng: int(rng.integers(count)) if rng.random() < share else action


def shaken(size: float) -> Callable[[Any, Any], Any]:
    """A draw added to all numbers of an action."""

    def change(action: Any, rng: Any) -> Any:
        return np.clip(action + rng.normal(0, size, np.shape(action)), -1, 1).astype(np.float32)

    return change


def times(*factors: float) -> Callable[[Any, Any], Any]:
    """All numbers of an action times a factor each, within bounds."""
    return lambda action, rng: np.clip(action * np.float32(factors), -1, 1).astype(np.float32)


def cut(most: float) -> Callable[[Any, Any], Any]:
    """All numbers of an action cut off at a bound."""
    return lambda action, rng: np.clip(action, -most, most).astype(np.float32)


def _untrained_barge(observation: Any, agent: str) -> int:
    table = np.random.default_rng(4).integers(5, size=(QUAYS, QUAYS, LEVELS, LEVELS))
    return int(table[tuple(observation)])


def _blocks(observation: Any, agent: str) -> int:
    return WHISTLE if observation[0] == 3 else lock(observation, agent)


def _other_weights(observation: Any, agent: str) -> Any:
    row = np.concatenate([observation[k] for k in ("draught", "place", "plant", "speed")])
    weights = np.random.default_rng(6).normal(0, 1, (2, 8))
    return np.tanh(weights @ row).astype(np.float32)


def _beside(observation: Any, agent: str) -> Any:
    return glasshouse(observation | {"plant": observation["plant"] + np.float32(0.5)}, agent)


def _gentle(observation: Any, agent: str) -> Any:
    action = glasshouse(observation, agent)
    return action if agent == "heater" else (action * np.float32(0.8)).astype(np.float32)


Row = tuple[str, str, tuple[str, ...], dict[str, Any]]
"""Agent, what it is, labels, arguments of `Mind`; `act`: another policy."""
P, C, T = ("perception",), ("control",), ("timing",)
LOCK: list[Row] = [
    ("keeper", "acts the other way", C, {"does": named(0, 2)}),
    ("keeper", "reads its gauge mirrored", P, {"sees": lambda seen: 2 * LEVELS - 2 - seen}),
    ("keeper", "acts 16 turns late", T, {"lag": 16}),
    ("keeper", "empties the lock (hostile)", (), {"act": lambda seen, agent: 0}),
    ("barge_0", "fields 0 and 1 exchanged", P, {"sees": swapped(0, 1)}),
    ("barge_0", "actions 1 and 2 exchanged", C, {"does": named(1, 2)}),
    ("barge_0", "holds each action for 7 turns", T, {"every": 7}),
    ("barge_0", "draws 19 of 20 actions", (), {"does": drawn(0.95, 5)}),
    ("barge_0", "knows its first place only", ("state estimation",), {"stale": 0}),
    ("barge_1", "fields 0 and 2 exchanged", P, {"sees": swapped(0, 2)}),
    ("barge_1", "whistles and never passes (hostile)", (), {"act": _blocks}),
    ("barge_1", "untrained weights", (), {"act": _untrained_barge}),
]
GLASSHOUSE: list[Row] = [
    ("drone_0", "axes of its plant exchanged", P, {"sees": axes("plant")}),
    ("drone_0", "place and plant exchanged", P, {"sees": swapped("place", "plant")}),
    ("drone_1", "axis 0 mirrored", C, {"does": times(-1, 1)}),
    ("drone_1", "acts 9 turns late", T, {"lag": 9}),
    ("drone_0", "holds each action for 12 turns", T, {"every": 12}),
    ("heater", "acts the other way", C, {"does": named(0, 2)}),
    ("heater", "air and wanted exchanged", P, {"sees": swapped("air", "wanted")}),
    ("heater", "draws 19 of 20 actions", (), {"does": drawn(0.95, 3)}),
    ("drone_1", "actions drawn hot", (), {"does": shaken(3.0)}),
    ("drone_0", "saturated action", C, {"does": cut(0.05)}),
    ("drone_1", "knows its first place only", ("state estimation",), {"stale": "place"}),
    ("drone_1", "another checkpoint", (), {"act": _other_weights}),
    ("drone_0", "hovers beside its plant (hostile)", (), {"act": _beside}),
    ("heater", "never heats (hostile)", (), {"act": lambda seen, agent: 0}),
]
HEALTHY: dict[str, list[Row]] = {
    "lock": [
        ("keeper", "as it is", (), {}),
        ("keeper", "acts a turn late", (), {"lag": 1}),
        ("keeper", "chooses every 2nd turn", (), {"every": 2}),
        ("barge_1", "draws 1 of 20 actions", (), {"does": drawn(0.05, 5)}),
        ("barge_1", "levels exchanged, which is the same", (), {"sees": swapped(2, 3)}),
    ],
    "glasshouse": [
        ("heater", "as it is", (), {}),
        ("drone_0", "acts a turn late", (), {"lag": 1}),
        ("heater", "chooses every 2nd turn", (), {"every": 2}),
        ("drone_1", "actions shaken", (), {"does": shaken(0.05)}),
        ("drone_1", "pushes less", (), {"act": _gentle}),
    ],
}
GAMES: dict[str, tuple[Any, Act, tuple[str, ...], list[Row], str, tuple[int, int]]] = {
    "lock": (Lock, lock, ("keeper", "barge_0", "barge_1"), LOCK, "rounds", (7, 40)),
    "glasshouse": (
        Glasshouse,
        glasshouse,
        ("drone_0", "drone_1", "heater"),
        GLASSHOUSE,
        "max_cycles",
        (9, 60),
    ),
}


def causes() -> Iterator[FreshCause]:
    """All set-ups."""
    for name, (env, act, agents, rows, argument, (short, long)) in GAMES.items():
        sound = {agent: Mind(act) for agent in agents}
        for kind, some in (("agent", rows), ("healthy", HEALTHY[name])):
            for agent, text, labels, arguments in some:
                policy = Mind(**{"act": act} | arguments)
                whose = (agent,) if kind == "agent" else ()
                title = f"{name}: {agent} {text}"
                policies = sound | {agent: policy}
                yield FreshCause(title, env, act, policies, kind, whose, labels)
        pair = [agent for agent in agents if agent[-1] in "01"]
        shared = Crossed(act, pair[1], pair[0])
        title, policies = f"{name}: {pair[1]} sees what {pair[0]} saw", sound.copy()
        policies |= dict.fromkeys(pair, shared)
        yield FreshCause(title, env, act, policies, "agent", (pair[1],), P)
        for value, kind in ((short, "protocol"), (long, "healthy")):
            title, kwargs = f"{name}: {argument} {value}", {argument: value}
            labels = ("evaluation",) if kind == "protocol" else ()
            yield FreshCause(title, env, act, sound, kind, (), labels, kwargs)


def holds(cause: FreshCause) -> bool:
    """Tells whether a set-up is what it claims to be."""
    count = successes(cause.env, cause.policies, cause.kwargs)
    if cause.kind == "healthy":
        return count >= EPISODES - 2
    sound = {agent: Mind(cause.act) for agent in cause.policies}
    return count <= EPISODES // 2 and successes(cause.env, sound, {}) >= EPISODES - 2


def successes(env: Any, policies: Any, kwargs: dict[str, Any]) -> int:
    """Number of fresh episodes that succeed."""
    played = gk.rollout(env, policies=policies, episodes=EPISODES, seed=SEED, env_kwargs=kwargs)
    return sum(sum(outcome_of(each).returns.values()) >= 3 for each in played.episodes)
