"""Which foreign environments replay bit for bit: each row of the table in docs/shapes.md.

Prints a JSON line for each row: package and version, environment, API, and `verified` or the cause.
A row whose package isn't installed says so. Packages that can't live together have lists of
their own in requirements/zoo/, one virtual environment each. Recording and replay are processes of
their own, under different hash seeds, as they would be on two days.

    python benchmarks/replay_foreign.py [--only WORD ...]
"""

import argparse
import importlib.util
import json
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, packages_distributions, version
from pathlib import Path
from typing import Any, Final

from gamekeeper.rollouts.rollout_plan import RolloutPlan
from gamekeeper.rollouts.workers import run_task
from gamekeeper.runs.comparison import replay
from gamekeeper.runs.load_run import load

EPISODES: Final = 2
MOST_TURNS: Final = 60
HASH_SEED: Final = 1  # of the recording; the replay has a random one, as any process
SILENCE_S: Final = 300.0  # XLA compiles for a minute on a busy processor
DRAMATIS: Final = str(Path(__file__).parent / "zoo" / "factories.py")


@dataclass(frozen=True, slots=True)
class Row:
    """One environment of the zoo."""

    packages: str
    """The list in requirements/zoo/ that installs it."""
    module: str
    """What has to be importable."""
    spec: str
    kwargs: Mapping[str, Any] = field(default_factory=dict)
    tolerance: float | None = None
    contract: str | None = None
    """Beside this file: which infos are volatile."""


ROWS: Final = (
    Row("rware", "rware", "rware:rware-tiny-2ag-v2"),
    Row("lbforaging", "lbforaging", "lbforaging:Foraging-8x8-2p-1f-v3"),
    Row("openspiel", "pyspiel", "openspiel:tic_tac_toe"),
    Row("openspiel", "pyspiel", "openspiel:leduc_poker"),
    Row("openspiel", "pyspiel", "openspiel:goofspiel"),
    Row("openspiel", "pyspiel", "openspiel:hanabi", {"players": 3}),
    Row(
        "magent2",
        "magent2",
        "magent2.environments.battle_v4:parallel_env",
        {"map_size": 16, "max_cycles": 60},
    ),
    Row("momaland", "momaland", "momaland:mobeach_v0", {"num_agents": 10, "num_timesteps": 5}),
    Row("momaland", "momaland", "momaland:moconnect4_v0"),
    Row(
        "pogema", "pogema", "pogema:pogema_v0", {"size": 8, "num_agents": 4, "on_target": "finish"}
    ),
    Row("jaxmarl", "jaxmarl", "jaxmarl:MPE_simple_spread_v3", tolerance=1e-6),
    Row("jaxmarl", "jaxmarl", "jaxmarl:overcooked", tolerance=1e-6),
    Row("jumanji", "jumanji", "jumanji:RobotWarehouse-v0", tolerance=1e-6),
    Row("jumanji", "jumanji", "jumanji:LevelBasedForaging-v0", tolerance=1e-6),
    Row("jumanji", "jumanji", "jumanji:Connector-v3", tolerance=1e-6),
    Row("dm_control", "dm_control", "dm_control:cartpole/swingup"),
    Row("dm_control", "dm_control", "dm_control:soccer"),
    Row("overcooked", "overcooked", "overcooked:cramped_room"),
    Row("lle", "lle", f"marlenv:{DRAMATIS}:laser_learning"),
    Row("ma_gym", "ma_gym", "gym:ma_gym:Switch2-v0"),
    Row("highway", "highway_env", f"gymnasium:{DRAMATIS}:highway", contract="zoo/highway.toml"),
    Row("dsse", "DSSE", "DSSE:DroneSwarmSearch"),
    Row("cogrid", "cogrid", f"{DRAMATIS}:cogrid_overcooked"),
    Row("generals", "generals", f"{DRAMATIS}:generals"),
    Row("fanorona", "env", "env.fanorona_env:raw_env"),
    Row("frondori", "frondori_football", f"{DRAMATIS}:football"),
)


def main() -> int:
    """Runs what is installed; 1 if a row neither verified nor got its cause named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", default=[], help="words, one of which a row must hold")
    only = parser.parse_args().only
    failed = False
    for row in ROWS:
        if only and not any(word in f"{row.packages} {row.spec}" for word in only):
            continue
        line = played(row)
        failed = failed or not (line["verified"] or line["cause"])
        print(json.dumps(line), flush=True)
    return int(failed)


def played(row: Row) -> dict[str, Any]:
    """One row, recorded and replayed where its package is there."""
    shown = row.spec.replace(DRAMATIS, "benchmarks/zoo/factories.py")
    line: dict[str, Any] = {"packages": row.packages, "env": shown, "kwargs": dict(row.kwargs)}
    if importlib.util.find_spec(row.module) is None:
        cause = f"{row.module} isn't installed: requirements/zoo/{row.packages}.in"
        return {**line, "verified": None, "cause": cause}
    line["package"] = _package(row.module)
    start = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="zoo-") as folder:
        run = Path(folder, "run")
        problem = _record(row, run)
        if problem is not None:
            line |= {"verified": False, "cause": f"can't be recorded: {problem}"}
        else:
            line |= _replayed(run, row.tolerance)
    return {**line, "seconds": round(time.monotonic() - start, 1)}


def _replayed(run: Path, tolerance: float | None) -> dict[str, Any]:
    evidence = load(run)
    result = replay(run, allow_import=True, tolerance=tolerance, timeout_s=SILENCE_S)
    ends = evidence.episode_table["end"].to_pylist()
    nonconforming = evidence.agent_steps["nonconforming"]
    line: dict[str, Any] = {
        "api": evidence.manifest["environment"]["api"],
        "agents": len(evidence.manifest["spaces"]),
        "turns": sum(evidence.episode_table["turns"].to_pylist()),
        "ends": ends,
        "nonconforming": len(nonconforming) - nonconforming.null_count,
        "verified": result.verified,
        "within_tolerance": result.within_tolerance,
        "cause": result.cause or result.reason,
    }
    if result.divergence is not None:
        where = result.divergence
        line["divergence"] = f"episode {where.episode}, turn {where.turn}, {where.field}"
    return line


def _record(row: Row, run: Path) -> str | None:
    """Records in a process of its own; what went wrong, or None."""
    plan = RolloutPlan(
        spec=row.spec,
        env_kwargs=dict(row.kwargs),
        episodes=EPISODES,
        most_turns=MOST_TURNS,
        contract=row.contract and str(Path(__file__).parent / row.contract),
    )
    task = "gamekeeper.runs.worker_tasks:record_task"
    outcome = run_task(
        task, {"plan": plan.to_json(), "out": str(run)}, silence_s=SILENCE_S, hash_seed=HASH_SEED
    )
    if not isinstance(outcome.value, dict):
        return f"{outcome.status}: {outcome.error}"
    error = outcome.value["error"]
    return None if error is None else str(error["what"])


def _package(module: str) -> str:
    for name in packages_distributions().get(module, [module]):
        try:
            return f"{name} {version(name)}"
        except PackageNotFoundError:
            continue
    return module


if __name__ == "__main__":
    sys.exit(main())
