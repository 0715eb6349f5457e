"""`gamekeeper pivots RUN`: the turns that lost failed episodes."""

from __future__ import annotations

from typing import Annotated, Final

import typer

from gamekeeper.cli._annotated import annotated
from gamekeeper.cli._fan import FanOption
from gamekeeper.cli._options import (
    MOST,
    ImportOption,
    PolicyOption,
    RunArgument,
    RunContractOption,
    SeedOption,
    episode_option,
)
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.cli.diagnose import FailedOption, only_condition
from gamekeeper.cli.show import has_blocks

ORDER: Final = 92
BUDGET: Final = 100_000
"""As `pivots.BUDGET` has it; importing that loads numpy, help doesn't."""
EpisodeOption = Annotated[
    int | None, episode_option("Number of a failed episode (default: all of them).")
]
BudgetOption = Annotated[
    int,
    typer.Option(
        "--budget",
        metavar="STEPS",
        min=1,
        max=MOST,
        help="Most env steps that are taken, shared equally by the episodes.",
    ),
]


def command(
    screen: Screen,
    run: RunArgument,
    episode: EpisodeOption = None,
    failed: FailedOption = None,
    contract: RunContractOption = None,
    policy: PolicyOption = None,
    seed: SeedOption = 0,
    budget: BudgetOption = BUDGET,
    workers: FanOption = None,
    allow_import: ImportOption = False,
) -> CommandResult:
    """Finds the turn that lost a failed episode, and the agent whose action would have kept it.

    From turns of the episode the policies go on, on fresh draws. Turns at which the share of
    successes falls beyond chance are pivots; at each, other actions of one agent are tried.
    Where nothing is drawn, the last turn is looked for at which another action succeeds.

    Exit code 0: a pivot was found in every episode, or no episode failed. 2: not in every episode.

    Example: gamekeeper pivots runs/warehouse-1 --episode 3
    """
    from gamekeeper.diagnosis.pivots import pivots
    from gamekeeper.interface.policy import parse_choices
    from gamekeeper.reporting.pivots_text import pivots_text

    found = pivots(
        run,
        episode,
        failed=only_condition(failed),
        contract=contract,
        policies=parse_choices(policy) if policy else None,
        seed=seed,
        budget=budget,
        workers=workers or 0,
        allow_import=allow_import,
    )
    document = found.to_json()
    screen.show(pivots_text(document, width=screen.width, has_blocks=has_blocks(screen)))
    annotated(screen, run, "pivots", document)
    return CommandResult(document, 0 if all(each.pivots for each in found.episodes) else 2)
