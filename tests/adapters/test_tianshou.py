"""Tianshou collects what each agent decided, with all that it brought: ends, masks, credit."""

from __future__ import annotations

import json
import sys
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

import gamekeeper as gk
from gamekeeper.errors import PolicyError, SpecError

pytestmark = [
    pytest.mark.trainer,
    # Of Tianshou itself and what it stands on, as they are imported.
    pytest.mark.filterwarnings("ignore::DeprecationWarning:tianshou.*"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning:sensai.*"),
]

SPREAD = "mpe2.simple_spread_v3:parallel_env"
TIRED = {"pickers": 1, "carriers": 1, "battery": 12, "horizon": 40, "debug": True}
"""Robots that run empty one by one, each followed by a spare."""


def made(spec: object, num_envs: int = 2, **options: Any) -> Any:
    """Without an audit, which has tests of its own."""
    from gamekeeper.adapters import tianshou

    return tianshou.vector_env(spec, num_envs, check=None, **options)


def first_legal(env: Any) -> Any:
    """A policy that takes the first legal action."""
    import torch
    from tianshou.algorithm.algorithm_base import Policy
    from tianshou.data import Batch

    class FirstLegal(Policy):
        def forward(self, batch: Any, state: Any = None, **kwargs: Any) -> Any:
            obs = batch.obs
            count = len(obs.agent_id) if isinstance(obs, Batch) else len(obs)
            acts = np.argmax(obs.mask, -1) if isinstance(obs, Batch) else np.zeros(count, int)
            return Batch(act=torch.as_tensor(acts))

    return FirstLegal(action_space=env.action_space)


def collected(env: Any, episodes: int) -> tuple[Any, Any]:
    """Stats and buffer of so many episodes."""
    from gamekeeper.adapters.tianshou import Collector

    collector = Collector(first_legal(env), env)
    collector.reset()
    stats = collector.collect(n_episode=episodes)
    return stats, collector.buffer


def rows(buffer: Any, seat: int) -> Any:
    """What a seat's part of a buffer holds, in the order in which it came."""
    part = buffer.buffers[seat]
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
    ],
)
def test_trace_is_the_same_seen_through_it(spec: str, kwargs: Any) -> None:
    """Each agent's decisions of one episode: what it saw, did, was paid, and how it ended."""
    several = spec == "speaker_listener"
    options = {"algorithms": "role"} if several else {}
    env = made(spec, 1, env_kwargs=kwargs, seed=5, **options)
    stats, buffer = collected(env, 1)
    evidence = gk.rollout(spec, policies="first-legal", episodes=1, seed=5, env_kwargs=kwargs)
    trace = next(iter(evidence.traces))
    ends = trace.steps.to_pylist()
    for seat, agent in enumerate(env.seats.learners):
        mine = [t for t in trace.turns if t.actions.get(agent) is not None]
        found = rows(buffer, seat)
        if not mine:
            assert found is None
            continue
        seen = found.obs if isinstance(found.obs, np.ndarray) else found.obs.obs
        assert len(seen) == len(mine)
        for turn, row, act in zip(mine, seen, found.act, strict=True):
            expected = np.asarray(bare(turn.observations[agent]))
            np.testing.assert_array_equal(expected, row[: len(expected)])
            assert act == turn.actions[agent]
        paid = sum(float(turn.rewards.get(agent, 0.0)) for turn in trace.turns)
        rewards = found.rew.sum(-1) if several else found.rew
        assert rewards.sum() == pytest.approx(paid)
        assert stats.returns[0, seat] == pytest.approx(paid)
        assert not found.done[:-1].any()
        assert found.terminated[-1] == any(r["terminated"] for r in ends if r["agent"] == agent)
        assert found.truncated[-1] == any(r["truncated"] for r in ends if r["agent"] == agent)
    env.close()


def test_what_follows_a_decision_is_what_its_agent_saw_then() -> None:
    """Not what the other player sees, as in Tianshou's own collector."""
    env = made("tictactoe", 1)
    _, buffer = collected(env, 1)
    for seat in range(2):
        found = rows(buffer, seat)
        np.testing.assert_array_equal(found.obs_next.obs[:-1], found.obs.obs[1:])
        np.testing.assert_array_equal(found.obs_next.mask[:-1], found.obs.mask[1:])
    env.close()


def test_reward_belongs_to_who_earned_it() -> None:
    """Who loses is paid while the other moves: that stands with its own last move."""
    env = made("tictactoe", 1)
    stats, buffer = collected(env, 1)
    last = [float(rows(buffer, seat).rew[-1]) for seat in range(2)]
    assert last == stats.returns[0].tolist()
    assert sorted(last) == [-1.0, 1.0]
    env.close()


def test_late_and_dead_agents_have_rows_for_their_decisions_only() -> None:
    """Spares that came in the middle begin there; nothing stands after an end."""
    env = made("warehouse", 1, env_kwargs=TIRED, seed=1)
    stats, buffer = collected(env, 1)
    lengths = [len(part) for part in buffer.buffers]
    assert all(0 < length < stats.lens[0] for length in lengths)
    assert all(rows(buffer, seat).done[-1] for seat, n in enumerate(lengths) if n)
    assert not any(rows(buffer, seat).done[:-1].any() for seat, n in enumerate(lengths) if n)
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


def ppo(env: Any, hidden: int = 8, lr: float = 1e-3, **options: Any) -> Any:
    """A small PPO for one of the environment's agents."""
    from tianshou.algorithm import PPO
    from tianshou.algorithm.modelfree.reinforce import DiscreteActorPolicy
    from tianshou.algorithm.optim import AdamOptimizerFactory
    from tianshou.utils.net.common import Net
    from tianshou.utils.net.discrete import DiscreteActor, DiscreteCritic

    from gamekeeper.adapters.tianshou import masked, unmasked

    shape, actions = env.observation_space.shape, int(env.action_space.n)
    nets = [Net(state_shape=shape, hidden_sizes=[hidden]) for _ in range(2)]
    actor: Any = DiscreteActor(preprocess_net=nets[0], action_shape=actions, softmax_output=False)
    critic: Any = DiscreteCritic(preprocess_net=nets[1])
    if env.seats.masks is not None:
        actor, critic = masked(actor), unmasked(critic)
    policy = DiscreteActorPolicy(actor=actor, action_space=env.action_space, **options)
    return PPO(policy=policy, critic=critic, optim=AdamOptimizerFactory(lr=lr))


@pytest.mark.parametrize(
    ("spec", "algorithms", "kwargs"),
    [
        ("warehouse", "one", TIRED),
        (SPREAD, "one", {}),
        (SPREAD, "agent", {}),
        ("speaker_listener", "role", {}),
        ("tictactoe", "agent", {}),
    ],
)
def test_ppo_trains(spec: str, algorithms: str, kwargs: Any) -> None:
    """A few updates by Tianshou's trainer, with tests of whole episodes; then it plays."""
    from tianshou.algorithm.multiagent.marl import MultiAgentOnPolicyAlgorithm
    from tianshou.trainer import OnPolicyTrainerParams

    from gamekeeper.adapters import tianshou

    env = made(spec, algorithms=algorithms, env_kwargs=kwargs)
    tests = made(spec, algorithms=algorithms, env_kwargs=kwargs, repeats=True, seed=9)
    each = [ppo(env) for _ in env.agents]
    learner = MultiAgentOnPolicyAlgorithm(algorithms=each, env=env) if env.is_multi else each[0]
    before = tianshou.policy(learner, env).version
    info = learner.run_training(
        OnPolicyTrainerParams(
            training_collector=tianshou.Collector(learner, env),
            test_collector=tianshou.Collector(learner, tests),
            test_step_num_episodes=2,
            max_epochs=1,
            epoch_num_steps=64,
            collection_step_num_env_steps=32,
            batch_size=16,
            update_step_num_repetitions=1,
            show_progress=False,
            verbose=False,
        )
    )
    assert info.train_step >= 64
    assert info.test_episode == 4
    learnt = tianshou.policy(learner, env)
    assert learnt.version != before
    evidence = gk.rollout(spec, policies=learnt, episodes=1, seed=0, env_kwargs=kwargs)
    assert learnt.version in evidence.episodes.to_pylist()[0]["policies"]


def test_parts_of_a_policy_know_that_they_are_learning() -> None:
    """Tianshou tells only the whole: its parts would take the likeliest action, or no noise."""
    from tianshou.algorithm.multiagent.marl import MultiAgentOnPolicyAlgorithm

    from gamekeeper.adapters import tianshou

    env = made("tictactoe", algorithms="agent")
    learner = MultiAgentOnPolicyAlgorithm(algorithms=[ppo(env) for _ in env.agents], env=env)
    collector = tianshou.Collector(learner, env)
    collector.reset()
    for learns in (True, False):
        learner.policy.is_within_training_step = learns
        collector.collect(n_step=2)
        parts = learner.policy.policies.values()
        assert [part.is_within_training_step for part in parts] == [learns, learns]


class Echo(gk.TickEnv):
    """One tick: who answers with the number that it sees, plus its own place, is paid 1."""

    metadata = {"name": "echo_v0"}  # noqa: RUF012  # PettingZoo declares it so
    closed = 0

    def __init__(self) -> None:
        super().__init__()
        self.possible_agents = ["a_0", "a_1"]
        seen = {"observation": spaces.Box(0, 1, (4,), np.float32),
                "action_mask": spaces.MultiBinary(6)}  # fmt: skip
        self.observation_spaces = dict.fromkeys(self.possible_agents, spaces.Dict(seen))
        self.action_spaces = dict.fromkeys(self.possible_agents, spaces.Discrete(6))

    def start(self, rng: Any, options: Any) -> None:
        self.told = {agent: int(rng.integers(4)) for agent in self.possible_agents}

    def tick(self, actions: Any) -> None:
        for place, (agent, action) in enumerate(actions.items()):
            self.pay(agent, float(action == (self.told[agent] + place) % 4))
            self.terminate(agent)

    def observe(self, agent: Any) -> Any:
        seen = np.eye(4, dtype=np.float32)[self.told[agent]]
        return {"observation": seen, "action_mask": np.array([1, 1, 1, 1, 0, 0], np.int8)}

    def close(self) -> None:
        Echo.closed += 1
        super().close()


def test_each_part_learns_what_is_its_own() -> None:
    """Right answers that differ from agent to agent are soon known: credit, masks, both nets."""
    import torch
    from tianshou.algorithm.multiagent.marl import MultiAgentOnPolicyAlgorithm
    from tianshou.trainer import OnPolicyTrainerParams

    from gamekeeper.adapters import tianshou

    torch.manual_seed(0)
    env = made(Echo, 8, algorithms="agent")
    learner = MultiAgentOnPolicyAlgorithm(
        algorithms=[ppo(env, hidden=32, lr=1e-2) for _ in env.agents], env=env
    )
    learner.run_training(
        OnPolicyTrainerParams(
            training_collector=tianshou.Collector(learner, env),
            max_epochs=1,
            epoch_num_steps=1_536,
            collection_step_num_env_steps=256,
            batch_size=64,
            update_step_num_repetitions=4,
            show_progress=False,
            verbose=False,
        )
    )
    evidence = gk.rollout(Echo, policies=tianshou.policy(learner, env), episodes=25, seed=9)
    paid = [row["reward"] for row in evidence.steps.to_pylist() if row["reward"] is not None]
    assert sum(paid) >= 48  # of 50; chance has 12
    env.close()


def test_drawn_actions_are_drawn() -> None:
    """Whatever `deterministic_eval` says, and without a draw from anybody's generator."""
    import torch

    from gamekeeper.adapters import tianshou

    env = made("tictactoe", 1)
    learner = ppo(env, deterministic_eval=True)
    given, info = first_board()
    state = torch.random.get_rng_state()
    rng = np.random.default_rng(0)
    found = {}
    for deterministic in (True, False):
        policy = tianshou.policy(learner, env, deterministic=deterministic)
        found[deterministic] = {policy(given, "player_1", info, rng) for _ in range(30)}
    assert len(found[True]) == 1
    assert len(found[False]) > 3
    assert torch.equal(state, torch.random.get_rng_state())
    env.close()


def first_board() -> tuple[Any, Any]:
    """What the first player of tic-tac-toe is given."""
    game = gk.make("tictactoe")
    game.reset(seed=0)
    given, _, _, _, info = game.last()
    game.close()
    return given, info


def test_steps_are_decisions_and_lengths_those_of_copies() -> None:
    """Two agents decide in each tick: an episode of one tick has two decisions."""
    env = made(Echo, 2)
    stats, _ = collected(env, 4)
    assert (stats.n_collected_steps, stats.lens.tolist()) == (8, [1] * 4)
    env.close()


def test_refused_environment_is_closed() -> None:
    """What was opened for a wish that can't be met doesn't stay open."""
    before = Echo.closed
    with pytest.raises(SpecError, match="has the role"):
        made(Echo, 2, role="pilot")
    assert Echo.closed - before >= 2


def test_dqn_trains_on_masks() -> None:
    """Off-policy: masks of what follows too, and exploration within them."""
    from tianshou.algorithm import DQN
    from tianshou.algorithm.modelfree.dqn import DiscreteQLearningPolicy
    from tianshou.algorithm.optim import AdamOptimizerFactory
    from tianshou.trainer import OffPolicyTrainerParams
    from tianshou.utils.net.common import Net

    from gamekeeper.adapters import tianshou

    env = made("tictactoe")
    net = Net(state_shape=env.observation_space.shape, action_shape=9, hidden_sizes=[8])
    policy = DiscreteQLearningPolicy(model=net, action_space=env.action_space, eps_training=0.5)
    learner = DQN(policy=policy, optim=AdamOptimizerFactory(lr=1e-3), target_update_freq=10)
    collector = tianshou.Collector(learner, env, exploration_noise=True)
    learner.run_training(
        OffPolicyTrainerParams(
            training_collector=collector,
            max_epochs=1,
            epoch_num_steps=40,
            collection_step_num_env_steps=10,
            batch_size=8,
            show_progress=False,
            verbose=False,
        )
    )
    kept = collector.buffer[:]
    assert len(kept) >= 40
    assert kept.obs.mask[np.arange(len(kept)), kept.act].all()
    evidence = gk.rollout("tictactoe", policies=tianshou.policy(learner, env), episodes=1, seed=0)
    assert len(list(evidence.traces)) == 1


def test_one_role_learns_while_others_follow() -> None:
    """Only its agents have seats; the others play as they were told."""
    env = made("warehouse", role="picker", others={"carrier": "reference"}, env_kwargs=TIRED)
    stats, _ = collected(env, 2)
    assert env.seats.learners == ["picker_0", "picker_1"]
    assert stats.returns.shape == (2, 2)
    env.close()


def test_what_cant_be_is_refused() -> None:
    """Each says where, and how to mend it."""
    import torch
    from tianshou.algorithm.algorithm_base import Policy
    from tianshou.data import Batch, Collector, ReplayBuffer
    from tianshou.utils.net.common import Net
    from tianshou.utils.net.discrete import DiscreteActor

    from gamekeeper.adapters import tianshou

    env = made("two_robot_line")
    theirs = Collector(first_legal(env), env)
    theirs.reset()
    with pytest.raises(SpecError, match="every seat for an environment"):
        theirs.collect(n_step=4)
    with pytest.raises(SpecError, match="part of the buffer"):
        tianshou.Collector(first_legal(env), env, ReplayBuffer(10))
    with pytest.raises(SpecError, match="decisions of agents"):
        tianshou.Collector(first_legal(env), object())
    with pytest.raises(SpecError, match="no policy"):
        made("warehouse", role="picker")
    with pytest.raises(SpecError, match="no such share"):
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
    with pytest.raises(PolicyError, match="didn't learn"):
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
