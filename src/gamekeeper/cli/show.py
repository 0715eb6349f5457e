"""`gamekeeper show RUN`: what a bundle holds, fact by fact and agent by agent."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from gamekeeper.cli._options import RunArgument
from gamekeeper.cli._screen import Answer, Screen

if TYPE_CHECKING:
    from gamekeeper.core.evidence import Evidence

ORDER: Final = 110


def command(screen: Screen, run: RunArgument) -> Answer:
    """Shows what a run holds, fact by fact and agent by agent.

    Also of a run that is still being recorded, or was killed.
    """
    from gamekeeper.record.bundle import load
    from gamekeeper.report.text import errors_text, facts_text, summary_text

    evidence = load(run)
    errors = _errors(evidence)
    screen.show(f"Run  {run}")
    screen.show(facts_text(evidence, width=screen.width))
    screen.show(f"\nAgents\n{summary_text(evidence.summary, width=screen.width)}")
    if errors:
        screen.show(f"\nErrors\n{errors_text(errors, width=screen.width)}")
    return Answer(_document(evidence, errors))


def _errors(evidence: Evidence) -> list[dict[str, Any]]:
    rows = evidence.episodes.select(["episode", "error"]).to_pylist()
    return [row for row in rows if row["error"] is not None]


def _document(evidence: Evidence, errors: list[dict[str, Any]]) -> dict[str, Any]:
    manifest = evidence.manifest
    kept = ("status", "environment", "contract", "level", "seed", "info_fingerprint")
    ends = evidence.episodes["end"].to_pylist()
    return {
        **evidence.to_json(),
        **{key: manifest.get(key) for key in kept},
        "ends": {end or "open": ends.count(end) for end in dict.fromkeys(ends)},
        "errors": errors,
    }
