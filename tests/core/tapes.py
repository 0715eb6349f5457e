"""Games of every kind of space, recorded in memory, and reels cut to any length."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Discrete, Space
from pettingzoo import ParallelEnv

from gamekeeper.core.press import Press, Pressed
from gamekeeper.core.tape import Tape, take
from gamekeeper.game.faces import face_of, game_of
from gamekeeper.run.memory import MemorySink

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
    play(face_of(game_of(env, sink=sink)), ticks, seed, episodes, options, actions)
    return sink.evidence(IDENTITY)


def play(
    face: Any,
    ticks: int,
    seed: Any = 1,
    episodes: int = 1,
    options: Any = None,
    actions: Any = None,
) -> None:
    """Plays episodes; every agent does `actions[tick]`, or 1."""
    for _ in range(episodes):
        face.reset(seed=seed, options=options)
        for tick in range(ticks):
            action = np.int64(1) if actions is None else actions[tick % len(actions)]
            face.step(dict.fromkeys(face.agents, action))
    face._game.end_episode()


class TapeSink(MemorySink):
    """Keeps everything on the tape, for a test to cut as it likes."""

    def keep_up(self) -> None:
        return


def taped(env: Any, ticks: int, **settings: Any) -> TapeSink:
    """The tape of some episodes, uncut."""
    sink = TapeSink()
    play(face_of(game_of(env, sink=sink)), ticks, **settings)
    return sink


def pressed(sink: MemorySink, *, most: int, level: str = "full") -> Iterator[Pressed]:
    """The tape's batches, cut into reels of at most `most` turns."""
    press = Press(sink.layout, sink._press.open_large, level=level)
    tape: Tape = sink.tape
    while (reel := take(tape, most=most)) is not None:
        yield press.press(reel)
