"""What workers cost and bring: tasks a second, memory of the driver, recording by one and by two.

Prints a JSON line for each measure:

- `tasks`: null tasks through `LocalExecutor`; tasks a second, the driver's resident memory after
  1 %, half and all of them: it doesn't grow with their number.
- `record`: `mpe2.simple_spread_v3`, the same episodes by one process without parts, by one worker
  and by two (rounds interleaved, the median told): wall seconds, those of playing and of merging,
  processor seconds of all processes. `speedup`: one worker's wall time over two workers'.
- `two_loops`: half of the episodes each by two processes that know nothing of each other, against
  all of them by one, in the same rounds: what this machine's two cores can give at best.
- `same`: fingerprints by 0 (no parts), 1, 2 and 4 workers, and by 2 of which one was killed by
  SIGKILL in mid-run.

    python benchmarks/executors.py [--tasks 10000] [--episodes 2000] [--rounds 3] [--seed 0]
"""

import argparse
import json
import os
import resource
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, Final

SPREAD: Final = "mpe2.simple_spread_v3:parallel_env"
WORKERS: Final = 2
LOOP: Final = f"""
import sys
import gamekeeper as gk
gk.rollout({SPREAD!r}, episodes=int(sys.argv[2]), out=sys.argv[1])
"""


def null(report: Any, **arguments: Any) -> None:
    """A task that does nothing."""


def main() -> None:
    """Measures what the options ask for."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--tasks", type=int, default=10_000)
    parser.add_argument("--episodes", type=int, default=2_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    if options.tasks:
        tell(tasks(options.tasks))
    if options.episodes:
        with tempfile.TemporaryDirectory() as folder:
            tell(record(Path(folder), options.episodes, options.rounds, options.seed))
            tell(two_loops(Path(folder), options.episodes, options.rounds))
            tell(same(Path(folder), options.episodes // 8 or 1, options.seed))


def tell(measured: dict[str, Any]) -> None:
    """One JSON line."""
    print(json.dumps(measured), flush=True)


def tasks(count: int) -> dict[str, Any]:
    """Tasks a second, and the driver's memory on the way."""
    from gamekeeper.rollouts.executors.local import LocalExecutor
    from gamekeeper.rollouts.executors.task import WorkTask

    call = f"{Path(__file__).stem}:null"
    marks = {max(count // 100, 1): 0.0, max(count // 2, 1): 0.0, count: 0.0}
    before_s, began_s = cpu_s(), time.perf_counter()
    drawn = (WorkTask(f"null-{number}", call, {"number": number}) for number in range(count))
    for done, end in enumerate(LocalExecutor(WORKERS).map(drawn), start=1):
        assert end.outcome.status == "done", end
        if done in marks:
            marks[done] = rss_mb()
    wall_s = time.perf_counter() - began_s
    return {
        "measure": "tasks",
        "tasks": count,
        "workers": WORKERS,
        "wall_s": round(wall_s, 2),
        "tasks_per_s": round(count / wall_s),
        "cpu_s": round(cpu_s() - before_s, 2),
        "driver_rss_mb": {str(done): rss for done, rss in marks.items()},
    }


def record(folder: Path, episodes: int, rounds: int, seed: int) -> dict[str, Any]:
    """Wall and processor seconds of the same recording by no, one and two workers."""
    measured: dict[int, list[dict[str, float]]] = {0: [], 1: [], WORKERS: []}
    for number in range(rounds):
        for workers, found in measured.items():
            _, times = recorded(folder / f"{number}-{workers}", episodes, seed, workers)
            found.append(times)
    medians = {
        workers: {
            name: round(statistics.median(each[name] for each in found), 2) for name in found[0]
        }
        for workers, found in measured.items()
    }
    return {
        "measure": "record",
        "environment": SPREAD,
        "episodes": episodes,
        "rounds": rounds,
        "load": round(os.getloadavg()[0], 1),
        "by_workers": {str(workers): times for workers, times in medians.items()},
        "speedup": round(medians[1]["wall_s"] / medians[WORKERS]["wall_s"], 2),
        "speedup_playing": round(medians[1]["playing_s"] / medians[WORKERS]["playing_s"], 2),
    }


def two_loops(folder: Path, episodes: int, rounds: int) -> dict[str, Any]:
    """Wall seconds of recordings without parts: one process, and two with half of it each."""
    seen: dict[int, list[float]] = {1: [], WORKERS: []}
    for number in range(rounds):
        for count, found in seen.items():
            outs = [folder / f"loops-{number}-{count}-{place}" for place in range(count)]
            began_s = time.perf_counter()
            loops = [
                subprocess.Popen([sys.executable, "-c", LOOP, str(out), str(episodes // count)])
                for out in outs
            ]
            codes = [loop.wait() for loop in loops]
            found.append(time.perf_counter() - began_s)
            assert codes == [0] * count, codes
    medians = {count: round(statistics.median(found), 2) for count, found in seen.items()}
    return {
        "measure": "two_loops",
        "environment": SPREAD,
        "episodes": episodes,
        "rounds": rounds,
        "by_processes": {str(count): wall_s for count, wall_s in medians.items()},
        "ceiling": round(medians[1] / medians[WORKERS], 2),
    }


def same(folder: Path, episodes: int, seed: int) -> dict[str, Any]:
    """Whether all ways of playing a run record the same."""
    prints = {
        str(workers): recorded(folder / f"same-{workers}", episodes, seed, workers)[0]
        for workers in (0, 1, 2, 4)
    }
    killer = threading.Thread(target=kill_one, args=(folder / "same-killed-parts" / "parts",))
    killer.start()
    prints["2, one killed"], told = recorded(folder / "same-killed", episodes, seed, 2)
    killer.join()
    return {
        "measure": "same",
        "episodes": episodes,
        "fingerprints": sorted(set(prints.values())),
        "is_same": len(set(prints.values())) == 1,
        "ways": list(prints),
        "deaths": told["deaths"],
    }


def recorded(out: Path, episodes: int, seed: int, workers: int) -> tuple[str, dict[str, float]]:
    """The fingerprint of a recording, and what it took."""
    import gamekeeper as gk
    from gamekeeper.rollouts.executors.local import LocalExecutor
    from gamekeeper.rollouts.executors.storage import Storage
    from gamekeeper.rollouts.rollout_plan import RolloutPlan
    from gamekeeper.runs.parts.fan_out import record_apart
    from gamekeeper.runs.parts.part_plan import parts_folder

    last_s = [0.0]

    def take(fields: dict[str, Any]) -> None:
        if "episode" in fields:
            last_s[0] = time.perf_counter()

    before_s, began_s, deaths = cpu_s(), time.perf_counter(), 0
    if workers:
        plan = RolloutPlan(spec=SPREAD, episodes=episodes, seed=seed)
        with LocalExecutor(workers) as executor:
            done = record_apart(
                plan, out, executor=executor, on_message=take, storage=Storage.at(parts_folder(out))
            )
        deaths = done.deaths
    else:
        gk.rollout(
            SPREAD,
            episodes=episodes,
            seed=seed,
            out=out,
            after_episode=lambda done: take({"episode": done}),
        )
    ended_s = time.perf_counter()
    return gk.load(out).fingerprint, {
        "wall_s": ended_s - began_s,
        "playing_s": last_s[0] - began_s,
        "merging_s": ended_s - last_s[0],
        "cpu_s": cpu_s() - before_s,
        "deaths": float(deaths),
    }


def kill_one(parts: Path) -> None:
    """Kills a worker of this process once parts begin to come."""
    deadline_s = time.monotonic() + 120
    while not any(parts.glob("*.json")) and time.monotonic() < deadline_s:
        time.sleep(0.02)
    children = [
        int(pid)
        for file in Path("/proc/self/task").glob("*/children")
        for pid in file.read_text().split()
    ]
    for pid in children[:1]:
        os.kill(pid, signal.SIGKILL)


def cpu_s() -> float:
    """Processor seconds of this process and of its children that have ended."""
    return sum(
        usage.ru_utime + usage.ru_stime
        for usage in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    )


def rss_mb() -> float:
    """Resident memory of this process, in megabytes."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return round(pages * os.sysconf("SC_PAGE_SIZE") / 1e6, 1)


if __name__ == "__main__":
    sys.exit(main())
