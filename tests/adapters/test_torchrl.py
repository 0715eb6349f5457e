"""TorchRL sees what was played: groups, ends, truncation, masks, credit, seeds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gamekeeper as gk
from gamekeeper.errors import ActionError, ContractError, PolicyError, SpecError
from gamekeeper.randomness.seeds import episode_seed
from tests.adapters.torchrl_views import (
    FOUR,
    LATE,
    LEAKY,
    LEAVES,
    TAG,
    Same,
    compare,
    first_legal,
    made,
)
from tests.vector.doors import SAYS
from tests.vector.doors import SPEC as DOORS

pytestmark = [
    pytest.mark.trainer,
    # Of TorchRL's own classes, as they are imported.
    pytest.mark.filterwarnings(
        "ignore:Creating .* which inherits from WeightUpdaterBase:DeprecationWarning"
    ),
]


@pytest.fixture(autouse=True)
def one_thread() -> None:
    """Two threads would spin for each other where other work has the cores."""
    import torch

    torch.set_num_threads(1)


@pytest.mark.parametrize(
    ("spec", "options"),
    [
        ("two_robot_line", {}),
        ("warehouse", {"engine": "kernel"}),
        ("handover", {}),
        (FOUR, {}),
        (TAG, {}),
        ("late", {}),
    ],
)
def test_env_passes_torchrls_own_check(spec: str, options: dict[str, Any]) -> None:
    """Specs and data agree, with and without a batch, flat and nested, across resets."""
    from torchrl.envs.utils import check_env_specs

    spec = LATE if spec == "late" else spec
    for num_envs, flatten in ((None, False), (3, True), (3, False)):
        env = made(spec, num_envs, flatten=flatten, **options)
        check_env_specs(env, seed=0, break_when_any_done="both")
        env.close()


@pytest.mark.parametrize(
    ("spec", "engine"),
    [
        ("two_robot_line", "serial"),
        ("warehouse", "kernel"),
        ("warehouse", "serial"),
        ("handover", "kernel"),
        (FOUR, "serial"),
        (TAG, "serial"),
        ("late", "serial"),
        (LEAVES, "serial"),
        (LEAVES, "process"),
    ],
)
def test_trace_is_the_same_seen_through_groups(spec: str, engine: str) -> None:
    """Rows of the first two episodes, agent by agent: observations, actions, rewards, ends."""
    spec = LATE if spec == "late" else spec
    env = made(spec, 2, seed=5, engine=engine)
    batch = env.rollout(260, first_legal(env), break_when_any_done=False)
    n = next(iter(env.full_action_spec.values(True, True))).space.n
    episodes = list(gk.rollout(spec, policies=Same(n), episodes=2, seed=5).episodes)
    for copy, episode in enumerate(episodes):
        for group, agents in env.group_map.items():
            for place, agent in enumerate(agents):
                after = batch["next"][copy]
                compare(batch[copy][group][:, place], after[group][:, place], episode, agent)
    env.close()


def test_death_ends_one_agent_and_not_its_copy() -> None:
    """An empty battery ends one robot: done stays, the mask is off, one action is legal."""
    env = made("warehouse", 3, env_kwargs={"battery": 6, "spares": 0})
    batch = env.rollout(30, break_when_any_done=False)
    own = batch["picker"]
    gone = own["done"][..., 0]
    assert gone.any()
    assert not own["mask"][gone].any()
    later = gone[:, 1:] & gone[:, :-1]  # at first it shows what the agent saw last
    assert not own["observation"][:, 1:][later].any()
    assert (own["action_mask"][gone].sum(-1) == 1).all()
    assert not batch["done"].any()  # a copy that is done begins anew before the next step
    env.close()


def test_truncation_is_no_termination() -> None:
    """What the horizon cuts off is truncated, for each agent and for the copy."""
    env = made("two_robot_line", 2)
    tensordict, steps = env.reset(), 0
    while not tensordict["done"].any():
        for group in env.group_map:
            tensordict[group, "action"] = env.full_action_spec[group, "action"].zero() + 1
        tensordict, steps = env.step(tensordict)["next"], steps + 1
    assert tensordict["truncated"].all()
    assert not tensordict["terminated"].any()
    assert tensordict["picker", "truncated"].all()
    assert not tensordict["picker", "terminated"].any()
    env.close()


def test_late_joiner_comes_and_goes() -> None:
    """Before it joins a slot is neither done nor masked in; then it plays, and is reset with it."""
    env = made(LATE, 2)
    batch = env.rollout(12, break_when_any_done=False)
    late = batch[0]["guest"]
    assert late["mask"][:, 0].tolist() == [False, False, True, True, True, False] * 2
    assert not late["done"][:2].any()
    env.close()


def test_roles_have_their_own_spaces() -> None:
    """Predators see more than their prey, each in a group."""
    env = made(TAG, 3)
    seen = env.reset()
    assert seen["adversary", "observation"].shape == (3, 3, 16)
    assert seen["agent", "observation"].shape == (3, 1, 14)
    env.close()


def test_group_map_may_be_torchrls() -> None:
    """One group for each agent, as TorchRL spells it; what can't be stacked is refused."""
    from torchrl.envs.utils import MarlGroupMapType

    env = made("two_robot_line", 2, group_map={"robots": ["carrier", "picker"]})
    assert env.reset()["robots", "observation"].shape[:2] == (2, 2)
    env.close()
    env = made(TAG, 2, group_map=MarlGroupMapType.ONE_GROUP_PER_AGENT)
    assert len(env.group_map) == 4
    env.close()
    with pytest.raises(SpecError, match="differ in their spaces"):
        made(TAG, 2, group_map=MarlGroupMapType.ALL_IN_ONE_GROUP)
    with pytest.raises(SpecError, match="every agent once"):
        made(TAG, 2, group_map={"agent": ["agent_0"]})


def test_turns_have_one_actor() -> None:
    """In each copy one seat acts; who waits has one legal action, and sees what it saw last."""
    env = made(FOUR, 3)
    batch = env.rollout(20, break_when_any_done=False)
    own = batch["player"]
    assert (own["mask"].sum(-1) == 1).all()
    assert (own["action_mask"][~own["mask"]].sum(-1) == 1).all()
    assert (own["action_mask"][own["mask"]].sum(-1) > 1).any()
    env.close()


@pytest.mark.parametrize("engine", ["serial", "kernel"])
def test_state_is_that_of_the_copy(engine: str) -> None:
    """The state is there for a centralised critic, also the one at the end."""
    env = made("two_robot_line", 2, engine=engine)
    alone = gk.make("two_robot_line")
    tensordict, actions = env.reset(), {"picker": 2, "carrier": 0}
    alone.reset(seed=episode_seed(0, 0))
    while not tensordict["done"][0]:
        assert tensordict["state"][0].tolist() == np.asarray(alone.state()).tolist()
        for group, action in actions.items():
            tensordict[group, "action"] = env.full_action_spec[group, "action"].zero() + action
        alone.step(actions)
        tensordict = env.step(tensordict)["next"]
    assert tensordict["state"][0].tolist() == np.asarray(alone.state()).tolist()
    env.close()


def test_seed_begins_the_same_run() -> None:
    """`set_seed` holds for the next reset; without one the run goes on with its next episodes."""
    env = made("warehouse", 2, engine="kernel", seed=9)
    one = env.reset().clone()
    assert env.episodes.tolist() == [0, 1]
    two = env.reset().clone()
    assert env.episodes.tolist() == [2, 3]
    env.set_seed(9)
    three = env.reset()
    assert (one["state"] == three["state"]).all()
    assert (one["state"] != two["state"]).any()
    env.close()


@pytest.mark.parametrize("engine", ["serial", "kernel", "process"])
def test_engines_give_the_same(engine: str) -> None:
    """Which engine steps the copies changes nothing."""
    import torch

    def played(engine: str) -> Any:
        env = made("two_robot_line", 3, engine=engine, state=False)
        torch.manual_seed(0)
        batch = env.rollout(60, break_when_any_done=False)
        env.close()
        return batch

    assert (played(engine) == played("serial")).all()


@pytest.mark.parametrize("engine", ["serial", "kernel"])
def test_some_copies_are_reset_in_mid_episode(engine: str) -> None:
    """TorchRL's StepCounter cuts copies off one by one; the others go on."""
    from torchrl.envs import StepCounter, TransformedEnv

    env = TransformedEnv(made("warehouse", 3, engine=engine), StepCounter(7))
    batch = env.rollout(30, break_when_any_done=False)
    assert int(batch["step_count"].max()) == 6
    assert batch["next", "truncated"].any()
    import torch

    tensordict = env.base_env.reset()
    tensordict = env.base_env.rand_step(tensordict)["next"]
    tensordict["_reset"] = torch.tensor([[False], [True], [False]])
    again = env.base_env.reset(tensordict)
    assert env.base_env.episodes[1] > env.base_env.episodes[0]
    assert again.batch_size == (3,)
    env.close()


def test_what_processes_cant_is_refused() -> None:
    """state() and a reset in mid-episode don't cross processes, and say so."""
    import torch

    with pytest.raises(SpecError, match="doesn't cross"):
        made("two_robot_line", 2, engine="process", state=True)
    env = made("two_robot_line", 2, engine="process")
    tensordict = env.reset()
    tensordict["_reset"] = torch.tensor([[True], [False]])
    with pytest.raises(SpecError, match="one by one"):
        env.reset(tensordict)
    one, two = env.reset().clone(), env.reset().clone()
    assert one.batch_size == two.batch_size
    env.close()


def test_wrong_use_says_what_and_where() -> None:
    """Roles that nobody has, others without a policy, actions of another shape, some copies."""
    import torch

    with pytest.raises(SpecError, match="no agent with the role"):
        made(TAG, role="wolf")
    with pytest.raises(SpecError, match="no policy"):
        made(TAG, role="adversary")
    with pytest.raises(SpecError, match="all agents learn"):
        made(TAG, others="random")
    env = made("two_robot_line", 2)
    tensordict = env.rand_action(env.reset())
    with pytest.raises(ActionError, match="don't fit"):
        env.step(tensordict.clone().exclude(("picker", "action")))
    with pytest.raises(SpecError, match="stepped together"):
        env.step(tensordict.clone().set("_step", torch.tensor([True, False])))
    env.close()


def test_broken_environment_isnt_trained_on(tmp_path: Path) -> None:
    """The quick audit comes first; `check=None` lets it pass."""
    from gamekeeper.adapters import torchrl

    with pytest.raises(ContractError, match="breaks its contract"):
        torchrl.env(LEAKY, 1)
    torchrl.env(LEAKY, 1, check=None).close()
    torchrl.env("two_robot_line", 1).close()


def test_others_play_inside() -> None:
    """One role is seen, the others follow a policy; the same as when everybody is seen."""
    env = made("warehouse", 2, role="picker", others={"carrier": "reference"}, seed=3)
    assert list(env.group_map) == ["picker"]
    batch = env.rollout(80, first_legal(env), break_when_any_done=False)
    n = env.full_action_spec["picker", "action"].space.n
    episode = next(
        iter(
            gk.rollout(
                "warehouse",
                policies={"picker": Same(n), "carrier": "reference"},
                episodes=1,
                seed=3,
            ).episodes
        )
    )
    own = batch[0]["picker"][:, 0]
    acts = [turn for turn in episode.turns if turn.actions.get("picker_0") is not None][:80]
    for step, turn in enumerate(acts):
        np.testing.assert_array_equal(turn.observations["picker_0"], own["observation"][step])
    env.close()


def test_advantages_are_torchrls_where_everybody_acts() -> None:
    """No deaths and no waiting: the same numbers as TorchRL's GAE, truncation bootstrapped."""
    import torch
    from torchrl.objectives.value.functional import generalized_advantage_estimate

    from gamekeeper.adapters.torchrl import advantages

    env = made("two_robot_line", 3)
    batch = env.rollout(70, break_when_any_done=False)
    torch.manual_seed(0)
    for group in env.group_map:
        batch[group, "state_value"] = torch.randn(*batch[group].batch_size, 1)
        batch["next", group, "state_value"] = torch.randn(*batch[group].batch_size, 1)
        inner = ~batch["next", "done"][:, :-1, None].expand(-1, -1, 1, 1)
        value = batch["next", group, "state_value"]
        value[:, :-1] = torch.where(inner, batch[group, "state_value"][:, 1:], value[:, :-1])
    advantages(batch, env.group_map, gamma=0.9, gae_lambda=0.8)
    for group in env.group_map:
        after = batch["next", group]
        parts = [
            part.squeeze(2)
            for part in (
                batch[group, "state_value"],
                after["state_value"],
                after["reward"],
                after["done"],
                after["terminated"],
            )
        ]
        expected, _ = generalized_advantage_estimate(0.9, 0.8, *parts)
        np.testing.assert_allclose(
            expected.numpy(), batch[group, "advantage"].squeeze(2).numpy(), atol=1e-5
        )
        assert batch[group, "decided"].all()
    env.close()


def test_advantages_credit_the_last_decision() -> None:
    """On a board the loser is paid while it waits; that belongs to its own last move."""
    import torch

    from gamekeeper.adapters.torchrl import advantages, decisions

    env = made(FOUR, 2)
    torch.manual_seed(0)
    batch = env.rollout(60, break_when_any_done=False)
    own = batch["player"]
    own["state_value"] = torch.zeros(*own.batch_size, 1)
    batch["next", "player", "state_value"] = torch.zeros(*own.batch_size, 1)
    advantages(batch, ["player"], gamma=1.0, gae_lambda=0.0)
    learnt = decisions(batch, "player")
    known = own["decided"]
    assert (known <= own["mask"]).all()
    assert len(learnt) == int(known.sum())
    assert learnt["action_mask"].gather(-1, learnt["action"][:, None]).all()
    assert int((learnt["advantage"] == -1).sum()) == int((learnt["advantage"] == 1).sum()) > 0
    env.close()


@pytest.mark.parametrize(
    ("spec", "options"), [("warehouse", {"engine": "kernel"}), (FOUR, {}), (TAG, {})]
)
def test_ppo_trains_and_plays(spec: str, options: dict[str, Any]) -> None:
    """Collector and PPO loss of TorchRL, a few updates; the actor's version names its weights."""
    import torch

    from examples.torchrl_spread import Learner
    from gamekeeper.adapters import torchrl

    torch.manual_seed(0)
    env = made(spec, 4, masks=True, flatten=True, **options)
    learner = Learner(env)
    before = torchrl.policy(learner.actor, env).version
    told = [learner.learn(batch) for batch in learner.batches(frames=64, total=192)]
    policy = torchrl.policy(learner.actor, env)
    assert policy.version != before
    assert len(told) == 3
    env.close()
    evidence = gk.rollout(spec, policies=policy, episodes=1, seed=0)
    assert policy.version in evidence.episode_table.to_pylist()[0]["policies"]


def test_policy_acts_as_in_the_env() -> None:
    """One agent at a time the actor chooses what it chose for all of them together."""
    import torch
    from torchrl.envs.utils import ExplorationType, set_exploration_type

    from examples.torchrl_spread import Learner
    from gamekeeper.adapters import torchrl

    torch.manual_seed(0)
    env = made(TAG, 2, masks=True, flatten=True, seed=4)
    actor = Learner(env).actor
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        batch = env.rollout(25, actor, break_when_any_done=False)
    episode = gk.rollout(TAG, policies=torchrl.policy(actor, env), episodes=1, seed=4).episodes[0]
    for group, agents in env.group_map.items():
        for place, agent in enumerate(agents):
            played = [t.actions[agent] for t in episode.turns if t.actions.get(agent) is not None]
            assert played == batch[0][group, "action"][: len(played), place].tolist()
    with pytest.raises(PolicyError, match="isn't among the agents"):
        torchrl.policy(actor, env)(np.zeros(16), "wolf_0", {}, np.random.default_rng(0))
    env.close()


def test_forbidden_action_is_named() -> None:
    """An actor that reads no masks: the agent, what it might have done, and the fix."""
    import torch

    env = made(DOORS, 1)
    given = env.rand_action(env.reset())
    given["left", "action"], given["right", "action"] = torch.tensor([[1]]), torch.tensor([[0]])
    with pytest.raises(ActionError, match=SAYS):
        env.step(given)
    env.close()
