"""What conversion costs: `to_aec` and `to_parallel` beside PettingZoo's converters.

    python benchmarks/converters.py [--quick]

Prints one JSON line for each figure: microseconds of processor time an agent-step around trivial
rules, by number of agents, the median of segments that take turns with each other. An AEC
environment is played by `agent_iter`, `last` and `step`, a Parallel one by `step`. The rules' own
cost is a figure too. `ratio` is the median of the ratios of segments that stood side by side: of a
conversion to the turns inside it; `to_theirs` is that of ours to PettingZoo's.
"""

import argparse
import json
from collections.abc import Callable
from operator import truediv
from statistics import median
from time import process_time
from typing import Any

from gymnasium.spaces import Discrete
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils.conversions import aec_to_parallel, parallel_to_aec
from turn_env import SIZES, Documented, Ours, names

from gamekeeper.interface.to_aec import ToAEC
from gamekeeper.interface.to_parallel import ToParallel

SEGMENT_S = 0.02  # long against the clock and the caches; at least a tick


class Ticks(ParallelEnv):
    """Trivial rules, all at once: everybody is paid."""

    metadata = {"name": "ticks_v0", "render_modes": []}  # noqa: RUF012  # PettingZoo's way
    render_mode = None

    def __init__(self, n: int) -> None:
        """As many agents as asked for."""
        self.possible_agents = names(n)
        self._spaces = {agent: Discrete(3) for agent in self.possible_agents}

    def observation_space(self, agent: str) -> Any:
        """The space of an agent's observations."""
        return self._spaces[agent]

    def action_space(self, agent: str) -> Any:
        """The space of an agent's actions."""
        return self._spaces[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Everybody is there."""
        self.agents = self.possible_agents[:]
        return dict.fromkeys(self.agents, 0), {agent: {} for agent in self.agents}

    def step(self, actions: dict[str, int]) -> Any:
        """Nothing to see, 1.0 for everybody."""
        flags = dict.fromkeys(self.agents, False)
        return (
            dict.fromkeys(self.agents, 0),
            dict.fromkeys(self.agents, 1.0),
            flags,
            flags.copy(),
            {agent: {} for agent in self.agents},
        )


class Standing(Documented):
    """The documented pattern with cheap turns: pay comes with a round's last turn, and stands."""

    def step(self, action: Any) -> None:
        """Does nothing for each agent but in the last turn of a round."""
        self._cumulative_rewards[self.agent_selection] = 0
        if self._agent_selector.is_last():
            self.rewards = dict.fromkeys(self.agents, 1.5)
            self._accumulate_rewards()
        self.agent_selection = self._agent_selector.next()


def declared(env: AECEnv) -> AECEnv:
    """The environment, which says that its rounds can be ticks."""
    env.metadata = {**env.metadata, "is_parallelizable": True}
    return env


def ticks_of(env: Any) -> Callable[[int], float]:
    """Plays whole ticks and says how long an agent's part in one took."""
    env.reset()
    actions = dict.fromkeys(env.agents, 1)

    def play(turns: int) -> float:
        ticks = -(-turns // len(actions))
        start = process_time()
        for _ in range(ticks):
            env.step(actions)
        return (process_time() - start) / (ticks * len(actions)) * 1e6

    return play


def turns_of(env: Any) -> Callable[[int], float]:
    """Plays a number of turns and says how long one took."""
    env.reset()

    def play(turns: int) -> float:
        start = process_time()
        for _ in env.agent_iter(turns):
            env.last()
            env.step(1)
        return (process_time() - start) / turns * 1e6

    return play


FIGURES: dict[str, Callable[[int], Callable[[int], float]]] = {
    "Parallel rules by themselves": lambda n: ticks_of(Ticks(n)),
    "to_aec": lambda n: turns_of(ToAEC(Ticks(n))),
    "PettingZoo's parallel_to_aec": lambda n: turns_of(parallel_to_aec(Ticks(n))),
    "TurnEnv, its own turns": lambda n: turns_of(Ours(n)),
    "to_parallel over TurnEnv": lambda n: ticks_of(ToParallel(Ours(n))),
    "PettingZoo's aec_to_parallel over TurnEnv": lambda n: ticks_of(
        aec_to_parallel(declared(Ours(n)))
    ),
    "documented AEC, its own turns": lambda n: turns_of(Documented(n)),
    "to_parallel over the documented AEC": lambda n: ticks_of(ToParallel(Documented(n))),
    "PettingZoo's aec_to_parallel over the documented AEC": lambda n: ticks_of(
        aec_to_parallel(declared(Documented(n)))
    ),
    "to_parallel over cheap turns": lambda n: ticks_of(ToParallel(Standing(n))),
    "PettingZoo's aec_to_parallel over cheap turns": lambda n: ticks_of(
        aec_to_parallel(declared(Standing(n)))
    ),
}
OVER = {
    "to_parallel over the documented AEC": "documented AEC, its own turns",
    "PettingZoo's aec_to_parallel over the documented AEC": "documented AEC, its own turns",
}
THEIRS = {
    name: f"PettingZoo's aec_{name}" for name in FIGURES if name.startswith("to_parallel over")
}
BARS = {"to_aec": 3.0, "to_parallel over TurnEnv": 4.0}  # microseconds, at every size


def measured(n: int, rounds: int) -> dict[str, list[float]]:
    """The cost of each figure in each round, one segment after the other."""
    plays = {name: make(n) for name, make in FIGURES.items()}
    turns = {
        name: n * max(1, int(SEGMENT_S / (play(n) * n * 1e-6))) for name, play in plays.items()
    }
    seen: dict[str, list[float]] = {name: [] for name in plays}
    for _ in range(rounds):
        for name, play in plays.items():
            seen[name].append(play(turns[name]))
    return seen


def main() -> None:
    """Measures everything in one run and prints it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a few rounds: seconds, and rough")
    most = 3 if parser.parse_args().quick else 25
    seen = {n: measured(n, min(most, max(5, 4096 // n))) for n in SIZES}
    for name in FIGURES:
        line: dict[str, Any] = {
            "figure": name,
            "unit": "us",
            "by_agents": {n: round(median(seen[n][name]), 2) for n in SIZES},
        }
        for key, other in (("ratio", OVER.get(name)), ("to_theirs", THEIRS.get(name))):
            if other is not None:
                line[key] = {
                    n: round(median(map(truediv, seen[n][name], seen[n][other])), 2) for n in SIZES
                }
        if name in BARS:
            line["bar"] = BARS[name]
        print(json.dumps(line))


if __name__ == "__main__":
    main()
