"""Writes the page of every check, which git doesn't keep: `python -m docs.check_pages docs/checks`.

A page shows the check's docstring, the faulty environment that fails it, and an audit of that.
"""

from __future__ import annotations

import inspect
import json
import shutil
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from gamekeeper.checks.check import checks
from gamekeeper.cli.explain import card_of
from gamekeeper.reporting.audit_text import failed_blocks, program_of, suspected_text
from gamekeeper.reporting.check_text import APIS, FENCE, SEVERITIES, Card, by_family, paragraphs
from tests.faults import Faulty, environments
from tests.matrix import audits

WIDTH: Final = 96
CHECKOUT: Final = f"{Path(__file__).parents[1]}/"
"""Left out of the pages: files are named from here."""


def faulty_by_check() -> dict[str, Faulty]:
    """An environment that fails each check; where there is a choice, one without a contract."""
    found: dict[str, Faulty] = {}
    for each in sorted(environments().values(), key=lambda each: each.declared is not None):
        for id in each.checks:
            found.setdefault(id, each)
    return found


def output_of(id: str) -> str:
    """What an audit of the faulty environment says of its check, with the command."""
    each = faulty_by_check()[id]
    audit = json.loads(json.dumps(audits.document(each.env.__name__)).replace(CHECKOUT, ""))
    audit = {**audit, "verdicts": [one for one in audit["verdicts"] if one["id"] == id]}
    command = f"$ gamekeeper audit {each.spec} --select {id}"
    lines = [command]
    if each.contract is not None:
        lines = ["# contract.toml", each.contract.to_toml(), f"{command} --contract contract.toml"]
    for heading, text in failed_blocks(audit, width=WIDTH):
        lines += [heading, text]
    if suspected := suspected_text(audit, width=WIDTH):
        lines.append(suspected)
    program = program_of(audit)
    return "\n".join(lines if program is None else [*lines, "", program[1].rstrip()])


def page(check: Card, *, source: str, output: str) -> str:
    """The page of a check, as Markdown.

    Args:
        check: as plain data.
        source: of the faulty environment.
        output: what `gamekeeper audit` says of it, with the command above.
    """
    blocks = [f"# {check['id']}: {check['claim'].rstrip('.')}"]
    for kind, text in paragraphs(check["about"]):
        blocks.append(f"{FENCE}python\n{text}\n{FENCE}" if kind == "code" else text)
    rows = [("severity", SEVERITIES[check["severity"]])]
    if check["confidence"] < 1:
        rows.append(("sure, where it is broken", f"{check['confidence']:g} of 1"))
    rows += [
        ("judges", APIS[check["api"]]),
        ("reads the probes", ", ".join(f"`{name}`" for name in check["needs"])),
        ("waive it in the contract", f'`[waivers]` `{check["id"]} = "the reason"`'),
    ]
    blocks += [f"**Fix:** {check['fix']}.", _table(rows)]
    blocks += ["## A faulty environment", f"{FENCE}python\n{source.rstrip()}\n{FENCE}"]
    blocks += ["## What the audit says", f"{FENCE}\n{output.rstrip()}\n{FENCE}"]
    return "\n\n".join(blocks) + "\n"


def index_page(cards: Iterable[Card]) -> str:
    """The page that lists all checks by family, as Markdown."""
    blocks = [
        "# Checks",
        "A check is one promise of an environment. `gamekeeper audit ENV` asks all of them, "
        "`gamekeeper explain GK402` says of one what stands on its page here. Ids are never used "
        "again for another promise. The faulty environments stand in `tests/faults` of a checkout.",
    ]
    for family, members in by_family(cards).items():
        rows = [
            f"| [{x['id']}]({x['id']}.md) | {x['severity']} | {_cell(x['claim'])} |"
            for x in members
        ]
        head = ["| check | severity | promise |", "|---|---|---|"]
        blocks += [f"## {family[0].upper()}{family[1:]}", "\n".join([*head, *rows])]
    return "\n\n".join(blocks) + "\n"


def _table(rows: Iterable[tuple[str, str]]) -> str:
    head = ["| | |", "|---|---|"]
    return "\n".join([*head, *(f"| {name} | {_cell(text)} |" for name, text in rows)])


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def pages(cards: Mapping[str, Card]) -> dict[str, str]:
    """Pages of these checks by the names of their files."""
    faulty: Mapping[str, Any] = faulty_by_check()
    audits.ask([faulty[id].env.__name__ for id in cards])
    outputs = {id: output_of(id) for id in cards}
    return {
        f"{id}.md": page(card, source=inspect.getsource(faulty[id].env), output=outputs[id])
        for id, card in cards.items()
    }


def main(folder: Path) -> None:
    """Writes all pages into a folder, the index last, as `make` looks at its time."""
    cards = {
        id: card_of(each)
        for id, each in checks().items()
        if each.run.__module__.startswith("gamekeeper")
    }
    written = {**pages(cards), "index.md": index_page(cards.values())}
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name, text in written.items():
        (folder / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
