"""Writes the page of every check: `python -m gamekeeper.cli._pages docs/checks`.

What a page says of the check comes from its docstring, what it shows of the audit from a real one
of the specimen that breaks it. `--changed` audits only for pages whose check says something else.
"""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gamekeeper.cli._checks import card_of, specimens

if TYPE_CHECKING:
    from gamekeeper.audit.check import Check

WIDTH: Final = 96
BUDGET: Final = 4_000
"""Environment steps of the audit that a page shows; those of the tests that hold it."""
OUTPUT: Final = re.compile(r"\n## What it says\n.*", re.DOTALL)
INDEX: Final = "index.md"


def pages(outputs: Mapping[str, str | None]) -> dict[str, str]:
    """The pages by the names of their files, the index among them.

    Args:
        outputs: what an audit says of a specimen, by the check's id.
    """
    from gamekeeper.audit.check import checks
    from gamekeeper.report.check_text import check_page, checks_page

    cards = [card_of(each) for each in ours(checks()).values()]
    found = {f"{card['id']}.md": check_page(card, output=outputs.get(card["id"])) for card in cards}
    return {INDEX: checks_page(cards), **found}


def ours(checks: Mapping[str, Check]) -> dict[str, Check]:
    """The checks that are part of Gamekeeper."""
    return {id: each for id, each in checks.items() if each.run.__module__.startswith("gamekeeper")}


def without_output(page: str) -> str:
    """A page without what an audit says: what its docstring alone settles."""
    return OUTPUT.sub("", page).rstrip() + "\n"


def kept_output(page: str) -> str | None:
    """What an audit says on a page that is there; None where nothing does."""
    found = re.search(r"\n## What it says\n\n```\n(.*)\n```\n", page, re.DOTALL)
    return None if found is None else found[1]


def output_of(id: str, specimen: str) -> str:
    """What the audit of a specimen says of the check that it breaks, with the command."""
    from gamekeeper.audit.audit import audit_here
    from gamekeeper.core.contract import Contract
    from gamekeeper.report.audit_text import broken_blocks, program_of

    module = importlib.import_module(specimen.removesuffix(":make"))
    declared: Any = getattr(module, "CONTRACT", None)
    contract = None if declared is None else Contract.from_json(declared)
    audit = audit_here(specimen, contract=contract, budget=BUDGET, select=(id,)).to_json()
    command = f"$ gamekeeper audit {specimen} --select {id}"
    lines = [command]
    if contract is not None:
        lines = ["# specimen.toml", contract.to_toml(), f"{command} --contract specimen.toml"]
    for heading, text in broken_blocks(audit, width=WIDTH):
        lines += [heading, text]
    program = program_of(audit)
    return "\n".join(lines if program is None else [*lines, "", program[1].rstrip()])


def main(arguments: Sequence[str]) -> int:
    """Writes the pages into a folder, and takes away those of checks that are gone."""
    words = [word for word in arguments if word != "--changed"]
    if len(words) != 1:
        sys.stderr.write(f"{__doc__}\n")
        return 2
    folder = Path(words[0])
    folder.mkdir(parents=True, exist_ok=True)
    there = {path.name: path.read_text(encoding="utf-8") for path in folder.glob("*.md")}
    texts = pages({})
    outputs: dict[str, str | None] = {}
    for id, specimen in sorted(specimens().items()):
        page = there.get(f"{id}.md", "")
        is_same = without_output(page) == without_output(texts.get(f"{id}.md", ""))
        kept = kept_output(page) if "--changed" in arguments and is_same else None
        if kept is None:
            sys.stderr.write(f"{id}\n")
        outputs[id] = kept or output_of(id, specimen)
    found = pages(outputs)
    for name, text in found.items():
        (folder / name).write_text(text, encoding="utf-8")
    for name in there.keys() - found.keys():
        (folder / name).unlink()
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
