"""Columns of a terminal: how many a text takes, and texts filled up to a number of them."""

from __future__ import annotations

import textwrap
import unicodedata
from typing import Final

from gamekeeper.core.contract.places import one_line

DOUBLE: Final = frozenset("WF")
"""East Asian widths of signs that take two columns. Source: Unicode Standard Annex 11."""
COMBINING: Final = frozenset({"Mn", "Me", "Cf"})
"""Categories of signs that take no column of their own."""
ELLIPSIS: Final = "..."

_STUFFING: Final = "\ue000"
"""A private sign that no text is expected to hold; it takes the second column of a wide one."""


def columns_of(text: str) -> int:
    """How many columns of a terminal the text takes."""
    return len(text) if text.isascii() else sum(map(_columns_of_sign, text))


def filled(text: str, columns: int, *, right: bool = False) -> str:
    """The text with spaces after it, or before it if it stands at the right."""
    spaces = " " * max(columns - columns_of(text), 0)
    return spaces + text if right else text + spaces


def one_cell(text: str, most: int) -> str:
    """The text on one line and with no control character, cut where it takes more columns.

    An agent's name may be of any length; the document has all of it.

    Args:
        most: columns that it may take, three or more.
    """
    line = one_line(text)
    if columns_of(line) <= most:
        return line
    line = line[:most]  # what is cut sign by sign from here on is short
    while columns_of(line) > most - len(ELLIPSIS):
        line = line[:-1]
    return line + ELLIPSIS


def wrapped(text: str, columns: int, *, first: str = "", rest: str = "") -> list[str]:
    """Lines of at most so many columns, broken at spaces where there are any.

    A word that is too long for a line is broken; a wide sign at that place stands out by a column.

    Args:
        text: spaces in a row count as one break.
        columns: of a line, what is put in front of it counted.
        first: stands in front of the first line.
        rest: stands in front of the others.
    """
    # textwrap counts signs, so a wide one stands as two while it does.
    stretched = "".join(sign + _STUFFING * (_columns_of_sign(sign) - 1) for sign in text)
    lines = textwrap.wrap(
        text if text.isascii() else stretched,
        columns,
        initial_indent=first,
        subsequent_indent=rest,
        break_on_hyphens=False,
    )
    return [line.replace(_STUFFING, "") for line in lines]


def _columns_of_sign(sign: str) -> int:
    if unicodedata.category(sign) in COMBINING:
        return 0
    return 2 if unicodedata.east_asian_width(sign) in DOUBLE else 1
