"""What evaluation costs over plain playing, and what a second worker brings.

Prints a JSON line for each measure:

- `cost`: processor time an agent-step, in microseconds: a plain loop over PettingZoo's own calls
  with random actions drawn from the action spaces, `gk.rollout` without recording to disk, and
  evaluation (random play, tallied, rows written, merged) in this process, rounds interleaved, the
  least told. `ratio`: evaluation over the plain loop.
- `judged`: processor seconds that results, comparisons and cross-play take once all is played.
- `workers`: wall seconds of the same evaluation by one worker and by two; `speedup`. `ceiling`: of
  plain loops in one process and in two that know nothing of each other, in the same rounds.
- `same`: fingerprints of the raw episodes here and by 1, 2 and 4 workers, and the documents.

    python benchmarks/evaluation.py [--env mpe2.simple_spread_v3:parallel_env] [--episodes 200]
        [--rounds 3] [--only cost]
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from hashlib import blake2b
from pathlib import Path
from typing import Any

import gamekeeper as gk
from gamekeeper.evaluation import evaluator as front
from gamekeeper.interface.opening import open_env


def main() -> None:
    """Measures what the options ask for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--env", default="mpe2.simple_spread_v3:parallel_env")
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--only", default="cost,judged,workers,same")
    told = parser.parse_args()
    measures: dict[str, Callable[..., dict[str, Any]]] = {
        "cost": cost,
        "judged": judged,
        "workers": workers,
        "same": same,
    }
    for name in told.only.split(","):
        found = measures[name](told.env, told.episodes, told.rounds)
        print(json.dumps({"measure": name, "env": told.env, "episodes": told.episodes, **found}))
        sys.stdout.flush()


def cost(env: str, episodes: int, rounds: int) -> dict[str, Any]:
    """Microseconds of processor time an agent-step."""
    ways = {"plain": plain, "rollout": rolled_out, "evaluate": evaluated}
    seen: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(rounds):
        for name, way in ways.items():
            begun_s = time.process_time()
            steps = way(env, episodes)
            seen[name].append(1e6 * (time.process_time() - begun_s) / steps)
    least = {name: min(values) for name, values in seen.items()}
    return {
        **{k: round(v, 2) for k, v in least.items()},
        "ratio": round(least["evaluate"] / least["plain"], 3),
    }


def plain(env: str, episodes: int) -> int:
    """Plays at random, as PettingZoo's documentation does; says how many actions were taken."""
    live: Any = open_env(env, api="parallel").env
    spaces = {agent: live.action_space(agent) for agent in live.possible_agents}
    steps = 0
    for episode in range(episodes):
        live.reset(seed=episode)
        while live.agents:
            actions = {agent: spaces[agent].sample() for agent in live.agents}
            steps += len(actions)
            live.step(actions)
    live.close()
    return steps


def rolled_out(env: str, episodes: int) -> int:
    """The same, recorded in memory."""
    return int(gk.rollout(env, policies="random", episodes=episodes).summary.agent_steps)


def evaluated(env: str, episodes: int) -> int:
    """The same, evaluated; nothing is compared, so that it is the playing that is measured."""
    with tempfile.TemporaryDirectory() as folder:
        gk.evaluate(env, policies={"random": "random"}, episodes=episodes, out=folder)
        receipts = [json.loads(path.read_text()) for path in Path(folder).glob("parts/*.json")]
        return sum(int(receipt["agent_steps"]) for receipt in receipts)


def judged(env: str, episodes: int, rounds: int) -> dict[str, Any]:
    """Processor seconds after everything has been played."""
    policies = {"random": "random", "first": "first-legal", "zero": "random "}
    with tempfile.TemporaryDirectory() as folder:
        told = {"policies": policies, "episodes": episodes, "out": folder, "crossplay": True}
        front.evaluate(env, **told)
        begun_s = time.process_time()
        found = front.evaluate(env, **told)
        seconds = time.process_time() - begun_s
    return {
        "seconds": round(seconds, 2),
        "results": len(found.results),
        "comparisons": len(found.comparisons),
    }


def workers(env: str, episodes: int, rounds: int) -> dict[str, Any]:
    """Wall seconds of playing by one and by two, rounds interleaved, the least told."""
    seen: dict[int, list[float]] = {1: [], 2: []}
    loops: dict[int, list[float]] = {1: [], 2: []}
    for _ in range(rounds):
        for count in seen:
            begun_s = time.monotonic()
            gk.evaluate(env, policies={"random": "random"}, episodes=episodes, workers=count)
            seen[count].append(time.monotonic() - begun_s)
            begun_s = time.monotonic()
            looped(env, episodes, count)
            loops[count].append(time.monotonic() - begun_s)
    one, two = min(seen[1]), min(seen[2])
    return {
        "one_s": round(one, 2),
        "two_s": round(two, 2),
        "speedup": round(one / two, 2),
        "ceiling": round(min(loops[1]) / min(loops[2]), 2),
    }


def looped(env: str, episodes: int, count: int) -> None:
    """Plain loops over as many episodes, by processes that know nothing of each other."""
    code = "import sys, evaluation; evaluation.plain(sys.argv[1], int(sys.argv[2]))"
    command = [sys.executable, "-c", code, env, str(episodes // count)]
    here = Path(__file__).parent
    loops = [subprocess.Popen(command, cwd=here) for _ in range(count)]
    codes = [loop.wait() for loop in loops]
    assert codes == [0] * count, codes


def same(env: str, episodes: int, rounds: int) -> dict[str, Any]:
    """Fingerprints and digests of the documents, by number of workers."""
    found = {}
    for count in (0, 1, 2, 4):
        with tempfile.TemporaryDirectory() as folder:
            each = gk.evaluate(
                env,
                policies={"random": "random", "first": "first-legal"},
                episodes=min(episodes, 60),
                workers=count,
                out=folder,
                crossplay=True,
            )
            digest = blake2b(digest_size=8)
            for name in ("evaluation.json", "episodes.parquet"):
                digest.update((Path(folder) / name).read_bytes())
            found[count] = (each.fingerprint, digest.hexdigest())
    return {"equal": len(set(found.values())) == 1, "by_workers": found}


if __name__ == "__main__":
    main()
