"""Plays a walk without an end, as many turns as each line of stdin says; `reset` begins the next.

python growing.py RUN
"""

import sys
from typing import Any, ClassVar

from gymnasium.spaces import Discrete

from gamekeeper.interface.tick_env import TickEnv
from gamekeeper.runs.recording import record


class Walk(TickEnv):
    """Two walkers, paid for each step."""

    metadata: ClassVar[dict[str, Any]] = {"name": "walk_v0", "render_modes": []}

    def __init__(self, render_mode: str | None = None) -> None:
        """Nothing to choose."""
        super().__init__(render_mode=render_mode)
        self.possible_agents = ["walker_0", "walker_1"]
        self.observation_spaces = dict.fromkeys(self.possible_agents, Discrete(1_000_000))
        self.action_spaces = dict.fromkeys(self.possible_agents, Discrete(2))

    def start(self, rng: Any, options: Any) -> None:
        """At the beginning."""
        del rng, options
        self.gone = 0

    def tick(self, actions: Any) -> None:
        """One step further, if all act."""
        self.gone += 1
        for agent, action in actions.items():
            self.add_reward(agent, float(action))

    def observe(self, agent: str) -> int:
        """How far they are."""
        del agent
        return self.gone


def main() -> None:
    """Obeys line by line, and says when it has."""
    env = record(Walk(), sys.argv[1])
    env.reset(seed=0)
    for line in sys.stdin:
        if line == "close\n":
            break
        if line == "reset\n":
            env.reset(seed=1)
        else:
            for _ in range(int(line)):
                env.step(dict.fromkeys(env.agents, 1))
        sys.stdout.write("done\n")
        sys.stdout.flush()
    env.close()


if __name__ == "__main__":
    main()
