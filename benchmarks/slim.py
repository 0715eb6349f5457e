"""What environments cost in the wrappers they ship in, and slim; and whether the rows are equal.

    python benchmarks/slim.py [--quick]

Prints JSON lines: microseconds of processor time an agent-step of each environment as shipped and
slim, the median of segments that take turns with each other, and the median of their ratios; then
how many of some whole episodes, played through both, gave the same rows, bit for bit. The actions
are drawn beforehand, so that only the environment is timed. Needs `pettingzoo[classic,butterfly]`
and `mpe2`.
"""

import argparse
import contextlib
import importlib
import io
import json
import os
import warnings
from collections.abc import Iterator
from operator import truediv
from statistics import median
from time import process_time
from typing import Any

import numpy as np
from gymnasium.spaces import Discrete
from pettingzoo import ParallelEnv
from pettingzoo.utils.env_logger import EnvLogger

from gamekeeper.interface.slim import slim

TIMED = {
    "simple_spread parallel_env": ("mpe2.simple_spread_v3:parallel_env", {}, 1.6),
    "tictactoe env": ("pettingzoo.classic.tictactoe_v3:env", {}, 3.5),
    "pistonball parallel_env": (
        "pettingzoo.butterfly.pistonball_v6:parallel_env",
        {"max_cycles": 20},
        1.8,
    ),
    "connect_four env": ("pettingzoo.classic.connect_four_v3:env", {}, None),
    "simple_spread env": ("mpe2.simple_spread_v3:env", {}, None),
    "rps parallel_env": ("pettingzoo.classic.rps_v2:parallel_env", {}, None),
}
COMPARED = {
    "simple_spread parallel_env": 1000,
    "tictactoe env": 1000,
    "connect_four env": 1000,
    "pistonball parallel_env": 10,
    "rps parallel_env": 100,
}
LEGAL = 0.97  # of the actions in compared episodes; the others may be masked out, which ends a game
Plan = list[list[Any]]  # by episode, the actions of its turns or ticks


def made(name: str) -> Any:
    """A new environment, as shipped."""
    path, kwargs, _ = TIMED[name]
    module, _, maker = path.partition(":")
    return getattr(importlib.import_module(module), maker)(**kwargs)


def drawn(space: Any, seen: Any, rng: np.random.Generator, legal: float) -> Any:
    """A random action in its space, mostly a legal one."""
    if not isinstance(space, Discrete):
        return rng.uniform(space.low, space.high).astype(space.dtype)
    mask = seen.get("action_mask") if isinstance(seen, dict) else None
    if mask is not None and rng.random() < legal:
        return int(rng.choice(np.flatnonzero(mask)))
    return int(rng.integers(space.n))


def planned(env: Any, episodes: int, *, legal: float = 1.0) -> Plan:
    """The actions of some episodes, drawn as they are played."""
    rng, plan = np.random.default_rng(0), []
    for seed in range(episodes):
        plan.append([])
        if isinstance(env, ParallelEnv):
            seen, _ = env.reset(seed=seed)
            while env.agents:
                spaces = {agent: env.action_space(agent) for agent in env.agents}
                plan[-1].append({a: drawn(spaces[a], seen[a], rng, legal) for a in spaces})
                seen = env.step(plan[-1][-1])[0]
            continue
        env.reset(seed=seed)
        for agent in env.agent_iter():
            shown, _, terminated, truncated, _ = env.last()
            space = env.action_space(agent)
            ended = terminated or truncated
            plan[-1].append(None if ended else drawn(space, shown, rng, legal))
            env.step(plan[-1][-1])
    return plan


def play(env: Any, plan: Plan) -> float:
    """Plays the plan and says how long an agent-step took, in microseconds."""
    steps, is_parallel = 0, isinstance(env, ParallelEnv)
    start = process_time()
    for seed, actions in enumerate(plan):
        env.reset(seed=seed)
        if is_parallel:
            for each in actions:
                steps += len(each)
                env.step(each)
        else:
            steps += len(actions)
            for _, action in zip(env.agent_iter(), actions, strict=False):
                env.last()
                env.step(action)
    return (process_time() - start) / steps * 1e6


def exact(value: Any) -> Any:
    """A value whose equality is that of every bit and type."""
    if isinstance(value, dict):
        return {key: exact(part) for key, part in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.dtype.str, value.shape, value.tobytes()
    return (type(value), value.hex()) if isinstance(value, float) else value


def rows(env: Any, seed: int, actions: list[Any]) -> Iterator[Any]:
    """All that an episode of the plan shows."""
    if isinstance(env, ParallelEnv):
        yield exact(dict(enumerate(env.reset(seed=seed))))
        for each in actions:
            yield [exact(dict(part)) for part in env.step(each)], list(env.agents)
        return
    env.reset(seed=seed)
    names = ("rewards", "_cumulative_rewards", "terminations", "truncations", "infos")
    for agent, action in zip(env.agent_iter(), actions, strict=True):
        books = [exact(dict(getattr(env, name))) for name in names]
        yield agent, exact(dict(enumerate(env.last()))), books, list(env.agents)
        env.step(action)


def timed(rounds: int) -> None:
    """Prints costs and ratios, the segments of both taking turns."""
    for name, (path, _, bar) in TIMED.items():
        envs: dict[str, Any] = {"shipped": made(name), "slim": slim(made(name))}
        plan = planned(envs["shipped"], 1 if "pistonball" in name else 12)
        seen: dict[str, list[float]] = {key: [] for key in envs}
        for _ in range(rounds):
            for key, env in envs.items():
                seen[key].append(play(env, plan))
        costs = {key: median(each) for key, each in seen.items()}
        line = {
            "figure": name,
            "environment": path,
            "unit": "us",
            **{key: round(cost, 2) for key, cost in costs.items()},
            "ratio": round(median(map(truediv, seen["shipped"], seen["slim"])), 2),
            "bar": bar,
        }
        print(json.dumps(line))


def compared(share: float) -> None:
    """Prints how many episodes gave the same rows."""
    for name, count in COMPARED.items():
        shipped, ours = made(name), slim(made(name))
        episodes, equal, turns = max(1, int(count * share)), 0, 0
        with quiet():
            plan = planned(made(name), episodes, legal=LEGAL)
            for seed, actions in enumerate(plan):
                pairs = zip(rows(shipped, seed, actions), rows(ours, seed, actions), strict=True)
                equal += all(theirs == mine for theirs, mine in pairs)
                turns += len(actions)
        line = {"figure": f"{name}, equal rows", "episodes": episodes, "equal": equal}
        print(json.dumps({**line, "turns": turns}))


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keeps the environments' own warnings of illegal moves off the figures."""
    with contextlib.redirect_stdout(io.StringIO()):
        yield
    EnvLogger.flush()


def main() -> None:
    """Measures everything in one run and prints it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a few rounds: seconds, and rough")
    is_quick = parser.parse_args().quick
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    warnings.simplefilter("ignore", DeprecationWarning)
    timed(5 if is_quick else 25)
    compared(0.03 if is_quick else 1.0)


if __name__ == "__main__":
    main()
