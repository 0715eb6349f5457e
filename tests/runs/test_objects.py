"""Runs of environments that were handed over as objects are opened again, or say what to add."""

import importlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from pettingzoo.utils.wrappers import BaseParallelWrapper

from gamekeeper.runs.comparison import Replay, replay
from gamekeeper.runs.recording import record, rollout

MODULE = "strolls"
TEXT = '''
import gamekeeper as gk
from gymnasium.spaces import Discrete
from gymnasium.utils import EzPickle
from pettingzoo import ParallelEnv


class Stroll(gk.TickEnv):
    metadata = {"name": "stroll_v0", "render_modes": []}

    def __init__(self, n=2, *, steps=3, tag=None, **more):
        super().__init__(horizon=steps)
        self.possible_agents = [f"a_{i}" for i in range(n)]
        self.observation_spaces = {a: Discrete(9) for a in self.possible_agents}
        self.action_spaces = {a: Discrete(2) for a in self.possible_agents}

    def start(self, rng, options):
        self.place = rng.integers(4)

    def tick(self, actions):
        self.place = min(self.place + sum(actions.values()), 8)

    def observe(self, agent):
        return self.place


class Bare(ParallelEnv):
    """The same without our base class: nothing keeps its arguments."""

    metadata = {"name": "bare_v0", "render_modes": []}
    render_mode = None

    def __init__(self, steps=3):
        self.inner = Stroll(steps=steps)
        self.possible_agents = self.inner.possible_agents
        self.observation_space, self.action_space = (
            self.inner.observation_space, self.inner.action_space
        )

    def reset(self, seed=None, options=None):
        out = self.inner.reset(seed=seed)
        self.agents = self.inner.agents
        return out

    def step(self, actions):
        out = self.inner.step(actions)
        self.agents = self.inner.agents
        return out


class Needy(Bare):
    def __init__(self, steps):
        super().__init__(steps)


class Pickled(Bare, EzPickle):
    def __init__(self, steps=3):
        EzPickle.__init__(self, steps)
        Bare.__init__(self, steps)


def inside():
    class Inner(Stroll):
        pass

    return Inner()
'''
SCRIPT = f"""{TEXT}
def main():
    gk.rollout(Stroll(3), episodes=1, seed=0, out="run")
"""


@pytest.fixture
def strolls(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """The module, in a folder of its own."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    (tmp_path / f"{MODULE}.py").write_text(TEXT)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield importlib.import_module(MODULE)
    del sys.modules[MODULE]


def replayed(env: Any, folder: Path) -> Replay:
    """The replay of a run of an object."""
    rollout(env, episodes=2, seed=0, out=folder / "run")
    return replay(folder / "run")


def test_object_of_a_base_class_replays_without_a_flag(strolls: ModuleType, tmp_path: Path) -> None:
    """Its class and its arguments are known, whatever way they were given in."""
    result = replayed(strolls.Stroll(3, steps=5, extra=[1, 2]), tmp_path)
    assert result.verified, str(result)
    assert result.consent is not None
    assert result.consent.rule == "own_run"


def test_recorded_object_replays_without_a_flag(strolls: ModuleType, tmp_path: Path) -> None:
    """So does what `record` wrapped."""
    env = record(strolls.Stroll(1), tmp_path / "run")
    env.reset(seed=3)
    while env.agents:
        env.step(dict.fromkeys(env.agents, 1))
    env.close()
    assert replay(tmp_path / "run").verified


def test_object_that_keeps_its_arguments_replays(strolls: ModuleType, tmp_path: Path) -> None:
    """Gymnasium's EzPickle keeps them."""
    assert replayed(strolls.Pickled(7), tmp_path).verified


def test_arguments_that_nobody_keeps_are_assumed(strolls: ModuleType, tmp_path: Path) -> None:
    """With the class's defaults the replay is verified; with others it can't tell, and says why."""
    assert replayed(strolls.Bare(), tmp_path / "usual").verified
    other = replayed(strolls.Bare(4), tmp_path / "other")
    assert (other.verified, other.divergence) == (False, None)
    assert "arguments aren't known" in str(other.reason)


@pytest.mark.parametrize(
    ("make", "add"),
    [
        (lambda m: m.Needy(3), "env_kwargs: steps"),
        (lambda m: m.inside(), "a function or class of that module, not inside another"),
        (lambda m: m.Stroll(tag=object()), "a function without such arguments"),
        (lambda m: BaseParallelWrapper(m.Stroll()), "BaseParallelWrapper around a Stroll; add"),
        (lambda m: lambda: m.Stroll(), "a lambda of"),
    ],
)
def test_object_that_no_text_builds_says_what_to_add(
    strolls: ModuleType, tmp_path: Path, make: Any, add: str
) -> None:
    """There is no verdict, and the reason names what would give one."""
    result = replayed(make(strolls), tmp_path)
    assert (result.verified, result.divergence) == (False, None)
    assert add in str(result.reason)


@pytest.mark.parametrize(
    ("end", "is_verified"),
    [('\nif __name__ == "__main__":\n    main()\n', True), ("main()\n", False)],
)
def test_script_replays_if_importing_it_records_nothing(
    strolls: ModuleType, tmp_path: Path, end: str, is_verified: bool
) -> None:
    """A class of the script that records is found in its file, where the script has its guard."""
    (tmp_path / "script.py").write_text(SCRIPT + end)
    subprocess.run([sys.executable, "script.py"], cwd=tmp_path, check=True)
    result = replay(tmp_path / "run")
    assert is_verified is result.verified, str(result)
    assert is_verified or "put what it runs under" in str(result.reason)
