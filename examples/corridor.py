"""An environment of one's own, which the examples of RLlib and EPyMARL learn: two roles, masks.

A walker and a runner stand in one corridor of nine places, no two in the same; each is paid 1 for
reaching its own lamp, less 0.05 a tick, and has ended then. After 15 ticks who is left is cut off.
The walker takes one place a tick; the runner up to two, and so leaps over the walker. A mask
forbids what leads out of the corridor or onto the other.

    python examples/corridor.py      # random play, and by hand
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import numpy as np
from gymnasium import spaces

import gamekeeper as gk

PLACES: Final = 9
TICKS: Final = 15
MOVES: Final = {"walker": (-1, 0, 1), "runner": (-2, -1, 0, 1, 2)}
GAMES: Final = 200
"""That judge what was learnt."""
FRESH: Final = 1_000_000
"""Seed of the run that they are of."""
WANTED: Final = 0.7
"""Mean return of an agent, stated before the first training; `main` prints what others reach."""
SPEC: Final = f"{Path(__file__).resolve()}:Corridor"


class Corridor(gk.TickEnv):
    """A walker and a runner on their ways to two lamps."""

    metadata = {"name": "corridor_v0"}  # noqa: RUF012  # as PettingZoo has it

    def __init__(self) -> None:
        super().__init__(horizon=TICKS)
        self.possible_agents = list(MOVES)
        self.observation_spaces = dict.fromkeys(MOVES, spaces.Box(0, 1, (4,), np.float32))
        self.action_spaces = {agent: spaces.Discrete(len(MOVES[agent])) for agent in MOVES}

    def start(self, rng: Any, options: dict[str, Any]) -> None:
        """Draws two places, and a lamp for each elsewhere than where it stands."""
        runner = int(rng.integers(PLACES))
        self.at = {"walker": elsewhere(rng, runner), "runner": runner}
        self.lamp = {agent: elsewhere(rng, self.at[agent]) for agent in MOVES}

    def tick(self, actions: dict[str, Any]) -> None:
        """The walker goes first; a place that is taken by then isn't entered."""
        for agent in [one for one in MOVES if one in actions]:
            to = self.at[agent] + MOVES[agent][int(actions[agent])]
            if self.is_free(agent, to):
                self.at[agent] = to
            self.add_reward(agent, -0.05, term="time")
            if self.at[agent] == self.lamp[agent]:
                self.add_reward(agent, 1.0, term="arrival")
                self.terminate(agent, "arrived")

    def is_free(self, agent: str, to: int) -> bool:
        """Whether an agent may stand there; one that has arrived is out of the way."""
        others = [self.at[one] for one in self.agents if one != agent]
        return 0 <= to < PLACES and to not in others

    def observe(self, agent: str) -> Any:
        """Own place and lamp, the other's place, and whether it is still there."""
        other = next(one for one in MOVES if one != agent)
        is_there = other in self.agents
        found = [self.at[agent], self.lamp[agent], self.at[other] * is_there]
        return np.array([*(np.array(found) / (PLACES - 1)), is_there], np.float32)

    def mask(self, agent: str) -> Any:
        """Moves to places that are free now."""
        free = [self.is_free(agent, self.at[agent] + move) for move in MOVES[agent]]
        return np.array(free, np.int8)


def elsewhere(rng: Any, place: int) -> int:
    """Any place but this one."""
    return int(place + 1 + rng.integers(PLACES - 1)) % PLACES


def nearer(observation: Any, agent: str, info: Any, rng: Any) -> int:
    """The allowed move that ends nearest to the lamp, of two the longer one: plays by hand."""
    away = np.rint((observation[1] - observation[0]) * (PLACES - 1))
    moves, is_barred = np.array(MOVES[agent]), info["action_mask"] == 0
    return int(np.argmin(np.abs(away - moves) - 0.1 * np.abs(moves) + PLACES * is_barred))


def mean_returns(evidence: Any) -> list[float]:
    """Mean return of an agent in each episode."""
    rows = evidence.agent_steps.group_by("episode").aggregate([("reward", "sum")]).to_pydict()
    return [paid / len(MOVES) for paid in rows["reward_sum"]]


def main() -> None:
    """Prints what is reached without learning."""
    found = {}
    for name, policy in (("random", "random"), ("by_hand", nearer)):
        played = gk.rollout(SPEC, policies=policy, episodes=GAMES, seed=FRESH)
        found[name] = round(float(np.mean(mean_returns(played))), 3)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
