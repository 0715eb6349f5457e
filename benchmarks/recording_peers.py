"""What recorders add to a step: Gymnasium's statistics, Minari, Gamekeeper; one process, one run.

The task is a robot on a line of five cells, as cheap as rules can be, so that what is measured is
the recorder. Each recorder plays the same episodes with the same actions. Recorders take turns,
each round in another order; figures are medians over the rounds, and each ratio is taken inside
its round, against the bare environment of the same API.

    python benchmarks/recording_peers.py                # what this Python has installed

With Minari, whose version stands in benchmarks/peers/minari.in:

    requirements/setup.sh make .venv-minari
    requirements/setup.sh install .venv-minari benchmarks/peers/minari.in
    .venv-minari/bin/python benchmarks/recording_peers.py

One JSON line a recorder: {"figure", "peer", "us", "ratio", ...}: `us` is wall time a step, resets
included; `cpu_us` counts all threads; `finish_us` is what it takes to put the rest on disk, spread
over the steps; `bytes` is what lies on disk, a step. A recorder that can't be measured has nulls
and the reason as `why`.
"""

import argparse
import gc
import json
import os
import statistics
import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete
from pettingzoo import ParallelEnv

FIGURE: Final = "recording_peers"
LAST: Final = 4
AGENT: Final = "robot"


class Line(gymnasium.Env[Any, Any]):
    """A robot walks on the cells 0 to 4; reaching cell 4 pays 1 and ends the episode."""

    def __init__(self) -> None:
        self.observation_space = Box(0, LAST, (1,), np.int64)
        self.action_space = Discrete(3)
        self.position = 0

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Puts the robot into cell 0."""
        super().reset(seed=seed)
        self.position = 0
        return np.array([0]), {"position": 0}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Moves by -1, 0 or +1, clipped."""
        self.position = min(max(self.position + int(action) - 1, 0), LAST)
        met = self.position == LAST
        return np.array([self.position]), float(met), met, False, {"position": self.position}


class ParallelLine(ParallelEnv):  # type: ignore[misc]  # PettingZoo ships no types
    """The same task with PettingZoo's Parallel API."""

    metadata: Final = {"name": "line_v0"}

    def __init__(self) -> None:
        self.line = Line()
        self.possible_agents = [AGENT]
        self.observation_spaces = {AGENT: self.line.observation_space}
        self.action_spaces = {AGENT: self.line.action_space}

    def observation_space(self, agent: str) -> Any:
        """The line's."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Any:
        """The line's."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> tuple[Any, Any]:
        """Puts the robot into cell 0."""
        self.agents = [AGENT]
        obs, info = self.line.reset(seed=seed)
        return {AGENT: obs}, {AGENT: info}

    def step(self, actions: dict[str, Any]) -> tuple[Any, Any, Any, Any, Any]:
        """Moves by -1, 0 or +1, clipped."""
        obs, reward, terminated, truncated, info = self.line.step(actions[AGENT])
        if terminated:
            self.agents = []
        return (
            {AGENT: obs},
            {AGENT: reward},
            {AGENT: terminated},
            {AGENT: truncated},
            {AGENT: info},
        )


def walk(env: Any, actions: list[Any]) -> None:
    """Plays Gymnasium episodes until the actions are used up."""
    episode = 0
    env.reset(seed=episode)
    for action in actions:
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            episode += 1
            env.reset(seed=episode)


def walk_parallel(env: Any, actions: list[Any]) -> None:
    """Plays Parallel episodes until the actions are used up."""
    episode = 0
    env.reset(seed=episode)
    for action in actions:
        env.step({AGENT: action})
        if not env.agents:
            episode += 1
            env.reset(seed=episode)


@dataclass
class Peer:
    """One way to record.

    Attributes:
        name: as it stands in the output.
        make: gives an environment that records into the folder; ImportError where it isn't here.
        finish: puts what is recorded on disk.
        bare: name of the peer that it is compared with.
        play: plays the actions.
    """

    name: str
    make: Callable[[Path], Any]
    finish: Callable[[Any], object] = lambda env: env.close()
    bare: str = "bare"
    play: Callable[[Any, list[Any]], None] = walk
    why: str | None = None
    us: list[float] = field(default_factory=list)
    cpu_us: list[float] = field(default_factory=list)
    finish_us: list[float] = field(default_factory=list)
    size_bytes: list[float] = field(default_factory=list)


def with_statistics(folder: Path) -> Any:
    """Gymnasium's own wrapper: return, length and time of each episode, no steps."""
    return gymnasium.wrappers.RecordEpisodeStatistics(Line())


def with_minari(data_format: str) -> Callable[[Path], Any]:
    """Minari's collector with infos, in one of its formats."""

    def make(folder: Path) -> Any:
        os.environ["MINARI_DATASETS_PATH"] = str(folder)
        import minari

        return minari.DataCollector(Line(), record_infos=True, data_format=data_format)

    return make


def checksums_minari(env: Any) -> None:
    """Makes the data set out of what was collected."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # it asks for an author and a paper
        env.create_dataset(dataset_id="line/random-v0", description="random actions")
    env.close()


def with_gamekeeper(level: str) -> Callable[[Path], Any]:
    """Our recorder at one of its levels; closing the environment finalizes the run."""

    def make(folder: Path) -> Any:
        import gamekeeper

        return gamekeeper.record(ParallelLine(), folder / "run", level=level)

    return make


PEERS: Final = [
    Peer("bare", lambda folder: Line()),
    Peer("RecordEpisodeStatistics", with_statistics),
    Peer("minari.DataCollector, hdf5", with_minari("hdf5"), checksums_minari),
    Peer("minari.DataCollector, arrow", with_minari("arrow"), checksums_minari),
    Peer("bare parallel", lambda folder: ParallelLine(), bare="bare parallel", play=walk_parallel),
    Peer("gamekeeper, full", with_gamekeeper("full"), bare="bare parallel", play=walk_parallel),
    Peer("gamekeeper, digest", with_gamekeeper("digest"), bare="bare parallel", play=walk_parallel),
]


def measure(peer: Peer, actions: list[Any]) -> None:
    """Plays one round with a fresh environment in a fresh folder."""
    with tempfile.TemporaryDirectory() as folder:
        env = peer.make(Path(folder))
        gc.collect()
        begun, cpu_begun = time.perf_counter(), time.process_time()
        peer.play(env, actions)
        played, cpu_played = time.perf_counter(), time.process_time()
        peer.finish(env)
        finished = time.perf_counter()
        files = [path for path in Path(folder).rglob("*") if path.is_file()]
        per_step = 1e6 / len(actions)
        peer.us.append((played - begun) * per_step)
        peer.cpu_us.append((cpu_played - cpu_begun) * per_step)
        peer.finish_us.append((finished - played) * per_step)
        peer.size_bytes.append(sum(path.stat().st_size for path in files) / len(actions))


def main() -> None:
    """Measures what is installed and says what isn't."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--steps", type=int, default=5_000, help="in each round")
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    actions = [np.int64(action) for action in rng.integers(3, size=options.steps)]
    for peer in PEERS:  # warm: imports, caches; and who isn't here
        try:
            measure(peer, actions[:200])
        except ImportError as error:
            peer.why = f"not installed: {error}"
            continue
        for figures in (peer.us, peer.cpu_us, peer.finish_us, peer.size_bytes):
            figures.clear()
    here = [peer for peer in PEERS if peer.why is None]
    for turn in range(options.rounds):
        start = turn % len(here)
        for peer in here[start:] + here[:start]:
            measure(peer, actions)
    by_name = {peer.name: peer for peer in PEERS}
    for peer in PEERS:
        show(peer, by_name[peer.bare], options)


def show(peer: Peer, bare: Peer, options: argparse.Namespace) -> None:
    """Prints one JSON line."""
    line: dict[str, Any] = {"figure": FIGURE, "peer": peer.name, "us": None, "ratio": None}
    if peer.why is None:
        ratios = [ours / theirs for ours, theirs in zip(peer.us, bare.us, strict=True)]
        line |= {
            "us": round(statistics.median(peer.us), 3),
            "ratio": round(statistics.median(ratios), 3),
            "added_us": round(statistics.median(np.subtract(peer.us, bare.us)), 3),
            "cpu_us": round(statistics.median(peer.cpu_us), 3),
            "finish_us": round(statistics.median(peer.finish_us), 3),
            "bytes": round(statistics.median(peer.size_bytes), 1),
            "against": bare.name,
            "rounds": options.rounds,
            "steps": options.steps,
        }
    else:
        line["why"] = peer.why
    print(json.dumps(line), flush=True)


if __name__ == "__main__":
    main()
