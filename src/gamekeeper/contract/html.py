"""A contract as HTML for notebooks: a table for each of its sections."""

from collections.abc import Mapping
from html import escape
from typing import Final

APIS: Final = {"parallel": "Parallel", "aec": "AEC"}
TITLE: Final = ("name", "api", "why")


def contract_html(data: Mapping[str, object]) -> str:
    """The contract's plain data as headings and tables; every text is escaped."""
    name = escape(str(data.get("name") or "a contract without a name"))
    api = APIS.get(str(data.get("api")), "API not declared")
    blocks = [f"<b>{name} ({api})</b>"]
    if data.get("why"):
        blocks.append(f"<div>{escape(str(data['why']))}</div>")
    for section, value in data.items():
        if section in TITLE:
            continue
        rows = value.items() if isinstance(value, Mapping) else [(section, value)]
        body = "".join(
            f"<tr><th>{escape(str(key))}</th><td>{escape(_text(each))}</td></tr>"
            for key, each in rows
        )
        blocks.append(f"<table><caption>{escape(section)}</caption>{body}</table>")
    return "".join(blocks)


def _text(value: object) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key}: {_text(each)}" for key, each in value.items())
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_text, value)) + "]"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return str(value)
