"""Stable-Baselines3 sees what was played: ends, truncation, masks, credit, evidence."""

from __future__ import annotations

import base64
import json
import zipfile
from copy import deepcopy
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import gamekeeper as gk
from gamekeeper.errors import ActionError, ContractError, PolicyError, SpecError
from tests.adapters import streams
from tests.adapters.streams import ByWhatIsSeen, of_episode, of_slots, same

pytestmark = pytest.mark.trainer
SPREAD = "mpe2.simple_spread_v3:parallel_env"
TAG = "mpe2.simple_tag_v3:parallel_env"
WORLDS = str(Path(__file__).parent.parent / "vector" / "worlds.py")
FOUR = "pettingzoo.classic.connect_four_v3:env"


def made(spec: object, num_envs: int, **options: Any) -> Any:
    """Without an audit, which has tests of its own."""
    from gamekeeper.adapters import sb3

    return sb3.vec_env(spec, num_envs, check=None, **options)


class _AsSlots:
    """The VecEnv in the form in which `streams.played` steps slots."""

    def __init__(self, venv: Any) -> None:
        self.venv, slots = venv, venv.slots
        self.reset, self.count, self.action_space = venv.reset, venv.num_envs, venv.action_space
        self.acting, self.acted, self.masks = slots.acting, slots.acted, slots.masks

    def step(self, actions: Any) -> Any:
        obs, rewards, dones, infos = self.venv.step(actions)
        cut = np.array([info.get("TimeLimit.truncated", False) for info in infos])
        assert all(bool(info) == bool(done) for info, done in zip(infos, dones, strict=True))
        return SimpleNamespace(
            obs=obs,
            rewards=rewards,
            truncated=cut,
            terminated=dones & ~cut,
            final={slot: info["terminal_observation"] for slot, info in enumerate(infos) if info},
        )


@pytest.mark.parametrize(
    ("spec", "role", "others"),
    [
        ("two_robot_line", None, None),
        ("warehouse", "picker", {"carrier": "reference"}),
        ("handover", None, None),
        (FOUR, None, None),
        (TAG, "adversary", "first-legal"),
        (f"{WORLDS}:Walk", None, None),
        (f"{WORLDS}:Late", "scout", "random"),
        (f"{WORLDS}:LateTurns", "cook", "random"),
    ],
)
def test_trace_is_the_same_seen_through_the_vec_env(spec: str, role: Any, others: Any) -> None:
    """A recording equals what each slot saw, did and was paid, but for what the table says."""
    venv = made(spec, 2, role=role, others=others, seed=5)
    mine = ByWhatIsSeen(venv.action_space)
    named = others if isinstance(others, dict) else {"*": others or mine}
    policies = {**named, **dict.fromkeys(venv.slots.learners, mine)}
    episodes = list(gk.rollout(spec, policies=policies, episodes=2, seed=5).episodes)
    longest = max(len(list(episode.turns)) for episode in episodes)
    try:
        told = streams.played(_AsSlots(venv), longest)
    finally:
        venv.close()
    compared = 0
    for copy, episode in enumerate(episodes):
        for learner, agent in enumerate(venv.slots.learners):
            recorded = of_episode(episode, str(agent))
            if recorded is None:  # a spare that nobody needed
                continue
            if recorded.end == (True, True):
                recorded.end = (True, False)  # `TimeLimit.truncated` is of who wasn't terminated
            found = of_slots(told, copy * len(venv.slots.learners) + learner)[0]
            same(recorded, found, paid=1e-5)
            compared += 1
    assert compared >= 2


def test_seed_begins_the_same_run() -> None:
    """`seed` holds for the reset after it."""
    venv = made(SPREAD, 3)
    venv.seed(9)
    one = venv.reset()
    venv.seed(9)
    two = venv.reset()
    venv.seed(10)
    assert np.array_equal(one, two)
    assert not np.array_equal(one, venv.reset())
    venv.close()


def test_attributes_are_those_of_slots() -> None:
    """Who sits in which slot can be asked; what would set a neighbour's environment is refused."""
    venv = made(TAG, 2, role="adversary", others="random")
    assert venv.get_attr("agent")[:4] == [
        "adversary_0",
        "adversary_1",
        "adversary_2",
        "adversary_0",
    ]
    assert venv.get_attr("role", [0]) == ["adversary"]
    with pytest.raises(SpecError, match="no attribute is set"):
        venv.set_attr("render_mode", None)
    with pytest.raises(AttributeError, match="known is"):
        venv.env_method("state")
    venv.close()


def test_learners_that_differ_are_refused() -> None:
    """One network has one observation space."""
    with pytest.raises(SpecError, match="can't be shared"):
        made(TAG, 1)
    with pytest.raises(SpecError, match="no policy"):
        made(TAG, 1, role="adversary")


@pytest.mark.parametrize("spec", [SPREAD, "warehouse", FOUR])
def test_ppo_trains(spec: str, tmp_path: Path) -> None:
    """A few updates, masked where the environment has masks; the model is saved and plays."""
    from sb3_contrib import MaskablePPO
    from stable_baselines3 import PPO

    from gamekeeper.adapters import sb3

    venv = made(spec, 4)
    masked = venv.has_attr("action_masks")
    kind = MaskablePPO if masked else PPO
    model = kind(
        "MlpPolicy",
        venv,
        n_steps=32,
        batch_size=64,
        n_epochs=1,
        device="cpu",
        seed=0,
        **sb3.buffer(venv, masked=masked),
    )
    before = sb3.policy(model).version
    model.learn(venv.num_envs * 64)
    assert sb3.policy(model).version != before
    model.save(tmp_path / "model.zip")
    venv.close()

    evidence = gk.rollout(spec, policies=f"sb3:{tmp_path / 'model.zip'}", episodes=1, seed=0)
    named = evidence.episode_table.to_pylist()[0]["policies"]
    assert f"{venv.num_envs * 64} steps" in named


def test_buffer_keeps_what_was_decided() -> None:
    """On a board of turns half of the slots wait: only decisions are learnt from."""
    from sb3_contrib import MaskablePPO

    from gamekeeper.adapters import sb3

    venv = made(FOUR, 3)
    model = MaskablePPO(
        "MlpPolicy",
        venv,
        n_steps=40,
        batch_size=16,
        n_epochs=1,
        device="cpu",
        seed=0,
        **sb3.buffer(venv, masked=True),
    )
    model.learn(venv.num_envs * 40)
    kept = model.rollout_buffer.buffer_size
    assert 3 * 40 - 3 <= kept <= 3 * 40
    assert len(next(model.rollout_buffer.get()).actions) == kept
    venv.close()


@pytest.mark.parametrize("engine", ["serial", "process"])
def test_saved_model_doesnt_hold_its_environment(engine: str, tmp_path: Path) -> None:
    """It learns on once it is given one again; without, it says so."""
    from stable_baselines3 import PPO

    from gamekeeper.adapters import sb3

    venv = made("two_robot_line", 2, engine=engine)
    model = PPO("MlpPolicy", venv, n_steps=16, batch_size=32, device="cpu", **sb3.buffer(venv))
    model.learn(64)
    model.save(tmp_path / "model")
    path = tmp_path / "model.zip"
    with zipfile.ZipFile(path) as file:
        assert b"TwoRobotLine" not in base64.b64decode(
            json.loads(file.read("data"))["rollout_buffer_kwargs"][":serialized:"]
        )
    try:
        with pytest.raises(SpecError, match="doesn't know which agents acted"):
            PPO.load(path, env=venv, device="cpu").learn(32)
        again = PPO.load(path, env=venv, device="cpu", **sb3.buffer(venv))
        again.learn(32, reset_num_timesteps=False)
        assert again.num_timesteps == 128
    finally:
        venv.close()


def test_buffer_leaves_no_batch_of_one() -> None:
    """sb3-contrib divides by a batch's deviation: of one decision it would be no number."""
    from sb3_contrib import MaskablePPO

    from gamekeeper.adapters import sb3

    venv = made(FOUR, 1)
    more = sb3.buffer(venv, masked=True)
    for steps in (16, 17, 18):  # a decision of who waits at the end is left out, so one of 16 or 17
        model = MaskablePPO(
            "MlpPolicy", venv, n_steps=steps, batch_size=2, n_epochs=1, device="cpu", **more
        )
        model.learn(steps)
        assert {len(batch.actions) for batch in model.rollout_buffer.get(2)} == {2}
        weights = model.policy.state_dict().values()
        assert all(bool(weight.isfinite().all()) for weight in weights)
    model = MaskablePPO("MlpPolicy", venv, n_steps=2, batch_size=2, device="cpu", **more)
    with pytest.raises(SpecError, match="1 decisions were made"):
        model.learn(2)
    venv.close()


def test_one_empty_info_is_never_written_into() -> None:
    """Slots that haven't ended share it; another info in its place stays in its step and slot."""
    venv = made("warehouse", 2)
    venv.reset()
    *_, infos = venv.step(venv.action_masks().argmax(1))
    writes: list[Any] = [
        lambda info: info.__setitem__("note", 1),
        lambda info: info.update(note=1),
        lambda info: info.setdefault("note", 1),
        lambda info: info.__ior__({"note": 1}),
    ]
    for write in writes:
        with pytest.raises(SpecError, match="share one info"):
            write(infos[0])
    infos[0] = {"note": 1}
    own = deepcopy(infos)
    *_, later = venv.step(venv.action_masks().argmax(1))
    assert own == infos == [{"note": 1}, *[{}] * (venv.num_envs - 1)]
    assert later == [{}] * venv.num_envs
    venv.close()


def test_decisions_are_shared_out_evenly() -> None:
    """A few that are left over would move the network as far as a whole batch does."""
    from sb3_contrib import MaskablePPO

    from gamekeeper.adapters import sb3

    venv = made(FOUR, 3)  # a decision of each that waits at the end is left out
    more = sb3.buffer(venv, masked=True)
    model = MaskablePPO("MlpPolicy", venv, n_steps=40, batch_size=100, device="cpu", **more)
    model.learn(venv.num_envs * 40)
    sizes = [len(batch.actions) for batch in model.rollout_buffer.get(100)]
    assert len(sizes) == 2
    assert max(sizes) - min(sizes) <= 1
    venv.close()


def test_drawn_actions_leave_torchs_generator_alone() -> None:
    """Whoever learns meanwhile draws the same; a stream gives its actions, to a copy too."""
    import torch
    from stable_baselines3 import PPO

    from gamekeeper.adapters import sb3

    venv = made(SPREAD, 1)
    model = PPO("MlpPolicy", venv, n_steps=8, batch_size=8, device="cpu", seed=0)
    plays = sb3.policy(model, deterministic=False)
    torch.manual_seed(3)
    before = torch.get_rng_state()
    seen = venv.reset()[0]
    copied = deepcopy(plays)
    assert copied.model.policy is plays.model.policy
    assert copied.model.action_space is not plays.model.action_space
    drawn = [
        [each(seen, "agent_0", {}, rng) for _ in range(20)]
        for each, rng in zip(
            (plays, copied, plays), map(np.random.default_rng, (1, 1, 2)), strict=True
        )
    ]
    assert torch.equal(before, torch.get_rng_state())
    assert drawn[0] == drawn[1] != drawn[2]
    assert len(set(drawn[0])) > 1
    venv.close()


def test_truncation_is_bootstrapped_and_termination_isnt() -> None:
    """Walkers fall or are stopped: who was stopped gets what was expected of its last place."""
    from stable_baselines3 import PPO

    from gamekeeper.adapters import sb3

    venv = made(f"{WORLDS}:Walk", 4, seed=1)
    model = PPO(
        "MlpPolicy", venv, n_steps=40, batch_size=32, device="cpu", seed=0, **sb3.buffer(venv)
    )
    paid, ends, step = [], [], venv.step_wait

    def noted() -> Any:
        obs, rewards, dones, infos = step()
        paid.append(rewards.copy())
        ends.append([info.get("TimeLimit.truncated") for info in infos])
        return obs, rewards, dones, infos

    venv.step_wait = noted
    kept: list[Any] = []
    compute = model.rollout_buffer.compute_returns_and_advantage
    model.rollout_buffer.compute_returns_and_advantage = lambda **told: (
        kept.append(model.rollout_buffer.rewards.copy()),
        compute(**told),
    )
    model.learn(40 * venv.num_envs)
    added = kept[0] - np.array(paid)[:40]
    flags = np.array(ends[:40], object)
    assert (flags == True).any()  # noqa: E712  # None, False and True stand in it
    assert (flags == False).any()  # noqa: E712
    assert (added[flags == True] != 0).all()  # noqa: E712
    assert not added[flags != True].any()  # noqa: E712
    venv.close()


def test_model_that_isnt_there_is_named() -> None:
    """The file's name and what was looked for."""
    from gamekeeper.adapters import sb3

    with pytest.raises(PolicyError, match="no such model"):
        sb3.policy("nowhere/model.zip")


def test_callbacks_evaluate_and_record(tmp_path: Path) -> None:
    """Each agent's and each role's mean over episodes; evidence that names the policy's version."""
    from stable_baselines3 import PPO

    from gamekeeper.adapters import sb3

    venv = made(TAG, 2, role="adversary", others="random")
    one = {"role": "adversary", "others": "random", "episodes": 2}
    evaluates = sb3.EvalCallback(TAG, every=128, best_path=tmp_path / "best", **one)
    records = sb3.RecordCallback(TAG, tmp_path / "runs", every=128, **one)
    model = PPO(
        "MlpPolicy",
        venv,
        n_steps=32,
        batch_size=64,
        n_epochs=1,
        device="cpu",
        seed=0,
        **sb3.buffer(venv),
    )
    model.learn(venv.num_envs * 64, callback=[evaluates, records])
    venv.close()

    step, returns = evaluates.history[0]
    assert step >= 128
    assert set(returns) == {"adversary_0", "adversary_1", "adversary_2", "agent_0"}
    assert {len(values) for values in returns.values()} == {2}
    assert (tmp_path / "best.zip").exists()
    runs = sorted((tmp_path / "runs").iterdir())
    versions = {gk.load(run).episode_table.to_pylist()[0]["policies"] for run in runs}
    assert len(versions) == len(runs) >= 3
    assert gk.replay(runs[-1]).verified


def test_broken_environment_isnt_trained_on(tmp_path: Path) -> None:
    """The quick audit comes first, once for each source; `check=None` lets it pass."""
    from gamekeeper.adapters import sb3

    file = tmp_path / "leaky.py"
    file.write_text(BROKEN, encoding="utf-8")
    with pytest.raises(ContractError, match="breaks its contract"):
        sb3.vec_env(f"{file}:Leaky", 1)
    sb3.vec_env(f"{file}:Leaky", 1, check=None).close()


def test_sound_environment_is_audited_once(capsys: pytest.CaptureFixture[str]) -> None:
    """The second time nothing is said, and nothing is waited for."""
    from gamekeeper.adapters import sb3

    for _ in range(2):
        sb3.vec_env("two_robot_line", 1).close()
    assert capsys.readouterr().err.count("audits") == 1


def test_unread_masks_and_waiting_slots_are_named(capsys: pytest.CaptureFixture[str]) -> None:
    """A learner without the adapter's buffer, or without an eye on masks, hears of both."""
    from examples.sb3_own import Lanes
    from gamekeeper.adapters import sb3

    venv = made(Lanes, 4)
    venv.reset()
    capsys.readouterr()
    while venv.slots.acting.all():
        venv.step(venv.action_masks().argmax(1))
    venv.step(venv.action_masks().argmax(1))
    assert capsys.readouterr().err.count("**sb3.buffer(venv)") == 1
    sb3.buffer(venv, masked=True)
    assert capsys.readouterr().err == ""
    sb3.buffer(venv)
    assert "MaskablePPO alone reads them" in capsys.readouterr().err
    while venv.action_masks().all():
        venv.step(venv.action_masks().argmax(1))
    with pytest.raises(ActionError, match=r"(?s)'gatherer_.' did what is masked out.*MaskablePPO"):
        venv.step(venv.action_masks().argmin(1))
    venv.close()


def test_example_runs(monkeypatch: Any, capsys: pytest.CaptureFixture[str]) -> None:
    """Its one line, after few steps."""
    from examples.sb3_tictactoe import main

    monkeypatch.setattr("sys.argv", ["sb3_tictactoe.py", "--quick"])
    assert main() == 0
    line = json.loads(capsys.readouterr().out)
    assert line["task"] == "tictactoe"
    assert line["result"] > 0.0


@pytest.mark.parametrize("way", ["dict", "image"])
def test_own_example_runs(way: str, monkeypatch: Any, capsys: pytest.CaptureFixture[str]) -> None:
    """Saved, loaded, learnt on, recorded, replayed; a few steps teach it nothing yet."""
    from examples.sb3_own import main

    monkeypatch.setattr("sys.argv", ["sb3_own.py", "--quick", "--way", way])
    assert main() == 0
    line = json.loads(capsys.readouterr().out)
    assert line["replayed"]
    assert line["interval"] is None


BROKEN = '''
import numpy as np
from gymnasium.spaces import Box, Discrete
from pettingzoo import ParallelEnv


class Leaky(ParallelEnv):
    """Draws from the global generator, and pays what lies outside every promise."""

    metadata = {"name": "leaky_v0", "render_modes": []}

    def __init__(self):
        self.possible_agents = ["a_0", "a_1"]
        self.render_mode = None

    def observation_space(self, agent):
        return Box(0, 1, (1,), np.float32)

    def action_space(self, agent):
        return Discrete(2)

    def reset(self, seed=None, options=None):
        self.agents = list(self.possible_agents)
        self.left = 10
        return self._seen(), {a: {} for a in self.agents}

    def _seen(self):
        return {a: np.random.random(1).astype(np.float32) * 3 for a in self.agents}

    def step(self, actions):
        self.left -= 1
        out = dict.fromkeys(self.agents, 0.0)
        ends = dict.fromkeys(self.agents, self.left == 0)
        seen = self._seen()
        infos = {a: {} for a in self.agents}
        no = dict.fromkeys(self.agents, False)
        if self.left == 0:
            self.agents = []
        return seen, out, no, ends, infos
'''
