"""`gamekeeper recover RUN`: seals a run whose process was killed."""

from __future__ import annotations

from typing import Final

from gamekeeper.cli._options import RunArgument
from gamekeeper.cli._screen import Answer, Screen
from gamekeeper.cli.record import show_recorded

ORDER: Final = 70


def command(screen: Screen, run: RunArgument) -> Answer:
    """Seals a run whose process was killed.

    It is kept up to its last whole turn. A run that is sealed already stays as it is.
    """
    from gamekeeper.record.bundle import load
    from gamekeeper.record.recover import recover

    was_open = load(run).manifest.get("status") == "open"
    evidence = recover(run)
    status = evidence.manifest.get("status")
    screen.verdict("recovered" if was_open else f"nothing to do: it is {status}", "good")
    cuts = evidence.manifest.get("cuts", []) if was_open else []
    for cut in cuts:
        screen.show(f"  cut: {cut['file']} at byte {cut['offset']:,}: {cut['why']}")
    show_recorded(screen, evidence)
    document = {**evidence.to_json(), "status": status, "changed": was_open, "cuts": cuts}
    return Answer(document)
