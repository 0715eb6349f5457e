"""Texts take as many columns as a terminal gives them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.contract.validation import one_line
from gamekeeper.reporting.results_text import table_lines
from gamekeeper.reporting.text_columns import columns_of, filled, one_cell, wrapped


@pytest.mark.parametrize(
    ("columns", "text"),
    [(0, ""), (5, "robot"), (1, "Ä"), (1, "A\u0308"), (8, "joueur\u4e8c"), (4, "ロボ")],
)
def test_columns_of_counts_what_a_terminal_shows(columns: int, text: str) -> None:
    """A wide sign takes two columns, a combining one none."""
    assert columns == columns_of(text)


@given(st.text("aä二 ロ\u0308", max_size=30), st.integers(0, 40), st.booleans())
def test_filled_reaches_its_columns(text: str, columns: int, right: bool) -> None:
    """A text is filled up to the columns and never cut."""
    assert max(columns, columns_of(text)) == columns_of(filled(text, columns, right=right))


@given(st.text("aä二 ロ", max_size=60), st.integers(8, 30))
def test_wrapped_keeps_to_its_columns_and_loses_nothing(text: str, columns: int) -> None:
    """No line is wider than asked but for half a sign, and all signs but the breaks are there."""
    lines = wrapped(text, columns, rest="  ")
    assert [line for line in lines if columns_of(line) > columns + 1] == []
    assert "".join(text.split()) == "".join("".join(lines).split())


@given(st.text("aä二 ロ\u0308\x1b\n", max_size=60), st.integers(3, 30))
def test_one_cell_keeps_to_its_columns_and_its_line(text: str, most: int) -> None:
    """However long or wide a name is, its cell isn't; no terminal obeys it."""
    cell = one_cell(text, most)
    assert columns_of(cell) <= most
    assert cell.isprintable()
    assert cell == one_line(text) or cell.endswith("...")


def test_table_stands_in_columns_whatever_the_script() -> None:
    """The second column begins at the same place behind wide names."""
    one, two = table_lines([("二二", "x"), ("abcd", "x")], width=40)
    assert columns_of(one) == columns_of(two)


def test_last_column_stands_below_where_the_others_leave_no_room() -> None:
    """No line is longer than asked for, and every word is there."""
    rows = [("a" * 25, "b" * 16, "one two three four five six"), ("c", "d", "")]
    lines = list(table_lines(rows, width=50))
    assert max(map(columns_of, lines)) <= 50
    assert lines[0].split() == ["a" * 25, "b" * 16]
    assert " ".join(" ".join(lines).split()).endswith("one two three four five six c d")
    assert lines[1].startswith("      one")
