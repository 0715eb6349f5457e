"""Who plays whom, with which stream, and what is told when a policy fails."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces
from numpy.random import Generator

from gamekeeper.errors import ActionError, PolicyError
from gamekeeper.interface.joint_policy import JointPolicy, assign
from gamekeeper.randomness.seeds import policy_rng

AGENTS = ["picker_0", "picker_1", "carrier_0"]
FOUR = spaces.Discrete(4)


def role(agent: str) -> str | None:
    """The part of a name before its number."""
    return agent.rpartition("_")[0] or None


def cast(policies: Any, space: Any = FOUR, agents: Any = AGENTS, **options: Any) -> JointPolicy:
    """A joint policy for three agents with roles, in its first episode."""
    options.setdefault("roles", role)
    made = assign(policies, possible_agents=agents, action_space=lambda agent: space, **options)
    made.begin(0, 0)
    return made


def constant(action: Any) -> Callable[..., Any]:
    """A policy that always does the same."""
    return lambda observation, agent, info, rng: action


def test_joint_policy_prefers_the_agents_choice_to_its_roles_to_everyones() -> None:
    """A choice by name goes before one by role, that before `*`."""
    chosen = {"picker_1": constant(1), "picker": constant(2), "*": constant(3)}
    played = cast(chosen)
    assert [played.act(agent, None, {}) for agent in AGENTS] == [2, 1, 3]
    assert played.act("picker_9", None, {}) == 2  # joins late, named nowhere


def test_joint_policy_plays_random_where_nothing_is_chosen() -> None:
    """`--policy picker=noop` leaves the carriers to chance."""
    played = cast({"picker": "noop"}, noop=lambda agent: 2)
    described = played.described([*AGENTS, "carrier_7"])
    assert described["carrier_7"] == {
        "policy": "random",
        "version": "1",
        "chosen_for": "*",
        "object": "*",
    }
    assert described["picker_0"] == {
        "policy": "noop",
        "version": "1",
        "chosen_for": "picker",
        "object": "picker",
    }
    assert cast(None).described(AGENTS) == cast("random").described(AGENTS)


def test_joint_policy_refuses_a_choice_for_nobody() -> None:
    """An agent or role that isn't in the game is named with what comes near it."""
    with pytest.raises(PolicyError, match=r"'carier'.*the nearest.*'carrier'"):
        cast({"carier": "random"})
    cast({"drone": "random"}, role_names=["drone"])  # a role of late joiners
    cast({"anybody": "random"}, agents=[])  # the environment can't say who will come


def test_joint_policy_draws_depend_on_nobody_else() -> None:
    """Another order of acting, one agent less, or a late start change no agent's actions."""

    def actions(order: list[str], turns: int) -> dict[str, list[int]]:
        played, got = cast("random", spaces.Discrete(1000)), {agent: [] for agent in order}
        for _ in range(turns):
            for agent in order:
                got[agent].append(int(played.act(agent, None, {})))  # type: ignore[attr-defined]
        return got

    there, back, fewer = actions(AGENTS, 5), actions(AGENTS[::-1], 5), actions(AGENTS[:1], 5)
    assert there == back
    assert fewer["picker_0"] == there["picker_0"]
    assert len(set(map(tuple, there.values()))) == 3


def test_joint_policy_draws_depend_on_run_and_episode_alone() -> None:
    """Episode 5 is the same whichever episodes were played before it."""
    played, space = cast("random", spaces.Discrete(10**6)), spaces.Discrete(10**6)
    played.begin(3, 5)
    first = [played.act("picker_0", None, {}) for _ in range(3)]
    played.begin(3, 6)
    other = [played.act("picker_0", None, {}) for _ in range(3)]
    again = cast("random", space)
    again.begin(3, 5)
    assert first == [again.act("picker_0", None, {}) for _ in range(3)]
    assert first != other


def test_joint_policy_hands_a_policy_the_agents_own_stream() -> None:
    """`rng` is the stream that run seed, episode and name give, so a policy can be played again."""
    got: list[float] = []

    def draw(observation: Any, agent: Any, info: Any, rng: Generator) -> int:
        got.append(rng.random())
        return 0

    played = cast(draw)
    played.begin(8, 2)
    played.act("picker_1", None, {})
    played.act("picker_1", None, {})
    assert got == policy_rng(8, 2, "picker_1").random(2).tolist()


def test_joint_policy_hands_over_what_the_agent_was_given() -> None:
    """Observation and info reach the policy as they are, not as copies."""
    seen: list[Any] = []
    observation, info = np.zeros(2), {"x": 1}

    def look(observation: Any, agent: Any, info: Any, rng: Generator) -> int:
        seen.append((observation, agent, info))
        return 0

    cast(look).act("picker_0", observation, info)
    assert seen[0][0] is observation
    assert seen[0][1] == "picker_0"
    assert seen[0][2] is info


def test_joint_policy_resets_policies_that_can_be_reset() -> None:
    """`reset(seed)` comes once an episode, with a seed of run, episode and whom it plays."""

    class Resets:
        def __init__(self) -> None:
            self.seeds: list[int] = []

        def reset(self, seed: int) -> None:
            self.seeds.append(seed)

        def __call__(self, observation: Any, agent: Any, info: Any, rng: Generator) -> int:
            return 0

    one, two = Resets(), Resets()
    played = cast({"picker": one, "carrier": two})
    played.begin(0, 1)
    played.begin(0, 0)
    both = Resets()
    cast({"picker": both, "carrier": both})
    assert len(both.seeds) == 1  # once an episode, wherever it plays
    assert one.seeds[0] == one.seeds[2] != one.seeds[1]
    assert one.seeds[0] != two.seeds[0]
    assert all(0 <= seed < 2**31 for seed in one.seeds)


class Counting:
    """Counts what it was asked, and never forgets."""

    calls = 0

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Generator) -> int:
        """An action."""
        self.calls += 1
        return 0


COUNTING = Counting()


@pytest.mark.parametrize("place", ["a", "*"])
def test_joint_policy_leaves_a_modules_object_as_it_was(place: str) -> None:
    """Each joint_policy that names it by a text plays with a copy, so that all begin alike."""
    for _ in range(2):
        joint_policy = assign(
            {place: f"{__name__}:COUNTING"},
            possible_agents=["a"],
            action_space=lambda agent: spaces.Discrete(2),
        )
        joint_policy.begin(0, 0)
        joint_policy.act("a", None, {})
        assert joint_policy.chosen_for("a").policy.calls == 1
    assert COUNTING.calls == 0


def test_joint_policy_resets_a_policy_that_takes_no_seed() -> None:
    """A `reset()` without arguments is called without any."""
    calls = []

    class Plain:
        def reset(self) -> None:
            calls.append("reset")

        def __call__(self, observation: Any, agent: Any, info: Any, rng: Generator) -> int:
            return 0

    played = cast({"*": Plain()})
    played.begin(0, 1)
    assert set(calls) == {"reset"}


def test_joint_policy_takes_agents_of_any_kind() -> None:
    """Agents that are numbers are chosen for by their text."""
    played = cast({"1": constant(1), "*": constant(0)}, agents=[0, 1], roles=lambda agent: None)
    assert [played.act(agent, None, {}) for agent in (0, 1)] == [0, 1]


def test_joint_policy_keeps_a_policy_that_looks_empty() -> None:
    """A policy object with a length of 0 is a policy all the same."""

    class Empty:
        def __len__(self) -> int:
            return 0

        def __call__(self, observation: Any, agent: Any, info: Any, rng: Generator) -> int:
            return 3

    assert cast(Empty()).act("picker_0", None, {}) == 3


@pytest.mark.parametrize("action", [0, 3, np.int64(2), np.uint8(1), np.array(1)])
def test_joint_policy_passes_on_actions_as_they_are(action: Any) -> None:
    """What a policy returns isn't coerced."""
    assert cast(constant(action)).act("picker_0", None, {}) is action


@pytest.mark.parametrize("action", [4, -1, np.int64(4), 1.5, "1", [1], np.array([1])])
def test_joint_policy_refuses_an_action_outside_a_discrete_space(action: Any) -> None:
    """Agent, policy, action and space are named."""
    with pytest.raises(ActionError, match="picker_0") as caught:
        cast(constant(action)).act("picker_0", None, {})
    assert "Discrete(4)" in str(caught.value)


def test_joint_policy_leaves_actions_of_other_spaces_to_the_environment() -> None:
    """Many environments take a list or a float64 where their space says float32."""
    box = spaces.Box(-1, 1, (2,))
    assert cast(constant([0.5, 0.5]), box).act("picker_0", None, {}) == [0.5, 0.5]


def test_joint_policy_refuses_none_for_a_live_agent() -> None:
    """A policy that forgot to return is told apart from an environment that failed."""
    with pytest.raises(PolicyError, match="returned None for 'picker_0', which is alive"):
        cast(constant(None)).act("picker_0", None, {})


def test_joint_policy_tells_what_a_policy_raised() -> None:
    """The error names agent and policy and keeps the traceback and the cause."""

    def broken(observation: Any, agent: Any, info: Any, rng: Generator) -> int:
        raise ZeroDivisionError("by nothing")

    with pytest.raises(PolicyError, match=r"picker_0.*ZeroDivisionError: by nothing") as caught:
        cast(broken).act("picker_0", None, {})
    assert "test_joint_policy.py" in caught.value.actual
    assert isinstance(caught.value.__cause__, ZeroDivisionError)


def test_joint_policy_tells_what_a_policys_reset_raised() -> None:
    """A reset that fails is as much the policy's as an action that does."""

    class Broken:
        def reset(self, seed: int) -> None:
            raise LookupError("no weights")

        def __call__(self, observation: Any, agent: Any, info: Any, rng: Generator) -> int:
            return 0

    with pytest.raises(PolicyError, match="no weights"):
        cast(Broken())


def test_noop_needs_to_be_declared_before_anything_runs() -> None:
    """Whoever asks for `noop` reads which key of the contract is missing."""
    with pytest.raises(PolicyError, match=r"roles\.picker\.noop"):
        assign("noop", possible_agents=AGENTS, action_space=lambda agent: FOUR, roles=role)


@pytest.mark.parametrize(
    ("space", "declared"),
    [
        (FOUR, 2),
        (spaces.Discrete(3, start=-1), -1),
        (spaces.Box(-1, 1, (2,), np.float32), [0, 0.5]),
        (spaces.MultiDiscrete([3, 4]), [2, 1]),
        (spaces.MultiBinary(2), [0, 1]),
        (spaces.Text(3), "ab"),
        (spaces.Tuple((FOUR, spaces.Box(0, 1, (1,)))), [1, [0.5]]),
        (spaces.Dict({"go": FOUR, "say": spaces.Text(2)}), {"go": 3, "say": "a"}),
    ],
)
def test_noop_plays_the_declared_action_in_the_spaces_types(space: Any, declared: Any) -> None:
    """What stands in a contract as numbers and lists reaches the environment as its space says."""
    played = cast("noop", space, noop=lambda agent: declared)
    action = played.act("picker_0", None, {})
    assert space.contains(action)
    again = played.act("picker_0", None, {})
    assert repr(again) == repr(action)
    if isinstance(action, np.ndarray | dict):
        assert again is not action  # an environment that writes into its action spoils no later one


@pytest.mark.parametrize(
    ("space", "declared"),
    [
        (FOUR, 4),
        (FOUR, [1]),
        (spaces.Box(0, 1, (2,)), [2, 2]),
        (spaces.Dict({"a": FOUR}), {"b": 1}),
    ],
)
def test_noop_refuses_a_declared_action_outside_the_space(space: Any, declared: Any) -> None:
    """A contract that names an impossible noop is told so."""
    with pytest.raises(PolicyError, match="outside its action space"):
        cast("noop", space, noop=lambda agent: declared).act("picker_0", None, {})
