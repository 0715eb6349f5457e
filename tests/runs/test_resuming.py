"""A resumed episode stands where the recorded one stood, and goes on as that did."""

import sys
from pathlib import Path
from typing import Any

import pytest

import gamekeeper as gk
from gamekeeper.cli import main
from gamekeeper.errors import EvidenceError, TrustError
from tests.runs.plays import played


def rewards_after(resumed: Any, steps: int) -> list[dict[str, float]]:
    """Rewards by agent of the next steps, in which the recorded policies go on choosing."""
    env, policies = resumed
    observations, infos, found = resumed.observations, resumed.infos, []
    for _ in range(steps):
        actions = {a: policies.act(a, observations[a], infos[a]) for a in env.agents}
        observations, rewards, _, _, infos = env.step(actions)
        found.append({str(agent): float(paid) for agent, paid in rewards.items()})
    return found


@pytest.mark.parametrize("turn", [0, 1, 13, 25])
def test_a_parallel_episode_goes_on_as_it_was_recorded(turn: int) -> None:
    """From any turn on the recorded policies choose, and are paid, what they were."""
    evidence = gk.rollout("parallel:spread", policies="random", episodes=3, seed=4)
    recorded = [dict(each.rewards) for each in evidence.episode(2).turns if each.actions]
    resumed = gk.resume(evidence, episode=2, turn=turn)
    assert resumed.turn == turn
    expected = recorded[turn:]
    assert rewards_after(resumed, len(expected)) == expected


def test_an_aec_episode_stands_at_its_agent() -> None:
    """The agent in turn, its observation and the recorded policy's action are those of the turn."""
    evidence = gk.rollout("aec:tictactoe", policies="random", episodes=2, seed=1)
    turns = list(evidence.episode(1).turns)
    for number in range(4):
        resumed = gk.resume(evidence, episode=1, turn=number)
        env, policies = resumed
        agent = env.agent_selection
        assert turns[number].order == (agent,)
        observation, _, _, _, info = env.last()
        assert policies.act(agent, observation, info) == turns[number].actions[agent]
        assert resumed.observations == {}


def test_policies_that_remember_have_seen_what_they_saw(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A policy that counts its decisions stands at the count of that turn."""
    (tmp_path / "counting.py").write_text(
        "class Counting:\n"
        "    def reset(self, seed):\n"
        "        self.count = 0\n"
        "    def __call__(self, observation, agent, info, rng):\n"
        "        self.count += 1\n"
        "        return self.count % 2\n"
    )
    monkeypatch.chdir(tmp_path)
    policies = {"*": "counting.py:Counting"}
    evidence = gk.rollout("parallel:spread", policies=policies, episodes=1)
    chosen = [dict(each.actions) for each in evidence.episode(0).turns if each.actions]
    resumed = gk.resume(evidence, turn=5)
    seen, infos = resumed.observations, resumed.infos
    found = {a: resumed.policies.act(a, seen[a], infos[a]) for a in resumed.env.agents}
    assert found == chosen[5]


def test_a_run_without_policies_plays_its_actions(tmp_path: Path) -> None:
    """What a loop of one's own recorded is resumed by its actions, also after unseeded resets."""
    env = gk.record(gk.make("parallel:spread"), tmp_path / "run")
    for seed in (3, None):
        observations, _ = env.reset(seed=seed)
        for _ in range(4):
            observations, *_ = env.step(dict.fromkeys(env.agents, 1))
    env.close()
    resumed = gk.resume(tmp_path / "run", episode=1, turn=4)
    assert resumed.policies is None
    assert {a: x.tolist() for a, x in resumed.observations.items()} == {
        a: x.tolist() for a, x in observations.items()
    }


def test_another_environment_is_refused(tmp_path: Path) -> None:
    """Where a turn on the way comes out otherwise, the error names the place and the values."""
    gk.rollout("parallel:spread", episodes=1, out=tmp_path / "run")
    with pytest.raises(EvidenceError, match="isn't what was recorded") as raised:
        gk.resume(tmp_path / "run", turn=3, env="parallel:tag")
    assert "episode 0, turn 0" in str(raised.value)


@pytest.mark.parametrize(
    ("asked", "expected"),
    [
        ({"episode": 7}, "one of its 2 episodes"),
        ({"turn": 26}, "a number from 0, after the reset, to 25"),
        ({"turn": -1}, "a number from 0, after the reset, to 25"),
    ],
)
def test_a_place_that_is_not_there_is_refused(asked: dict[str, int], expected: str) -> None:
    """The error says which episodes and turns there are."""
    evidence = gk.rollout("parallel:spread", episodes=2)
    with pytest.raises(EvidenceError) as raised:
        gk.resume(evidence, **asked)
    assert expected in str(raised.value)


@pytest.mark.usefixtures("nothing_is_ours")
def test_code_of_another_person_runs_only_where_it_is_allowed(tmp_path: Path) -> None:
    """The rule of consent is that of a replay."""
    played(tmp_path)
    with pytest.raises(TrustError, match="resuming this run"):
        gk.resume(tmp_path / "run", turn=1)
    assert gk.resume(tmp_path / "run", turn=1, allow_import=True).turn == 1


def test_command_reads_lines_at_that_turn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Without IPython Python's own console has env, policies, observations and infos."""
    run = tmp_path / "run"
    gk.rollout("parallel:spread", episodes=1, out=run)
    lines = iter(["print(env.agents == list(observations) == list(infos), policies is not None)"])

    def typed(prompt: str = "") -> str:
        for line in lines:
            return line
        raise EOFError

    monkeypatch.setitem(sys.modules, "IPython", None)
    monkeypatch.setattr("builtins.input", typed)
    assert main(["resume", str(run), "--turn", "3"]) == 0
    shown = "".join(capfd.readouterr())
    assert "True True" in shown
    assert "turn 3: turns 0 to 2 are as recorded" in shown


SLIPPING = """\
import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

class Slip(ParallelEnv):
    metadata = {"name": "slip_v0"}
    possible_agents = ["a"]

    def __init__(self):
        self.rng, self.slips = np.random.default_rng(), np.random.default_rng(5)

    def observation_space(self, agent):
        return spaces.Box(-99, 99, (1,), np.float64)

    def action_space(self, agent):
        return spaces.Discrete(2)

    def reset(self, seed=None, options=None):
        self.agents, self.turn, self.at = ["a"], 0, 0.0
        return self.seen(), {"a": {}}

    def seen(self):
        return {"a": np.array([self.at])}

    def step(self, actions):
        self.turn += 1
        self.at += self.slips.random()
        self.agents = [] if self.turn == 5 else ["a"]
        return self.seen(), {"a": 0.0}, {"a": False}, {"a": self.turn == 5}, {"a": {}}
"""


def test_an_episode_of_actions_that_hangs_on_others_is_refused(tmp_path: Path) -> None:
    """State that outlives a seeded reset shows in the witnesses at the episode's end alone."""
    path = tmp_path / "slipping.py"
    path.write_text(SLIPPING, encoding="utf-8")
    env = gk.record(gk.make(f"{path}:Slip"), tmp_path / "run", level="actions")
    for seed in (3, 4):
        env.reset(seed=seed)
        while env.agents:
            env.step({"a": 1})
    env.close()
    named = {"env": f"{path}:Slip", "turn": 4}
    resumed = gk.resume(tmp_path / "run", episode=0, **named)
    assert "turns 0 to 3 and 1 witness" in resumed.compared
    assert "weren't compared" in resumed.compared
    with pytest.raises(
        EvidenceError, match="any turn after 0, the last whose digest is in the run"
    ):
        gk.resume(tmp_path / "run", episode=1, **named)
