"""`gamekeeper label RUN LABEL`: a label for a failure, stored beside the run."""

from pathlib import Path
from typing import Final

from gamekeeper.cli._options import Number
from gamekeeper.cli._screen import CommandResult, Screen

ORDER: Final = 85


def command(
    screen: Screen,
    run: Path,
    label: str | None = None,
    episode: Number | None = None,
    turn: Number | None = None,
    agent: str | None = None,
    why: str = "",
    by: str | None = None,
) -> CommandResult:
    """Labels a failure, or lists the labels of a run.

    Labels are added to the annotations beside the run, and never changed; a diagnosis proposes
    labels too. They name a cause of failure, not the rule by which an episode ended.

    Example: gamekeeper label runs/warehouse-1 planning --episode 3 --agent picker_0

    Args:
        label (LABEL): Label: perception, state-estimation, planning, control, timing, data-coverage
            or evaluation; without it, existing labels are listed.
        episode (--episode N): Episode of the failure (default: all episodes).
        turn (--turn N): Turn of the failure (default: the whole episode).
        agent (--agent AGENT): Agent that failed (default: the team).
        why (--why TEXT): Reason for the label (default: none).
        by (--by NAME): Author of the label (default: the user's name).
    """
    from gamekeeper.diagnosis import labels
    from gamekeeper.reporting.results_text import labels_text

    if label is None:
        found = labels.labels(run, agent=agent, episode=episode)
    else:
        found = (labels.label(run, label, agent=agent, episode=episode, turn=turn, why=why, by=by),)
    rows = [each.to_json() for each in found]
    screen.show(labels_text(rows, width=screen.width))
    return CommandResult({"run": str(run), "labels": rows}, 0)
