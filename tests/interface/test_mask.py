"""`random` and `first-legal` in every action space, with masks and without."""

import copy
from collections import Counter
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import given, settings
from hypothesis import strategies as st

from gamekeeper.errors import PolicyError
from gamekeeper.interface.joint_policy import JointPolicy, assign

DISCRETE = spaces.Discrete
SPACES = [
    DISCRETE(1),
    DISCRETE(5, start=-2),
    DISCRETE(4, dtype=np.int32) if "dtype" in DISCRETE.__init__.__annotations__ else DISCRETE(4),
    DISCRETE(2**40),
    spaces.MultiDiscrete([3, 4]),
    spaces.MultiDiscrete([[2, 3], [4, 5]]),
    spaces.MultiDiscrete([3, 4], start=[10, -3]),
    spaces.MultiBinary(3),
    spaces.MultiBinary((2, 2)),
    spaces.Box(-1, 1, (2, 3)),
    spaces.Box(-1, 1, ()),
    spaces.Box(np.array([-1.0, 0.0]), np.array([0.0, 9.0]), dtype=np.float64),
    spaces.Box(-np.inf, np.inf, (2,)),
    spaces.Box(-np.inf, -3, (2,)),
    spaces.Box(0, 255, (2, 2), np.uint8),
    spaces.Box(-3e38, 3e38, (2,)),
    spaces.Text(5, min_length=2, charset="xyz"),
    spaces.Sequence(DISCRETE(3)),
    spaces.Tuple((DISCRETE(3), spaces.Box(0, 1, (2,)))),
    spaces.Dict({"move": DISCRETE(3), "say": spaces.Text(3), "aim": spaces.MultiBinary(2)}),
    spaces.OneOf((DISCRETE(3), spaces.Box(0, 1, (2,)))),
]


def cast(policy: str, space: Any, place: str | None = None) -> JointPolicy:
    """One agent in its first episode."""
    made = assign(
        policy, possible_agents=["a"], action_space=lambda agent: space, mask_at=lambda agent: place
    )
    made.begin(0, 0)
    return made


def play(policy: str, space: Any, mask: Any, times: int = 1) -> list[Any]:
    """Actions under one mask in the info."""
    played = cast(policy, space)
    return [played.act("a", None, {"action_mask": mask}) for _ in range(times)]


@pytest.mark.parametrize("space", SPACES, ids=str)
@pytest.mark.parametrize("policy", ["random", "first-legal"])
def test_policies_choose_within_every_space(policy: str, space: Any) -> None:
    """Actions are in the space and of the types that it gives itself."""
    played = cast(policy, space)
    for _ in range(20):
        action = played.act("a", None, {})
        assert space.contains(action)
        assert type(action) is type(copy.deepcopy(space).sample())


@pytest.mark.parametrize("space", SPACES, ids=str)
def test_random_doesnt_draw_from_the_environments_space(space: Any) -> None:
    """What the environment's own space would give next is the same afterwards."""
    own, untouched = copy.deepcopy(space), copy.deepcopy(space)
    own.seed(7)
    untouched.seed(7)
    played = cast("random", own)
    for _ in range(3):
        played.act("a", None, {})
    assert repr(own.sample()) == repr(untouched.sample())


def test_policies_choose_within_a_box_wider_than_any_number() -> None:
    """Gymnasium can't draw where high - low overflows; a policy can."""
    box = spaces.Box(-1.7e308, 1.7e308, (2,), np.float64)
    drawn = [*play("random", box, None, 50), *play("first-legal", box, None)]
    assert all(box.contains(action) for action in drawn)
    assert len({float(np.sign(action[0])) for action in drawn}) == 2


def test_random_is_uniform_over_what_is_legal() -> None:
    """Each legal action comes up equally often, an illegal one never."""
    mask = np.array([1, 0, 1, 1, 0], np.int8)
    counts = Counter(int(action) for action in play("random", DISCRETE(5), mask, 6000))
    assert set(counts) == {0, 2, 3}
    assert sum((n - 2000) ** 2 / 2000 for n in counts.values()) < 15  # chi square, p = 0.0006


def test_random_is_uniform_over_a_bounded_box() -> None:
    """Draws fill the box evenly from its low to its high."""
    box = spaces.Box(np.array([-2.0, 0.0]), np.array([2.0, 1.0]), dtype=np.float64)
    drawn = np.array(play("random", box, None, 4000))
    for axis, (low, high) in enumerate([(-2, 2), (0, 1)]):
        counts = np.histogram(drawn[:, axis], bins=10, range=(low, high))[0]
        assert float(((counts - 400) ** 2 / 400).sum()) < 30


@settings(max_examples=25)
@given(st.lists(st.booleans(), min_size=1, max_size=70), st.sampled_from(["random", "first-legal"]))
def test_policies_choose_legal_actions_whatever_the_masks_type(
    flags: list[bool], policy: str
) -> None:
    """The same mask as list, tuple, bool, int8, int64 or float leads to the same legal actions."""
    space = DISCRETE(len(flags), start=3)
    forms = [flags, tuple(flags), *(np.array(flags, kind) for kind in (bool, np.int8, int, float))]
    chosen = [[int(action) for action in play(policy, space, form, 4)] for form in forms]
    assert all(one == chosen[0] for one in chosen)
    if any(flags):
        assert all(flags[action - 3] for action in chosen[0])
    if policy == "first-legal":
        assert chosen[0][0] == 3 + (flags.index(True) if any(flags) else 0)


def test_policies_pass_over_a_mask_that_leaves_nothing() -> None:
    """A mask of zeros means that there is nothing to forbid, so all actions are open."""
    drawn = {int(action) for action in play("random", DISCRETE(3), np.zeros(3, np.int8), 200)}
    assert drawn == {0, 1, 2}
    assert play("first-legal", DISCRETE(3, start=5), np.zeros(3, np.int8)) == [5]


@pytest.mark.parametrize(
    ("observation", "info", "place"),
    [
        ({"observation": 0, "action_mask": np.array([0, 1])}, {}, None),
        (np.zeros(2), {"action_mask": np.array([0, 1])}, None),
        ({"action_mask": np.array([0, 1])}, {"action_mask": np.array([1, 0])}, None),
        ({"action_mask": np.array([1, 0])}, {"legal": np.array([0, 1])}, "infos.legal"),
        ({"a": {"b": np.array([0, 1])}}, {"action_mask": np.array([1, 0])}, "observation.a.b"),
    ],
)
def test_masks_are_found_where_they_stand(observation: Any, info: Any, place: str | None) -> None:
    """The contract's place first; without one, the observation goes before the info."""
    for policy in ("random", "first-legal"):
        played = cast(policy, DISCRETE(2), place)
        assert {int(played.act("a", observation, info)) for _ in range(20)} == {1}


@pytest.mark.parametrize("info", [{}, None, "text", {"action_mask": None}])
def test_masks_that_arent_there_forbid_nothing(info: Any) -> None:
    """An info without a mask, or one that is no dictionary, leaves all actions open."""
    for place in (None, "infos.action_mask", "observation.x.y"):
        played = cast("random", DISCRETE(2), place)
        assert {int(played.act("a", {"x": 3}, info)) for _ in range(40)} == {0, 1}


@pytest.mark.parametrize(
    ("space", "mask", "legal"),
    [
        (spaces.MultiDiscrete([2, 3]), (np.array([0, 1]), np.array([1, 0, 0])), [1, 0]),
        (spaces.MultiDiscrete([2, 3]), np.array([0, 1, 0, 0, 1]), [1, 2]),
        (spaces.MultiDiscrete([2, 2]), np.array([[0, 1], [0, 1]], bool), [1, 1]),
        (
            spaces.MultiDiscrete([[2, 2]], start=[[4, 4]]),
            ((np.array([0, 1]), np.array([1, 0])),),
            [[5, 4]],
        ),
        (spaces.MultiBinary(3), np.array([0, 1, 1]), [0, 1, 1]),
        (spaces.Tuple((DISCRETE(2), DISCRETE(2))), (np.array([0, 1]), [1, 0]), (1, 0)),
        (spaces.Dict({"m": DISCRETE(2)}), {"m": np.array([0, 1])}, {"m": 1}),
        (spaces.OneOf((DISCRETE(2),)), ([0, 1],), (0, 1)),
    ],
)
def test_masks_of_compound_spaces_leave_one_action(space: Any, mask: Any, legal: Any) -> None:
    """Parts of a mask are taken for the parts of the space, in any numeric type."""
    for policy in ("random", "first-legal"):
        for action in play(policy, space, mask, 5):
            assert space.contains(action)
            assert np.array_equal(action, legal) or action == legal


def test_masks_of_compound_spaces_may_leave_parts_open() -> None:
    """A part without a mask, or with one of zeros, is drawn from all of it."""
    space = spaces.Dict({"a": DISCRETE(2), "b": DISCRETE(2), "c": spaces.MultiDiscrete([2, 2])})
    mask = {"a": np.zeros(2), "c": (np.array([0, 0]), np.array([0, 1]))}
    drawn = play("random", space, mask, 60)
    assert {int(one["a"]) for one in drawn} == {int(one["b"]) for one in drawn} == {0, 1}
    assert {int(one["c"][0]) for one in drawn} == {0, 1}
    assert {int(one["c"][1]) for one in drawn} == {1}


def test_masks_say_nothing_about_continuous_actions() -> None:
    """A Box has no list of legal actions; whatever is called a mask there is passed over."""
    box = spaces.Box(-np.inf, np.inf, (2,))
    assert box.contains(play("random", box, np.ones(2))[0])


@pytest.mark.parametrize(
    ("space", "mask"),
    [
        (DISCRETE(3), np.ones(4, np.int8)),
        (DISCRETE(3), np.ones((1, 3), np.int8)),
        (DISCRETE(3), "yes"),
        (DISCRETE(3), 1),
        (DISCRETE(3), [[1], [1, 0]]),
        (DISCRETE(10**9), np.ones(3)),
        (spaces.MultiDiscrete([2, 2]), np.ones(3)),
        (spaces.MultiDiscrete([2, 2]), 1),
        (spaces.Tuple((DISCRETE(2),)), np.ones(2)),
        (spaces.Dict({"a": DISCRETE(2)}), np.ones(2)),
        (spaces.MultiBinary(2), np.ones(5)),
    ],
)
@pytest.mark.parametrize("policy", ["random", "first-legal"])
def test_masks_that_dont_fit_are_told(policy: str, space: Any, mask: Any) -> None:
    """Agent, space and mask are named, and the key of the contract that fixes it."""
    with pytest.raises(PolicyError, match=r"mask of 'a' doesn't fit.*\n(.*\n)*.*roles\."):
        play(policy, space, mask)


@pytest.mark.parametrize("place", ["reward.mask", "infos", "infos.", ""])
def test_masks_cant_be_declared_anywhere_else(place: str) -> None:
    """A place that is neither in the observation nor in the info is refused."""
    with pytest.raises(PolicyError, match="can't stand there"):
        cast("random", DISCRETE(2), place).act("a", None, {})


def test_first_legal_says_what_it_cant_play() -> None:
    """A graph has no first one."""
    graph = spaces.Graph(spaces.Box(0, 1, (1,)), None)
    with pytest.raises(PolicyError, match="no first action in Graph"):
        cast("first-legal", graph).act("a", None, {})
