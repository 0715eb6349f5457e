"""Rows of a query as text: a table where it fits, else each row as a block."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from gamekeeper.contract.validation import one_line
from gamekeeper.reporting.text_columns import (
    GAP,
    INDENT,
    columns_of,
    filled,
    fitted,
    indented,
    wrapped,
)

NARROWEST: Final = 8
"""Least columns of a text that is cut; below, rows become blocks."""
LONGEST: Final = 200
"""Characters of one value in a block; the document has all of it."""


def query_text(
    columns: Sequence[str], rows: Sequence[Sequence[Any]], *, width: int, more: bool = False
) -> str:
    """The rows as a table with a heading; where they don't fit side by side, block by block.

    Args:
        rows: a value for each column.
        more: there are more rows than these.
    """
    if not rows:
        return f"{GAP.join(columns)}\n{INDENT}no rows"
    cells = [[one_line(value_text(value)) for value in row] for row in rows]
    lines = _table(columns, cells, _numbers(rows), width) or _blocks(columns, cells, width)
    last = ["..."] if more else []
    return "\n".join([*lines, *last])


def views_text(views: Mapping[str, Mapping[str, str]], *, width: int) -> str:
    """The views, each with its columns and their types."""
    lines = []
    for name, columns in views.items():
        text = ", ".join(f"{column} {type_}" for column, type_ in columns.items())
        lines += [name, *indented(one_line(text), width)]
    return "\n".join(lines)


def value_text(value: Any) -> str:
    """A value as a reader would write it."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, bytes | bytearray):
        return f"0x{bytes(value).hex()}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(value_text, value))}]"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{key}: {value_text(each)}' for key, each in value.items())}}}"
    return str(value)


def plain_value(value: Any) -> Any:
    """A value as JSON holds it; bytes as hexadecimal digits, times and decimals as text."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, bytes | bytearray):
        return bytes(value).hex()
    if isinstance(value, Mapping):
        return {str(key): plain_value(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain_value(each) for each in value]
    return str(value)


def _numbers(rows: Sequence[Sequence[Any]]) -> set[int]:
    """The columns that hold only numbers; they are aligned right."""
    return {
        place
        for place, column in enumerate(zip(*rows, strict=True))
        if all(value is None or _is_number(value) for value in column)
        and any(value is not None for value in column)
    }


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _table(
    columns: Sequence[str], cells: Sequence[Sequence[str]], right: set[int], width: int
) -> list[str]:
    """The lines of a table, texts cut where they have to be; empty where it doesn't fit."""
    head = [one_line(name) for name in columns]
    natural = [max(map(columns_of, column)) for column in zip(head, *cells, strict=True)]
    least = [
        size if place in right else min(size, max(NARROWEST, columns_of(head[place])))
        for place, size in enumerate(natural)
    ]
    room = width - len(GAP) * (len(columns) - 1)
    if sum(least) > room:
        return []
    # Each column has its least width; what is left of the room goes to those that want more.
    more = [size - low for size, low in zip(natural, least, strict=True)]
    given = fitted(more, room - sum(least)) if sum(natural) > room else more
    widths = [low + min(part, want) for low, part, want in zip(least, given, more, strict=True)]
    return [
        GAP.join(
            filled(_cut(cell, size), size, right=place in right)
            for place, (cell, size) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in [head, *cells]
    ]


def _blocks(columns: Sequence[str], cells: Sequence[Sequence[str]], width: int) -> Iterator[str]:
    """Each row as lines of a name and its value."""
    before = max(map(columns_of, columns))
    for number, row in enumerate(cells, start=1):
        yield f"row {number}"
        for name, cell in zip(columns, row, strict=True):
            text = cell if len(cell) <= LONGEST else f"{cell[:LONGEST]}..."
            room = max(width - before - len(INDENT) - len(GAP), 16)
            first, *rest = wrapped(text, room) or [""]
            yield f"{INDENT}{filled(one_line(name), before)}{GAP}{first}".rstrip()
            yield from (" " * (before + len(INDENT) + len(GAP)) + line for line in rest)


def _cut(text: str, size: int) -> str:
    """Cuts a text to so many columns by leaving out its middle."""
    if columns_of(text) <= size:
        return text
    if columns_of(text) == len(text) and size > 5:  # both ends of a path or a digest tell most
        tail = (size - 2) // 2
        return f"{text[: size - 2 - tail]}..{text[-tail:]}"
    while text and columns_of(text) > size - 2:
        text = text[:-1]
    return f"{text}.."
