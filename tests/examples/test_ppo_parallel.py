"""The example with shared parameters: what it learns from, what it doesn't, and that it replays."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

import gamekeeper as gk
from examples.kernel import RING
from gamekeeper.kernels.kernel_env import kernel_env

pytestmark = pytest.mark.trainer
ENDS = {"pilot_0": 3, "pilot_1": 4, "scout": 7}


class Relay(gk.TickEnv):
    """Pilots end in ticks 3 (cut off) and 4 (over), the scout is cut off in 7; a mask moves on.

    Everybody sees the tick; each tick pays 1. With `late` pilot_1 joins in tick 2.
    """

    metadata = {"name": "relay_v0"}  # noqa: RUF012

    def __init__(self, *, late: bool = False) -> None:
        super().__init__()
        self.late, self.possible_agents = late, list(ENDS)
        seen = {"pilot_0": 2, "pilot_1": 2, "scout": 5}
        self.observation_spaces = {
            agent: spaces.Box(0, 9, (size,), np.float32) for agent, size in seen.items()
        }
        self.action_spaces = {agent: spaces.Discrete(3) for agent in seen}

    def starting_agents(self) -> list[str]:
        return ["pilot_0", "scout"] if self.late else self.possible_agents

    def start(self, rng: Any, options: dict[str, Any]) -> None:
        self.time = 0

    def tick(self, actions: dict[str, Any]) -> None:
        self.time += 1
        for agent in actions:
            self.add_reward(agent, 1.0)
            if self.time == ENDS[agent]:
                end = self.terminate if agent == "pilot_1" else self.truncate
                end(agent, "done")
        if self.late and self.time == 2:
            self.join("pilot_1")

    def observe(self, agent: str) -> Any:
        return np.full(self.observation_spaces[agent].shape, self.time, np.float32)

    def mask(self, agent: str) -> Any:
        return np.array([self.time % 3 == k for k in range(3)], np.int8)


@pytest.fixture
def ppo() -> Any:
    """The example, which imports torch."""
    pytest.importorskip("torch", reason="it learns with torch")
    from examples import ppo_parallel

    return ppo_parallel


def played(ppo: Any, spec: Any, *, length: int = 12, **kwargs: Any) -> tuple[Any, Any]:
    """Learners after so many steps of two copies, and what was observed last."""
    args = ppo.Args(env=spec, copies=2, length=length)
    venv = gk.vector.make(spec, 2, seed=0, env_kwargs=kwargs, copy=False)
    obs, infos = venv.reset()
    learners = [ppo.Learner(group, args, obs) for group in venv.groups]
    for t in range(length):
        actions = {learner.group.name: learner.act(t, obs, infos) for learner in learners}
        obs, *paid, infos = venv.step(actions.get("", actions))
        for learner in learners:
            learner.note(t, obs, paid, infos)
    return {learner.group.name: learner for learner in learners}, obs


def test_steps_count_for_who_is_there(ppo: Any) -> None:
    """Each role has its network; an agent's steps are those up to its own end, in each episode."""
    learners, _ = played(ppo, Relay)
    assert list(learners) == ["pilot", "scout"]
    assert learners["pilot"].seen.shape == (12, 2, 2, 2)
    assert learners["scout"].seen.shape == (12, 2, 1, 5)
    live = learners["pilot"].live[:, 0].numpy()
    assert live[:, 0].tolist() == [True] * 3 + [False] * 4 + [True] * 3 + [False] * 2
    assert live[:, 1].tolist() == [True] * 4 + [False] * 3 + [True] * 4 + [False]
    assert learners["scout"].live.all()


def test_who_joins_late_counts_from_then_on(ppo: Any) -> None:
    """Nothing is learnt from a place before its agent comes."""
    learners, _ = played(ppo, Relay, late=True)
    live = learners["pilot"].live[:, 0, 1].tolist()
    assert live == [False] * 2 + [True] * 2 + [False] * 5 + [True] * 2 + [False]


def test_observations_are_those_of_the_step(ppo: Any) -> None:
    """Also after an end, where final observations were looked at; and what is masked isn't done."""
    learners, _ = played(ppo, Relay)
    ticks = np.arange(12) % 7
    for learner in learners.values():
        seen, did, live = (array.numpy() for array in (learner.seen, learner.did, learner.live))
        for t in range(12):
            assert (seen[t][live[t]] == ticks[t]).all()
            assert (did[t][live[t]] == ticks[t] % 3).all()


def test_only_what_was_cut_off_is_bootstrapped(ppo: Any) -> None:
    """By the value of an agent's own last observation; after a termination nothing follows."""
    import torch

    learners, _ = played(ppo, Relay)
    for name, agent, place in (
        ("pilot", "pilot_0", 0),
        ("pilot", "pilot_1", 1),
        ("scout", "scout", 0),
    ):
        learner, end = learners[name], ENDS[agent]
        last = torch.full((learner.seen.shape[-1],), float(end))
        beyond = 0.0 if agent == "pilot_1" else 0.95 * float(learner.value(last).detach())
        rewards = learner.rewards[:7, 0, place].tolist()
        assert rewards[: end - 1] == [1.0] * (end - 1)
        assert rewards[end - 1] == pytest.approx(1.0 + beyond, abs=1e-5)
        assert rewards[end:] == [0.0] * (7 - end)
        assert learner.goes_on[:7, 0, place].tolist() == [True] * (end - 1) + [False] * (8 - end)


def test_advantages_are_sums_of_discounted_rewards(ppo: Any) -> None:
    """With lambda 1, against sums computed agent by agent and step by step."""
    learners, obs = played(ppo, lambda: kernel_env(RING, debug=True), length=40)
    (learner,) = learners.values()
    learner.args = replace(learner.args, gae_lambda=1.0)
    found = (learner.advantages(obs) + learner.values).numpy()
    after = learner.value(ppo.flat(obs, 2)).detach().numpy()
    assert not learner.live.all()  # batteries ran empty
    for copy in range(2):
        for agent in range(3):
            total = float(after[copy, agent])
            for t in reversed(range(40)):
                goes_on = bool(learner.goes_on[t, copy, agent])
                total = float(learner.rewards[t, copy, agent]) + (0.95 * total if goes_on else 0.0)
                assert found[t, copy, agent] == pytest.approx(total, abs=1e-3)


def test_observations_in_parts_are_flat(ppo: Any) -> None:
    """All numbers of a Dict but the mask, and of a Tuple, behind the leading axes."""
    seen = {"a": np.ones((4, 2, 3)), "action_mask": np.ones((4, 2, 9)), "b": (np.zeros((4, 2)),)}
    flat = ppo.flat(seen, 2)
    assert flat.shape == (4, 2, 4)
    assert flat[0, 0].tolist() == [1.0, 1.0, 1.0, 0.0]


def test_run_learns_the_same_on_every_engine(ppo: Any) -> None:
    """The same weights from one copy at a time and from a batch, and others from another seed."""
    found = []
    for engine, seed in (("serial", 0), ("kernel", 0), ("kernel", 1)):
        args = ppo.Args(env="two_robot_line", engine=engine, steps=600, copies=4)
        found.append(ppo.Learnt(ppo.train(args, seed, lambda *line: None)).version)
    assert found[0] == found[1] != found[2]


def test_run_that_was_stopped_ends_with_the_same_weights(ppo: Any, tmp_path: Path) -> None:
    """Stopped in its second part and gone on with from the file, as if it hadn't been stopped."""
    args = ppo.Args(env="two_robot_line", engine="kernel", steps=1_200, part=400, copies=4)
    whole, parts = tmp_path / "whole.pt", tmp_path / "parts.pt"
    straight = ppo.Learnt(ppo.train(args, 0, lambda *line: None, whole)).version

    def stop(name: str, value: float, played: int) -> None:
        if played > 600:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ppo.train(args, 0, stop, parts)
    half = ppo.Learnt(ppo.loaded(args, parts)).version
    assert half != straight == ppo.Learnt(ppo.loaded(args, whole)).version
    assert ppo.Learnt(ppo.train(args, 0, lambda *line: None, parts)).version == straight


@pytest.mark.parametrize("env", ["mpe2.simple_spread_v3:parallel_env", "tag", "warehouse"])
def test_quick_run_ends_in_evidence_that_replays(
    ppo: Any, env: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One network or one for each role, masks, spares; one line of JSON names the evidence."""
    engine = "serial" if "." in env else "kernel"
    given = ["--quick", "--env", env, "--engine", engine, "--out", str(tmp_path / "run")]
    assert ppo.main(given) == 0
    out, err = capsys.readouterr()
    (line,) = out.splitlines()
    told = json.loads(line)
    assert set(told) >= {
        "example",
        "trainer",
        "task",
        "seed",
        "steps",
        "seconds",
        "measure",
        "result",
        "wanted",
        "reached",
    }
    assert "return/role/" in err or env == "warehouse"
    assert gk.load(tmp_path / "run").fingerprint == told["fingerprint"]
    assert told["replayed"]


def test_what_it_isnt_for_is_refused(ppo: Any) -> None:
    """Agents that take turns, and actions that aren't Discrete."""
    with pytest.raises(ValueError, match="take turns"):
        ppo.train(ppo.Args(env="connect_four"), 0, print)
    continuous = {"continuous_actions": True}
    with pytest.raises(ValueError, match="not in a Discrete"):
        ppo.train(ppo.Args(env="spread", env_kwargs=continuous, copies=1), 0, print)
