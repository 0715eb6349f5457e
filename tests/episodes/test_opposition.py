"""Opponents are told from a team by what they are paid."""

import numpy as np
import pyarrow as pa
import pytest

from gamekeeper.episodes.opposition import opponents, opponents_in

RNG = np.random.default_rng(0)
CATCHES = (RNG.uniform(size=(60, 1)) < 0.5) * RNG.uniform(1, 3, (60, 1))
NAMES = ("a", "b", "c")


def test_payments_that_cancel_out_are_of_opponents() -> None:
    """Row by row, in five or more; not where nothing is paid, or one agent alone plays."""
    rows = np.array([[1.0, -1.0], [0.0, 0.0], [-0.5, 0.5]])
    said = opponents(np.vstack([rows, rows, rows]), NAMES[:2], of="turns")
    assert said == "what agents are paid cancels out in each of 6 turns that paid anything"
    assert opponents(rows, NAMES[:2]) is None
    assert opponents(np.zeros((9, 2)), NAMES[:2]) is None
    assert opponents(np.zeros((9, 1)), NAMES[:1]) is None


def test_one_that_gains_where_another_loses_is_an_opponent() -> None:
    """Though a third is paid beside them, and the hunted one has costs of its own."""
    table = np.hstack([CATCHES, -2 * CATCHES - 0.01, np.full((60, 1), 0.1)])
    said = opponents(table, NAMES)
    assert said is not None
    assert said.startswith("a and b are paid with opposite signs in ")


@pytest.mark.parametrize(
    "table",
    [
        np.hstack([CATCHES, 3 - CATCHES, CATCHES]),
        np.hstack([CATCHES, np.full((60, 1), -0.1), CATCHES]),
        np.hstack([CATCHES, -RNG.uniform(0, 1, (60, 1)), CATCHES]),
    ],
    ids=["they share what there is", "one has costs", "one has costs by chance"],
)
def test_a_team_is_no_opponent(table: np.ndarray) -> None:
    """Sharing and costs aren't competing."""
    assert opponents(table, NAMES) is None


def test_a_table_is_read_by_turns_and_by_episodes() -> None:
    """A prize that one loses at another turn than the other gains it cancels out by episode."""
    rows = [(e, t, a, x) for e in range(5) for t, (a, x) in enumerate((("a", 1.0), ("b", -1.0)))]
    columns = dict(
        zip(("episode", "turn", "agent", "reward"), map(list, zip(*rows, strict=True)), strict=True)
    )
    said = opponents_in(pa.table(columns), NAMES[:2])
    assert said == "what agents are paid cancels out in each of 5 episodes that paid anything"
    assert opponents_in(pa.table({**columns, "reward": [1.0] * 10}), NAMES[:2]) is None
