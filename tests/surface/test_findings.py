"""Pages of findings: each fault has its place, a fix, and a program without Gamekeeper."""

import re

from tests.surface.sources import ROOT

PROGRAM = re.compile(r"^```python\n(.*?)^```", re.M | re.S)


def incomplete(page: str) -> list[str]:
    """Faults of a page that lack something, each with what it lacks."""
    found = []
    for fault in re.split(r"^## ", page, flags=re.M)[1:]:
        title, programs = fault.partition("\n")[0], PROGRAM.findall(fault)
        lacks = [part for part in ("- Where:", "- Fix:") if part not in fault]
        lacks += [] if programs else ["a program"]
        for program in programs:
            compile(program, title, "exec")
            if re.search("gamekeeper|benchmarks", program, re.I):
                lacks.append("a program of its own")
        found += [f"{title}: {part}" for part in lacks]
    return found


def test_findings_are_shown_without_gamekeeper() -> None:
    """Whoever reads of a fault runs its program where nothing but its package is installed."""
    pages = {path.name: path.read_text() for path in (ROOT / "docs" / "findings").glob("*.md")}
    assert {name: faults for name, page in pages.items() if (faults := incomplete(page))} == {}


def test_a_fault_without_its_parts_is_seen() -> None:
    """A fault without place, fix or program, one that imports Gamekeeper, and a whole one."""
    shown = "- Where: here\n- Fix: this\n\n```python\n"
    page = f"# It\n\n## One\n\n## Two\n\n{shown}import gamekeeper\n```\n\n"
    page += f"## Three\n\n{shown}1 + 1\n```\n"
    lacks = ["One: - Where:", "One: - Fix:", "One: a program", "Two: a program of its own"]
    assert incomplete(page) == lacks
