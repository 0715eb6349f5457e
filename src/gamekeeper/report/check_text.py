"""What a check promises and why: for a terminal, and as a page of the documentation.

All functions take a check as plain data: `id`, `claim`, `about` (Markdown), `needs`, `severity`,
`confidence`, `mend`, `api`.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

from gamekeeper.report.columns import wrapped
from gamekeeper.report.text import table_lines

Card = Mapping[str, Any]

INDENT: Final = "  "
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
    "high": "high: the game isn't the one that is described",
    "medium": "medium: some readers are misled, or crash",
    "low": "low: a nuisance",
}


def family_of(id: str) -> str:
    """What a check is about, by the first figure of its id; `others` for third parties'."""
    return FAMILIES.get(id[:3], "others") if len(id) == len("GK402") else "others"


def check_text(check: Card, *, specimen: str | None, width: int) -> str:
    """A check explained on a terminal.

    Args:
        check: as plain data.
        specimen: an environment that breaks it, to be tried; None where there is none.
        width: columns that no line of prose exceeds.
    """
    lines = wrapped(f"{check['id']}  {check['claim']}", width, rest=" " * 7)
    for kind, text in paragraphs(check["about"]):
        if kind == "code":
            lines += ["", *textwrap.indent(text, "      ").splitlines()]
        elif kind == "heading":
            lines += ["", f"{INDENT}{text}"]
        else:
            lines += ["", *wrapped(text, width, first=INDENT, rest=INDENT)]
    rows = [("mend", check["mend"]), ("severity", SEVERITIES[check["severity"]])]
    if check["confidence"] < 1:
        rows.append(("sure", f"{check['confidence']:g} of 1"))
    rows += [("judges", APIS[check["api"]]), ("reads", f"probes: {', '.join(check['needs'])}")]
    rows.append(("waive", f'[waivers] {check["id"]} = "the reason", in the contract'))
    lines += ["", *table_lines(rows, width=width)]
    if specimen is not None:  # not in the table: a command is copied whole
        lines.append(f"{INDENT}try       gamekeeper audit {specimen} --select {check['id']}")
    return "\n".join(lines)


def checks_text(checks: Iterable[Card], *, width: int) -> str:
    """A line for each check, by family."""
    blocks = []
    for family, members in by_family(checks).items():
        rows = [(each["id"], each["severity"], each["claim"]) for each in members]
        title = family[0].upper() + family[1:]
        blocks.append("\n".join([title, *table_lines(rows, width=width)]))
    return "\n\n".join(blocks)


def by_family(checks: Iterable[Card]) -> dict[str, list[Card]]:
    """The checks in the order of their ids, by what they are about."""
    found: dict[str, list[Card]] = {}
    for each in sorted(checks, key=lambda each: str(each["id"])):
        found.setdefault(family_of(each["id"]), []).append(each)
    return found


def paragraphs(about: str) -> Iterator[tuple[str, str]]:
    """The parts of a docstring: `text` in one line, `heading` (`Bad:`), `code` without its fence.

    Code stands in a fence, or indented behind a line.
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


def check_page(check: Card, *, output: str | None) -> str:
    """The page of a check, as Markdown.

    Args:
        check: as plain data.
        output: what `gamekeeper audit` says of an environment that breaks it, with the command
            above it; None leaves that part out.
    """
    blocks = [f"# {check['id']}: {check['claim'].rstrip('.')}"]
    for kind, text in paragraphs(check["about"]):
        blocks.append(f"{FENCE}python\n{text}\n{FENCE}" if kind == "code" else text)
    rows = [
        ("severity", SEVERITIES[check["severity"]]),
        *[("sure, where it is broken", f"{check['confidence']:g} of 1")]
        * (check["confidence"] < 1),
        ("judges", APIS[check["api"]]),
        ("reads the probes", ", ".join(f"`{name}`" for name in check["needs"])),
        ("waive it in the contract", f'`[waivers]` `{check["id"]} = "the reason"`'),
    ]
    if check["confidence"] < 1:
        rows.insert(1, ("sure, where it is broken", f"{check['confidence']:g} of 1"))
    blocks += [f"**Mend:** {check['mend']}.", _table(rows)]
    if output is not None:
        blocks += ["## What it says", f"{FENCE}\n{output.rstrip()}\n{FENCE}"]
    return "\n\n".join(blocks) + "\n"


def checks_page(checks: Iterable[Card]) -> str:
    """The page that lists all checks by family, as Markdown."""
    blocks = [
        "# Checks",
        "A check is one promise of an environment. `gamekeeper audit ENV` asks all of them, "
        "`gamekeeper explain GK402` says of one what stands on its page here. Ids are never used "
        "again for another promise.",
    ]
    for family, members in by_family(checks).items():
        rows = [f"| [{x['id']}]({x['id']}.md) | {x['severity']} | {_cell(x['claim'])} |"
                for x in members]  # fmt: skip
        title = family[0].upper() + family[1:]
        blocks += [f"## {title}", "\n".join(["| check | severity | promise |", "|---|---|---|",
                                             *rows])]  # fmt: skip
    return "\n\n".join(blocks) + "\n"


def _table(rows: Sequence[tuple[str, str]]) -> str:
    return "\n".join(
        ["| | |", "|---|---|", *(f"| {name} | {_cell(text)} |" for name, text in rows)]
    )


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
