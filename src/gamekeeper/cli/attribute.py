"""`gamekeeper attribute RUN`: what each agent brings, and whose doing changes what for whom."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import typer

from gamekeeper.cli._document import document_text
from gamekeeper.cli._fan import ExecutorOption, FanOption, players_of
from gamekeeper.cli._options import (
    MOST,
    SILENCE_S,
    ContractOption,
    ImportOption,
    PolicyOption,
    ReopenOption,
    RunArgument,
    SeedOption,
    TimeoutOption,
)
from gamekeeper.cli._screen import Answer, Screen
from gamekeeper.errors import BundleError

ORDER: Final = 56
PAPERS: Final = 50
"""As `diagnose.attribution.attribute.PAPERS` has it; that loads numpy, help doesn't."""
KIND: Final = "attribution"
MOST_BYTES: Final = 16 << 20
"""Of a document that is kept among a run's annotations."""

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
        max=MOST,
        help="Fresh ones in which agents are replaced; otherwise 50. Of fewer no intervals.",
    ),
]
PapersOption = Annotated[
    int,
    typer.Option(
        "--papers",
        metavar="N",
        min=0,
        max=MOST,
        help="Episodes that are looked into action by action.",
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
    workers: FanOption = None,
    executor: ExecutorOption = None,
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

    with (
        players_of(executor, workers or 1, asked=workers) as players,
        screen.progress("attributing") as take,
    ):
        found = attribute(
            run,
            contract=contract,
            baseline=baseline,
            episodes=episodes,
            papers=papers,
            policies=parse_choices(policy) if policy else None,
            env=env,
            seed=seed,
            workers=players,
            allow_import=allow_import,
            timeout_s=timeout,
            on_message=take,
        )
    document = found.to_json()
    screen.show(attribution_text(document, width=screen.width))
    _keep(screen, run, document)
    return Answer(document, 0)


def _keep(screen: Screen, run: Path, document: dict[str, Any]) -> None:
    """The document is added to the run's annotations, where a report finds it; not twice."""
    from gamekeeper.record.files.notes import annotate, read_notes

    text = document_text(document)
    if len(text) > MOST_BYTES:
        screen.note(f"not kept in the run: it has {len(text):,} bytes")
        return
    version = sys.modules["gamekeeper"].__version__  # the front stands above all layers
    plain = json.loads(text)
    try:
        known = [note.get("document") for note in read_notes(run) if note.get("kind") == KIND]
        if known[-1:] != [plain]:
            by = f"gamekeeper attribute {version}"
            annotate(run, {"kind": KIND, "by": by, "document": plain})
    except BundleError as error:  # a run that nobody may write into is attributed all the same
        screen.note(f"not kept in the run: {error.what}")
