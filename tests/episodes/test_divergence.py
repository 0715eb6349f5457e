from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.episodes.divergence import Divergence, compare, difference, shown_pair
from gamekeeper.episodes.episode import Episode
from gamekeeper.runs.recording import rollout
from tests.runs.walks import Turns, Walk

numbers = st.floats(allow_nan=False, allow_infinity=False, width=32)


def episode(env: Any = None, *, seed: int = 0, **options: Any) -> Episode:
    """One episode of an environment, in memory."""
    return rollout(env or Walk(), episodes=1, seed=seed, **options).episodes[0]


@pytest.mark.parametrize("kind", [Walk, Turns])
def test_compare_finds_equal_traces_exact(kind: type) -> None:
    """Two episodes from one seed are equal bit for bit, whatever the tolerance."""
    for tolerance in (None, 0.0, 1e-6):
        found = compare(episode(kind()), episode(kind()), tolerance=tolerance)

        assert (found.divergence, found.is_exact, found.largest) == (None, True, 0.0)


def test_compare_names_rows_that_are_missing() -> None:
    """An episode that ends earlier differs in the rows of the turn that it lacks."""
    found = compare(episode(), episode(most_turns=2)).divergence

    assert found is not None
    assert (found.episode, found.turn, found.field) == (0, 2, "order")

    found = compare(episode(Walk(turns=2)), episode(Walk(turns=2), most_turns=1)).divergence
    assert found is not None
    assert (found.turn, found.agent) == (1, "a")


class Boxed(Walk):
    """Its state is no array, and its observations lie in a dictionary of tuples."""

    def __init__(self, *, state: Any = "s", shift: float = 0.0, terms: Any = None) -> None:
        super().__init__()
        self.kept, self.shift = state, shift

    def state(self) -> Any:
        return {"passed": self.kept}


def test_compare_sees_a_state_that_fits_no_column() -> None:
    """States that are no arrays differ by their values, and are exact where they don't."""
    assert compare(episode(Boxed()), episode(Boxed())).is_exact
    found = compare(episode(Boxed()), episode(Boxed(state="t"))).divergence

    assert found is not None
    assert (found.turn, found.agent, found.field) == (0, None, "state")
    assert (found.recorded, found.replayed) == ({"passed": "s"}, {"passed": "t"})


class Informed(Walk):
    """Its infos hold a number of another type, and a time."""

    def __init__(self, *, note: Any = 1, wall_s: float = 0.0) -> None:
        super().__init__()
        self.note, self.wall_s = note, wall_s

    def step(self, actions: Any) -> Any:
        *out, infos = super().step(actions)
        return *out, {agent: {"note": self.note, "wall_s": self.wall_s} for agent in infos}


def test_compare_leaves_volatile_infos_out() -> None:
    """A field of an info that is declared volatile may differ; any other may not."""
    one, two = episode(Informed(wall_s=1.0)), episode(Informed(wall_s=2.0))

    assert compare(one, two, volatile={"wall_s"}).divergence is None
    found = compare(one, two).divergence
    assert found is not None
    assert (found.turn, found.agent, found.field) == (1, "a", "info")


def test_compare_within_tolerance_is_not_exact() -> None:
    """1 and 1.0 differ by nothing, and are still not the same bit for bit."""
    found = compare(episode(Informed()), episode(Informed(note=1.0)), tolerance=0.5)

    assert (found.divergence, found.is_exact) == (None, False)


@given(one=numbers, two=numbers, tolerance=st.floats(0, 10))
def test_difference_is_symmetric_and_bounded(one: float, two: float, tolerance: float) -> None:
    """Within the tolerance, absolute or relative, means the gap; beyond it, nothing."""
    found = difference(one, two, tolerance)

    assert found == difference(two, one, tolerance)
    gap = abs(np.float64(one) - np.float64(two))
    within = gap <= tolerance * max(1.0, abs(one), abs(two))
    assert found == (gap if within else None)


@pytest.mark.parametrize(
    ("one", "two"),
    [
        (True, False),
        (True, 1.0),
        ("1.5", "1.50"),
        ("a", "b"),
        (None, float("nan")),
        (None, 0.0),
        (float("inf"), 1e300),
        (float("inf"), float("-inf")),
        (float("nan"), 1.0),
        ([1.0], (1.0,)),
        ([1.0], [1.0, 2.0]),
        ({"a": 1.0}, {"b": 1.0}),
        (np.zeros(2), np.zeros(3)),
        (np.array([True]), np.array([False])),
        (b"1", b"2"),
        (object(), 1.0),
    ],
)
def test_difference_has_no_tolerance_but_for_numbers(one: Any, two: Any) -> None:
    """Flags, texts, shapes, infinities and what is missing are never nearly equal."""
    assert difference(one, two, 5.0) is None


@pytest.mark.parametrize(
    "value", [float("nan"), float("inf"), None, "x", {"a": [np.float32(1)]}, np.array([np.nan])]
)
def test_difference_of_equal_values_is_none_at_all(value: Any) -> None:
    """What is the same bit for bit differs by 0.0, with and without tolerance."""
    assert difference(value, value, None) == 0.0
    assert difference(value, value, 0.1) == 0.0


def test_difference_keeps_the_sign_of_zero() -> None:
    """-0.0 isn't 0.0 bit for bit, and is within any tolerance."""
    assert difference(0.0, -0.0, None) is None
    assert difference(0.0, -0.0, 0.0) == 0.0


def test_divergence_of_images_shows_the_first_element() -> None:
    """A large array is shown by the first element that differs; a small one whole."""
    one = np.zeros((4, 5, 3), np.uint8)
    two = one.copy()
    two[2, 3, 1], two[3, 0, 0] = 7, 9

    left, right = shown_pair(one, two)

    assert (left, right) == ("0 at [2, 3, 1], the first of 2 of 60 elements that differ", "7")
    assert shown_pair(np.array([1, 2]), np.array([1, 3])) == ("[1,2]", "[1,3]")
    assert shown_pair({"a": np.eye(2)}, {"a": np.zeros((2, 2))})[0] == '{"a":[[1.0,0.0],[0.0,1.0]]}'
    floats = shown_pair(np.zeros(2, np.float32), np.zeros(2))  # the type alone differs
    assert "<f4" in floats[0]
    text = str(Divergence(3, 4, "a", "obs.view", one, two))
    assert text.startswith("episode 3, turn 4, obs.view['a']\n  recorded: 0 at [2, 3, 1]")


def test_divergence_is_plain_json() -> None:
    """Arrays and non-numbers stand in the document as canonical JSON has them."""
    found = Divergence(0, 1, None, "state", np.float64("nan"), np.array([1.5]))

    assert found.to_json() == {
        "episode": 0,
        "turn": 1,
        "agent": None,
        "field": "state",
        "recorded": {"$": "nan"},
        "replayed": {"$": "ndarray", "dtype": "<f8", "shape": [1], "v": [1.5]},
        "witness": None,
    }
