"""`gamekeeper attribute RUN`: what each agent brings, and whose doing changes what for whom."""

from __future__ import annotations

from typing import Annotated, Final, Literal

import typer

from gamekeeper.cli._options import (
    SILENCE_S,
    ContractOption,
    ImportOption,
    PolicyOption,
    ReopenOption,
    RunArgument,
    SeedOption,
    TimeoutOption,
    WorkersOption,
)
from gamekeeper.cli._screen import Answer, Screen

ORDER: Final = 56
PAPERS: Final = 50
"""As `diagnose.attribution.attribute.PAPERS` has it; that loads numpy, help doesn't."""

BaselineOption = Annotated[
    Literal["noop", "random", "reference"],
    typer.Option("--baseline", help="What takes an agent's place; noop where one is declared."),
]
FreshOption = Annotated[
    int | None,
    typer.Option(
        "--episodes",
        metavar="N",
        min=0,
        help="Fresh ones in which agents are replaced; otherwise 50. Of fewer no intervals.",
    ),
]
PapersOption = Annotated[
    int,
    typer.Option(
        "--papers", metavar="N", min=0, help="Episodes that are looked into action by action."
    ),
]


def command(
    screen: Screen,
    run: RunArgument,
    baseline: BaselineOption = "noop",
    episodes: FreshOption = None,
    papers: PapersOption = PAPERS,
    contract: ContractOption = None,
    policy: PolicyOption = None,
    env: ReopenOption = None,
    seed: SeedOption = 0,
    workers: WorkersOption = 1,
    allow_import: ImportOption = False,
    timeout: TimeoutOption = SILENCE_S,
) -> Answer:
    """What each agent brings, who is lazy, who pays for whom.

    Agents are replaced by a baseline in fresh episodes in which the others react, and single
    actions in episodes in which the others do what they did. Own reward by term, difference
    rewards, Shapley values, influence, messages, penalties on the wrong participant.
    """
    from gamekeeper.diagnose.attribution.attribute import attribute
    from gamekeeper.game.policy import parse_choices
    from gamekeeper.report.attribution_text import attribution_text

    with screen.progress("attributing") as take:
        found = attribute(
            run,
            contract=contract,
            baseline=baseline,
            episodes=episodes,
            papers=papers,
            policies=parse_choices(policy) if policy else None,
            env=env,
            seed=seed,
            workers=workers,
            allow_import=allow_import,
            timeout_s=timeout,
            on_message=take,
        )
    document = found.to_json()
    screen.show(attribution_text(document, width=screen.width))
    return Answer(document, 0)
