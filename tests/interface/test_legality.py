"""Which actions an author's rules get to see, and what becomes of the others."""

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Space, Tuple

from gamekeeper.errors import ActionError, ContractError
from gamekeeper.interface.turn_env import TurnEnv
from tests.interface.relays import FinedTurnTickets, TurnTickets


class Spaces(TurnEnv):
    """Keeps what it is handed."""

    def __init__(self, space: Space[Any]) -> None:
        super().__init__()
        self.possible_agents = ["a_0", "a_1"]
        self.action_spaces = self.observation_spaces = dict.fromkeys(self.possible_agents, space)

    def observe(self, agent: str) -> int:
        return 0

    def act(self, agent: str, action: Any) -> None:
        self.handed = action


@pytest.mark.parametrize(
    "action", [1, np.int64(1), np.int8(1), np.uint64(1), np.array(1), True, np.array([1])[0]]
)
def test_whole_numbers_reach_the_rules_as_int(action: Any) -> None:
    """Whatever type holds an action of a Discrete space, rules compute with a Python int."""
    env = Spaces(Discrete(3))
    env.reset()
    env.step(action)
    assert int is type(env.handed)
    assert env.handed == 1


@pytest.mark.parametrize(
    ("space", "fit", "misfits"),
    [
        (Discrete(3), 2, [3, -1, 1.0, "1", None, [1], 2**70, np.float32(1), {}]),
        (Discrete(3, start=-1), -1, [2, -2]),
        (Box(0, 1, (2,)), np.ones(2, "f4"), [np.full(2, 2, "f4"), np.zeros(2), [0.0, 0.0], None]),
        (MultiDiscrete([2, 3]), np.array([1, 2]), [np.array([2, 0]), np.array([0]), None]),
        (MultiBinary(2), np.array([0, 1], np.int8), [np.array([0, 2], np.int8), None]),
        (Tuple((Discrete(2), Discrete(2))), (0, 1), [(0, 2), (0,), 0]),
        (Dict(a=Discrete(2)), {"a": 1}, [{"a": 2}, {"b": 1}, 1]),
    ],
)
def test_action_outside_its_space_is_refused(space: Any, fit: Any, misfits: list[Any]) -> None:
    """The error names agent, action and space; nothing has changed, and a fit action is played."""
    env = Spaces(space)
    env.reset()
    for misfit in misfits:
        with pytest.raises(ActionError, match="agent 'a_0' did what is not in its action") as told:
            env.step(misfit)
        assert repr(space) in str(told.value)
        assert (env.turns, env.agent_selection) == (0, "a_0")
    env.step(fit)
    assert env.agent_selection == "a_1"


# -- masks


def test_mask_stands_in_infos_and_observation_as_new_arrays() -> None:
    """Both hold the mask as their spaces want it; whoever writes to one changes nothing else."""
    env = TurnTickets()
    env.reset()
    env.step(6)
    observation, *_, info = env.last()
    assert [1, 0, 1, 1] == info["action_mask"].tolist() == observation["action_mask"].tolist()
    assert np.int8 == info["action_mask"].dtype
    assert env.observation_space("taker_1").contains(observation)
    assert info["free"] == 3
    info["action_mask"][:] = 1
    observation["action_mask"][:] = 1
    with pytest.raises(ActionError, match="masked out"):
        env.step(6)
    assert env.observe("taker_1")["action_mask"].tolist() == [1, 0, 1, 1]


def test_author_is_asked_once_a_turn_for_the_mask() -> None:
    """Info, observation and check share one answer, as a mask may be dear."""
    env = TurnTickets()
    env.reset()
    before = env.asked
    for action in (5, 6, 7):
        env.last()
        env.observe(env.agent_selection)
        env.step(action)
    assert env.asked - before == 3


def test_mask_seen_inside_a_turn_is_that_of_the_moment() -> None:
    """A rule that looks at an observation before and after a change sees two masks."""

    class Looking(TurnTickets):
        def act(self, agent: str, action: int) -> None:
            before = self.observe(agent)["action_mask"].tolist()
            super().act(agent, action)
            self.looks = (before, self.observe(agent)["action_mask"].tolist())

    env = Looking()
    env.reset()
    env.step(6)
    assert env.looks == ([1, 1, 1, 1], [1, 0, 1, 1])
    assert env.last()[4]["action_mask"].tolist() == [1, 0, 1, 1]


def test_masked_action_is_refused_with_what_was_legal() -> None:
    """The error tells the legal actions, and leaves everything as it was."""
    env = TurnTickets()
    env.reset()
    env.step(6)
    env.last()
    with pytest.raises(ActionError, match=r"agent 'taker_1' did what is masked out") as told:
        env.step(6)
    assert "one of [5, 7, 8]" in str(told.value)
    assert env.agent_selection == "taker_1"
    env.step(5)
    assert env.taken == 5


def test_rule_for_illegal_actions_takes_the_place_of_the_error() -> None:
    """The penalty is paid, the turn is over, and nothing else was played."""
    env = FinedTurnTickets()
    env.reset()
    env.step(6)
    for action in (6, 99):
        agent = env.agent_selection
        env.step(action)
        assert env.rewards[agent] == -1.0
        assert {agent: {"fine": -1.0}} == env.terms
        assert env.taken == 6
    assert env.turns == 3


def test_rule_for_illegal_actions_may_play_another() -> None:
    """What `illegal` returns is played instead."""

    class Forgiving(TurnTickets):
        def illegal(self, agent: str, action: Any) -> int:
            return 5 + self.free.index(True)

    env = Forgiving()
    env.reset()
    env.step(5)
    env.step(5)
    assert env.taken == 6


@pytest.mark.parametrize("mask", [[1, 0], [[1, 0, 1]], [0.5, 1, 1], [2, 1, 1], "no", [1, -1, 1]])
def test_mask_that_does_not_fit_is_the_rules_mistake(mask: Any) -> None:
    """A wrong mask is named as such, and isn't taken for a wrong action."""

    class Wrong(Spaces):
        def mask(self, agent: str) -> Any:
            return mask

    with pytest.raises(ContractError, match="the mask of agent 'a_0'"):
        Wrong(Discrete(3)).reset()


def test_mask_of_none_permits_everything() -> None:
    """Where all actions are legal the author need not count them up."""

    class Open(TurnTickets):
        def mask(self, agent: str) -> None:  # type: ignore[override]
            return None

    env = Open()
    env.reset()
    observation, *_, info = env.last()
    assert observation["action_mask"].tolist() == [1, 1, 1, 1]
    assert "action_mask" not in info
    env.step(5)


@pytest.mark.parametrize(
    ("space", "mask", "legal", "illegal"),
    [
        (MultiDiscrete([2, 3]), ([1, 0], [0, 1, 1]), [0, 2], [1, 2]),
        (MultiDiscrete([[2], [2]]), (([1, 0],), ([0, 1],)), [[0], [1]], [[0], [0]]),
        (MultiBinary(3), [0, 2, 1], [0, 1, 1], [1, 1, 1]),
        (MultiBinary(3), [0, 2, 1], [0, 0, 1], [0, 1, 0]),
        (Tuple((Discrete(2), Box(0, 1))), ([0, 1], None), (1, [0.5]), (0, [0.5])),
        (Dict(b=Discrete(2, start=4)), {"b": [0, 1]}, {"b": 5}, {"b": 4}),
    ],
)
def test_masks_of_every_space_are_gymnasiums_own(
    space: Any, mask: Any, legal: Any, illegal: Any
) -> None:
    """What `space.sample(mask)` gives is legal, and what it never gives is masked out."""

    class Masked(Spaces):
        def mask(self, agent: str) -> Any:
            return mask

    def shaped(action: Any) -> Any:
        if isinstance(space, Tuple):
            return (action[0], np.array(action[1], np.float32))
        return action if isinstance(space, Dict) else np.array(action, space.dtype)

    env = Masked(space)
    env.reset()
    space.seed(1)
    for _ in range(20):
        env.step(space.sample(mask=env.infos[env.agent_selection]["action_mask"]))
    env.step(shaped(legal))
    with pytest.raises(ActionError, match="masked out"):
        env.step(shaped(illegal))
