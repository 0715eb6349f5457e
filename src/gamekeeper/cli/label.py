"""`gamekeeper label RUN LABEL`: what a failure is called, kept beside the evidence."""

from __future__ import annotations

from typing import Annotated, Final

import typer

from gamekeeper.cli._options import MOST, RunArgument
from gamekeeper.cli._screen import Answer, Screen

ORDER: Final = 85

LabelArgument = Annotated[
    str | None,
    typer.Argument(
        metavar="LABEL",
        show_default=False,
        help="perception, state-estimation, planning, control, timing, data-coverage or "
        "evaluation; without it, the labels that are there.",
    ),
]
EpisodeOption = Annotated[
    int | None, typer.Option("--episode", metavar="N", min=0, max=MOST, help="In this episode.")
]
TurnOption = Annotated[
    int | None,
    typer.Option("--turn", metavar="N", min=0, max=MOST, help="At this turn of the episode."),
]
AgentOption = Annotated[
    str | None, typer.Option("--agent", metavar="AGENT", help="Whose failure; else the team's.")
]
WhyOption = Annotated[str, typer.Option("--why", metavar="TEXT", help="The reason.")]
ByOption = Annotated[
    str | None, typer.Option("--by", metavar="NAME", help="Who says so; else this user's name.")
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
) -> Answer:
    """Says what a failure is called, or lists what was said.

    Labels are added to the annotations beside the evidence, never changed; a diagnosis proposes
    some too. Why an episode ended is something else: its rules say that.
    """
    from gamekeeper.diagnose import labels as kept
    from gamekeeper.report.labels_text import labels_text

    if label is None:
        found = kept.labels(run, agent=agent, episode=episode)
    else:
        found = (
            kept.label(run, label, agent=agent, episode=episode, turn=turn, why=why, by=by),
        )  # fmt: skip
    rows = [each.to_json() for each in found]
    screen.show(labels_text(rows, width=screen.width))
    return Answer({"run": str(run), "labels": rows}, 0)
