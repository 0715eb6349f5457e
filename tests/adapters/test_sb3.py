"""Stable-Baselines3 sees what was played: ends, truncation, masks, credit, evidence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gamekeeper as gk
from gamekeeper.errors import ContractError, PolicyError, SpecError

pytestmark = pytest.mark.trainer
SPREAD = "mpe2.simple_spread_v3:parallel_env"
TAG = "mpe2.simple_tag_v3:parallel_env"
FOUR = "pettingzoo.classic.connect_four_v3:env"


def made(spec: object, num_envs: int, **options: Any) -> Any:
    """Without an audit, which has tests of its own."""
    from gamekeeper.adapters import sb3

    return sb3.vec_env(spec, num_envs, check=None, **options)


def played(venv: Any, choose: Any, steps: int) -> list[dict[str, Any]]:
    """What every slot was given and paid, step by step."""
    told, obs = [], venv.reset()
    for _ in range(steps):
        acted = venv.slots.acting.copy()
        actions = choose(venv, obs)
        following, rewards, dones, infos = venv.step(actions)
        told.append({
            "obs": obs, "actions": actions, "acted": acted, "rewards": rewards, "dones": dones,
            "infos": infos,
        })  # fmt: skip
        obs = following
    return told


def first_legal(venv: Any, obs: Any) -> Any:
    """The first action that each slot's mask allows; the last of all where there is none."""
    masks = venv.action_masks()
    if masks.size:
        return masks.argmax(axis=1)
    return np.full(venv.num_envs, venv.action_space.n - 1)


@pytest.mark.parametrize(
    ("spec", "role", "others"),
    [
        ("two_robot_line", None, None),
        ("warehouse", None, None),
        ("handover", None, None),
        (FOUR, None, None),
        (TAG, "adversary", "first-legal"),
    ],
)
def test_trace_is_the_same_seen_through_slots(spec: str, role: str | None, others: Any) -> None:
    """The first episode's rows, agent by agent: observations, actions, rewards, ends."""
    venv = made(spec, 2, role=role, others=others, seed=5)
    told = played(venv, first_legal, 260)
    learners = list(venv.slots.learners)
    policies = {"*": others or _Same(venv), **({role: _Same(venv)} if role else {})}
    trace = next(gk.rollout(spec, policies=policies, episodes=1, seed=5).traces)
    came = {name for turn in trace.turns for name in turn.received}
    for place, agent in enumerate(learners):
        if str(agent) not in came:  # a spare that nobody needed
            continue
        seen, paid, end = _stream(told, place)
        rows = [turn for turn in trace.turns if str(agent) in turn.actions]
        rows = [turn for turn in rows if turn.actions[str(agent)] is not None]
        recorded = [_bare(turn.observations[str(agent)]) for turn in rows]
        assert len(recorded) == len(seen)
        for one, two in zip(recorded, seen, strict=True):
            np.testing.assert_array_equal(one, two)
        total = sum(float(turn.rewards.get(str(agent), 0.0)) for turn in trace.turns)
        assert sum(paid) == pytest.approx(total, abs=1e-5)
        last = [turn for turn in trace.turns if str(agent) in turn.received][-1]
        assert end["TimeLimit.truncated"] == (str(agent) in _truncated(trace))
        np.testing.assert_array_equal(
            end["terminal_observation"], _bare(last.observations[str(agent)])
        )
    venv.close()


class _Same:
    """The policy of `first_legal`, one agent at a time."""

    def __init__(self, venv: Any) -> None:
        self.n = venv.action_space.n

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> int:
        mask = info.get("action_mask")
        if isinstance(observation, dict):
            mask = observation.get("action_mask", mask)
        return self.n - 1 if mask is None else int(np.argmax(mask))


def _bare(observation: Any) -> Any:
    if isinstance(observation, dict):
        return observation["observation"]
    return observation


def _stream(told: list[dict[str, Any]], slot: int) -> tuple[list[Any], list[float], Any]:
    """What one slot saw as it acted and was paid, until its first end."""
    seen, paid = [], []
    for step in told:
        if step["acted"][slot]:
            seen.append(step["obs"][slot])
        paid.append(float(step["rewards"][slot]))
        if step["dones"][slot]:
            return seen, paid, step["infos"][slot]
    raise AssertionError("no end in these steps")


def _truncated(trace: Any) -> set[str]:
    found: set[str] = set()
    for row in trace.steps.to_pylist():
        if row["truncated"] and not row["terminated"]:
            found.add(row["agent"])
    return found


def test_slots_of_dead_agents_say_that_nobody_acts() -> None:
    """An empty battery ends one robot; its slot shows zeros until the copy begins anew."""
    venv = made("warehouse", 2, env_kwargs={"battery": 6, "spares": 0})
    waited = 0
    for step in played(venv, lambda venv, obs: _random(venv), 120):
        gone = ~step["acted"]
        waited += int(gone.sum())
        assert not step["obs"][gone].any()
    assert waited > 0
    venv.close()


def _random(venv: Any, rng: Any = np.random.default_rng(0)) -> Any:  # noqa: B008  # one stream
    masks = venv.action_masks()
    return np.array([rng.choice(np.flatnonzero(mask)) for mask in masks])


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
    with pytest.raises(SpecError, match="nothing is set"):
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
        "MlpPolicy", venv, n_steps=32, batch_size=64, n_epochs=1, device="cpu", seed=0,
        **sb3.buffer(venv, masked=masked),
    )  # fmt: skip
    before = sb3.policy(model).version
    model.learn(venv.num_envs * 64)
    assert sb3.policy(model).version != before
    model.save(tmp_path / "model.zip")
    venv.close()

    evidence = gk.rollout(spec, policies=f"sb3:{tmp_path / 'model.zip'}", episodes=1, seed=0)
    named = evidence.episodes.to_pylist()[0]["policies"]
    assert f"{venv.num_envs * 64} steps" in named


def test_buffer_keeps_what_was_decided() -> None:
    """On a board of turns half of the slots wait: only decisions are learnt from."""
    from sb3_contrib import MaskablePPO

    from gamekeeper.adapters import sb3

    venv = made(FOUR, 3)
    model = MaskablePPO(
        "MlpPolicy", venv, n_steps=40, batch_size=16, n_epochs=1, device="cpu", seed=0,
        **sb3.buffer(venv, masked=True),
    )  # fmt: skip
    model.learn(venv.num_envs * 40)
    kept = model.rollout_buffer.buffer_size
    assert 3 * 40 - 3 <= kept <= 3 * 40
    assert len(next(model.rollout_buffer.get()).actions) == kept
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
        "MlpPolicy", venv, n_steps=32, batch_size=64, n_epochs=1, device="cpu", seed=0,
        **sb3.buffer(venv),
    )  # fmt: skip
    model.learn(venv.num_envs * 64, callback=[evaluates, records])
    venv.close()

    step, returns = evaluates.history[0]
    assert step >= 128
    assert set(returns) == {"adversary_0", "adversary_1", "adversary_2", "agent_0"}
    assert {len(values) for values in returns.values()} == {2}
    assert (tmp_path / "best.zip").exists()
    runs = sorted((tmp_path / "runs").iterdir())
    versions = {gk.load(run).episodes.to_pylist()[0]["policies"] for run in runs}
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
