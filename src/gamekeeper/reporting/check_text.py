"""Text of a check for a terminal: its promise, its reason, examples, fix.

All functions take a check as plain data: `id`, `claim`, `about` (Markdown), `needs`, `severity`,
`confidence`, `fix`, `api`.
"""

import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

from gamekeeper.reporting.results_text import table_lines, table_text
from gamekeeper.reporting.text_columns import INDENT, indented, wrapped

Card = Mapping[str, Any]

FENCE: Final = "```"
APIS: Final = {"aec": "AEC environments", "parallel": "Parallel environments", None: "both APIs"}
FAMILIES: Final = {
    "GK1": "rosters and identity",
    "GK2": "spaces, masks, infos",
    "GK3": "timing, order, conflicts",
    "GK4": "rewards",
    "GK5": "endings and the life cycle",
    "GK6": "seeds, leaks, aliasing",
    "GK7": "conversion and copies",
    "GK8": "rendering, state, metadata, cost",
    "GK9": "evidence",
}
SEVERITIES: Final = {
    "high": "high: agents learn another task than the one described",
    "medium": "medium: some trainers or tools are misled, or crash",
    "low": "low: a nuisance",
}


def family_of(id: str) -> str:
    """Subject of a check, by the first figure of its id; `others` for third parties'."""
    return FAMILIES.get(id[:3], "others") if len(id) == len("GK402") else "others"


def check_text(check: Card, *, width: int) -> str:
    """A check explained on a terminal."""
    lines = wrapped(f"{check['id']}  {check['claim']}", width, rest=" " * 7)
    for kind, text in paragraphs(check["about"]):
        if kind == "code":
            lines += ["", *textwrap.indent(text, "      ").splitlines()]
        elif kind == "heading":
            lines += ["", f"{INDENT}{text}"]
        else:
            lines += ["", *indented(text, width)]
    rows = [("fix", check["fix"]), ("severity", SEVERITIES[check["severity"]])]
    if check["confidence"] < 1:
        rows.append(("confidence", f"{check['confidence']:g}"))
    rows += [
        ("applies to", APIS[check["api"]]),
        ("needs", f"probes: {', '.join(check['needs'])} (gamekeeper list probes)"),
    ]
    rows.append(("to waive", f'[waivers] {check["id"]} = "the reason", in the contract'))
    lines += ["", *table_lines(rows, width=width)]
    return "\n".join(lines)


def checks_text(checks: Iterable[Card], *, width: int) -> str:
    """A line for each check, by family."""
    blocks = []
    for family, members in by_family(checks).items():
        rows = [(each["id"], each["severity"], each["claim"]) for each in members]
        title = family[0].upper() + family[1:]
        blocks.append(table_text(title, rows, width))
    return "\n\n".join(blocks)


def by_family(checks: Iterable[Card]) -> dict[str, list[Card]]:
    """The checks in the order of their ids, by their subject."""
    found: dict[str, list[Card]] = {}
    for each in sorted(checks, key=lambda each: str(each["id"])):
        found.setdefault(family_of(each["id"]), []).append(each)
    return found


def paragraphs(about: str) -> Iterator[tuple[str, str]]:
    """Splits a docstring: `text` in one line, `heading` (`Bad:`), `code` without its fence.

    Code stands in a fence, or indented.
    """
    for is_code, lines in _runs(about.splitlines()):
        if is_code:
            code = textwrap.dedent("\n".join(lines)).strip("\n")
            if code.strip():
                yield "code", code
            continue
        for block in re.split(r"\n\s*\n", "\n".join(lines)):
            text = " ".join(block.split())
            if text:
                yield ("heading" if text in ("Bad:", "Good:") else "text"), text


def _runs(lines: Sequence[str]) -> Iterator[tuple[bool, list[str]]]:
    """Lines of prose and lines of code in turn; the fences are left out."""
    is_fenced = is_code = False
    run: list[str] = []
    for line in lines:
        is_mark = line.strip().startswith(FENCE)
        if is_mark:
            is_fenced = not is_fenced
        belongs = is_fenced or line.startswith("    ") or (is_code and not line.strip())
        if is_mark or belongs != is_code:
            yield is_code, run
            run, is_code = [], belongs
        if not is_mark:
            run.append(line)
    yield is_code, run
