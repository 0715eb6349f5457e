"""`gamekeeper pivots RUN`: the turns that lost failed episodes."""

from pathlib import Path
from typing import Final

from gamekeeper.cli._annotated import annotated
from gamekeeper.cli._options import Count, Number
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.cli.diagnose import only_condition
from gamekeeper.cli.show import has_blocks

ORDER: Final = 92
BUDGET: Final = 100_000
"""As `pivots.BUDGET` has it; importing that loads numpy, help doesn't."""


def command(
    screen: Screen,
    run: Path,
    episode: Number | None = None,
    failed: list[str] | None = None,
    contract: Path | None = None,
    policy: list[str] | None = None,
    seed: int = 0,
    budget: Count = BUDGET,
    workers: int | None = None,
    allow_import: bool = False,
) -> CommandResult:
    """Finds the turn that lost a failed episode, and the agent whose action would have kept it.

    The policies continue the episode from some of its turns, with new random draws. A turn at
    which the share of successes falls beyond chance is a pivot; there, other actions of one agent
    are tried. Without random draws, it finds the last turn at which another action succeeds.

    Exit code 0: a pivot was found in every episode, or no episode failed. 2: not in every episode.

    Example: gamekeeper pivots runs/warehouse-1 --episode 3

    Args:
        episode (--episode N): Number of a failed episode (default: all of them).
        budget (--budget STEPS): Most env steps that are taken, shared equally by the episodes.
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
