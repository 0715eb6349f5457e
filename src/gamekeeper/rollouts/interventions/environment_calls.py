"""Calls and writes around the turns that leave a sound environment as it is."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from operator import methodcaller
from typing import Any, Final

from numpy.random import Generator

from gamekeeper.interface.capture import AgentId
from gamekeeper.rollouts.intervention import Hooks, Intervention
from gamekeeper.rollouts.snapshots import overwrite


def _observe(env: Any) -> None:
    for agent in list(env.agents):
        env.observe(agent)


def _last(env: Any) -> None:
    if env.agents:
        env.last()


def _spaces(env: Any) -> None:
    for agent in list(env.agents):
        env.observation_space(agent)
        env.action_space(agent)


def _sample(env: Any) -> None:
    for agent in list(env.agents):
        env.action_space(agent).sample()
        env.observation_space(agent).sample()


def _attributes(env: Any) -> None:
    str(env)
    for name in ("num_agents", "max_num_agents", "metadata", "unwrapped"):
        getattr(env, name, None)


CALLS: Final[dict[str, Callable[[Any], None]]] = {
    "observe": _observe,
    "last": _last,
    "state": methodcaller("state"),
    "render": methodcaller("render"),
    "spaces": _spaces,
    "sample": _sample,
    "attributes": _attributes,
}
"""Each kind of call, as it is made on an environment."""


@dataclass(frozen=True, slots=True)
class ExtraCalls(Intervention):
    """Makes calls that should only read after the reset and every step.

    In an AEC environment, also between `last()` and the step, and once more at every second turn:
    of calls that turn something on and off again, an even number shows nothing.

    Attributes:
        calls: kinds of `CALLS`; what one of them raises is passed over.
    """

    calls: tuple[str, ...]

    def start(self, rng: Generator) -> Hooks:
        """The hooks; they draw nothing."""
        return _Calling(self.calls)


class _Calling(Hooks):
    def __init__(self, calls: tuple[str, ...]) -> None:
        self._calls = [CALLS[name] for name in calls]
        self._env: Any = None

    def between(self, turn: int, env: Any) -> None:
        """Calls before anybody has looked."""
        self._env = env
        for _ in range(1 + (turn % 2 if hasattr(env, "agent_iter") else 0)):
            self._call()

    def acts(self, turn: int, actions: dict[AgentId, Any]) -> dict[AgentId, Any]:
        """Calls once more when the agent in turn has looked and chosen."""
        if hasattr(self._env, "agent_iter"):
            self._call()
        return actions

    def _call(self) -> None:
        """Calls; whatever an extra call raises, the episode goes on: others look at that."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            for call in self._calls:
                try:
                    call(self._env)
                except Exception:  # foreign code: a call that isn't offered at this turn
                    continue


@dataclass(frozen=True, slots=True)
class ActionsOverwritten(Intervention):
    """Overwrites the arrays of actions after their step, and empties their dict.

    A learner re-uses its buffers like that; an environment that kept a reference reads them late.
    """

    def start(self, rng: Generator) -> Hooks:
        """The hooks; they draw nothing."""
        return _Overwriting()


class _Overwriting(Hooks):
    def __init__(self) -> None:
        self._given: dict[AgentId, Any] = {}

    def acts(self, turn: int, actions: dict[AgentId, Any]) -> dict[AgentId, Any]:
        """Remembers the very objects that are handed over."""
        self._given = actions
        return actions

    def between(self, turn: int, env: Any) -> None:
        """Writes into them."""
        for action in self._given.values():
            overwrite(action)
        self._given.clear()
