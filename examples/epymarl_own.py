"""EPyMARL's QMIX learns an environment of one's own, in EPyMARL's own loop: `corridor.py`.

Needs a checkout of EPyMARL, torch and PyYAML (in Tianshou's environment, say):

    git clone https://github.com/uoe-agents/epymarl
    git -C epymarl checkout cbc38c09588064eab978501d0f12c2cf58fa7fc2
    python examples/epymarl_own.py epymarl/src --seed 0

`run.run_sequential` makes the environment by EPyMARL's registry, learns half of the steps and
saves; called again with `checkpoint_path` it goes on from there. Called with `evaluate` it plays
200 games that weren't learnt from, greedily; they are recorded, and replayed. Sacred around the
loop, which keeps settings and logs, is left out. One JSON line; exit status 1 if the wanted result
isn't reached.
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, Final

import numpy as np
from corridor import FRESH, GAMES, SPEC, TICKS, WANTED, mean_returns

import gamekeeper as gk
from gamekeeper.adapters.epymarl import gymma
from gamekeeper.statistics.one_sample import one_sample

STEPS: Final = 40_000
"""Ticks that are learnt from; half of them before everything is saved and loaded."""
QUICK: Final = 1_000
ALGORITHM: Final = "qmix"


def recorded(out: Path, *, key: str, **arguments: Any) -> Any:
    """An environment for EPyMARL whose episodes are recorded."""
    return gymma(gk.record(gk.make(key), out), check=None, **arguments)


def loop(source: Path) -> Any:
    """EPyMARL's module `run`, with environments of Gamekeeper's in its registry."""
    sys.path.insert(0, str(source))
    try:
        import smaclite  # noqa: F401  # its environments of StarCraft
    except ImportError:
        sys.modules["smaclite"] = ModuleType("smaclite")  # which it imports for its name alone
    import envs
    import run

    envs.REGISTRY["gamekeeper"] = gymma
    return run


def settings(source: Path, folder: Path, seed: int, **more: Any) -> SimpleNamespace:
    """EPyMARL's own settings of the algorithm, but for these."""
    import yaml

    found: dict[str, Any] = {}
    for name in ("default", "envs/gymma", f"algs/{ALGORITHM}"):
        found |= yaml.safe_load((source / "config" / f"{name}.yaml").read_text(encoding="utf-8"))
    env_args = {"key": SPEC, "time_limit": TICKS, "seed": seed}
    found |= {"env": "gamekeeper", "env_args": env_args, "use_cuda": False, "device": "cpu"}
    found |= {"epsilon_anneal_time": STEPS // 3, "test_interval": STEPS, "test_nepisode": 1}
    found |= {"save_model": True, "local_results_path": str(folder), "unique_token": ALGORITHM}
    return SimpleNamespace(**found | more)


def learn(run: Any, source: Path, seed: int, steps: int, folder: Path) -> Path:
    """Learns in two halves, the second from the checkpoint of the first; returns the last one."""
    checkpoints = ""
    for half in (1, 2):
        until, here = steps * half // 2, folder / f"half_{half}"
        done = 0 if half == 1 else max(map(int, (path.name for path in checkpoints.iterdir())))
        every = until - done - 2 * TICKS  # at the first episode, and near the end
        run.run_sequential(
            settings(
                source,
                here,
                seed + 1_000 * (half - 1),
                t_max=until,
                save_model_interval=every,
                checkpoint_path=str(checkpoints),
            ),
            logger(),
        )
        checkpoints = here / "models" / ALGORITHM
    return checkpoints


def judge(run: Any, source: Path, checkpoints: Path, out: Path, games: int) -> list[float]:
    """Mean return of an agent in each game that EPyMARL's own evaluation played."""
    import envs

    envs.REGISTRY["recorded"] = partial(recorded, out)
    played = {"env": "recorded", "evaluate": True, "test_nepisode": games}
    args = settings(source, out.parent, FRESH, checkpoint_path=str(checkpoints), **played)
    run.run_sequential(args, logger())
    return mean_returns(gk.load(out))


def logger() -> Any:
    """EPyMARL's logger, on stderr."""
    from utils.logging import Logger

    return Logger(logging.getLogger("epymarl"))


def main() -> int:
    """Learns with one seed and prints what came of it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("source", type=Path, help="the folder src of EPyMARL")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="a short run that shows that it runs")
    given = parser.parse_args()
    source, began_s = given.source.resolve(), time.perf_counter()
    run = loop(source)
    import torch

    torch.set_num_threads(1)
    torch.manual_seed(given.seed)
    np.random.seed(given.seed)  # EPyMARL's replay buffer draws from it
    logging.basicConfig(level=logging.INFO, stream=sys.stderr)
    steps = QUICK if given.quick else STEPS
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        checkpoints = learn(run, source, given.seed, steps, folder)
        found = judge(run, source, checkpoints, folder / "run", GAMES)
        is_replayed = gk.replay(folder / "run").verified
    result, shown = float(np.mean(found)), one_sample(found, rng=np.random.default_rng(0))
    line = {
        "example": "epymarl_own",
        "trainer": f"EPyMARL's {ALGORITHM}",
        "seed": given.seed,
        "steps": steps,
        "seconds": round(time.perf_counter() - began_s, 1),
        "measure": "mean return of an agent",
        "result": round(result, 3),
        "interval": [round(shown.low, 3), round(shown.high, 3)],
        "replayed": is_replayed,
        "wanted": WANTED,
        "reached": result >= WANTED,
    }
    print(json.dumps(line))
    return 0 if is_replayed and (given.quick or result >= WANTED) else 1


if __name__ == "__main__":
    sys.exit(main())
