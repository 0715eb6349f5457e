"""A game whose names and words are whatever a test wants, and recordings of it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray

import gamekeeper as gk
from gamekeeper.contract import Contract
from gamekeeper.episodes.evidence import Evidence

PLAIN = ("one_0", "one_1")


class Told(gk.TickEnv):
    """Agents with any names; infos and endings say any word; the second one fails at will."""

    metadata: Any = {"name": "told_v0", "render_modes": []}  # noqa: RUF012 - as PettingZoo has it

    def __init__(
        self,
        agents: Sequence[str] = PLAIN,
        word: str = "word",
        *,
        length: int = 6,
        raises_at: int | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Episodes of `length` turns; with `raises_at` it raises then."""
        super().__init__(render_mode=render_mode)
        self.possible_agents = list(agents)
        self.word, self.length, self.raises_at = word, length, raises_at
        self.observation_spaces = dict.fromkeys(self.possible_agents, Box(-1, 1, (3,), np.float32))
        self.action_spaces = dict.fromkeys(self.possible_agents, Discrete(3))

    def start(self, rng: Any, options: Any) -> None:
        """A place for everybody."""
        self.now, self.place = 0, {agent: rng.uniform(-1, 1) for agent in self.agents}

    def tick(self, actions: Any) -> None:
        """Pays by the action and moves."""
        self.now += 1
        if self.now == self.raises_at:
            raise RuntimeError(self.word)
        for agent, action in actions.items():
            self.place[agent] = (self.place[agent] + 0.1 * (int(action) - 1)) % 1
            self.add_reward(agent, float(action), term="gain")
            if self.now >= self.length:
                self.terminate(agent, self.word)

    def observe(self, agent: Any) -> NDArray[np.float32]:
        """Its place, thrice."""
        return np.full(3, self.place[agent], np.float32)

    def mask(self, agent: Any) -> NDArray[np.int8]:
        """Everything is legal but the last action at the start."""
        return np.array([1, 1, self.now > 0], np.int8)

    def info(self, agent: Any) -> dict[str, Any]:
        """Its position, and a word."""
        return {"position": [self.place[agent], float(self.now)], "said": self.word}


def recorded(
    out: Path | None = None,
    *,
    agents: Sequence[str] = PLAIN,
    word: str = "word",
    episodes: int = 3,
    failure: str | None = "gain < 6",
    policies: Any = "random",
    seed: int = 0,
    **options: Any,
) -> Evidence:
    """Episodes of `Told`, in memory or in a run."""
    env = Told(agents, word, **options)
    contract = Contract.from_json(
        {
            "name": "told_v0",
            "api": "parallel",
            "rewards": {"gain": {"kind": "individual"}},
            **({"failure": {"team": failure}} if failure else {}),
        }
    )
    return gk.rollout(
        env, policies=policies, episodes=episodes, seed=seed, out=out, contract=contract
    )
