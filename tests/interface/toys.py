"""Small environments and source texts that several tests of opening share."""

from typing import Any, ClassVar

import numpy as np
import pytest
from gymnasium.spaces import Discrete, Space
from pettingzoo import AECEnv, ParallelEnv

from gamekeeper.errors import SpecError
from gamekeeper.interface.opening import open_env

PARALLEL_TEXT = """
from pettingzoo import ParallelEnv
from gymnasium.spaces import Discrete

class Pair(ParallelEnv):
    metadata = {"name": "pair_v0", "render_modes": []}

    def __init__(self, n=2, names=None, render_mode=None):
        self.n, self.names, self.render_mode = n, names, render_mode
        self.possible_agents = [f"a_{i}" for i in range(n)]
        self.agents = []

    def observation_space(self, agent):
        return Discrete(2)

    def action_space(self, agent):
        return Discrete(2)

    def reset(self, seed=None, options=None):
        self.agents = self.possible_agents[:]
        return {a: 0 for a in self.agents}, {a: {} for a in self.agents}

    def step(self, actions):
        over, self.agents = self.agents, []
        return ({a: 0 for a in over}, {a: 0.0 for a in over}, {a: True for a in over},
                {a: False for a in over}, {a: {} for a in over})
"""
"""A file with one Parallel class and nothing else."""


class Pair(ParallelEnv[str, Any, Any]):
    """Two agents that guess once."""

    metadata: ClassVar[dict[str, Any]] = {"name": "pair_v0", "render_modes": []}

    def __init__(self, n: int = 2, render_mode: str | None = None) -> None:
        self.n, self.render_mode = n, render_mode
        self.possible_agents = [f"a_{i}" for i in range(n)]
        self.agents = []

    def observation_space(self, agent: str) -> Space[Any]:
        return Discrete(2)

    def action_space(self, agent: str) -> Space[Any]:
        return Discrete(2)

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        self.agents = self.possible_agents[:]
        return dict.fromkeys(self.agents, np.int64(0)), {a: {} for a in self.agents}

    def step(self, actions: dict[str, Any]) -> Any:
        over, self.agents = self.agents, []
        return (
            dict.fromkeys(over, np.int64(0)),
            dict.fromkeys(over, 0.0),
            dict.fromkeys(over, True),
            dict.fromkeys(over, False),
            {a: {} for a in over},
        )


class Alone(AECEnv[str, Any, Any]):
    """An AEC environment that is no tick game: nothing says that a round is one tick."""

    metadata: ClassVar[dict[str, Any]] = {"name": "alone_v0"}

    def __init__(self, render_mode: str | None = None) -> None:
        self.render_mode = render_mode
        self.possible_agents = ["a_0"]


def make_pair(n: int = 2) -> Pair:
    """A factory that can be imported by its name."""
    return Pair(n)


def told(spec: object, **kwargs: Any) -> str:
    """What the SpecError says that opening raises."""
    with pytest.raises(SpecError) as caught:
        open_env(spec, **kwargs)
    assert type(caught.value) is SpecError
    return str(caught.value)
