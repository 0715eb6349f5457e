"""Views of episodes and turns are sequences: counted, indexed, sliced, read more than once."""

import pytest

from gamekeeper.episodes.views import Views
from gamekeeper.runs.recording import rollout
from tests.runs.walks import Walk


def test_views_are_a_sequence() -> None:
    """Places count from either end, a slice is views again, and too far is an IndexError."""
    views = Views(5, lambda place: place * 10)
    assert len(views) == 5
    assert [0, 10, 20, 30, 40] == list(views) == list(views)
    assert (views[0], views[-1]) == (0, 40)
    assert list(views[1:4:2]) == [10, 30]
    assert views[3:][-1] == 40
    assert list(reversed(views)) == [40, 30, 20, 10, 0]
    assert not Views(0, lambda place: place)
    with pytest.raises(IndexError):
        views[5]


def test_episodes_and_turns_are_read_by_place() -> None:
    """The same turns by place as one after another, each time they are asked for."""
    evidence = rollout(Walk(), episodes=3, seed=0)
    assert len(evidence.episodes) == 3
    assert [each.episode for each in evidence.episodes] == [0, 1, 2]
    last = evidence.episodes[-1]
    assert last.episode == 2
    assert [turn.index for turn in last.turns] == list(range(len(last.turns)))
    assert last.turns[2].rewards == list(last.turns)[2].rewards
    assert [turn.index for turn in last.turns[1:3]] == [1, 2]
    assert last.turns[-1].index == len(last) - 1
