"""RLlib sees what was played: each agent's end, truncation, masks, credit, seeds, turns."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Discrete

import gamekeeper as gk
from gamekeeper.errors import ActionError, ContractError, PolicyError, SpecError
from gamekeeper.randomness.seeds import episode_seed
from tests.adapters.rllib_books import (
    Ends,
    FirstLegal,
    Returns,
    bare,
    config,
    first_legal,
    made,
    noted_steps,
    played,
)
from tests.vector.doors import SAYS
from tests.vector.doors import SPEC as DOORS

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before torch: more threads only wait
os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")

pytestmark = [
    pytest.mark.trainer,
    # Foreign ones, by whose they are: Ray's and torch's own calls of what is deprecated.
    pytest.mark.filterwarnings("ignore::DeprecationWarning:ray"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning:torch"),
    # RLlib registers its own environment with Gymnasium anew for each env runner.
    pytest.mark.filterwarnings("ignore:.*Overriding environment rllib-multi-agent:UserWarning"),
]
BATTERY = {"battery": 12}


@pytest.mark.parametrize(
    ("spec", "kwargs"),
    [
        ("two_robot_line", {}),
        ("warehouse", BATTERY),
        ("warehouse_turns", BATTERY),
        ("handover", {}),
        ("tictactoe", {}),
        ("tag", {}),
    ],
)
def test_trace_is_the_same_seen_through_rllib(spec: str, kwargs: dict[str, Any]) -> None:
    """Each agent's rows, in RLlib's own book: observations, actions, pay, last sight, end."""
    episode = next(
        iter(
            gk.rollout(spec, policies=FirstLegal(), episodes=1, seed=5, env_kwargs=kwargs).episodes
        )
    )
    env = made(spec, seed=5, env_kwargs=kwargs)
    book = played(env)
    flags = {row["agent"]: row for row in episode.steps.to_pylist() if ended(row)}
    decided = {a for turn in episode.turns for a, act in turn.actions.items() if act is not None}
    assert decided == set(book.agent_ids)
    for agent, one in book.agent_episodes.items():
        rows = [turn for turn in episode.turns if turn.actions.get(agent) is not None]
        recorded = [bare(turn.observations[agent]) for turn in rows]
        last = [turn for turn in episode.turns if agent in turn.cumulative_reward][-1]
        recorded.append(bare(last.observations[agent]))
        for seen, shown in zip(recorded, one.get_observations(), strict=True):
            np.testing.assert_array_equal(seen, bare(shown))
        assert [turn.actions[agent] for turn in rows] == list(one.get_actions())
        paid = sum(float(turn.rewards.get(agent, 0.0)) for turn in episode.turns)
        assert one.get_return() == pytest.approx(paid)
        assert one.is_terminated == bool(flags[agent]["terminated"])
        assert one.is_truncated == bool(flags[agent]["truncated"])
        assert env.returns[agent] == pytest.approx(paid)
    env.close()


def ended(row: dict[str, Any]) -> bool:
    """Whether the row is of an agent's end."""
    return bool(row["terminated"] or row["truncated"])


def test_each_turn_is_paid_to_who_earned_it() -> None:
    """AEC: one agent is observed at a time, and its pay stands beside its own last action."""
    env = made("handover", seed=2)
    episode = gk.rollout("handover", policies=FirstLegal(), episodes=1, seed=2).episodes[0]
    observations, _ = env.reset()
    given: dict[str, list[float]] = {}
    is_over = False
    while not is_over:
        assert len(observations) == 1
        actions = {agent: first_legal(env, agent, seen) for agent, seen in observations.items()}
        observations, rewards, terms, truncs, _ = env.step(actions)
        assert set(rewards) == set(observations)
        for agent, paid in rewards.items():
            given.setdefault(agent, []).append(paid)
        is_over = terms["__all__"] or truncs["__all__"]
    for agent, cumulative_reward in given.items():
        told = [
            turn.cumulative_reward[agent]
            for turn in episode.turns
            if agent in turn.cumulative_reward
        ]
        told = [reward for reward in told if reward is not None]
        assert cumulative_reward == pytest.approx(told[-len(cumulative_reward) :])
    env.close()


def test_late_joiners_come_when_they_come() -> None:
    """A spare takes over from a robot whose battery is empty: nobody is asked before or after."""
    env = made("warehouse", seed=3, env_kwargs=BATTERY)
    rng = np.random.default_rng(0)

    def legal(env: Any, agent: str, seen: Any) -> int:
        return int(rng.choice(np.flatnonzero(seen["action_mask"])))

    book = played(env, legal)
    starts = {agent: book.env_t_to_agent_t[agent].data.index(0) for agent in book.agent_ids}
    lengths = {len(one) for one in book.agent_episodes.values()}
    assert max(starts.values()) > 0
    assert len(lengths) > 1
    assert all(one.is_truncated and not one.is_terminated for one in book.agent_episodes.values())
    env.close()


@pytest.mark.parametrize(
    ("plan", "joins"),
    [
        ({"a": (3, "trunc"), "b": (3, "trunc")}, {}),
        ({"a": (3, "term"), "b": (3, "term")}, {}),
        ({"a": (2, "trunc"), "b": (3, "term")}, {}),
        ({"a": (2, "term"), "b": (3, "trunc")}, {}),
        ({"a": (2, "term"), "b": (4, "trunc")}, {"b": 2}),
        ({"a": (2, "trunc"), "b": (4, "term"), "c": (4, "term")}, {"b": 2, "c": 3}),
    ],
)
def test_truncation_stays_apart_from_termination(plan: Any, joins: Any) -> None:
    """Also where all end at once, and where all who are known end as others join."""
    env = made(lambda: Ends(plan, joins))
    book = played(env)
    for agent, (at, how) in plan.items():
        one = book.agent_episodes[agent]
        assert (one.is_terminated, one.is_truncated) == (how == "term", how == "trunc")
        assert len(one) == at - joins.get(agent, 0) == one.get_return()
        assert one.get_observations(-1)[0] == at
    env.close()


def test_end_in_the_last_step_of_another_kind_counts_as_terminated() -> None:
    """One is terminated as the other is truncated: no value is bootstrapped for the first."""
    env = made(lambda: Ends({"a": (3, "term"), "b": (3, "trunc")}))
    one = played(env).agent_episodes
    assert one["a"].is_terminated
    assert (one["b"].is_terminated, one["b"].is_truncated) == (False, True)
    env.close()


def test_actions_count_from_zero() -> None:
    """RLlib draws from 0; the environment gets what its space says."""
    env = made(lambda: Ends({"a": (2, "term"), "b": (2, "term")}))
    played(env)
    assert env.action_spaces["a"] == Discrete(2)
    assert set(env.env.unwrapped.chosen) == {4}
    env.close()


@pytest.mark.parametrize("spec", ["warehouse", "tag"])
def test_roles_have_modules_of_their_own(spec: str) -> None:
    """Each reads what its agents see; the order is that of `possible_agents`."""
    from gamekeeper.adapters import rllib

    env, mapping = made(spec), rllib.policy_mapping(spec)
    assert env.possible_agents == list(env.env.possible_agents) == list(env.observation_spaces)
    assert list(mapping["policies"]) == list(dict.fromkeys(env.role_of.values()))
    for agent in env.possible_agents:
        policy = mapping["policies"][mapping["policy_mapping_fn"](agent, None)]
        assert policy.observation_space == env.observation_spaces[agent]
        assert policy.action_space == env.action_spaces[agent]
    spaces = {str(policy.observation_space) for policy in mapping["policies"].values()}
    assert len(spaces) == (2 if spec == "tag" else 1)
    env.close()


def test_others_play_inside() -> None:
    """One role learns; the others follow their policies, the episode is the one of a rollout."""
    from gamekeeper.adapters import rllib

    policies: dict[str, Any] = {"carrier": "reference", "picker": FirstLegal()}
    episode = gk.rollout("warehouse", policies=policies, episodes=1, seed=4).episodes[0]
    asked: Any = {"role": "picker", "others": {"carrier": "reference"}}
    assert list(rllib.policy_mapping("warehouse", **asked)["policies"]) == ["picker"]
    env = made("warehouse", seed=4, **asked)
    book = played(env)
    assert {agent.split("_")[0] for agent in book.agent_ids} == {"picker"}
    for agent, one in book.agent_episodes.items():
        paid = sum(float(turn.rewards.get(agent, 0.0)) for turn in episode.turns)
        assert one.get_return() == pytest.approx(paid)
    assert set(env.returns) == set(map(str, env.env.possible_agents))
    env.close()


@pytest.mark.parametrize(("opponent", "paid"), [("random", 1.0), ("reference", -1.0)])
def test_returns_are_told_of_the_others_too(opponent: str, paid: float) -> None:
    """Also what they are paid as the learner's episode is over: a board game sums to zero."""
    env = made("tictactoe", role="player_1", others={"player_2": opponent}, seed=1)
    played(env)
    assert env.returns == {"player_1": paid, "player_2": -paid}
    env.close()


def test_seeds_are_those_of_a_rollout() -> None:
    """Episode k has our seed; `reset(seed=s)` begins run s anew."""
    env = made("warehouse", seed=7)
    seen = [env.reset()[0] for _ in range(3)]
    again = [env.reset(seed=7)[0], env.reset()[0], env.reset()[0]]
    episodes = list(gk.rollout("warehouse", policies="noop", episodes=3, seed=7).episodes)
    for episode, one, two in zip(episodes, seen, again, strict=True):
        assert episode_seed(7, episode.episode) == episode.seed
        first = episode.turns[0].observations
        for agent in one:
            np.testing.assert_array_equal(first[agent], one[agent]["observations"])
            np.testing.assert_array_equal(first[agent], two[agent]["observations"])
    env.close()


def test_env_runners_play_disjoint_episodes() -> None:
    """Of two runners with two copies each, whatever seeds RLlib hands out, and after its look."""
    from ray.rllib.env.env_context import EnvContext
    from ray.tune.registry import ENV_CREATOR, _global_registry

    from gamekeeper.adapters import rllib

    name = rllib.register("two_robot_line", check=None, seed=1)
    numbers: list[int] = []
    for runner in (1, 2):
        create = _global_registry.get(ENV_CREATOR, name)  # as each runner gets its own
        copies = [create(EnvContext({}, runner, num_workers=2)) for _ in range(2)]
        copies[0].reset(seed=42, options={})  # RLlib's look, before the run
        assert copies[0].episode == -1
        for place, env in enumerate(copies):
            env.reset(seed=runner + place)
            numbers.append(env.episode)
        copies[0].reset()
        numbers.append(copies[0].episode)
    assert numbers == [0, 2, 4, 1, 3, 5]
    other = _global_registry.get(ENV_CREATOR, name)(EnvContext({"seed": 8}, 1, num_workers=2))
    other.reset()
    assert other.episode == 0


@pytest.mark.parametrize(
    ("call", "says", "fix"),
    [
        (lambda rllib: rllib.multi_agent_env("tag", role="wolf", check=None), "wolf", "adversary"),
        (lambda rllib: rllib.multi_agent_env("tag", role="agent", check=None), "policy", "others="),
        (
            lambda rllib: rllib.multi_agent_env("tag", others="random", check=None),
            "all agents learn",
            "name the role",
        ),
        (lambda rllib: rllib.modules("two_robot_line"), "don't read", "flatten=True"),
        (lambda rllib: rllib.policy("no/where"), "no checkpoint", "save_to_path"),
        (lambda rllib: rllib.multi_agent_env("tag", check="slow"), "no such check", "quick"),
    ],
)
def test_what_is_refused_says_how_to_fix_it(call: Any, says: str, fix: str) -> None:
    """What, where, and what would do."""
    from gamekeeper.adapters import rllib

    with pytest.raises((SpecError, PolicyError), match=says) as caught:
        call(rllib)
    assert fix in str(caught.value)


def test_actions_of_the_wrong_agents_are_refused() -> None:
    """A missing one, and one of somebody whose turn it isn't."""
    env = made("tictactoe")
    env.reset()
    with pytest.raises(ActionError, match="out of turn"):
        env.step({"player_2": 0})
    env.close()
    env = made("two_robot_line")
    env.reset()
    with pytest.raises(ActionError, match="was observed and has no action"):
        env.step({"picker": 0})
    env.close()


def test_name_that_comes_back_is_refused() -> None:
    """RLlib has one stream for each name, so an agent ends once in an episode."""
    env = made(Returns)
    with pytest.raises(ContractError, match="is back within the episode"):
        played(env)


def test_broken_environment_isnt_trained_on() -> None:
    """The quick audit comes first."""
    from gamekeeper.adapters import rllib

    with pytest.raises(ContractError, match="breaks its contract"):
        rllib.register("tests.faults.endings:OneEndsAll")


# -- with RLlib's own runners and learners


@pytest.fixture(scope="module")
def cluster() -> Iterator[None]:
    """Ray on one core, on this machine alone, stopped at the end."""
    import ray

    ray.init(
        num_cpus=1,
        include_dashboard=False,
        log_to_driver=False,
        logging_level="ERROR",
        _node_ip_address="127.0.0.1",
    )
    yield
    ray.shutdown()


@pytest.mark.parametrize("spec", ["warehouse_turns", "warehouse", "tictactoe"])
def test_chunks_hold_every_decision_once(spec: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fragments of seven steps: actions with their pay are those that the environment had."""
    from ray.rllib.env.multi_agent_env_runner import MultiAgentEnvRunner

    kwargs = BATTERY if "warehouse" in spec else {}
    done = noted_steps(monkeypatch)
    runner = MultiAgentEnvRunner(config=config(spec, flatten=True, env_kwargs=kwargs))
    done.clear()  # of RLlib's look
    learnt: dict[Any, list[Any]] = {}
    for _ in range(8):
        for book in runner.sample():
            for agent, one in book.agent_episodes.items():
                pairs = zip(one.get_actions(), one.get_rewards(), strict=True)
                learnt.setdefault((book.id_, agent), []).extend(
                    [int(a), float(r)] for a, r in pairs
                )
    runner.stop()
    paid = [[pair for pair in pairs if pair[1] is not None] for pairs in done.values()]
    assert sorted(filter(None, paid)) == sorted(filter(None, learnt.values()))


def test_ppo_trains_and_its_checkpoint_plays(cluster: None, tmp_path: Path) -> None:
    """Two updates with masks and roles; returns by agent and role; `rllib:CHECKPOINT` plays."""
    from gamekeeper.adapters import rllib

    algorithm = config("handover", flatten=True).build_algo()
    before = rllib.policy(algorithm).version
    for _ in range(3):
        result = algorithm.train()
    told = result["env_runners"]["gamekeeper"]
    assert set(told["agent"]) == {"giver_0", "receiver_0"}
    assert set(told["role"]) == {"giver", "receiver"}
    assert told["team"] == pytest.approx(sum(told["agent"].values()))
    assert told["episodes"] >= 1
    assert set(result["learners"]) >= {"giver", "receiver"}
    algorithm.save_to_path(str(tmp_path / "run"))
    kept = rllib.policy(algorithm).version
    algorithm.stop()
    assert kept != before

    named = f"rllib:{tmp_path / 'run'}"
    evidence = gk.rollout("handover", policies=named, episodes=2, seed=0)
    assert kept in evidence.episode_table.to_pylist()[0]["policies"]
    legal = [
        info["action_mask"][turn.actions[agent]]
        for episode in evidence.episodes
        for turn in episode.turns
        for agent, info in turn.infos.items()
        if turn.actions.get(agent) is not None
    ]
    assert all(legal)
    drawn = rllib.policy(tmp_path / "run", deterministic=False)
    again = [gk.rollout("handover", policies=drawn, episodes=2, seed=0) for _ in range(2)]
    assert again[0].fingerprint == again[1].fingerprint


def test_example_runs() -> None:
    """A few steps of it; its page tells what it reaches."""
    ran = subprocess.run(
        [sys.executable, "examples/rllib_own.py", "--quick"],
        check=True,
        capture_output=True,
        text=True,
    )
    assert json.loads(ran.stdout.splitlines()[-1])["trainer"].startswith("rllib 2.60")


def test_order_of_agents_doesnt_hang_on_the_hash_seed() -> None:
    """Observations and modules come in one order, here and in a process of another hash seed."""
    code = (
        "from gamekeeper.adapters import rllib\n"
        "env, mapping = rllib.multi_agent_env('warehouse', check=None),"
        " rllib.policy_mapping('warehouse')\n"
        "said = [*env.reset()[0], *env.observation_spaces, *mapping['policies']]"
    )
    ran = subprocess.run(
        [sys.executable, "-c", f"{code}\nprint(said)"],
        check=True,
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONHASHSEED": "1"},
    )
    here: dict[str, Any] = {}
    exec(code, here)
    assert str(here["said"]) == ran.stdout.strip()


def test_forbidden_action_is_named() -> None:
    """A module that reads no masks: the agent, what it might have done, and the fix."""
    env = made(DOORS)
    env.reset(seed=0)
    with pytest.raises(ActionError, match=SAYS):
        env.step({"left": 1, "right": 0})
