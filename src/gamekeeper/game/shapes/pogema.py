"""POGEMA's shape: lists by agent, the seed in its GridConfig, a limit that a wrapper would keep."""

from __future__ import annotations

from typing import Any

from numpy.random import Generator, default_rng

from gamekeeper.errors import SpecError
from gamekeeper.game.shapes.by_agent import dealt, infos
from gamekeeper.game.shapes.guest import TIME_LIMIT, Crossing, Given
from gamekeeper.game.shapes.gymnasium import SeveralAgents
from gamekeeper.game.shapes.spaces import as_gymnasium


class Pogema(SeveralAgents):
    """A grid of POGEMA's as a ParallelEnv.

    | | kept | changed |
    |---|---|---|
    | rewards, terminated, infos | of each agent | |
    | seeds | | into `GridConfig.seed`: what its `reset(seed=...)` takes comes after the grid |
    | | | was made; episodes without a seed draw on from the last one |
    | max_episode_steps | truncates those that are left | by us: POGEMA's wrapper needs a way |
    | | | through wrappers that Gymnasium 1.0 took away |
    | metrics in infos | | none: they are kept by wrappers of the same kind |
    """

    unknown: tuple[str, ...] = (
        "whether the environment looks at the action of an agent that has ended",
    )

    def __init__(self, env: Any, *, name: str) -> None:
        """Takes hold of one of the classes of `pogema.envs`, without wrappers."""
        count = int(env.grid_config.num_agents)
        seen, done = as_gymnasium(env.observation_space), as_gymnasium(env.action_space)
        super().__init__(env, [seen] * count, [done] * count, name=name)
        self.metadata["render_modes"] = []  # it draws whole episodes, into files
        self._most = int(env.grid_config.max_episode_steps)
        self._rng: Generator = default_rng(env.grid_config.seed)

    def _begin(self, seed: int | None, options: dict[str, Any] | None) -> tuple[Given, Given]:
        if options:
            raise SpecError(
                "POGEMA looks at no options", where="options", seen=f"{options!r}"[:100]
            )
        if seed is not None:
            self._rng = default_rng(seed)
        self.guest.grid_config.seed = int(self._rng.integers(2**31)) if seed is None else seed
        observations, info = self.guest.reset()
        agents = self.possible_agents
        return dealt(observations, agents, "observations"), dict(infos(info, agents))

    def _play(self, actions: Given) -> Crossing:
        out = super()._play(actions)
        if self.turns + 1 < self._most:
            return out
        cut = {agent: not ended for agent, ended in out.terminated.items()}
        self.endings |= {agent: TIME_LIMIT for agent in self.agents if cut[agent]}
        return Crossing(out.observations, out.rewards, out.terminated, cut, out.infos)
