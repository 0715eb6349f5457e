"""MOMAland's shape: vectors of rewards become terms, and their sum is paid."""

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete
from pettingzoo import AECEnv, ParallelEnv

from gamekeeper.errors import EnvError, SpecError
from gamekeeper.foreign.momaland import Scalarised, ScalarisedTurns
from gamekeeper.runs.recording import rollout


class Beach(ParallelEnv[Any, Any, Any]):
    """Rewards are vectors of two, one agent leaves before the other."""

    metadata = {"name": "beach", "render_modes": []}  # noqa: RUF012  # as PettingZoo declares it
    possible_agents = ["agent_0", "agent_1"]  # noqa: RUF012

    def observation_space(self, agent: Any) -> Any:
        return Discrete(9)

    def action_space(self, agent: Any) -> Any:
        return Discrete(2)

    def reward_space(self, agent: Any) -> Any:
        return Box(-5.0, 5.0, (2,))

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.agents, self.ticks = list(self.possible_agents), 0
        return dict.fromkeys(self.agents, 0), {agent: {} for agent in self.agents}

    def step(self, actions: Any) -> Any:
        self.ticks += 1
        live = self.agents
        paid = {agent: np.array([self.ticks, -0.5], np.float32) for agent in live}
        ended = {agent: self.ticks >= (2 if agent == "agent_0" else 3) for agent in live}
        self.agents = [agent for agent in live if not ended[agent]]
        flags = dict.fromkeys(live, False)
        return dict.fromkeys(live, self.ticks), paid, ended, flags, {agent: {} for agent in live}


class BeachByTurns(AECEnv[Any, Any, Any]):
    """One agent's turns with vector rewards."""

    metadata = {"name": "turns", "render_modes": []}  # noqa: RUF012
    possible_agents = ["a", "b"]  # noqa: RUF012
    observation_space = action_space = Beach.action_space  # type: ignore[assignment]
    reward_space = Beach.reward_space

    def observe(self, agent: Any) -> int:
        return 0

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        self.agents, self.agent_selection, self.ticks = ["a", "b"], "a", 0
        self.rewards = {agent: np.zeros(2) for agent in self.agents}
        self._cumulative_rewards = {agent: np.zeros(2) for agent in self.agents}
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {agent: {} for agent in self.agents}

    def step(self, action: Any) -> None:
        if self.terminations[self.agent_selection]:
            self.agents = self.agents[1:]
            for book in (self.rewards, self._cumulative_rewards, self.terminations):
                book.pop(self.agent_selection)
            self.truncations.pop(self.agent_selection)
            self.infos.pop(self.agent_selection)
            self.agent_selection = self.agents[0] if self.agents else self.agent_selection
            return
        self.ticks += 1
        self._cumulative_rewards[self.agent_selection] = np.zeros(2)
        for agent in self.agents:
            self.rewards[agent] = np.array([1.0, float(self.ticks)])
            self._cumulative_rewards[agent] = self._cumulative_rewards[agent] + self.rewards[agent]
        if self.ticks == 4:
            self.terminations = dict.fromkeys(self.agents, True)
        self.agent_selection = "a" if self.agent_selection == "b" else "b"


def make_beach(weights: list[float] | None = None) -> Any:
    """For rollouts by name."""
    return Scalarised(Beach(), ["capacity", "mixture"], weights)


def test_vector_rewards_become_terms_of_evidence() -> None:
    """Each component is a declared column, their sum the reward, also of agents that end early."""
    evidence = rollout(make_beach, episodes=1, seed=0, env_kwargs={"weights": [1.0, 2.0]})
    rows = evidence.agent_steps.select(["reward", "reward.capacity", "reward.mixture"]).to_pylist()
    paid = [tuple(row.values()) for row in rows if row["reward"] is not None]
    assert paid == [(0.0, 1.0, -1.0)] * 2 + [(1.0, 2.0, -1.0)] * 2 + [(2.0, 3.0, -1.0)]


def test_vector_rewards_by_turns_add_up_as_numbers() -> None:
    """What `last` returns is the sum of the components since the agent's last turn."""
    env = ScalarisedTurns(BeachByTurns(), None, None)
    env.reset(seed=0)
    cumulative_reward = []
    for _ in env.agent_iter():
        _, reward, terminated, truncated, _ = env.last()
        cumulative_reward.append(reward)
        env.step(None if terminated or truncated else 0)
    assert cumulative_reward == [0.0, 2.0, 5.0, 7.0, 9.0, 5.0]
    evidence = rollout(ScalarisedTurns(BeachByTurns(), None, None), episodes=1)
    assert not any(evidence.agent_steps["nonconforming"].to_pylist())


@pytest.mark.parametrize("given", [{"weights": [1.0]}, {"objectives": ["a", "b", "c"]}])
def test_vector_rewards_need_a_name_and_weight_each(given: dict[str, Any]) -> None:
    """One weight for two components isn't stretched."""
    with pytest.raises(SpecError, match="one of each component"):
        Scalarised(Beach(), given.get("objectives"), given.get("weights"))


def test_vector_rewards_of_another_length_are_an_error() -> None:
    """A reward that is no vector of the declared length is told with its agent."""
    beach = Beach()
    env = Scalarised(beach, None, None)
    env.reset()
    beach.step = lambda actions: ({}, {"agent_0": 1.0}, {}, {}, {})  # type: ignore[method-assign]
    with pytest.raises(EnvError, match="'agent_0'"):
        env.step({})
