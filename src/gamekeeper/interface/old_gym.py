"""Ours in the old Gym's shape, for trainers that speak no other: lists in, lists out."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from gymnasium.spaces import Space

from gamekeeper.errors import ActionError, EnvError, OrderError
from gamekeeper.interface.env_source import Env, convert

TRUNCATED: Final = "TimeLimit.truncated"
"""Key by which the old Gym's TimeLimit says that it, and no rule, ended the episode."""


def as_old_gym(env: Env) -> AsOldGym:
    """An environment in the old Gym's shape: `reset()`, four values from `step`, `env.seed()`.

    | | kept | changed |
    |---|---|---|
    | agents | in the order of `possible_agents`, in every list | |
    | dones | one of each agent, true from its end on | both kinds of end |
    | truncation | `info["truncated"]`, one of each; `info["TimeLimit.truncated"]` where the |
    | | episode is over and nobody terminated | |
    | infos, masks | `info["n"]`, one of each | |
    | who has ended | | its observation stays the last, its reward is 0, its action is ignored |
    | seeds | `env.seed(s)`, used by the next reset | |
    | options, late joiners | | refused: lists have a fixed length |

    Args:
        env: Parallel, or AEC where it declares that a round of turns is one tick.
    Raises:
        SpecError: an AEC environment that can't be played in ticks.
    """
    return AsOldGym(convert(env, "parallel"))


class AsOldGym:
    """See `as_old_gym`, which builds it.

    Attributes:
        n_agents: the length of every list.
        action_space: [n_agents], one of each.
        observation_space: [n_agents], one of each.
    """

    def __init__(self, env: Any) -> None:
        self.env = env
        self.agents: list[Any] = list(env.possible_agents)
        self.n_agents = len(self.agents)
        self.metadata = env.metadata
        self.action_space: list[Space[Any]] = [env.action_space(agent) for agent in self.agents]
        self.observation_space: list[Space[Any]] = [
            env.observation_space(agent) for agent in self.agents
        ]
        self.reward_range = (-float("inf"), float("inf"))
        self.spec = None
        self._seed: int | None = None
        self._last: dict[Any, Any] = {}
        self._cut: dict[Any, bool] = {}
        self._infos: dict[Any, Any] = {}

    @property
    def unwrapped(self) -> AsOldGym:
        """Itself: there is nothing of the old Gym further in."""
        return self

    def seed(self, seed: int | None = None) -> list[int | None]:
        """The seed of the next reset; the seeds that are used, as the old Gym returned them."""
        self._seed = seed
        return [seed]

    def reset(self) -> list[Any]:
        """Begins an episode: [n_agents] observations.

        Raises:
            EnvError: somebody isn't there from the start.
        """
        seed, self._seed = self._seed, None
        self._last, self._infos = self.env.reset(seed=seed)
        if list(self.env.agents) != self.agents:
            raise EnvError(
                "an episode doesn't begin with everybody",
                where="reset",
                expected=f"{self.agents!r}"[:200],
                actual=f"{self.env.agents!r}"[:200],
                fix="the old Gym's lists have a fixed length: use the environment as it is",
            )
        self._cut = dict.fromkeys(self.agents, False)
        return [self._last[agent] for agent in self.agents]

    def step(self, actions: Any) -> tuple[list[Any], list[float], list[bool], dict[str, Any]]:
        """One tick: [n_agents] observations, rewards, dones, and one info for all.

        Raises:
            OrderError: everybody has ended, or there was no reset.
            ActionError: there isn't one action of each agent.
            EnvError: an agent joined, for which the lists have no place.
        """
        live = list(self.env.agents) if self._last else []
        if not live:
            raise OrderError("step came without a running episode", fix="call reset first")
        if not isinstance(actions, list | tuple | np.ndarray) or len(actions) != self.n_agents:
            raise ActionError(
                "there isn't one action of each agent",
                where="step",
                expected=f"a list of {self.n_agents}",
                actual=repr(actions)[:200],
                fix="hand a list with one action for each agent to step",
            )
        given = dict(zip(self.agents, actions, strict=True))
        seen, paid, _, truncated, infos = self.env.step({a: given[a] for a in live})
        strangers = [agent for agent in self.env.agents if agent not in given]
        if strangers:
            raise _joined(strangers)
        self._last |= seen
        self._infos = {agent: infos.get(agent, {}) for agent in self.agents}
        self._cut |= {agent: bool(truncated[agent]) for agent in live if truncated[agent]}
        dones = [agent not in self.env.agents for agent in self.agents]
        info = {
            "n": [self._infos[agent] for agent in self.agents],
            "truncated": [self._cut[agent] for agent in self.agents],
            TRUNCATED: all(dones) and all(self._cut.values()),
        }
        rewards = [paid.get(agent, 0.0) for agent in self.agents]
        return [self._last[agent] for agent in self.agents], rewards, dones, info

    def render(self, mode: str = "human") -> Any:
        """Renders the environment, in the mode that it was built with."""
        return self.env.render()

    def close(self) -> None:
        """Closes the environment."""
        self.env.close()


def _joined(agents: list[Any]) -> EnvError:
    return EnvError(
        "an agent joined for which the old Gym's lists have no place",
        where="step",
        expected="the agents of the first reset, to the end",
        actual=f"{agents!r}"[:200],
        fix="use the environment as it is",
    )
