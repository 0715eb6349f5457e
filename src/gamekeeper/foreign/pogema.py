"""`pogema:pogema_v0`: POGEMA's grids, built from the fields of its GridConfig."""

from typing import Any, Final

from numpy.random import Generator, default_rng

from gamekeeper.errors import SpecError
from gamekeeper.foreign._guest import TIME_LIMIT, ForeignStep, Given, dealt, infos
from gamekeeper.foreign._spaces import as_gymnasium
from gamekeeper.foreign.gymnasium import SeveralAgents
from gamekeeper.interface import foreign_openers
from gamekeeper.interface.env_source import Source


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

    optionless = "POGEMA"
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
        if seed is not None:
            self._rng = default_rng(seed)
        self.guest.grid_config.seed = int(self._rng.integers(2**31)) if seed is None else seed
        observations, info = self.guest.reset()
        agents = self.possible_agents
        return dealt(observations, agents, "observations"), dict(infos(info, agents))

    def _play(self, actions: Given) -> ForeignStep:
        out = super()._play(actions)
        if self.turns + 1 < self._most:
            return out
        cut = {agent: not ended for agent, ended in out.terminated.items()}
        self.endings |= {agent: TIME_LIMIT for agent in self.agents if cut[agent]}
        return ForeignStep(out.observations, out.rewards, out.terminated, cut, out.infos)


WORD: Final = "pogema"
SYNTAX: Final = "pogema:pogema_v0"
ORDER: Final = foreign_openers.ORDER
matches: Final = foreign_openers.begins_with(WORD)
distrust: Final = foreign_openers.distrust_packages(WORD)

NAMES: Final = ("pogema_v0",)
KINDS: Final = {"finish": "Pogema", "nothing": "PogemaCoopFinish", "restart": "PogemaLifeLong"}
"""Classes by what happens to agents on their target. Source: pogema.envs._make_pogema."""


def locate(spec: str, api: str | None) -> Source:
    """The grid; keyword arguments are GridConfig's fields (`size`, `num_agents`, `on_target`, ...).

    POGEMA's own lists are opened: its environment, and its factory, ask Gymnasium for a way
    through wrappers that Gymnasium 1.0 took away.
    """
    name = foreign_openers.rest(spec, WORD) or ""
    package, envs = foreign_openers.need(WORD), foreign_openers.need(f"{WORD}.envs")
    if name not in NAMES:
        raise foreign_openers.unknown(name, "POGEMA", list(NAMES))

    def build(**kwargs: Any) -> Pogema:
        grid = package.GridConfig(**kwargs)
        kind = KINDS.get(grid.on_target)
        if kind is None:
            raise SpecError(
                "POGEMA has no such rule for agents on their target",
                where="on_target",
                expected=", ".join(KINDS),
                actual=repr(grid.on_target),
                fix="build the grid with one of these for on_target",
            )
        return Pogema(getattr(envs, kind)(grid_config=grid), name=name)

    return foreign_openers.source(WORD, name, build, accepts=package.GridConfig)
