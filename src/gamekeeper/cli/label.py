"""`gamekeeper label RUN LABEL`: a label for a failure, stored beside the run."""

from __future__ import annotations

from typing import Annotated, Final

import typer

from gamekeeper.cli._options import MOST, RunArgument, episode_option
from gamekeeper.cli._screen import CommandResult, Screen

ORDER: Final = 85

LabelArgument = Annotated[
    str | None,
    typer.Argument(
        metavar="LABEL",
        show_default=False,
        help="Label: perception, state-estimation, planning, control, timing, data-coverage or "
        "evaluation; without it, existing labels are listed.",
    ),
]
EpisodeOption = Annotated[
    int | None, episode_option("Episode of the failure (default: all episodes).")
]
TurnOption = Annotated[
    int | None,
    typer.Option(
        "--turn",
        metavar="N",
        min=0,
        max=MOST,
        help="Turn of the failure (default: the whole episode).",
    ),
]
AgentOption = Annotated[
    str | None,
    typer.Option("--agent", metavar="AGENT", help="Agent that failed (default: the team)."),
]
WhyOption = Annotated[
    str, typer.Option("--why", metavar="TEXT", help="Reason for the label (default: none).")
]
ByOption = Annotated[
    str | None,
    typer.Option("--by", metavar="NAME", help="Author of the label (default: the user's name)."),
]


def command(
    screen: Screen,
    run: RunArgument,
    label: LabelArgument = None,
    episode: EpisodeOption = None,
    turn: TurnOption = None,
    agent: AgentOption = None,
    why: WhyOption = "",
    by: ByOption = None,
) -> CommandResult:
    """Labels a failure, or lists the labels of a run.

    Labels are added to the annotations beside the run, and never changed; a diagnosis proposes
    labels too. They name a cause of failure, not the rule by which an episode ended.

    Example: gamekeeper label runs/warehouse-1 planning --episode 3 --agent picker_0
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
