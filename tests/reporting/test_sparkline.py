"""Returns over episodes as pictures of text."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

import gamekeeper as gk
from gamekeeper.reporting.text_columns import (
    ASCII,
    BLOCKS,
    columns_of,
    means_of,
    returns_by_episode,
    returns_text,
    sparkline,
)


@pytest.mark.parametrize(("has_blocks", "signs"), [(True, BLOCKS), (False, ASCII)])
def test_sparkline_goes_from_the_lowest_to_the_highest(has_blocks: bool, signs: str) -> None:
    """Eight heights, whatever the scale."""
    assert sparkline(range(8), has_blocks=has_blocks) == signs
    assert sparkline([1e300, -1e300], has_blocks=has_blocks) == signs[-1] + signs[0]


def test_sparkline_shows_what_is_missing_and_what_is_no_number() -> None:
    """A blank and a question mark; equal values stand at half height."""
    assert sparkline([1.0, None, math.nan, math.inf, 1.0]) == "▄ ??▄"
    assert sparkline([]) == ""
    assert sparkline([0.0, 0.0], bounds=(0.0, 1.0)) == "▁▁"


@given(st.lists(st.none() | st.floats(), max_size=50), st.integers(1, 7))
def test_sparkline_has_a_sign_for_each_value(values: list[float | None], each: int) -> None:
    """Whatever the values are, as many signs as values, or as buckets of them."""
    assert len(sparkline(values)) == len(values)
    assert len(means_of(values, each)) == math.ceil(len(values) / each)


@given(
    st.dictionaries(
        st.text(min_size=1, max_size=12),
        st.lists(st.floats(-9, 9), max_size=300),
        min_size=1,
        max_size=4,
    ),
    st.integers(60, 110),
)
def test_returns_keep_to_their_width(returns: dict[str, list[float]], width: int) -> None:
    """A picture has as many columns as are left; hostile names stay on their line."""
    lines = returns_text(returns, width=width).splitlines()
    assert max(map(columns_of, lines)) <= max(width, 78)
    assert len(returns) <= len(lines) <= len(returns) + 1


def test_returns_tell_the_scale_and_the_bucket() -> None:
    """The lowest and the highest return; how many episodes a sign stands for."""
    text = returns_text({"a": [0.0, 1.0, 0.5], "bb": [2.0, 2.0, 2.0]}, width=80)
    assert text.splitlines() == ["  a   ▁█▅  0 to 1", "  bb  ▄▄▄  all 2"]
    text = returns_text({"a": [float(k) for k in range(200)]}, width=60)
    assert text.splitlines()[-1] == "  each character is the mean of 5 episodes"


def test_returns_by_episode_are_those_of_the_rows() -> None:
    """Their means are those of the summary."""
    evidence = gk.rollout("handover", episodes=4, seed=2)
    found = returns_by_episode(evidence)
    assert list(found) == evidence.manifest["agents"]
    for agent, summary in evidence.summary.agents.items():
        assert sum(found[agent]) / 4 == pytest.approx(summary.return_mean)
