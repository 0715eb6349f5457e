"""Runs EPyMARL's own training loop on an environment of ours, and judges what its buffer holds.

Needs a checkout of EPyMARL, torch and PyYAML (in Tianshou's environment, say):

    git clone https://github.com/uoe-agents/epymarl && git -C epymarl checkout COMMIT
    python benchmarks/epymarl_inside.py epymarl/src [--algorithms iql qmix vdn]

`run.run_sequential` of EPyMARL makes the environment by its registry, plays, stores, learns and
saves, with the settings of its algorithms' files but for length and size; what is left out is
Sacred around it. The environment is the ledger of the tests: every observation tells seed, agent,
time and last action, so each number of an episode is worked out from its rules and from the actions
that EPyMARL chose: observations, available actions, rewards, ends, filled steps. One JSON line for
each algorithm and environment; 1 if any differs.
"""

import argparse
import json
import logging
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).parent.parent))

import numpy as np
from gymnasium.spaces import flatten

from gamekeeper.adapters.epymarl import gymma
from gamekeeper.randomness.seeds import episode_seed
from tests.adapters import ledger

COMMIT: Final = "cbc38c09588064eab978501d0f12c2cf58fa7fc2"
"""The version of EPyMARL that this was last run with."""
SEED: Final = 3
LIMIT: Final = 20  # steps of an episode, in both interfaces
STEPS: Final = 100  # of a run
BATCH: Final = 8  # episodes of an update
FORMS: Final = ("Box", "nested Dict")


def loop(source: Path) -> Any:
    """EPyMARL's module `run`, which registers environments as it is imported."""
    sys.path.insert(0, str(source))
    try:
        import smaclite  # noqa: F401  # its environments of StarCraft
    except ImportError:
        sys.modules["smaclite"] = ModuleType("smaclite")  # which it imports for its name alone
    import envs
    import run

    envs.REGISTRY["gamekeeper"] = gymma
    return run


def settings(source: Path, algorithm: str, cell: ledger.Cell, folder: str) -> SimpleNamespace:
    """EPyMARL's own settings of an algorithm, for a short run of a small environment."""
    import yaml

    found: dict[str, Any] = {}
    for name in ("default", "envs/gymma", f"algs/{algorithm}"):
        found |= yaml.safe_load((source / "config" / f"{name}.yaml").read_text(encoding="utf-8"))
    found |= {
        "env": "gamekeeper",
        "env_args": {
            "key": cell.spec,
            "time_limit": LIMIT,
            "seed": SEED,
            "check": None,
            **cell.kwargs,
        },
        "common_reward": algorithm != "iql",
        "use_cuda": False,
        "device": "cpu",
        "t_max": STEPS,
        "batch_size": BATCH,
        "buffer_size": STEPS,
        "test_interval": 10 * STEPS,
        "test_nepisode": 1,
        "save_model": True,
        "local_results_path": folder,
        "unique_token": algorithm,
    }
    return SimpleNamespace(**found)


def buffer_of(run: Any, args: SimpleNamespace) -> Any:
    """The replay buffer after EPyMARL's loop, and how often its learner was trained."""
    from utils.logging import Logger

    made: list[Any] = []
    own = run.ReplayBuffer

    class Kept(own):  # type: ignore[misc]
        """EPyMARL's buffer, which is looked at afterwards."""

        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            self.sampled = 0
            made.append(self)

        def sample(self, batch_size: int) -> Any:
            """Counts updates."""
            self.sampled += 1
            return super().sample(batch_size)

    run.ReplayBuffer = Kept
    try:
        run.run_sequential(args, Logger(logging.getLogger("epymarl")))
    finally:
        run.ReplayBuffer = own
    return made[0]


class Rules:
    """The ledger's rules for one episode, worked out once more."""

    def __init__(self, cell: ledger.Cell, seed: int) -> None:
        self.cell, self.first, self.time, self.last = cell, seed % ledger.SIZES[0], 0, [0, 0, 0]
        self.roster = [i for i in range(3) if not (cell.ends == "late" and i in ledger.JOINS)]
        self.due = 0

    @property
    def acting(self) -> list[int]:
        """Agents that act in this step."""
        return [self.roster[self.due]] if self.cell.api == "aec" else list(self.roster)

    def seen(self, agent: int) -> Any:
        """The vector that a live agent is shown."""
        code = self.first, agent, self.time, self.last[agent]
        form = self.cell.seen
        return np.asarray(flatten(ledger.SEEN[form], ledger.encode(form, code)), np.float32)

    def available(self, agent: int) -> Any:
        """Available actions; of an agent that doesn't act, the first."""
        if agent not in self.acting:
            return np.array([1, 0, 0])
        code = self.first, agent, self.time, self.last[agent]
        return ledger.flags_of("Discrete", code) if self.cell.mask else np.ones(3, int)

    def step(self, actions: Any) -> tuple[Any, bool | None]:
        """Rewards [agent], and whether the last ones that ended were terminated; None: go on."""
        acting, cell = self.acting, self.cell
        self.time += 1
        for agent in acting:
            self.last[agent] = ledger.last_of("Discrete", actions[agent])
        paid = np.zeros(3)
        for agent in self.roster:
            is_actor = agent in acting
            amount = ledger.payment(self.time, agent, self.last[agent])
            paid[agent] = amount if is_actor else self.time / 16
        ticks = self.time / ledger.TURNS_A_TICK if cell.api == "aec" else self.time
        ended = [i for i in self.roster if ticks >= ledger.ENDS[cell.ends][i]]
        comes = [i for i, tick in ledger.JOINS.items() if cell.ends == "late" and ticks == tick]
        paid[comes] = 0.5
        order = [*self.roster[self.due + 1 :], *comes, *self.roster[: self.due + 1]]
        queue = [agent for agent in order if agent not in ended]
        self.roster = [agent for agent in [*self.roster, *comes] if agent not in ended]
        if not self.roster:
            return paid, any(ledger.ending(self.first, agent)[0] for agent in ended)
        self.due = self.roster.index(queue[0]) if cell.api == "aec" else 0
        return paid, None


def differences(buffer: Any, cell: ledger.Cell, *, common: bool) -> Iterator[str]:
    """Yields the places where the buffer isn't what the rules say."""
    data = {name: part.numpy() for name, part in buffer.data.transition_data.items()}
    for place in range(buffer.episodes_in_buffer):
        number = place if place == 0 else place + 1  # one test episode follows the first
        rules, t, is_over = Rules(cell, episode_seed(SEED, number)), 0, None
        while is_over is None:
            for agent in rules.roster:
                row = data["obs"][place, t, agent]
                own = rules.seen(agent)
                if not np.array_equal(row[: len(own)], own) or row[len(own) :].any():
                    yield f"episode {number}, step {t}, agent {agent}: observation"
            for agent in range(3):
                found = data["avail_actions"][place, t, agent]
                if not np.array_equal(found, rules.available(agent)):
                    yield f"episode {number}, step {t}, agent {agent}: available actions"
            paid, is_over = rules.step(data["actions"][place, t, :, 0])
            wanted = [paid.sum()] if common else paid
            if not np.allclose(data["reward"][place, t], wanted, rtol=1e-6):
                yield f"episode {number}, step {t}: reward"
            if bool(data["terminated"][place, t, 0]) != bool(is_over):
                yield f"episode {number}, step {t}: terminated"
            t += 1
        filled = data["filled"][place, :, 0]
        if filled.sum() != t + 1 or not filled[: t + 1].all():
            yield f"episode {number}: {filled.sum()} filled steps and not {t + 1}"


def main() -> int:
    """Runs each algorithm on each environment."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("source", type=Path, help="the folder src of EPyMARL")
    parser.add_argument("--algorithms", nargs="+", default=["iql", "qmix"])
    given = parser.parse_args()
    commit = subprocess.run(
        ["git", "-C", str(given.source), "rev-parse", "HEAD"], capture_output=True, text=True
    ).stdout.strip()
    if commit != COMMIT:
        print(f"last run with {COMMIT}, this is {commit or 'no checkout'}", file=sys.stderr)
    run, differs = loop(given.source.resolve()), False
    cells = [c for c in ledger.CELLS if c.roles == 1 and c.seen in FORMS and c.form == "Discrete"]
    for algorithm in given.algorithms:
        for cell in cells:
            with tempfile.TemporaryDirectory() as folder:
                args = settings(given.source, algorithm, cell, folder)
                buffer = buffer_of(run, args)
                saved = len(list(Path(folder).rglob("*.th")))
            found = list(differences(buffer, cell, common=args.common_reward))
            differs |= bool(found)
            line = {
                "algorithm": algorithm,
                "cell": str(cell),
                "episodes": buffer.episodes_in_buffer,
                "updates": buffer.sampled,
                "saved": saved,
                "differ": len(found),
                "first": found[:1],
            }
            print(json.dumps(line), flush=True)
    return int(differs)


if __name__ == "__main__":
    sys.exit(main())
