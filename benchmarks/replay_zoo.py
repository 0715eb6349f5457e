"""Which environments replay bit for bit: each is recorded in one process and replayed in another.

Prints a JSON line for each environment and API: whether it verified and, where it didn't, what the
replay says of the cause. Recording and replay run under hash seeds of their own, as they would on
two days. The exit code is 1 if any environment neither verified nor got its cause named.

    python benchmarks/replay_zoo.py [--only WORD ...] [--extra FILE:factory ...] [--markdown]
"""

import argparse
import json
import pkgutil
import sys
import tempfile
import time
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import mpe2
import pettingzoo

from gamekeeper.episodes.encoder import LEVELS
from gamekeeper.errors import GamekeeperError
from gamekeeper.rollouts.rollout_plan import RolloutPlan
from gamekeeper.rollouts.workers import run_task
from gamekeeper.runs.comparison import replay
from gamekeeper.runs.expanding import expand
from gamekeeper.runs.load_run import load

ROOT: Final = Path(__file__).resolve().parent.parent
EXAMPLE: Final = "examples/two_robot_line.py:make"
HASH_SEED: Final = 1  # of the recording; the replay has a random one, as any process
KWARGS: Final[dict[str, dict[str, Any]]] = {
    "sisl/pursuit": {"n_pursuers": 4, "n_evaders": 6}  # 60 turns see every agent act
}


def main() -> int:
    """Records and replays what was asked for; 1 if a failure has no named cause."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", default=[], help="words, one of which an id must hold")
    parser.add_argument(
        "--extra", nargs="*", default=[], help="file.py:factory, as often as wanted"
    )
    parser.add_argument("--episodes", type=int, default=2)
    parser.add_argument("--turns", type=int, default=60, help="of an episode, at most")
    parser.add_argument(
        "--level",
        choices=LEVELS,
        default="full",
        help="actions: record at this level too, expand that, and compare the fingerprints",
    )
    parser.add_argument("--markdown", action="store_true", help="a table in place of JSON lines")
    given = parser.parse_args()
    specs = [spec for spec in zoo() if _wanted(spec, given.only)]
    specs += [f"{api}:{spec}" for spec in given.extra for api in ("parallel", "aec")]
    lines = []
    for spec in specs:
        line = played(spec, episodes=given.episodes, turns=given.turns, level=given.level)
        lines.append(line)
        if not given.markdown:
            print(json.dumps(line), flush=True)
    if given.markdown:
        print(table(lines))
    return int(any(not line["verified"] and not line["cause"] for line in lines))


def zoo() -> Iterator[str]:
    """Every environment that PettingZoo and mpe2 bring, for each API that they offer it in.

    But for Atari, whose ROMs no package may bring.
    """
    for api in ("parallel", "aec"):
        yield f"{api}:{ROOT / EXAMPLE}"
    registries = {"parallel": pettingzoo.parallel_registry, "aec": pettingzoo.aec_registry}
    ids = sorted({*registries["parallel"], *registries["aec"]})
    for env_id in ids:
        if env_id.startswith("atari/"):
            continue
        yield from (f"{api}:{env_id}" for api in registries if env_id in registries[api])
    for module in sorted(found.name for found in pkgutil.iter_modules(mpe2.__path__)):
        if module.startswith("simple") and module.rpartition("_v")[2].isdigit():
            yield f"parallel:mpe2.{module}:parallel_env"
            yield f"aec:mpe2.{module}:env"


def played(spec: str, *, episodes: int, turns: int, level: str) -> dict[str, Any]:
    """One environment, recorded and replayed."""
    start = time.monotonic()
    api, _, name = spec.partition(":")
    line: dict[str, Any] = {
        "env": name.removeprefix(f"{ROOT}/"),
        "api": api,
        "version": "",
        "turns": 0,
    }
    with tempfile.TemporaryDirectory(prefix="replay-zoo-") as folder:
        run = Path(folder, "run")
        problem = _record(spec, run, episodes=episodes, turns=turns)
        if problem is not None:
            line |= {"verified": False, "cause": f"can't be recorded: {problem}"}
        else:
            evidence = load(run)
            line["turns"] = sum(evidence.episode_table["turns"].to_pylist())
            line["version"] = _version(evidence.manifest["environment"])
            result = replay(run, allow_import=True)
            document = result.to_json()
            cause = document.get("cause") or document["reason"]
            line |= {"verified": result.verified, "cause": cause}
            if result.divergence is not None:
                where = result.divergence
                line["divergence"] = f"episode {where.episode}, turn {where.turn}, {where.field}"
            if level != "full":
                small = Path(folder, "small")
                _record(spec, small, episodes=episodes, turns=turns, level=level)
                line |= _expanded(small, Path(folder, "whole"), evidence.fingerprint)
    return {**line, "seconds": round(time.monotonic() - start, 1)}


def _expanded(small: Path, whole: Path, fingerprint: str) -> dict[str, Any]:
    """Tells whether expanding a small run gives the fingerprint of the full recording."""
    try:
        expanded = expand(small, whole, allow_import=True)
    except GamekeeperError as error:
        return {"expanded": False, "because": str(error)}
    return {"expanded": expanded.fingerprint == fingerprint}


def table(lines: list[dict[str, Any]]) -> str:
    """The lines as a Markdown table."""
    rows = [
        "| environment | API | version | turns | verified, or the cause |",
        "|---|---|---|---|---|",
    ]
    for line in lines:
        said = "verified" if line["verified"] else line["cause"] or line.get("divergence", "no")
        rows.append(
            f"| `{line['env']}` | {line['api']} | {line['version']} | {line['turns']} | {said} |"
        )
    return "\n".join(rows)


def _record(spec: str, run: Path, *, episodes: int, turns: int, level: str = "full") -> str | None:
    """Records in a process of its own; what went wrong, or None."""
    kwargs = next((given for name, given in KWARGS.items() if name in spec), {})
    plan = RolloutPlan(
        spec=spec, env_kwargs=kwargs, episodes=episodes, most_turns=turns, level=level
    )
    task = "gamekeeper.runs.worker_tasks:record_task"
    outcome = run_task(
        task, {"plan": plan.to_json(), "out": str(run)}, silence_s=120.0, hash_seed=HASH_SEED
    )
    if not isinstance(outcome.value, dict):
        return f"{outcome.status}: {outcome.error}"
    error = outcome.value["error"]
    return None if error is None else str(error["what"])


def _version(environment: dict[str, Any]) -> str:
    """The distribution that brings the environment, with its version."""
    own = environment["entry_point"].partition("/")[0].partition(".")[0]
    known = environment["versions"]
    name = own if own in known else "pettingzoo"
    if environment["kind"] == "file":
        return f"source {environment['source_digest'][:8]}"
    return f"{name} {known.get(name) or version(name)}"


def _wanted(spec: str, words: list[str]) -> bool:
    return not words or any(word in spec for word in words)


if __name__ == "__main__":
    sys.exit(main())
