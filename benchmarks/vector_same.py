"""Serial, process (1 to 4 workers) and kernel engines: the same fingerprints, episode by episode.

Copies of each of our tasks are recorded at level `digest` under random legal actions. An action
hangs on its episode, turn and agent alone, so that engines and workers have no say in it; what is
compared is the fingerprint of every episode, with its infos.

One JSON line a task: {"figure", "task", "episodes", "copies", "seconds", "same", "fingerprint"}.
Exits 1 where any differs.

    python benchmarks/vector_same.py [--tasks two_robot_line handover ...] [--episodes 10000] \
        [--engines serial kernel]
"""

import argparse
import hashlib
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow.parquet as pq

import gamekeeper as gk

FIGURE: Final = "vector_same"
TASKS: Final = ("two_robot_line", "handover", "warehouse_turns", "warehouse")
ENGINES: Final = ("serial", *(f"process {workers}" for workers in (1, 2, 3, 4)), "kernel")
TAG: Final = np.uint64(0x9E3779B97F4A7C15)  # the golden ratio's, as splitmix64 has it
SEED: Final = 0


def mixed(words: Any) -> Any:
    """Words of 64 bits that tell nothing of those they came from.

    Source: Steele, Lea and Flood 2014, splitmix64.
    """
    words = (words ^ (words >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    words = (words ^ (words >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return words ^ (words >> np.uint64(31))


def legal(mask: Any, group: Any, shape: Any, episode: Any, turn: Any) -> Any:
    """One legal action of each agent (or of the agent in turn), of Discrete spaces.

    Args:
        mask: [env, agent, n] or [env, n]; None: all is legal.
        group: the agents' spaces and columns.
        shape: [env, agent] or [env].
        episode: [env] int64.
        turn: [env] int64, from 0.
    """
    word = mixed(episode.astype(np.uint64) * TAG + turn.astype(np.uint64))
    agents = np.arange(1 if len(shape) == 1 else shape[1], dtype=np.uint64)
    words = mixed(word[:, None] + (agents[None, :] + np.uint64(group.first + 1)) * TAG)
    words = words.reshape(shape)
    if mask is None:
        return (words % np.uint64(group.action_space.n)).astype(np.int64)
    flags = mask > 0
    counts = np.maximum(flags.sum(-1), 1).astype(np.uint64)
    place = (words % counts).astype(np.int64)
    chosen = (np.cumsum(flags, -1) > place[..., None]).argmax(-1)
    return np.where(flags.any(-1), chosen, 0)


def actions_of(venv: Any, infos: Any, turn: Any) -> Any:
    """Legal actions for every copy, by role where there are several."""
    masks, spaces, episode = infos.get("action_mask"), venv.action_space, infos["episode"]
    if not isinstance(venv.agents, dict):
        return legal(masks, venv.groups[0], spaces.shape, episode, turn)
    return {
        group.name: legal(
            (masks or {}).get(group.name), group, spaces[group.name].shape, episode, turn
        )
        for group in venv.groups
    }


def prints(task: str, engine: str, episodes: int, copies: int) -> list[tuple[str, str]]:
    """Fingerprint and info fingerprint of each of the first episodes."""
    name, _, workers = engine.partition(" ")
    options: dict[str, Any] = {"workers": int(workers)} if workers else {}
    with tempfile.TemporaryDirectory(prefix="same-") as folder:
        out = Path(folder, "run")
        venv = gk.record(gk.vector.make(task, copies, engine=name, **options), out, level="digest")
        _, infos = venv.reset(seed=SEED)
        turn = np.zeros(copies, np.int64)
        while infos["episode"].min() < episodes:
            before = infos["episode"]
            infos = venv.step(actions_of(venv, infos, turn))[-1]
            turn = np.where(infos["episode"] == before, turn + 1, 0)
        venv.close()
        columns = ["episode", "end", "fingerprint", "info_fingerprint"]
        rows = pq.read_table(out / "episodes.parquet", columns=columns).to_pylist()[:episodes]
    assert [row["episode"] for row in rows] == list(range(episodes))
    assert all(row["end"] == "ended" for row in rows)
    return [(row["fingerprint"], row["info_fingerprint"]) for row in rows]


def main() -> int:
    """Compares all engines on each task; 1 if any episode differs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tasks", nargs="+", default=list(TASKS))
    parser.add_argument("--episodes", type=int, default=10_000)
    parser.add_argument("--copies", type=int, default=64)
    parser.add_argument("--engines", nargs="+", default=list(ENGINES), help="serial among them")
    given = parser.parse_args()
    is_same = True
    for task in given.tasks:
        begun_s = time.perf_counter()
        found = {e: prints(task, e, given.episodes, given.copies) for e in given.engines}
        same = {engine: found[engine] == found["serial"] for engine in given.engines}
        is_same = is_same and all(same.values())
        print(
            json.dumps(
                {
                    "figure": FIGURE,
                    "task": task,
                    "episodes": given.episodes,
                    "copies": given.copies,
                    "seconds": round(time.perf_counter() - begun_s, 1),
                    "same": same,
                    "fingerprint": hashlib.sha256(repr(found["serial"]).encode()).hexdigest()[:32],
                }
            ),
            flush=True,
        )
    return 0 if is_same else 1


if __name__ == "__main__":
    sys.exit(main())
