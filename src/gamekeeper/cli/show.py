"""`gamekeeper show`: what a run or an evaluation holds, what an environment is made of."""

from __future__ import annotations

from pathlib import Path
from textwrap import indent
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from gamekeeper.cli._form import look_at
from gamekeeper.cli._options import (
    SILENCE_S,
    ContractOption,
    ImportOption,
    KwargsOption,
    TimeoutOption,
    json_object,
)
from gamekeeper.cli._screen import Answer, Screen
from gamekeeper.errors import GamekeeperError, SpecError

if TYPE_CHECKING:
    from gamekeeper.core.evidence import Evidence

ORDER: Final = 110
EVALUATION: Final = "evaluation.json"


ThingArgument = Annotated[
    str,
    typer.Argument(
        metavar="RUN|ENV", show_default=False, help="The folder of evidence, or an environment."
    ),
]
AgainstOption = Annotated[
    str | None,
    typer.Option(
        "--against", metavar="ENV",
        help="What of the run, or of an evaluation, still holds for ENV as it is installed now.",
    ),
]  # fmt: skip


def command(
    screen: Screen,
    thing: ThingArgument,
    against: AgainstOption = None,
    kwargs: KwargsOption = None,
    contract: ContractOption = None,
    allow_import: ImportOption = False,
    timeout: TimeoutOption = SILENCE_S,
) -> Answer:
    """Shows what a run or an evaluation holds, or what an environment is made of.

    Also of a run that is still being recorded, or was killed. Of an environment, which wrappers
    `gk.make` replaces by one face with the same promises, and which stay. With --against, exit
    code 0: all of it still holds. 1: something is stale, and must be measured again. 2: it can't
    be told.
    """
    if against is not None:
        return _show_against(
            screen, Path(thing), against, kwargs, contract=contract, allow_import=allow_import,
            silence_s=timeout,
        )  # fmt: skip
    if (Path(thing) / EVALUATION).is_file():
        return _show_evaluation(screen, Path(thing))
    if Path(thing).is_dir():
        return _show_run(screen, Path(thing))
    return _show_env(screen, thing, kwargs, timeout)


def _show_against(
    screen: Screen, run: Path, env: str, kwargs: str | None, **options: Any
) -> Answer:
    from gamekeeper.cli._against import show_against

    if Path(env).is_dir():
        raise GamekeeperError(
            "evidence is put against an environment, not against evidence", where="--against",
            expected="an environment", seen=env, mend=f"gamekeeper diff {run} {env}",
        )  # fmt: skip
    if not run.is_dir():
        raise GamekeeperError(
            "only evidence can be put against an environment", where="RUN",
            expected="the folder of a run or an evaluation", seen=str(run),
            mend="gamekeeper show RUN --against ENV; two environments: gamekeeper diff A B",
        )  # fmt: skip
    given = None if kwargs is None else json_object(kwargs, option="--kwargs")
    return show_against(screen, run, env, kwargs=given, **options)


def _show_evaluation(screen: Screen, folder: Path) -> Answer:
    from gamekeeper.evaluate.evaluate import load_evaluation
    from gamekeeper.report.evaluation_text import evaluation_text

    document = load_evaluation(folder).to_json()
    screen.show(evaluation_text(document, width=screen.width))
    return Answer(document)


def _show_env(screen: Screen, env: str, kwargs: str | None, timeout: float) -> Answer:
    from gamekeeper.report.text import brief_card

    given = json_object(kwargs, option="--kwargs")
    try:
        form = look_at(env, env_kwargs=given, contract=None, silence_s=timeout)
    except SpecError:
        _refuse_lost_run(Path(env))
        raise
    screen.show(
        brief_card(
            form.contract,
            form.agents,
            name=form.name,
            open_questions=len(form.questions),
            width=screen.width,
        )
    )
    screen.show("\nMade of")
    for line in form.made_of:
        screen.show(f"  {line}")
    return Answer({**form.to_json(), "made_of": list(form.made_of)})


def _refuse_lost_run(path: Path) -> None:
    """What is no environment but lies beside runs was meant to be one of them.

    Raises:
        BundleError: there is no such run.
    """
    from gamekeeper.record.files.manifest import MANIFEST, load_manifest

    if not path.exists() and any(path.parent.glob(f"*/{MANIFEST}")):
        load_manifest(path)


def _show_run(screen: Screen, run: Path) -> Answer:
    from gamekeeper.diagnose.labels import labels
    from gamekeeper.record.bundle import load
    from gamekeeper.report.labels_text import labels_text
    from gamekeeper.report.sparkline import returns_by_episode, returns_text
    from gamekeeper.report.text import errors_text, facts_text, summary_text

    evidence = load(run)
    errors = _errors(evidence)
    screen.show(f"Run  {run}")
    screen.show(facts_text(evidence, width=screen.width))
    screen.show(f"\nAgents\n{summary_text(evidence.summary, width=screen.width)}")
    returns = returns_by_episode(evidence)
    if evidence.episodes.num_rows > 1 and returns:
        pictures = returns_text(returns, width=screen.width, has_blocks=_has_blocks(screen))
        screen.show(f"\nReturns over episodes\n{pictures}")
    if errors:
        screen.show(f"\nErrors\n{errors_text(errors, width=screen.width)}")
    said = [each.to_json() for each in labels(run)]
    if said:
        screen.show(f"\nFailure labels\n{indent(labels_text(said, width=screen.width - 2), '  ')}")
    return Answer({**_document(evidence, errors), "returns": returns, "labels": said})


def _has_blocks(screen: Screen) -> bool:
    """Whether the stream's encoding has the signs of a sparkline; most have."""
    from gamekeeper.report.sparkline import BLOCKS

    try:
        BLOCKS.encode(getattr(screen.out, "encoding", None) or "utf-8")
    except (UnicodeError, LookupError):
        return False
    return True


def _errors(evidence: Evidence) -> list[dict[str, Any]]:
    rows = evidence.episodes.select(["episode", "error"]).to_pylist()
    errors = [row for row in rows if row["error"] is not None]
    of_run = evidence.manifest.get("error")
    if of_run and not errors:  # it ended before the first turn was written
        return [{"episode": None, "error": of_run}]
    return errors


def _document(evidence: Evidence, errors: list[dict[str, Any]]) -> dict[str, Any]:
    manifest = evidence.manifest
    kept = ("status", "environment", "contract", "level", "seed", "info_fingerprint")
    ends = evidence.episodes["end"].to_pylist()
    return {
        **evidence.to_json(),
        **{key: manifest.get(key) for key in kept},
        "ends": {end or "open": ends.count(end) for end in dict.fromkeys(ends)},
        "errors": errors,
    }
