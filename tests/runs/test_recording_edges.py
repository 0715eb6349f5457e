"""Edges of recording and replaying that users come upon."""

import contextlib
import gc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete, Space
from pettingzoo import ParallelEnv

import gamekeeper as gk
from gamekeeper.errors import EvidenceError, PolicyError
from gamekeeper.interface import identity
from gamekeeper.runs.run_check import verify

LINE = f"{Path(__file__).parents[2] / 'examples' / 'two_robot_line.py'}:make"
MEET = {"picker": 2, "carrier": 0}


def test_recording_outlives_a_change_of_the_working_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A relative path means the folder that it meant when recording began."""
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    env = gk.record(gk.make(LINE), "run")
    env.reset(seed=1)
    monkeypatch.chdir(tmp_path / "elsewhere")
    while env.agents:
        env.step(MEET)
    env.close()
    assert gk.load(tmp_path / "run").manifest["status"] == "finalized"


def test_rollout_of_no_episode_is_refused() -> None:
    """As the command line does."""
    with pytest.raises(EvidenceError, match="nothing is to be played"):
        gk.rollout(LINE, episodes=0)


def test_evidence_traces_and_turns_are_shown_in_one_line() -> None:
    """At a prompt nobody wants to see all columns."""
    evidence = gk.rollout(LINE, episodes=1)
    episode = evidence.episodes[0]
    turn = episode.turns[0]
    for thing in (evidence, episode, turn):
        assert len(repr(thing).splitlines()) == 1
        assert len(repr(thing)) < 100


def test_replay_says_why_it_takes_no_evidence_in_memory() -> None:
    """Evidence that lies in no folder can't be handed to a process of its own."""
    with pytest.raises(EvidenceError, match="in memory alone"):
        gk.replay(gk.rollout(LINE, episodes=1))


def test_recording_of_a_made_environment_replays_by_its_name(tmp_path: Path) -> None:
    """What `gk.make` opened by name is no nameless object when it is recorded."""
    env = gk.record(gk.make("classic/tictactoe-v3"), tmp_path / "run")
    env.reset(seed=1)
    for _ in env.agent_iter():
        observation, _, terminated, truncated, _ = env.last()
        done = terminated or truncated
        env.step(None if done else int(observation["action_mask"].argmax()))
    env.close()
    assert gk.replay(tmp_path / "run").verified


def test_origin_is_forgotten_with_its_environment() -> None:
    """Nothing keeps an environment alive, and no later object inherits its name."""
    env = gk.make("classic/tictactoe-v3")
    key = id(env)
    assert key in identity._ORIGINS
    del env
    gc.collect()
    assert key not in identity._ORIGINS


class Painted(ParallelEnv[str, Any, Any]):
    """A large `state()`; its third step raises once."""

    metadata = {"name": "painted_v0"}  # noqa: RUF012  # as PettingZoo declares it

    def __init__(self) -> None:
        self.possible_agents = ["painter"]
        self.state_space = Box(0, 255, (100, 120), np.uint8)

    def observation_space(self, agent: str) -> Any:
        return Discrete(9)

    def action_space(self, agent: str) -> Any:
        return Discrete(2)

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.agents, self.steps, self.canvas = ["painter"], 0, np.zeros((120, 100), np.uint8)
        return {"painter": np.int64(0)}, {"painter": {}}

    def state(self) -> Any:
        return self.canvas.T

    def step(self, actions: Any) -> Any:
        self.steps += 1
        if self.steps == 3:
            raise RuntimeError("out of paint")
        self.canvas[self.steps] = self.steps
        over = self.steps >= 6
        if over:
            self.agents = []
        parts = [np.int64(0), 0.0, over, False, {}]
        return tuple({"painter": part} for part in parts)


def painted(env: Any) -> None:
    """One episode; who steps goes on after the raise."""
    env.reset(seed=1)
    while env.agents:
        with contextlib.suppress(RuntimeError):
            env.step({"painter": np.int64(1)})


def test_large_states_are_put_aside_and_come_back(tmp_path: Path) -> None:
    """States go through the ring as images do, each once, also past a step that raised."""
    env = gk.record(Painted(), tmp_path / "run")
    for _ in range(40):
        painted(env)
    env.close()
    episodes = list(gk.load(tmp_path / "run").episodes)
    assert len(episodes) == 40
    for episode in episodes:
        states = [turn.state for turn in episode.turns]
        assert [None if s is None else int(s.max()) for s in states] == [0, 1, 2, None, 4, 5, 6]
    assert verify(tmp_path / "run").ok


def test_rollout_that_a_policy_ended_says_so_in_the_run(tmp_path: Path) -> None:
    """The run is finalized; show, report and `print` say that episodes are missing, and why."""

    def tired(observation: Any, agent: Any, info: Any, rng: Any) -> Any:
        raise RuntimeError("my network is broken")

    with pytest.raises(PolicyError, match="my network is broken"):
        gk.rollout("two_robot_line", policies=tired, episodes=3, out=tmp_path / "run")
    found = gk.load(tmp_path / "run")
    assert found.manifest["status"] == "finalized"
    assert "my network is broken (episode 0, turn 0); 1 of 3 episodes" in found.not_whole
    assert gk.verify(tmp_path / "run").ok


class Even(Space[np.int64]):
    """Even numbers below a bound: a space class that only its own code knows."""

    def __init__(self, bound: int) -> None:
        self.bound = bound
        super().__init__((), np.int64)

    def sample(self, mask: Any = None, probability: Any = None) -> np.int64:
        """An even number."""
        return np.int64(2 * self.np_random.integers(self.bound // 2))

    def contains(self, x: Any) -> bool:
        """Any even whole number below the bound."""
        return isinstance(x, int | np.integer) and 0 <= x < self.bound and x % 2 == 0

    @property
    def is_np_flattenable(self) -> bool:
        """It has no vector."""
        return False


class Strides(ParallelEnv):
    """Walkers go on by even strides, and refuse all that is no such stride."""

    metadata = {"name": "strides_v0"}  # noqa: RUF012  # as PettingZoo has it

    def __init__(self) -> None:
        self.possible_agents, self.agents = ["one", "two"], []
        self.render_mode = None
        self.observation_spaces = dict.fromkeys(self.possible_agents, Even(1_000))
        self.action_spaces = {agent: Even(6) for agent in self.possible_agents}

    def observation_space(self, agent: str) -> Space[Any]:
        """Of the walked way."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space[Any]:
        """Of the strides."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Both start at 0."""
        self.agents = self.possible_agents[:]
        self.walked = dict.fromkeys(self.agents, 0)
        return self.walked.copy(), {agent: {} for agent in self.agents}

    def step(self, actions: Any) -> Any:
        """Walks; ten are enough."""
        for agent, stride in actions.items():
            if not self.action_spaces[agent].contains(stride):
                raise ValueError(stride)
            self.walked[agent] += int(stride)
        acting, is_over = self.agents, max(self.walked.values()) >= 10
        self.agents = [] if is_over else acting
        ended = dict.fromkeys(acting, is_over), dict.fromkeys(acting, False)
        return self.walked.copy(), dict.fromkeys(acting, 1.0), *ended, {a: {} for a in acting}


def test_actions_of_a_space_class_of_its_own_are_read_and_replayed(tmp_path: Path) -> None:
    """What the space was is not known from the run, its values are: they stand there as JSON."""
    gk.rollout(f"{__file__}:Strides", episodes=2, out=tmp_path / "run")
    first = gk.load(tmp_path / "run").episodes[0].turns[0]
    assert first.actions.keys() == first.observations.keys() == {"one", "two"}
    assert {action % 2 for action in first.actions.values()} == {0}
    assert gk.replay(tmp_path / "run").verified
    assert gk.audit(tmp_path / "run").failed == ()
