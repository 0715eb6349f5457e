"""Environments and a policy that tests of the Tianshou adapter play with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces

import gamekeeper as gk

SPREAD = "mpe2.simple_spread_v3:parallel_env"
LEAVES = f"{Path(__file__).parents[1] / 'vector' / 'worlds.py'}:Leaves"
TIRED = {"pickers": 1, "carriers": 1, "battery": 12, "horizon": 40, "debug": True}
"""Robots that run empty one by one, each followed by a spare."""


def made(spec: object, num_envs: int = 2, **options: Any) -> Any:
    """Without an audit, which has tests of its own."""
    from gamekeeper.adapters import tianshou

    return tianshou.vector_env(spec, num_envs, check=None, **options)


def first_legal(env: Any) -> Any:
    """A policy that takes the first legal action."""
    import torch
    from tianshou.algorithm.algorithm_base import Policy
    from tianshou.data import Batch

    class FirstLegal(Policy):
        def forward(self, batch: Any, state: Any = None, **kwargs: Any) -> Any:
            obs = batch.obs
            count = len(obs.agent_id) if isinstance(obs, Batch) else len(obs)
            acts = np.argmax(obs.mask, -1) if isinstance(obs, Batch) else np.zeros(count, int)
            return Batch(act=torch.as_tensor(acts))

    return FirstLegal(action_space=env.action_space)


class Echo(gk.TickEnv):
    """One tick: who answers with the number that it sees, plus its own place, is paid 1."""

    metadata = {"name": "echo_v0"}  # noqa: RUF012  # PettingZoo declares it so
    closed = 0

    def __init__(self) -> None:
        super().__init__()
        self.possible_agents = ["a_0", "a_1"]
        seen = {
            "observation": spaces.Box(0, 1, (4,), np.float32),
            "action_mask": spaces.MultiBinary(6),
        }
        self.observation_spaces = dict.fromkeys(self.possible_agents, spaces.Dict(seen))
        self.action_spaces = dict.fromkeys(self.possible_agents, spaces.Discrete(6))

    def start(self, rng: Any, options: Any) -> None:
        self.told = {agent: int(rng.integers(4)) for agent in self.possible_agents}

    def tick(self, actions: Any) -> None:
        for place, (agent, action) in enumerate(actions.items()):
            self.add_reward(agent, float(action == (self.told[agent] + place) % 4))
            self.terminate(agent)

    def observe(self, agent: Any) -> Any:
        seen = np.eye(4, dtype=np.float32)[self.told[agent]]
        return {"observation": seen, "action_mask": np.array([1, 1, 1, 1, 0, 0], np.int8)}

    def close(self) -> None:
        Echo.closed += 1
        super().close()


def first_board() -> tuple[Any, Any]:
    """What the first player of tic-tac-toe is given."""
    game = gk.make("tictactoe")
    game.reset(seed=0)
    given, _, _, _, info = game.last()
    game.close()
    return given, info
