"""`gamekeeper diagnose RUN`: which agent's what made a run fail, by controlled experiments."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from gamekeeper.cli._fan import ExecutorOption, players_of
from gamekeeper.cli._options import (
    MOST,
    MOST_WORKERS,
    SILENCE_S,
    ImportOption,
    PolicyOption,
    ReopenOption,
    RunArgument,
    SeedOption,
    TimeoutOption,
)
from gamekeeper.cli._screen import Answer, Screen

if TYPE_CHECKING:
    from gamekeeper.diagnose.diagnosis import Diagnosis

ORDER: Final = 90
BUDGET: Final = 2_000
LEVEL: Final = 0.9
PART: Final = 0.7
"""As `gk.diagnose` has them; importing it loads numpy, help doesn't."""

FailedOption = Annotated[
    str | None,
    typer.Option(
        "--failed", metavar="CONDITION",
        help="""When an episode failed: "return < 0.5"; else the contract's [failure].""",
    ),
]  # fmt: skip
ContractOption = Annotated[
    Path | None,
    typer.Option("--contract", metavar="FILE", help="In place of the one it was recorded under."),
]
LevelOption = Annotated[
    float,
    typer.Option(
        "--level", metavar="SHARE", min=0.01, max=1.0,
        help="The share of episodes that succeed where nothing is wrong.",
    ),
]  # fmt: skip
PartOption = Annotated[
    float,
    typer.Option(
        "--part", metavar="SHARE", min=0.01, max=1.0,
        help="What part of the gap to that level a remedy closes, to restore.",
    ),
]  # fmt: skip
BudgetOption = Annotated[
    int,
    typer.Option("--budget", metavar="N", min=100, max=MOST, help="Episodes that may be played."),
]
StressorsOption = Annotated[
    bool | None,
    typer.Option(
        "--stressors/--no-stressors",
        show_default=False,
        help="Also play what makes things worse; otherwise where the run fails.",
    ),
]
WorkersOption = Annotated[
    int | None,
    typer.Option(
        "--workers", metavar="N", min=0, max=MOST_WORKERS,
        help="Processes that play; 0: this one. Otherwise as many as there are cores.",
    ),
]  # fmt: skip
OutOption = Annotated[
    Path | None,
    typer.Option(
        "--out", metavar="FOLDER",
        help="What was played and twins that replay; otherwise RUN-diagnosis. A second call goes "
        "on there.",
    ),
]  # fmt: skip
CaseOption = Annotated[
    Path | None,
    typer.Option(
        "--save-case", metavar="FILE",
        help="Writes a pytest case that plays this failure and its remedy again.",
    ),
]  # fmt: skip
ShrinkOption = Annotated[
    int | None,
    typer.Option(
        "--shrink", metavar="N", min=0, max=MOST,
        help="Only cuts failing episode N down to the fewest turns and actions that still fail.",
    ),
]  # fmt: skip


def command(
    screen: Screen,
    run: RunArgument,
    failed: FailedOption = None,
    contract: ContractOption = None,
    env: ReopenOption = None,
    policy: PolicyOption = None,
    level: LevelOption = LEVEL,
    part: PartOption = PART,
    seed: SeedOption = 0,
    budget: BudgetOption = BUDGET,
    stressors: StressorsOption = None,
    workers: WorkersOption = None,
    executor: ExecutorOption = None,
    out: OutOption = None,
    save_case: CaseOption = None,
    shrink: ShrinkOption = None,
    allow_import: ImportOption = False,
    timeout: TimeoutOption = SILENCE_S,
) -> Answer:
    """Finds which agent's what made a run fail, for every agent.

    Plays the recorded set-up on fresh seeds as it is, with one thing at its ideal (a remedy can
    isolate a cause) and with one thing worse (a stressor shows dependence, never a cause). Exit
    code 0: a cause is named, or nothing fails beyond chance. 2: it can't be told, with the reason.
    """
    from gamekeeper.diagnose.diagnose import diagnose
    from gamekeeper.diagnose.labels import propose
    from gamekeeper.game.policy import parse_choices
    from gamekeeper.report.diagnosis_text import diagnosis_text

    folder = _beside(run) if out is None else out
    if shrink is not None:
        return _shrunk(
            screen, run, shrink, failed=failed, env=env, contract=contract,
            out=folder / f"shrunk-{shrink}", allow_import=allow_import,
        )  # fmt: skip
    count = (os.cpu_count() or 1) if workers is None else workers
    with (
        players_of(executor, count, asked=workers) as players,
        screen.progress("diagnosing") as take,
    ):
        found = diagnose(
            run, failed=failed, contract=contract, env=env,
            policies=parse_choices(policy) if policy else None, level=level, part=part, seed=seed,
            budget=budget, stressors=stressors,
            workers=players, out=folder,
            allow_import=allow_import, timeout_s=timeout, on_message=take,
        )  # fmt: skip
    document = found.to_json()
    version = sys.modules["gamekeeper"].__version__  # the front stands above all layers
    propose(run, found, by=f"gamekeeper diagnose {version}")
    screen.show(diagnosis_text(document, width=screen.width))
    if found.bundles:
        screen.show(f"\nTwins  {folder / 'bundles'}")
    if save_case is not None:
        _save(screen, found, run, save_case, failed)
    return Answer(document, diagnosis_code(found))


def _beside(run: Path) -> Path:
    named = run if run.name else run.absolute()  # `.` has none
    return named.with_name(f"{named.name}-diagnosis")


def diagnosis_code(found: Diagnosis) -> int:
    """0: a cause is named, or nothing fails beyond chance. 2: it can't be told."""
    everybody = [*found.agents.values(), *([found.team] if found.team else [])]
    is_failing = any(each.success[2] < found.level for each in everybody)
    return 2 if is_failing and not found.has_cause else 0


def _save(screen: Screen, found: Any, run: Path, path: Path, failed: str | None) -> None:
    from gamekeeper.diagnose.case import case_text

    path.write_text(case_text(found, run, failed=failed), encoding="utf-8")
    screen.note(f"case written to {path}")


def _shrunk(
    screen: Screen, run: Path, episode: int, *, contract: Path | None, out: Path, **options: Any
) -> Answer:
    from gamekeeper.diagnose.shrunk import shrunk
    from gamekeeper.game.contract_file import load_contract

    declared = None if contract is None else load_contract(contract)
    with screen.progress("shrinking") as take:
        found = shrunk(run, episode, contract=declared, out=out, on_message=take, **options)
    left, before = found.turns
    acts, acts_before = found.acts
    screen.show(
        f"Shrunk  episode {episode} of {run}, failing for {found.scope}\n"
        f"  turns    {left} of {before}\n  actions  {acts} of {acts_before} that aren't noops\n"
        f"  tried    {found.tries} plays" + ("" if found.is_least else ", then gave up looking")
        + f"\n  evidence {out}"
    )  # fmt: skip
    return Answer({"run": str(run), **found.to_json(), "bundle": str(out)}, 0)
