"""How long `gamekeeper view` takes to open an episode, and how much memory it holds.

A run of 200 episodes, 500 turns, 8 agents with 32 numbers of observation, rewards in two terms,
masks, infos and positions is recorded once (or taken from --run). `gamekeeper view` runs in a
process of its own; a client asks for the page, the index and every episode in a random order
(cold: the server has packed none), then for some again (warm), each from the request to the last
byte. With --live the same is asked of a recording while it is written.

Prints JSON lines: {"figure": "view", "what": "start|page|index|cold|warm|live", "n", "p50_ms",
"p95_ms", "max_ms", "bytes_max", "rss_mb"}; `rss_mb` is the server's resident memory after those.

    python benchmarks/view.py [--run RUN] [--episodes 200] [--turns 500] [--live] [--seed 0]
"""

from __future__ import annotations

import argparse
import http.client
import json
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar, Final
from urllib.parse import urlsplit

import numpy as np
from gymnasium.spaces import Box, Discrete

from gamekeeper.interface.tick_env import TickEnv
from gamekeeper.runs.recording import rollout

AGENTS: Final = 8
NUMBERS: Final = 32
LIVE_LOOKS: Final = 40
PAUSE_S: Final = 0.25


class Crowd(TickEnv):
    """Agents that walk on a plane and are paid for being near to others."""

    metadata: ClassVar[dict[str, Any]] = {"name": "crowd_v0", "render_modes": []}

    def __init__(self, turns: int = 500, render_mode: str | None = None) -> None:
        """An episode has so many turns."""
        super().__init__(render_mode=render_mode)
        self.length = turns
        self.possible_agents = [f"walker_{number}" for number in range(AGENTS)]
        sight = Box(-np.inf, np.inf, (NUMBERS,), np.float32)
        self.observation_spaces = dict.fromkeys(self.possible_agents, sight)
        self.action_spaces = dict.fromkeys(self.possible_agents, Discrete(5))

    def start(self, rng: Any, options: Any) -> None:
        """At random places."""
        del options
        self.rng = rng
        self.now = 0
        self.places = np.array([[rng.uniform(-1, 1) for _ in "xy"] for _ in self.possible_agents])
        self.sight = np.zeros((AGENTS, NUMBERS), np.float32)

    def tick(self, actions: Any) -> None:
        """Everybody moves; being far from the others and moving cost."""
        moves = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]]) * 0.05
        for number, action in enumerate(actions.values()):
            self.places[number] += moves[action]
        self.sight = np.tile(self.places.ravel(), (AGENTS, 2)).astype(np.float32)
        near = np.linalg.norm(self.places[:, None] - self.places[None], axis=2).mean(axis=1)
        for number, agent in enumerate(self.possible_agents):
            self.add_reward(agent, -float(near[number]), term="distance")
            self.add_reward(agent, -0.01 * (list(actions.values())[number] != 0), term="effort")
        self.now += 1
        if self.now == self.length:
            for agent in self.possible_agents:
                self.truncate(agent, "horizon")

    def observe(self, agent: str) -> Any:
        """Where everybody is, twice."""
        return self.sight[self.possible_agents.index(agent)]

    def mask(self, agent: str) -> Any:
        """The last move isn't there at every seventh turn."""
        return [1, 1, 1, 1, int(self.now % 7 > 0)]

    def info(self, agent: str) -> Any:
        """Its place, and a number that the player shows."""
        place = self.places[self.possible_agents.index(agent)]
        return {"position": place.copy(), "tired": self.now % 11}


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--run", type=Path)
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--turns", type=int, default=500)
    parser.add_argument("--live", action="store_true")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        run = options.run or Path(folder) / "run"
        if options.live:
            with recording(run, options):
                measured(run, options, live=True)
        else:
            if options.run is None:
                kwargs = {"turns": options.turns}
                rollout(f"{__file__}:Crowd", episodes=options.episodes, out=run, env_kwargs=kwargs)
            measured(run, options)


def measured(run: Path, options: argparse.Namespace, *, live: bool = False) -> None:
    """Prints the figures of one server."""
    begun = time.perf_counter()
    with served(run) as visit:
        say("start", [(time.perf_counter() - begun, 0)], visit.pid)
        say("page", [visit("/") for _ in range(3)], visit.pid)
        say("index", [visit("/index.json") for _ in range(3)], visit.pid)
        if live:
            say("live", list(looks(visit)), visit.pid)
            return
        numbers = [each["episode"] for each in visit.index()["episodes"]]
        random.Random(options.seed).shuffle(numbers)
        say("cold", [visit(f"/episode/a/{number}") for number in numbers], visit.pid)
        say("warm", [visit(f"/episode/a/{number}") for number in numbers[-20:]], visit.pid)


def looks(visit: Visit) -> Iterator[tuple[float, int]]:
    """Looks at the episode that is being recorded, as somebody does who follows it."""
    for _ in range(LIVE_LOOKS):
        time.sleep(PAUSE_S)
        newest = visit.index()["episodes"][-1]["episode"]
        yield visit(f"/episode/a/{newest}")


class Visit:
    """Asks one server, once it is let in."""

    def __init__(self, url: str, pid: int) -> None:
        self.pid, parts = pid, urlsplit(url)
        self.host, self.cookie = parts.netloc, f"gamekeeper-{parts.port}={parts.query[6:]}"

    def __call__(self, target: str) -> tuple[float, int]:
        """Seconds and bytes of one answer."""
        start = time.perf_counter()
        body = self.body(target)
        return time.perf_counter() - start, len(body)

    def index(self) -> Any:
        """The index."""
        return json.loads(self.body("/index.json"))

    def body(self, target: str) -> bytes:
        """One answer."""
        connection = http.client.HTTPConnection(self.host, timeout=600)
        connection.request("GET", target, headers={"Cookie": self.cookie})
        reply = connection.getresponse()
        body = reply.read()
        assert reply.status == 200, body[:500]
        return body


@contextmanager
def served(run: Path) -> Iterator[Visit]:
    """`gamekeeper view` of a run."""
    line = [sys.executable, "-m", "gamekeeper", "view", str(run), "--json"]
    with subprocess.Popen(line, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield Visit(json.loads(process.stdout.readline())["url"], process.pid)
        process.terminate()


@contextmanager
def recording(run: Path, options: argparse.Namespace) -> Iterator[None]:
    """A recording under way, killed at the end."""
    line = [sys.executable, "-m", "gamekeeper", "rollout", f"{__file__}:Crowd", "--out", str(run)]
    more = ["--episodes", "1000000", "--kwargs", json.dumps({"turns": options.turns}), "--quiet"]
    with subprocess.Popen([*line, *more], stdout=subprocess.DEVNULL) as process:
        while not (run / "agent_steps-0000.arrows").exists():
            time.sleep(PAUSE_S)
        yield
        process.terminate()


def say(what: str, found: Iterable[tuple[float, int]], pid: int) -> None:
    """One JSON line."""
    times, sizes = zip(*found, strict=True)
    p50, p95, most = (round(1e3 * float(t), 2) for t in np.quantile(times, [0.5, 0.95, 1.0]))
    line = {
        "figure": "view",
        "what": what,
        "n": len(times),
        "p50_ms": p50,
        "p95_ms": p95,
        "max_ms": most,
        "bytes_max": max(sizes),
        "rss_mb": resident_mb(pid),
    }
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()


def resident_mb(pid: int) -> float | None:
    """The resident memory of a process; None where the system doesn't say."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    return int(next(line for line in lines if line.startswith("VmRSS")).split()[1]) / 1024


if __name__ == "__main__":
    main()
