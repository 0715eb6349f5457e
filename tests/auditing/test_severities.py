"""Less than the worst: cases that are low, one cause told once, and forms that readers take."""

from __future__ import annotations

import copy
import pickle
import random
from collections import defaultdict
from collections.abc import Callable
from contextlib import ExitStack
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from gamekeeper.auditing.audit import audit_here
from gamekeeper.auditing.draw_holds import generators_held, hold_entropy, spaces_held
from gamekeeper.auditing.holds import copies_held
from gamekeeper.checks.spaces.action_masks import stands_elsewhere
from gamekeeper.checks.verdict import Verdict
from tests.auditing.lucky_games import Sound
from tests.faults.copies import CopyLosesAView, RotatesAllTheSame
from tests.faults.rovers import Rovers


def verdict(make: Callable[[], Any], id: str) -> Verdict:
    """The verdict of one check on a short audit."""
    return audit_here(make, select=(id,), budget=200).of(id)


class Pairs(Rovers):
    """Observes a pair of small numbers, in any form."""

    space: spaces.Space[Any] = spaces.MultiDiscrete([3, 3])
    value: Any = (1, 2)

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Of the pair."""
        return self.space

    def observation(self, agent: str) -> Any:
        """Always the same pair."""
        return self.value


def paired(space: spaces.Space[Any], value: Any) -> type[Pairs]:
    """The environment with this space and this value."""
    return type("Paired", (Pairs,), {"space": space, "value": value})


BOX = spaces.Box(0, 9, (2,), np.float32)


@pytest.mark.parametrize(
    ("space", "value", "id", "severity"),
    [
        (spaces.MultiDiscrete([3, 3]), (1, 2), "GK211", "low"),
        (spaces.MultiDiscrete([3, 3]), (1, 7), "GK211", "high"),
        (BOX, [1.0, 2.0], "GK211", "high"),
        (BOX, np.array([1, 2], np.int8), "GK212", "low"),
        (BOX, np.array([1, 2], np.float64), "GK212", "medium"),
        (spaces.MultiBinary(2), np.array([1, 0], np.float32), "GK212", "low"),
        (spaces.MultiDiscrete([2, 2]), np.array([1, 0], np.float32), "GK212", "medium"),
    ],
)
def test_what_contains_takes_without_loss_is_low(
    space: Any, value: Any, id: str, severity: str
) -> None:
    """A tuple of a MultiDiscrete, a dtype that NumPy casts safely, zeros and ones of any: low."""
    found = verdict(paired(space, value), id)
    assert ("failed", severity) == (found.outcome, found.severity)


class Answering(Rovers):
    """Its infos are empty, and answer for every agent."""

    kind: Any = defaultdict

    def step(self, actions: dict[str, Any]) -> Any:
        """Without an entry."""
        *rest, _ = super().step(actions)
        return *rest, self.kind(dict) if self.kind is defaultdict else {}


def test_a_defaultdict_is_an_info_for_every_agent() -> None:
    """`infos[agent]` raises nothing there; of a plain dictionary it does."""
    assert verdict(Answering, "GK109").outcome == "passed"
    plain = type("Plain", (Answering,), {"kind": dict})
    assert verdict(plain, "GK109").outcome == "failed"


@pytest.mark.parametrize("shared", [np.array("go home"), np.array(3.0, np.float32)], ids=str)
def test_texts_and_single_values_may_be_shared(shared: Any) -> None:
    """Nobody writes into a text, nor scales a single value in place; arrays of numbers they do."""
    text = shared
    alike = spaces.Box(0, 9, (), np.float32)
    assert verdict(paired(alike, text), "GK614").outcome != "failed"
    numbers = np.ones(2, np.float32)
    assert verdict(paired(BOX, numbers), "GK614").outcome == "failed"


class Forbidding(Rovers):
    """Refuses the last move; the mask that says so stands under any key."""

    key = "mask"

    def info(self, agent: str) -> dict[str, Any]:
        """With the mask."""
        return {self.key: np.array([1, 1, 1, 1, 0], np.int8)}

    def step(self, actions: dict[str, Any]) -> Any:
        """Not the last."""
        if any(actions[agent] == 4 for agent in self.agents):
            raise ValueError("not there")
        return super().step(actions)


def test_a_mask_under_another_name_is_no_promise_to_take_everything() -> None:
    """Where a mask is given, and nobody reads it, refused actions accuse nobody."""
    assert verdict(Forbidding, "GK221").outcome != "failed"
    nameless = type("Nameless", (Forbidding,), {"key": "moves"})
    assert verdict(nameless, "GK221").outcome == "failed"


@pytest.mark.parametrize(("count", "is_mask"), [(10, True), (9, False)])
def test_a_mask_of_a_tuple_has_a_flag_for_each_joint_choice(count: int, is_mask: bool) -> None:
    """Of five moves and two tools, ten; of another size it is no mask."""
    space = spaces.Tuple([spaces.Discrete(5), spaces.Discrete(2)])
    turn = SimpleNamespace(observations={}, infos={"a": {"mask": [True] * count}})
    assert stands_elsewhere(space, turn, "a") == is_mask


def test_a_mask_of_joint_actions_fits() -> None:
    """One number for each pair of choices is a mask of a MultiDiscrete, a smaller one isn't."""

    def masked(shape: tuple[int, ...]) -> type[Rovers]:
        mask = np.ones(shape, np.int8)
        methods = {
            "info": lambda self, agent: {"action_mask": mask},
            "action_space": lambda self, agent: spaces.MultiDiscrete([5, 3]),
            "step": lambda self, actions: Rovers.step(
                self, {a: int(np.ravel(each)[0]) for a, each in actions.items()}
            ),
        }
        return type("Masked", (Rovers,), methods)

    assert verdict(masked((5, 3)), "GK230").outcome == "passed"
    assert verdict(masked((4, 3)), "GK230").outcome == "failed"


def test_a_game_that_is_not_converted_shows_nothing_within_cycles() -> None:
    """GK711 leaves to GK710 what this says already."""
    found = verdict(RotatesAllTheSame, "GK711")
    assert found.outcome == "not_applicable"
    assert "GK710" in found.reason


class Unseeded:
    """Draws from generators of its own that no reset reaches."""

    def __init__(self) -> None:
        self.parts = [np.random.default_rng(), random.Random(), np.random.RandomState()]

    @property
    def unwrapped(self) -> Unseeded:
        """Is itself, as it has no wrapper."""
        return self

    def reset(self, seed: int | None = None) -> list[float]:
        """One number of each."""
        return self.step(None)

    def step(self, action: Any) -> list[float]:
        """The next of each."""
        return [each.random() for each in self.parts]


def test_generators_begin_anew_at_each_reset_where_they_are_held() -> None:
    """A used instance then plays like a fresh one, so that nothing else survives a reset."""
    with ExitStack() as put_back:  # what a held program leaves as it is
        put_back.callback(hold_entropy())
        env = generators_held(Unseeded)()
        first = [env.reset(), env.step(0)]
        assert first[0] != first[1]
        assert first == [env.reset(), env.step(0)]
    fresh = Unseeded()
    assert fresh.reset() != fresh.reset()


class DealsOnce:
    """Shuffles once, when it is built, and deals on from there."""

    def __init__(self) -> None:
        self.deck = random.Random().sample(range(1_000), 50)
        self.dealt = 0

    @property
    def unwrapped(self) -> DealsOnce:
        """Is itself, as it has no wrapper."""
        return self

    def reset(self, seed: int | None = None) -> list[int]:
        """The next card, and how many were dealt."""
        self.dealt += 1
        return [self.deck.pop(), self.dealt]


def test_what_a_constructor_drew_is_put_back_at_each_reset_where_it_is_held() -> None:
    """The deck is as it was in every instance; what nobody drew goes on over resets."""
    with ExitStack() as put_back:
        put_back.callback(hold_entropy())
        held = generators_held(DealsOnce)
        one, other = held(), held()
        first = one.reset()
        assert [first[0], 2] == one.reset()
        assert first == other.reset()


class Sampled(Sound):
    """Shows samples of a space that it hands out, whatever the seed."""

    def seen(self) -> Any:
        """Luck of the space."""
        return self.observation_space("a").sample()


def test_a_space_begins_anew_at_each_reset_where_it_is_held() -> None:
    """A seed that settles nothing follows from draws of a space, where it then settles all."""
    for make, is_alike in ((Sampled, False), (spaces_held(Sampled), True)):
        env = make()
        first, again = (env.reset(seed=3)[0]["a"] for _ in range(2))
        assert is_alike == (first == again).all()


def test_held_copies_play_on_like_their_originals() -> None:
    """A copy is made by the same calls, however its class would copy itself."""
    env = copies_held(CopyLosesAView)()
    env.reset(seed=3)
    actions = dict.fromkeys(env.agents, 0)
    env.step(actions)
    copies = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    expected = env.step(actions)[1]
    assert [expected, expected] == [each.step(actions)[1] for each in copies]


def test_a_passed_check_says_what_it_could_have_missed() -> None:
    """By the rule of three: of 30 cases without a failure 3 / 30, of one nearly everything."""
    few, many = (Verdict("GK1", "x", "passed", "low", cases=n) for n in (1, 300))
    assert few.could_miss == pytest.approx(0.95)
    assert many.could_miss == pytest.approx(3 / 300, rel=0.01)
    assert Verdict("GK1", "x", "not_exercised", "low").could_miss is None
    assert many == Verdict.from_json(many.to_json())
    assert many.to_json()["could_miss"] == many.could_miss
