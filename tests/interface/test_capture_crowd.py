"""Many agents: rows a turn and work a turn don't grow with their number."""

import sys
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete
from pettingzoo import AECEnv

from gamekeeper.interface.aec_capture import AECCapture
from tests.interface.capture_games import evidence_of, recorded


class Crowd(AECEnv):  # type: ignore[type-arg, misc]
    """Many agents; the agent in turn dies and is gone with its next turn."""

    metadata: dict[str, Any] = {"name": "crowd_v0"}  # noqa: RUF012 - as PettingZoo has it

    def __init__(self, n: int) -> None:
        self.possible_agents = [f"a_{i}" for i in range(n)]
        self.space, self.acts = Box(0, 1, (1,), np.float32), Discrete(2)

    def observation_space(self, agent: str) -> Any:
        return self.space

    def action_space(self, agent: str) -> Any:
        return self.acts

    def observe(self, agent: str) -> Any:
        return np.zeros(1, np.float32)

    def reset(self, seed: Any = None, options: Any = None) -> None:
        self.agents = self.possible_agents[:]
        self.rewards, self._cumulative_rewards = (dict.fromkeys(self.agents, 0.0) for _ in "12")
        self.terminations, self.truncations = (dict.fromkeys(self.agents, False) for _ in "12")
        self.infos: dict[str, Any] = {a: {} for a in self.agents}
        self.agent_selection = self.agents[0]

    def step(self, action: Any) -> None:
        agent = self.agent_selection
        if self.terminations[agent]:
            for book in (self.rewards, self._cumulative_rewards, self.infos):
                del book[agent]
            del self.terminations[agent], self.truncations[agent]
            self.agents.remove(agent)
            self.agent_selection = self.agents[0] if self.agents else agent
        else:
            self.terminations[agent] = True


def test_many_agents_cost_a_row_a_turn() -> None:
    """2,048 agents that die one a turn: turn 0 lists them all, then a row a turn."""
    n = 2048
    wrapped, sink = recorded(Crowd(n))
    wrapped.reset(seed=1)
    for _ in range(2 * n):
        _, _, over, *_ = wrapped.last()
        wrapped.step(None if over else 1)
    evidence = evidence_of(wrapped, sink)
    assert evidence.episode_table["turns"].to_pylist() == [2 * n]
    assert evidence.agent_steps.num_rows == (n - 1) + 2 * n
    assert evidence.episode_table["end"].to_pylist() == ["ended"]


def operations(n: int, turns: int) -> int:
    """How many bytecodes the door runs for some turns in which one agent after the other dies."""
    wrapped, _ = recorded(Crowd(n))
    wrapped.reset(seed=1)
    wrapped.step(1)  # turn 0 lists everybody
    wrapped.step(None)
    count = 0
    ours = sys.modules[AECCapture.__module__].__file__ or ""
    room = ours.rpartition("/")[0]

    def episode(frame: Any, event: str, argument: Any) -> Any:
        nonlocal count
        if not frame.f_code.co_filename.startswith(room):
            return None
        frame.f_trace_opcodes = True
        count += event == "opcode"
        return episode

    before = sys.gettrace()
    # Python 3.12 turns opcode events on with settrace, and only where some frame asked before.
    sys._getframe().f_trace_opcodes = True
    sys.settrace(episode)
    try:
        for _ in range(turns):
            _, _, over, *_ = wrapped.last()
            wrapped.step(None if over else 1)
    finally:
        sys.settrace(before)
    return count


def test_deaths_one_a_turn_are_followed_without_walking_over_all_agents() -> None:
    """A turn runs as many bytecodes among 512 agents as among 16."""
    assert operations(16, 12) == operations(512, 12)
