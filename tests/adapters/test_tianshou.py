"""Tianshou collects what each agent decided, with all that it brought: ends, masks, credit."""

from __future__ import annotations

import json
import sys
from typing import Any

import numpy as np
import pytest

import gamekeeper as gk
from gamekeeper.errors import ActionError, PolicyError, SpecError
from tests.adapters.tianshou_play import LEAVES, TIRED, Echo, first_legal, made
from tests.vector.doors import SAYS
from tests.vector.doors import SPEC as DOORS

pytestmark = [
    pytest.mark.trainer,
    # Of Tianshou itself and what it stands on, as they are imported.
    pytest.mark.filterwarnings("ignore::DeprecationWarning:tianshou.*"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning:sensai.*"),
]


def collected(env: Any, episodes: int) -> tuple[Any, Any]:
    """Stats and buffer of so many episodes."""
    from gamekeeper.adapters.tianshou import Collector

    collector = Collector(first_legal(env), env)
    collector.reset()
    stats = collector.collect(n_episode=episodes)
    return stats, collector.buffer


def rows(buffer: Any, slot: int) -> Any:
    """What a slot's part of a buffer holds, in the order in which it came."""
    part = buffer.buffers[slot]
    return part[np.arange(len(part))] if len(part) else None


def bare(observation: Any) -> Any:
    """Without its mask."""
    return observation["observation"] if isinstance(observation, dict) else observation


@pytest.mark.parametrize(
    ("spec", "kwargs"),
    [
        ("warehouse", TIRED),
        ("two_robot_line", {}),
        ("speaker_listener", {}),
        ("tictactoe", {}),
        ("handover", {"debug": True}),
        (LEAVES, {}),
    ],
)
def test_trace_is_the_same_seen_through_it(spec: str, kwargs: Any) -> None:
    """Each agent's decisions of one episode: what it saw, did, was paid, and how it ended."""
    several = spec == "speaker_listener"
    options = {"algorithms": "role"} if several else {}
    env = made(spec, 1, env_kwargs=kwargs, seed=5, **options)
    stats, buffer = collected(env, 1)
    evidence = gk.rollout(spec, policies="first-legal", episodes=1, seed=5, env_kwargs=kwargs)
    episode = evidence.episodes[0]
    ends = episode.steps.to_pylist()
    for slot, agent in enumerate(env.slots.learners):
        mine = [t for t in episode.turns if t.actions.get(agent) is not None]
        found = rows(buffer, slot)
        if not mine:
            assert found is None
            continue
        seen = found.obs if isinstance(found.obs, np.ndarray) else found.obs.obs
        assert len(seen) == len(mine)
        for turn, row, act in zip(mine, seen, found.act, strict=True):
            expected = np.asarray(bare(turn.observations[agent]))
            np.testing.assert_array_equal(expected, row[: len(expected)])
            assert act == turn.actions[agent]
        paid = sum(float(turn.rewards.get(agent, 0.0)) for turn in episode.turns)
        rewards = found.rew.sum(-1) if several else found.rew
        assert rewards.sum() == pytest.approx(paid)
        assert stats.returns[0, slot] == pytest.approx(paid)
        last = [t.observations[agent] for t in episode.turns if agent in t.observations][-1]
        after = found.obs_next if isinstance(found.obs_next, np.ndarray) else found.obs_next.obs
        np.testing.assert_array_equal(bare(last), after[-1][: len(bare(last))])
        assert not found.done[:-1].any()
        assert found.terminated[-1] == any(r["terminated"] for r in ends if r["agent"] == agent)
        assert found.truncated[-1] == any(r["truncated"] for r in ends if r["agent"] == agent)
    env.close()


def test_what_follows_a_decision_is_what_its_agent_saw_then() -> None:
    """Not what the other player sees, as in Tianshou's own collector."""
    env = made("tictactoe", 1)
    _, buffer = collected(env, 1)
    for slot in range(2):
        found = rows(buffer, slot)
        np.testing.assert_array_equal(found.obs_next.obs[:-1], found.obs.obs[1:])
        np.testing.assert_array_equal(found.obs_next.mask[:-1], found.obs.mask[1:])
    env.close()


def test_reward_belongs_to_who_earned_it() -> None:
    """Who loses is paid while the other moves: that stands with its own last move."""
    env = made("tictactoe", 1)
    stats, buffer = collected(env, 1)
    last = [float(rows(buffer, slot).rew[-1]) for slot in range(2)]
    assert last == stats.returns[0].tolist()
    assert sorted(last) == [-1.0, 1.0]
    env.close()


def test_late_and_dead_agents_have_rows_for_their_decisions_only() -> None:
    """Spares that came in the middle begin there; nothing stands after an end."""
    env = made("warehouse", 1, env_kwargs=TIRED, seed=1)
    stats, buffer = collected(env, 1)
    lengths = [len(part) for part in buffer.buffers]
    assert all(0 < length < stats.lens[0] for length in lengths)
    assert all(rows(buffer, slot).done[-1] for slot, n in enumerate(lengths) if n)
    assert not any(rows(buffer, slot).done[:-1].any() for slot, n in enumerate(lengths) if n)
    env.close()


def test_roles_with_different_spaces_are_padded() -> None:
    """A speaker's 3 numbers and words beside a listener's 11 numbers and 5 moves."""
    env = made("speaker_listener", 2, algorithms="role")
    assert env.agents == ["speaker", "listener"]
    assert env.observation_space.shape == (11,)
    given, _ = env.reset()
    assert given.agent_id.tolist() == ["speaker", "listener"] * 2
    assert given.mask.tolist() == [[True] * 3 + [False] * 2, [True] * 5] * 2
    assert not given.obs[0, 3:].any()
    env.close()


def test_episodes_are_the_first_of_the_run() -> None:
    """However long each is, and whatever the number of copies; the same ones with `repeats`."""
    one, _ = collected(made("handover", 1, seed=3, env_kwargs={"debug": True}), 5)
    env = made("handover", 3, seed=3, env_kwargs={"debug": True}, repeats=True)
    many, _ = collected(env, 5)
    np.testing.assert_array_equal(one.returns, many.returns)
    np.testing.assert_array_equal(one.lens, many.lens)
    again, _ = collected(env, 5)
    np.testing.assert_array_equal(many.returns, again.returns)
    env.close()


def test_next_reset_begins_the_next_run() -> None:
    """So that training doesn't play the same episodes again; a seed begins that run."""
    env, same = made("speaker_listener", 2, seed=3, algorithms="role"), None
    first, second = env.reset()[0].obs, env.reset()[0].obs
    same = env.reset(seed=3)[0].obs
    assert not np.array_equal(first, second)
    np.testing.assert_array_equal(first, same)
    env.close()


def test_steps_go_on_where_the_last_ones_stopped() -> None:
    """Decisions that were open are finished in the next collection, with all that was paid."""
    from gamekeeper.adapters.tianshou import Collector

    env, whole = made("tictactoe", 1, seed=2), made("tictactoe", 1, seed=2)
    parts = Collector(first_legal(env), env)
    parts.reset()
    rewards: list[float] = []
    for _ in range(12):
        parts.collect(n_step=1)
        rewards += parts.buffer[:].rew.tolist()
        parts.reset_buffer(keep_statistics=True)
    at_once = Collector(first_legal(whole), whole)
    at_once.reset()
    at_once.collect(n_step=len(rewards))
    assert sum(rewards) == pytest.approx(at_once.buffer[:].rew.sum())


def test_steps_are_decisions_and_lengths_those_of_copies() -> None:
    """Two agents decide in each tick: an episode of one tick has two decisions."""
    env = made(Echo, 2)
    stats, _ = collected(env, 4)
    assert (stats.n_collected_steps, stats.lens.tolist()) == (8, [1] * 4)
    env.close()


def test_refused_environment_is_closed() -> None:
    """What was opened for a wish that can't be met doesn't stay open."""
    before = Echo.closed
    with pytest.raises(SpecError, match="with the role"):
        made(Echo, 2, role="pilot")
    assert Echo.closed - before >= 2


def test_one_role_learns_while_others_follow() -> None:
    """Only its agents have slots; the others play as they were told."""
    env = made("warehouse", role="picker", others={"carrier": "reference"}, env_kwargs=TIRED)
    stats, _ = collected(env, 2)
    assert env.slots.learners == ["picker_0", "picker_1"]
    assert stats.returns.shape == (2, 2)
    env.close()


def test_what_cant_be_is_refused() -> None:
    """Each says where, and how to fix it."""
    import torch
    from tianshou.algorithm.algorithm_base import Policy
    from tianshou.data import Batch, Collector, ReplayBuffer
    from tianshou.utils.net.common import Net
    from tianshou.utils.net.discrete import DiscreteActor

    from gamekeeper.adapters import tianshou

    env = made("two_robot_line")
    theirs = Collector(first_legal(env), env)
    theirs.reset()
    with pytest.raises(SpecError, match="every slot for an environment"):
        theirs.collect(n_step=4)
    with pytest.raises(SpecError, match="part of the buffer"):
        tianshou.Collector(first_legal(env), env, ReplayBuffer(10))
    with pytest.raises(SpecError, match="needs an environment of vector_env"):
        tianshou.Collector(first_legal(env), object())  # type: ignore[arg-type]  # refused
    with pytest.raises(SpecError, match="no policy"):
        made("warehouse", role="picker")
    with pytest.raises(SpecError, match="has no such value"):
        made("two_robot_line", algorithms="two")
    with pytest.raises(SpecError, match="can't be masked"):
        tianshou.masked(DiscreteActor(preprocess_net=Net(state_shape=1), action_shape=2))

    class Remembers(Policy):
        def forward(self, batch: Any, state: Any = None, **kwargs: Any) -> Any:
            return Batch(act=torch.zeros(len(batch.obs)), state=torch.zeros(len(batch.obs), 3))

    collector = tianshou.Collector(Remembers(action_space=env.action_space), env)
    collector.reset()
    with pytest.raises(SpecError, match="hidden state"):
        collector.collect(n_step=4)
    tag = made("warehouse", role="picker", others="random", env_kwargs=TIRED)
    with pytest.raises(PolicyError, match="that learnt"):
        tianshou.policy(first_legal(tag), tag)(None, "carrier_0", {}, None)


def test_environment_is_audited_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """What it is made with too; `check=None` lets it pass."""
    from gamekeeper.adapters import tianshou

    asked: list[Any] = []
    monkeypatch.setattr(
        sys.modules[tianshou.vector_env.__module__],
        "checked",
        lambda spec, check, *, env_kwargs: asked.append((spec, check, env_kwargs)),
    )
    tianshou.vector_env("two_robot_line", 1, env_kwargs={"n": 4}).close()
    assert asked == [("two_robot_line", "quick", {"n": 4})]


def test_example_prints_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A few steps of a PPO that plays both sides."""
    from examples import tianshou_tictactoe as example

    monkeypatch.setattr("sys.argv", ["tianshou_tictactoe.py", "--quick", "--seed", "3"])
    assert example.main() == 0
    (line,) = capsys.readouterr().out.splitlines()
    told = json.loads(line)
    assert (told["example"], told["task"], told["seed"]) == ("tianshou_tictactoe", "tictactoe", 3)
    assert told["steps"] >= 128
    assert 0.0 <= told["result"] <= 1.0


def test_forbidden_action_is_named() -> None:
    """An actor that reads no masks: the agent, what it might have done, and the fix."""
    env = made(DOORS, 1)
    env.reset(seed=0)
    with pytest.raises(ActionError, match=SAYS):
        env.slots.step(np.array([[1, 0]]))
    env.close()
