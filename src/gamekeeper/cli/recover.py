"""`gamekeeper recover RUN`: finalizes a run whose process was killed."""

from pathlib import Path
from typing import Final

from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.cli.rollout import show_recorded

ORDER: Final = 70


def command(screen: Screen, run: Path) -> CommandResult:
    """Finalizes a run whose process was killed.

    All turns up to the last complete one are kept. A run that is finalized already isn't changed.

    Example: gamekeeper recover runs/warehouse-1
    """
    from gamekeeper.runs.load_run import load
    from gamekeeper.runs.run_check import recover

    was_open = load(run).manifest.get("status") == "open"
    evidence = recover(run)
    status = evidence.manifest.get("status")
    screen.verdict("recovered" if was_open else f"nothing to do: it is {status}", "good")
    cuts = evidence.manifest.get("cuts", []) if was_open else []
    for cut in cuts:
        screen.show(f"  cut: {cut['file']} at byte {cut['offset']:,}: {cut['why']}")
    show_recorded(screen, evidence)
    document = {**evidence.to_json(), "status": status, "changed": was_open, "cuts": cuts}
    return CommandResult(document)
