"""Raw episodes as rows, and figures of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.contract import Contract
from gamekeeper.episodes.outcome import Outcome
from gamekeeper.evaluation.episode_rows import (
    Fingerprint,
    Sheet,
    Success,
    rows_of,
    schema_with,
    sheets_of,
    table_of,
    widened,
)

CONTRACT = Contract.parse(
    """
[roles.p]
agents = "p_*"
symmetric = true
[roles.c]
agents = "c_*"
[failure]
team = "return < 3"
p = "return < 2"
"""
)


def table(outcomes: list[Outcome], pairing: str = "a") -> object:
    """The rows of episodes."""
    rows = []
    for number, outcome in enumerate(outcomes):
        rows += rows_of(
            outcome,
            label={"environment": "e", "pairing": pairing, "episode": number},
            sides={"*": ("a", 0)},
            lengths=dict.fromkeys(outcome.returns, 2),
            success=Success(CONTRACT, {}),
            contract=CONTRACT,
            roster=("p_0", "c_0"),
            infos=("seen",),
        )
    return table_of(rows)


WHOLE = Outcome(
    seed=1,
    turns=5,
    returns={"p_0": 1.0, "p_1": 2.0, "c_0": 0.0},
    terms={"p_0": {"x": 1.0}, "p_1": {"x": 2.0}, "c_0": {}},
    endings={"p_0": "battery", "p_1": "cleared", "c_0": "cleared"},
    flags={"p_0": "truncated", "p_1": "terminated", "c_0": "terminated"},
    infos={"p_0": {"seen": 4.0}},
)
FEWER = Outcome(
    seed=2,
    turns=3,
    returns={"p_0": 3.0, "c_0": 1.0},
    endings={"p_0": "cut", "c_0": "cut"},
    flags={"p_0": "cut", "c_0": "cut"},
)
BROKEN = Outcome(seed=3, error="ValueError: no")


def test_sheet_sums_the_team_and_averages_roles() -> None:
    """One who isn't there has no figure, rather than 0."""
    sheet = Sheet.of(table([WHOLE, FEWER]))  # type: ignore[arg-type]
    assert sheet.values("return").tolist() == [3.0, 4.0]
    assert sheet.values("return", "role", "p").tolist() == [1.5, 3.0]
    assert sheet.values("return", "agent", "p_1")[:1].tolist() == [2.0]
    assert np.isnan(sheet.values("return", "agent", "p_1")[1])
    assert sheet.values("length").tolist() == [5.0, 3.0]
    assert sheet.values("reward.x")[0] == 3.0
    assert sheet.values("info.seen", "role", "p")[0] == 4.0


def test_sheet_tells_success_by_scope() -> None:
    """The team's condition and a role's; of agents nothing was asked."""
    sheet = Sheet.of(table([WHOLE, FEWER, BROKEN]))  # type: ignore[arg-type]
    assert sheet.values("success").tolist() == [1.0, 1.0, 0.0]
    assert sheet.values("success", "role", "p").tolist() == [1.0, 1.0, 0.0]
    assert np.isnan(sheet.values("success", "agent", "p_0")).all()


def test_sheet_keeps_terminations_from_truncations() -> None:
    """By flag and by reason; a team whose agents ended differently is mixed."""
    sheet = Sheet.of(table([WHOLE, FEWER, BROKEN]))  # type: ignore[arg-type]
    ends = sheet.endings("role", "p")
    assert tuple(ends[k] for k in ("terminated", "truncated", "cut", "failed")) == (1, 1, 1, 1)
    assert ends["reasons"] == {"battery": 1, "cleared": 1, "cut": 1, "failed": 1}
    team = sheet.endings()
    assert tuple(team[k] for k in ("terminated", "truncated", "cut", "mixed", "failed")) == (
        0,
        0,
        1,
        1,
        1,
    )


def test_sheet_has_no_return_of_a_broken_episode() -> None:
    """What was paid until then is no return."""
    sheet = Sheet.of(table([WHOLE, BROKEN]))  # type: ignore[arg-type]
    assert sheet.broken.tolist() == [False, True]
    assert np.isnan(sheet.values("return")[1])


def test_sheets_are_found_by_line_up() -> None:
    """Rows of one stand together."""
    import pyarrow as pa

    both = pa.concat_tables([table([WHOLE]), table([FEWER], "b")], promote_options="default")
    found = sheets_of(both)
    assert list(found) == [("e", "a"), ("e", "b")]
    assert found["e", "b"].values("return").tolist() == [4.0]
    assert sheets_of(both.slice(0, 0)) == {}


@given(st.integers(1, 8))
def test_fingerprint_is_the_same_however_rows_are_split(size: int) -> None:
    """Parts of any size give one digest."""
    whole = table([WHOLE, FEWER, WHOLE, FEWER])
    schema = schema_with(["reward.x", "info.seen"])
    whole = widened(whole, schema)
    one, many = Fingerprint(schema), Fingerprint(schema)
    one.add(whole)
    for start in range(0, whole.num_rows, size):
        many.add(whole.slice(start, size))
    assert one.hexdigest() == many.hexdigest()
    other = Fingerprint(schema)
    other.add(whole.slice(1))
    assert one.hexdigest() != other.hexdigest()


def test_success_takes_conditions_in_place_of_the_contracts() -> None:
    """Those who are asked; the contract's don't count then."""
    told = Success(CONTRACT, {"agent": "return > 1", "team": "length > 4"}).of(WHOLE)
    assert told == {"p_0": False, "p_1": True, "c_0": False, "team": True}
    assert pytest.approx(0) == sum(Success(CONTRACT, {"agent": "return > 9"}).of(WHOLE).values())
