"""Rows of texts as a table, for a terminal and for a notebook; the first row is the heading."""

from collections.abc import Collection, Sequence
from html import escape


def text_lines(rows: Sequence[Sequence[str]], *, right: Collection[int] = ()) -> list[str]:
    """A line for each row, in columns; those at the places `right` stand at the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            text.rjust(width) if place in right else text.ljust(width)
            for place, (text, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def html_text(text: str) -> str:
    """Lines of text for a notebook, the first one bold."""
    first, *others = map(escape, text.splitlines() or [""])
    rest = f"<pre><code>{chr(10).join(others)}</code></pre>" if others else ""
    return f"<b>{first}</b>{rest}"


def html_table(rows: Sequence[Sequence[str]], *, caption: str = "") -> str:
    """The rows as an HTML table under a caption; texts are escaped."""
    head, *others = rows
    heading = "".join(f"<th>{escape(text)}</th>" for text in head)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>" for row in others
    )
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    return f"<table>{title}<thead><tr>{heading}</tr></thead><tbody>{body}</tbody></table>"
