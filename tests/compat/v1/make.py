"""Records the runs beside this file; kept to show how they were made, and never run on them.

A run of format version 1 is what a gamekeeper of that version wrote. Writing them anew would
only show that the reader of a day reads the writer of that day. So this refuses a folder that holds
them: for a new format version copy the folder to the next number, change what is new, run it there.

    python make.py FOLDER      # FOLDER holds worlds.py and relay.toml, and no run yet
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

import gamekeeper as gk
from gamekeeper.errors import EnvError

MARKET = "worlds.py:Market"
OFFERS = ({"ask": np.array([1.5, 9.0])}, 0, np.array([2, 1]))


def market(env: object, seed: int, turns: int, **options: object) -> None:
    """Plays the market by a fixed rule; the buyer acts against its mask at times."""
    env.reset(seed=seed, options=options or None)  # type: ignore[attr-defined]  # PettingZoo's
    for turn in range(turns):
        if not env.agents:  # type: ignore[attr-defined]  # PettingZoo's
            return
        offers = dict(zip(env.possible_agents, OFFERS, strict=True))  # type: ignore[attr-defined]  # PettingZoo's
        actions = {agent: offers[agent] for agent in reversed(env.agents)}  # type: ignore[attr-defined]  # PettingZoo's
        actions["buyer_0"] = 7 if turn == 3 else turn % 3  # outside its space
        env.step(actions)  # type: ignore[attr-defined]  # PettingZoo's


def record_market(name: str, *, level: str = "full", frames: bool = False) -> None:
    """One whole episode, one with options, one cut."""
    mode = {"render_mode": "rgb_array"} if frames else {}
    env = gk.record(gk.make(MARKET, **mode), name, level=level, frames=frames)
    market(env, 11, 99)
    market(env, 12, 99, start=2.5)
    market(env, 13, 3)
    env.close()


def killed() -> None:
    """A recording whose process ends in the middle of its second episode."""
    env = gk.record(gk.make(MARKET), "open")
    market(env, 21, 99)
    market(env, 22, 3)
    from gamekeeper.runs import recorder

    for each in recorder._OPEN:  # what was flushed is there; the process dies before it finalizes
        each._closing = True
        each._wake.set()
        each._thread.join()
    os._exit(9)


def main() -> None:
    """Records all of them into the folder named on the command line."""
    os.chdir(sys.argv[1])
    if sys.argv[2:] == ["killed"]:
        killed()
    if list(Path().glob("*/manifest.json")):
        raise SystemExit("here are runs already; they are never written anew")
    record_market("parallel")
    record_market("frames", frames=True)
    record_market("digest", level="digest")
    relay = {"policies": "random", "episodes": 3, "seed": 5}
    gk.rollout("worlds.py:Relay", out="aec", **relay)
    gk.rollout("worlds.py:Relay", out="aec-digest", level="digest", **relay)
    try:
        gk.rollout(MARKET, episodes=2, seed=6, out="failed", env_kwargs={"fails": True})
    except EnvError as error:
        print(error)  # noqa: T201  # what the failed run holds is told to who makes it
    subprocess.run([sys.executable, __file__, ".", "killed"], check=False)
    label = ["-m", "gamekeeper", "label", "aec", "control", "--episode", "1", "--agent", "runner_1"]
    subprocess.run([sys.executable, *label, "--why", "waits", "--by", "author"], check=True)


if __name__ == "__main__":
    main()
