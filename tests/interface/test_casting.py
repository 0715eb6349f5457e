"""Observations, infos and states are handed out as copies, of the type that their space says."""

import copy
import pickle
from typing import Any, ClassVar

import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete

from gamekeeper.errors import ContractError
from gamekeeper.interface.casting import CastError, cast_to
from gamekeeper.interface.tick_env import TickEnv
from gamekeeper.interface.turn_env import TurnEnv

NUMBERS = Box(0, 9, (2,), np.float32)


class Shown:
    """One agent, which is shown what the class holds."""

    space: ClassVar[Any] = NUMBERS
    value: ClassVar[Any] = None

    def __init__(self) -> None:
        super().__init__()
        self.possible_agents = ["a", "b"]
        self.observation_spaces = dict.fromkeys(self.possible_agents, self.space)
        self.action_spaces = dict.fromkeys(self.possible_agents, Discrete(2))

    def start(self, rng: Any, options: Any) -> None:
        self.held = np.zeros(2, np.float32)
        self.noted = {"places": [np.zeros(2)]}

    def observe(self, agent: str) -> Any:
        return self.held if self.value is None else self.value

    def info(self, agent: str) -> Any:
        return self.noted

    def state(self) -> Any:
        return self.held


class Ticks(Shown, TickEnv):
    def tick(self, actions: Any) -> None:
        self.held += 1


class Turns(Shown, TurnEnv):
    def act(self, agent: str, action: int) -> None:
        self.held += 1


class Plain(Ticks):
    copy = False


def test_what_is_handed_out_is_a_copy() -> None:
    """Observations, infos and the state share no memory with the rules, nor with each other."""
    env = Ticks()
    observations, infos = env.reset(seed=1)
    state = env.state()
    env.step({"a": 0, "b": 0})
    observations["a"] += 5
    infos["a"]["places"][0] += 5
    assert [0.0, 0.0] == observations["b"].tolist() == state.tolist()
    assert [1.0, 1.0] == env.held.tolist() == env.observe("a").tolist()
    assert not env.noted["places"][0].any()
    assert infos["a"] is not infos["b"]


def test_turns_hand_out_copies_too() -> None:
    """What `last` and `observe` give stays as it was given."""
    env = Turns()
    env.reset(seed=1)
    first, seen = env.last()[0], env.observe("b")
    env.step(0)
    assert [0.0, 0.0] == first.tolist() == seen.tolist()
    assert env.last()[0].tolist() == [1.0, 1.0]


def test_copies_can_be_switched_off() -> None:
    """A class with copy = False hands out what its author returned."""
    env = Plain()
    observations, infos = env.reset(seed=1)
    assert observations["a"] is env.held is env.observe("b") is env.state()
    assert infos["a"]["places"] is env.noted["places"]


@pytest.mark.parametrize(
    ("space", "value", "expected"),
    [
        (NUMBERS, [1, 2], np.array([1, 2], np.float32)),
        (NUMBERS, np.array([0.5, 2.0]), np.array([0.5, 2], np.float32)),
        (NUMBERS, (True, np.nan), np.array([1, np.nan], np.float32)),
        (Box(0, 1, (), np.float64), 0.1, np.array(0.1)),
        (MultiDiscrete([3, 3]), [1, 2], np.array([1, 2], np.int64)),
        (MultiBinary(2), [True, False], np.array([1, 0], np.int8)),
    ],
)
def test_arrays_are_converted_where_nothing_is_lost(space: Any, value: Any, expected: Any) -> None:
    """The same numbers, of the space's dtype and shape."""
    found = cast_to(space)(value)
    np.testing.assert_array_equal(expected, found, strict=True)


@pytest.mark.parametrize(
    ("space", "value", "expected"),
    [
        (Discrete(3), 2, 2),
        (Discrete(3), np.int64(2), np.int64(2)),
        (Discrete(3), True, 1),
        (Discrete(3), 2.0, 2),
        (Discrete(3), np.array(2), np.int64(2)),
        (spaces.Text(3), "ab", "ab"),
        (spaces.Tuple([Discrete(2), Discrete(2)]), [0, 1], (0, 1)),
        (spaces.Sequence(Discrete(5)), [1, 2, 3], (1, 2, 3)),
    ],
)
def test_other_values_are_of_their_space(space: Any, value: Any, expected: Any) -> None:
    """The same value, of the type that the space samples."""
    found = cast_to(space)(value)
    assert expected == found
    assert type(expected) is type(found)
    assert space.contains(found)


@pytest.mark.parametrize(
    ("space", "value", "actual"),
    [
        (NUMBERS, np.array([0.1, 1.0]), "0.1 of float64, which float32 can't hold exactly"),
        (NUMBERS, [1e300, 1.0], "1e+300 of float64, which float32 can't hold exactly"),
        (NUMBERS, [2**24 + 1, 0], "16777217 of int64, which float32 can't hold exactly"),
        (NUMBERS, [1, 2, 3], "shape (3,)"),
        (NUMBERS, [1, [2]], "list: [1, [2]]"),
        (NUMBERS, "ab", "str: 'ab'"),
        (NUMBERS, None, "NoneType: None"),
        (MultiDiscrete([3, 3]), [1, 0.5], "0.5 of float64, which int64 can't hold exactly"),
        (Box(0, 255, (1,), np.uint8), [256], "256 of int64, which uint8 can't hold exactly"),
        (Box(0, 255, (1,), np.uint8), [-1], "-1 of int64, which uint8 can't hold exactly"),
        (Discrete(3), 1.5, "1.5 of float64, which int64 can't hold exactly"),
        (Discrete(3), None, "NoneType: None"),
        (spaces.Tuple([Discrete(2)]), (0, 1), "tuple: (0, 1)"),
        (spaces.Text(3), 5, "int: 5"),
        (Dict(x=NUMBERS), {"y": [1, 2]}, "the keys ['y']"),
        (Dict(x=NUMBERS), [1, 2], "list: [1, 2]"),
    ],
)
def test_what_would_be_lost_is_refused(space: Any, value: Any, actual: str) -> None:
    """The error says what was found."""
    with pytest.raises(CastError) as caught:
        cast_to(space)(value)
    assert actual == caught.value.actual
    assert caught.value.fix


def test_misfit_names_agent_place_and_line() -> None:
    """The author reads which part of which observation is at fault, and where it was returned."""

    class Nested(Ticks):
        space = Dict(near=spaces.Tuple([Discrete(2), NUMBERS]))
        value: ClassVar[Any] = {"near": (0, [0.1, 0.2])}

    with pytest.raises(ContractError) as caught:
        Nested().reset(seed=1)
    line = Shown.observe.__code__.co_firstlineno
    assert f"observe('a')['near'][1] (test_casting.py, line {line})" in str(caught.value)
    assert "copy = False" in str(caught.value)


def test_subclass_may_show_another_space() -> None:
    """What a subclass asks of its base isn't held against the subclass's own space."""

    class Wider(Ticks):
        space = Box(0, 9, (3,), np.float32)

        def observe(self, agent: str) -> Any:
            return [*super().observe(agent), 7]

    assert Wider().reset(seed=1)[0]["a"].tolist() == [0, 0, 7]


def test_spaces_may_be_new_at_a_reset() -> None:
    """Values are held against the spaces of their own episode."""
    env = Ticks()
    env.reset(seed=1)
    env.observation_spaces = dict.fromkeys(env.possible_agents, Box(0, 9, (2,), np.float64))
    assert np.float64 == env.reset(seed=1)[0]["a"].dtype


@pytest.mark.parametrize("again", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copied_environments_go_on_copying(again: Any) -> None:
    """A copy, a pickle and a restored snapshot hand out copies."""
    env = Ticks()
    env.reset(seed=1)
    other = again(env)
    fresh = Ticks()
    fresh.restore(env.snapshot())
    for each in (other, fresh):
        assert each.observe("a") is not each.held
        assert each.observe("a").tolist() == [0.0, 0.0]


def test_mask_still_goes_into_the_observation() -> None:
    """The author may leave the mask's key out, and no other."""

    class Masked(Ticks):
        space = Dict(x=NUMBERS, action_mask=MultiBinary(2))
        value: ClassVar[Any] = {"x": [1, 2]}

        def mask(self, agent: str) -> Any:
            return [1, 0]

    found = Masked().reset(seed=1)[0]["a"]
    assert Masked.space.contains(found)
    assert found["action_mask"].tolist() == [1, 0]
