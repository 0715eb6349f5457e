"""Games of every kind of space, recorded in memory, and buffered turns cut to any length."""

from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Discrete, Space
from pettingzoo import ParallelEnv

from gamekeeper.episodes.buffer import Buffer, take
from gamekeeper.episodes.encoder import Encoded, Encoder
from gamekeeper.interface.recorded_env import capture_of, recorded_of
from gamekeeper.rollouts.memory import MemorySink

IDENTITY = {"name": "given_v0", "api": "parallel", "kwargs": {}}


class Given(ParallelEnv):  # type: ignore[type-arg, misc]  # PettingZoo ships no types
    """Gives each agent the values that a test hands in, tick after tick."""

    metadata: ClassVar[dict[str, Any]] = {"name": "given_v0"}

    def __init__(
        self,
        observations: dict[str, list[Any]],
        spaces: dict[str, Space[Any]],
        *,
        infos: dict[str, list[Any]] | None = None,
        rewards: list[Any] | None = None,
        states: list[Any] | None = None,
        actions: Space[Any] | None = None,
    ) -> None:
        self.given, self.spaces = observations, spaces
        self.told, self.rewards, self.states = infos or {}, rewards or [1.0], states
        self.acts = Discrete(9) if actions is None else actions
        self.possible_agents = list(observations)
        self.tick = 0

    def observation_space(self, agent: str) -> Space[Any]:
        return self.spaces[agent]

    def action_space(self, agent: str) -> Space[Any]:
        return self.acts

    def _at(self, items: list[Any]) -> Any:
        return items[self.tick % len(items)]

    def _look(self) -> tuple[dict[str, Any], dict[str, Any]]:
        return (
            {agent: self._at(values) for agent, values in self.given.items()},
            {agent: self._at(self.told.get(agent, [{}])) for agent in self.given},
        )

    def state(self) -> Any:
        if self.states is None:
            raise NotImplementedError
        value = self._at(self.states)
        if isinstance(value, Exception):
            raise value
        return value

    def reset(self, seed: Any = None, options: Any = None) -> Any:
        self.agents, self.tick = self.possible_agents[:], 0
        return self._look()

    def step(self, actions: Any) -> Any:
        reward = self._at(self.rewards)
        self.tick += 1
        observations, infos = self._look()
        every = [dict.fromkeys(self.agents, value) for value in (reward, False, False)]
        return observations, *every, infos


def record(
    env: Any,
    ticks: int,
    *,
    seed: int | None = 1,
    episodes: int = 1,
    options: Any = None,
    actions: Any = None,
    volatile: tuple[str, ...] = (),
) -> Any:
    """The evidence of some episodes of `ticks` ticks each."""
    sink = MemorySink(volatile=volatile)
    play(recorded_of(capture_of(env, sink=sink)), ticks, seed, episodes, options, actions)
    return sink.evidence(IDENTITY)


def play(
    wrapped: Any,
    ticks: int,
    seed: Any = 1,
    episodes: int = 1,
    options: Any = None,
    actions: Any = None,
) -> None:
    """Plays episodes; every agent does `actions[tick]`, or 1."""
    for _ in range(episodes):
        wrapped.reset(seed=seed, options=options)
        for tick in range(ticks):
            action = np.int64(1) if actions is None else actions[tick % len(actions)]
            wrapped.step(dict.fromkeys(wrapped.agents, action))
    wrapped._capture.end_episode()


class BufferSink(MemorySink):
    """Keeps everything on the buffer, for a test to cut as it likes."""

    def keep_up(self) -> None:
        return


def taped(env: Any, ticks: int, **settings: Any) -> BufferSink:
    """The buffer of some episodes, uncut."""
    sink = BufferSink()
    play(recorded_of(capture_of(env, sink=sink)), ticks, **settings)
    return sink


def encoded(sink: MemorySink, *, most: int, level: str = "full") -> Iterator[Encoded]:
    """The buffer's batches, cut into buffered turns of at most `most` turns."""
    press = Encoder(sink.layout, sink._encoder.open_large, level=level)
    buffer: Buffer = sink.buffer
    while (buffered := take(buffer, most=most)) is not None:
        yield press.encode_turns(buffered)
