"""Gymnasium's environments as games: one agent, or several in tuples."""

import sys
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Discrete, Tuple

from gamekeeper.episodes.evidence import Evidence
from gamekeeper.errors import ActionError, DependencyError, EnvError, OrderError, SpecError
from gamekeeper.foreign.gymnasium import SeveralAgents, guest_of
from gamekeeper.interface.opening import distrust, open_env, reopen
from gamekeeper.runs.comparison import replay_evidence
from gamekeeper.runs.recording import rollout
from tests.interface.other_shapes import Tuples

HERE = "gymnasium:tests.interface.other_shapes:Tuples"


def several(**given: Any) -> SeveralAgents:
    """The fake environment behind its wrapper."""
    env = open_env(HERE, **given).env
    assert isinstance(env, SeveralAgents)
    return env


def column(evidence: Evidence, name: str) -> list[Any]:
    """A column of the rows."""
    return list(evidence.agent_steps[name].to_pylist())


def test_gymnasium_id_opens_as_a_game_of_one_agent() -> None:
    """CartPole's rows are those of Gymnasium itself, its end a termination, and nothing resets."""
    bare = gymnasium.make("CartPole-v1")
    env = open_env("gymnasium:CartPole-v1").env
    seen, _ = env.reset(seed=3)
    expected, _ = bare.reset(seed=3)
    assert (env.agents, env.action_space("agent_0").n) == (["agent_0"], 2)
    np.testing.assert_array_equal(expected, seen["agent_0"])
    for tick in range(500):
        obs, reward, terminated, truncated, info = bare.step(tick % 2)
        out = env.step({"agent_0": tick % 2})
        np.testing.assert_array_equal(obs, out[0]["agent_0"])
        assert (reward, terminated, truncated, info) == tuple(part["agent_0"] for part in out[1:])
        if terminated or truncated:
            break
    assert terminated
    assert env.agents == []
    with pytest.raises(OrderError, match="everybody has ended"):
        env.step({"agent_0": 0})


def test_gymnasium_time_limit_is_a_truncation() -> None:
    """What Gymnasium's TimeLimit ends is truncated and not terminated."""
    env = open_env("gymnasium:Pendulum-v1", max_episode_steps=2).env
    env.reset(seed=0)
    action = {"agent_0": np.zeros(1, np.float32)}
    env.step(action)
    _, _, terminated, truncated, _ = env.step(action)
    assert (terminated, truncated) == ({"agent_0": False}, {"agent_0": True})


def test_gymnasium_object_is_opened_as_it_is() -> None:
    """An environment of Gymnasium's may be handed over in place of a name."""
    opened = open_env(gymnasium.make("CartPole-v1"))
    assert opened.make is None
    assert opened.env.metadata["name"] == "CartPole-v1"
    assert opened.identity["kind"] == "object"


def test_gymnasium_rollout_replays() -> None:
    """A recorded single-agent rollout is verified in another instance."""
    evidence = rollout("gymnasium:CartPole-v1", episodes=2, seed=4)
    assert replay_evidence(evidence, reopen(evidence.manifest["environment"])).verified


def test_several_agents_get_their_own_rewards_ends_and_masks() -> None:
    """Lists of rewards, flags and masks come apart by agent; who has ended leaves the roster."""
    env = several(ends="each")
    env.reset(seed=0)
    env.step({"agent_0": 2, "agent_1": 0})
    _, rewards, terminated, truncated, infos = env.step({"agent_0": 2, "agent_1": 1})
    assert rewards == {"agent_0": 2.0, "agent_1": 1.0}
    assert terminated == {"agent_0": True, "agent_1": False}
    assert truncated == {"agent_0": False, "agent_1": False}
    assert env.agents == ["agent_1"]
    assert infos["agent_0"]["action_mask"].tolist() == [1, 1, 0]
    assert infos["agent_1"]["tick"] == 2
    out = env.step({"agent_1": 0})
    assert [{"agent_1"}] * 5 == [set(part) for part in out]
    assert env.guest.unwrapped.given[-1] == (0, 0)


def test_several_agents_at_the_limit_are_truncated() -> None:
    """An end of all in the tick of the environment's own limit is the limit's, and says so."""
    env = several(max_steps=2)
    env.reset(seed=0)
    env.step({"agent_0": 0, "agent_1": 0})
    _, _, terminated, truncated, _ = env.step({"agent_0": 0, "agent_1": 0})
    assert (any(terminated.values()), all(truncated.values())) == (False, True)
    assert env.endings == {"agent_0": "time limit", "agent_1": "time limit"}
    assert env.contract.schedule.horizon == 2


def test_several_agents_share_a_single_reward() -> None:
    """One number is paid to everybody in full."""
    env = several(pays="one")
    env.reset(seed=0)
    _, rewards, *_ = env.step({"agent_0": 2, "agent_1": 1})
    assert rewards == {"agent_0": 3.0, "agent_1": 3.0}


def test_several_agents_paid_after_their_end_are_told() -> None:
    """A reward for one who has ended isn't swallowed: it stands in the rewards."""
    env = several(ends="each")
    env._idle["agent_0"] = 1  # the rule pays each by its action
    env.reset(seed=0)
    env.step({"agent_0": 2, "agent_1": 0})
    env.step({"agent_0": 2, "agent_1": 0})
    _, rewards, *_ = env.step({"agent_1": 0})
    assert rewards == {"agent_1": 0.0, "agent_0": 1.0}


def test_several_agents_rollout_replays() -> None:
    """Record and replay of lists agree to the bit, masks and ends with them."""
    evidence = rollout(HERE, episodes=3, seed=1, env_kwargs={"ends": "each", "agents": 3})
    assert replay_evidence(evidence, reopen(evidence.manifest["environment"])).verified
    assert not any(column(evidence, "nonconforming"))
    assert True in column(evidence, "terminated")


@pytest.mark.parametrize(
    "actions", [{}, {"agent_0": 0}, {"agent_0": 0, "agent_1": 0, "x": 0}, [0, 0]]
)
def test_actions_of_others_than_the_live_are_refused(actions: Any) -> None:
    """A tick takes exactly one action of each live agent, and refuses before the guest steps."""
    env = several()
    env.reset(seed=0)
    with pytest.raises(ActionError, match="the actions of a tick"):
        env.step(actions)
    assert env.guest.unwrapped.given == []


def test_lists_of_a_wrong_length_are_an_error_that_names_them() -> None:
    """Two observations for three agents are no game, and nobody's are guessed."""
    env = several(agents=3)
    env.reset(seed=0)
    env.guest.unwrapped.heights = [0, 0]
    with pytest.raises(EnvError, match="observations"):
        env.step({"agent_0": 0, "agent_1": 0, "agent_2": 0})


def test_spaces_of_different_numbers_are_refused() -> None:
    """Three action spaces and two observation spaces name no agents."""
    env = Tuples()
    env.action_space = Tuple([Discrete(2)] * 3)
    with pytest.raises(SpecError, match="different numbers"):
        guest_of(env, name="nonconforming")


def test_what_resets_itself_and_what_holds_copies_is_refused() -> None:
    """Autoreset hides ends, and a vector of copies is no game; both say what to hand over."""
    with pytest.raises(SpecError, match="by itself"):
        open_env(gymnasium.wrappers.Autoreset(gymnasium.make("CartPole-v1")))
    vector = gymnasium.make_vec("CartPole-v1", num_envs=2, vectorization_mode="sync")
    with pytest.raises(SpecError, match="2 copies"):
        guest_of(vector, name="many")
    vector.close()


def test_gymnasium_names_what_is_near_and_what_to_install() -> None:
    """A wrong version lists those there are, a missing package the line that installs it."""
    with pytest.raises(SpecError, match=r"`v0`, `v1`"):
        open_env("gymnasium:CartPole-v9")
    with pytest.raises(DependencyError, match="pip install no_such_package"):
        open_env("no_such_package:Farm-v0")
    with pytest.raises(SpecError, match="no Gymnasium environment"):
        open_env("gymnasium:tests.interface.other_shapes:Lists")


def test_gymnasium_id_behind_its_module_needs_no_word() -> None:
    """`module:Id-v0` is read as `gymnasium.make` reads it, and the module is imported."""
    gymnasium.register("TuplesHere-v0", "tests.interface.other_shapes:Tuples", kwargs={"agents": 3})
    try:
        opened = open_env("tests.interface.other_shapes:TuplesHere-v0")
    finally:
        del gymnasium.registry["TuplesHere-v0"]
    assert opened.spec == "tests.interface.other_shapes:TuplesHere-v0"
    assert opened.env.possible_agents == ["agent_0", "agent_1", "agent_2"]
    assert "tests.interface.other_shapes" in sys.modules


def test_gymnasium_evidence_is_trusted_by_its_registry_alone() -> None:
    """A registered id may be opened unasked; a file or a module that a text names may not."""
    assert distrust(open_env("gymnasium:CartPole-v1").identity) is None
    assert distrust({**open_env(HERE).identity}) is not None
    assert distrust(
        {"kind": "gymnasium", "entry_point": "gymnasium:x/evil.py:make", "api": "parallel"}
    )
