"""An agent that leaves without an ending is terminated in the step in which it left."""

from typing import Any

import numpy as np
import pytest
from gymnasium import spaces
from pettingzoo import AECEnv, ParallelEnv

import gamekeeper as gk
from tests.vector import worlds


class _Leaving:
    """`a` is taken off the list after two ticks without a word, `b` after four."""

    def __init__(self) -> None:
        self.possible_agents = ["a", "b"]
        self.render_mode = None

    def observation_space(self, agent: str) -> Any:
        return spaces.Box(0, 9, (1,), np.float32)

    def action_space(self, agent: str) -> Any:
        return spaces.Discrete(2)


class LeavesAtOnce(_Leaving, ParallelEnv):
    """Parallel."""

    metadata = {"name": "leaves_at_once_v0"}  # noqa: RUF012  # as PettingZoo has it

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.agents, self.time = ["a", "b"], 0
        return self._all(np.ones(1, np.float32)), self._all({})

    def step(self, actions: Any) -> Any:
        self.time += 1
        self.agents = {2: ["b"], 4: []}.get(self.time, self.agents)
        seen = self._all(np.full(1, self.time, np.float32))
        return seen, self._all(1.0), self._all(False), self._all(False), self._all({})

    def _all(self, value: Any) -> dict[str, Any]:
        return dict.fromkeys(self.agents, value)


class LeavesInTurn(_Leaving, AECEnv):
    """AEC: a, b, a, then b alone."""

    metadata = {"name": "leaves_in_turn_v0"}  # noqa: RUF012  # as PettingZoo has it

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        self.agents, self.time, self.agent_selection = ["a", "b"], 0, "a"
        self._tell()

    def step(self, action: Any) -> None:
        self.time += 1
        self.agents = {3: ["b"], 5: []}.get(self.time, self.agents)
        self._tell()
        if self.agents:
            self.agent_selection = "a" if self.time == 2 else "b"

    def observe(self, agent: str) -> Any:
        return np.full(1, self.time, np.float32)

    def _tell(self) -> None:
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos: dict[str, Any] = {agent: {} for agent in self.agents}


@pytest.mark.parametrize("autoreset", ["same_step", "next_step"])
@pytest.mark.parametrize(("kind", "steps"), [(LeavesAtOnce, [2, 4]), (LeavesInTurn, [3, 5])])
def test_departure_is_a_termination(kind: Any, steps: list[int], autoreset: str) -> None:
    """Of that agent in that step, in every episode; nothing was truncated."""
    venv = gk.vector.make(kind, 1, engine="serial", autoreset=autoreset)
    venv.reset()
    rounds = steps[1] + (autoreset == "next_step")
    actions = np.zeros((1, 2) if kind is LeavesAtOnce else 1, int)
    ends = {agent: [] for agent in (0, 1)}
    for step in range(1, 2 * rounds + 1):
        _, _, terminated, truncated, infos = venv.step(actions)
        assert not truncated.any()
        for agent in np.flatnonzero(terminated[0]).tolist():
            assert infos["_final_obs"][0]
            assert not infos["final_obs"][0][agent].any()
            ends[agent].append(step)
    assert ends == {agent: [at, at + rounds] for agent, at in enumerate(steps)}
    venv.close()


def test_agents_that_ended_before_are_shown_zeros_whatever_the_environment_shows_them() -> None:
    """The last observation in the step of the end; until the copy begins anew, nothing more."""
    with gk.vector.make(f"{worlds.__file__}:Shown", 2) as venv:
        venv.reset()
        seen = [venv.step(np.zeros((2, 2), np.int64))[0][:, 0, 0].tolist() for _ in range(10)]
    assert seen == [[time] * 2 for time in (1, 2, 3, 4, 0, 0, 0, 0, 0, 0)]
