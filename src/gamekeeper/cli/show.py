"""`gamekeeper show`: contents of a run or an evaluation, or the wrappers of an environment."""

from __future__ import annotations

from pathlib import Path
from textwrap import indent
from typing import TYPE_CHECKING, Any, Final

from gamekeeper.cli._form import look_at, show_form
from gamekeeper.cli._options import SILENCE_S, json_object
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.errors import GamekeeperError, SpecError

if TYPE_CHECKING:
    from gamekeeper.episodes.evidence import Evidence

ORDER: Final = 110
EVALUATION: Final = "evaluation.json"


def command(
    screen: Screen,
    thing: str,
    against: str | None = None,
    kwargs: str | None = None,
    contract: Path | None = None,
    allow_import: bool = False,
    timeout: float = SILENCE_S,
) -> CommandResult:
    """Shows a run or an evaluation, or the structure and wrappers of an environment.

    A run may still be recording, or have been killed. For an environment, wrappers that `gk.make`
    replaces by one faster wrapper are listed beside those that stay. With --against, results that
    no longer hold for the installed environment are named.

    Exit code with --against, 0: all results hold. 1: some must be measured again. 2: no answer.

    Example: gamekeeper show runs/warehouse-1

    Args:
        thing (RUN|ENV): Folder of a run or an evaluation, or an environment.
        against (--against ENV): Environment, as installed now, that the run or evaluation is
            compared with (default: none).
    """
    if against is not None:
        return _show_against(
            screen,
            Path(thing),
            against,
            kwargs,
            contract=contract,
            allow_import=allow_import,
            silence_s=timeout,
        )
    if (Path(thing) / EVALUATION).is_file():
        return _show_evaluation(screen, Path(thing))
    if Path(thing).is_dir():
        return _show_run(screen, Path(thing))
    return _show_env(screen, thing, kwargs, timeout)


def _show_against(
    screen: Screen, run: Path, env: str, kwargs: str | None, **options: Any
) -> CommandResult:
    from gamekeeper.cli._against import show_against

    if Path(env).is_dir():
        raise GamekeeperError(
            "a run is compared with an environment, not with a run",
            where="--against",
            expected="an environment",
            actual=env,
            fix=f"gamekeeper diff {run} {env}",
        )
    if not run.is_dir():
        raise GamekeeperError(
            "only a run or an evaluation can be compared with an environment",
            where="RUN",
            expected="the folder of a run or an evaluation",
            actual=str(run),
            fix="gamekeeper show RUN --against ENV; two environments: gamekeeper diff A B",
        )
    given = None if kwargs is None else json_object(kwargs, option="--kwargs")
    return show_against(screen, run, env, kwargs=given, **options)


def _show_evaluation(screen: Screen, folder: Path) -> CommandResult:
    from gamekeeper.evaluation.evaluator import load_evaluation
    from gamekeeper.reporting.evaluation_text import evaluation_text

    document = load_evaluation(folder).to_json()
    screen.show(evaluation_text(document, width=screen.width))
    return CommandResult(document)


def _show_env(screen: Screen, env: str, kwargs: str | None, timeout: float) -> CommandResult:
    given = json_object(kwargs, option="--kwargs")
    try:
        form = look_at(env, env_kwargs=given, contract=None, silence_s=timeout)
    except SpecError:
        _refuse_lost_run(Path(env))
        raise
    show_form(screen, form)
    screen.show("\nWrappers")
    for line in form.made_of:
        screen.show(f"  {line}")
    return CommandResult({**form.to_json(), "made_of": list(form.made_of)})


def _refuse_lost_run(path: Path) -> None:
    """Refuses a name that is no environment but lies in a folder of runs.

    Raises:
        RunError: there is no such run.
    """
    from gamekeeper.runs.files.folder import MANIFEST
    from gamekeeper.runs.files.manifest import load_manifest

    if not path.exists() and any(path.parent.glob(f"*/{MANIFEST}")):
        load_manifest(path)


def _show_run(screen: Screen, run: Path) -> CommandResult:
    from gamekeeper.diagnosis.labels import labels
    from gamekeeper.reporting.results_text import errors_text, facts_text, labels_text, summary_text
    from gamekeeper.reporting.text_columns import returns_by_episode, returns_text
    from gamekeeper.runs.load_run import load

    evidence = load(run)
    errors = _errors(evidence)
    screen.show(f"Run  {run}")
    screen.show(facts_text(evidence, width=screen.width))
    screen.show(f"\nAgents\n{summary_text(evidence.summary, width=screen.width)}")
    returns = returns_by_episode(evidence)
    if evidence.episode_table.num_rows > 1 and returns:
        pictures = returns_text(returns, width=screen.width, has_blocks=has_blocks(screen))
        screen.show(f"\nReturns over episodes\n{pictures}")
    if errors:
        screen.show(f"\nErrors\n{errors_text(errors, width=screen.width)}")
    known = [each.to_json() for each in labels(run)]
    if known:
        screen.show(f"\nFailure labels\n{indent(labels_text(known, width=screen.width - 2), '  ')}")
    return CommandResult({**_document(evidence, errors), "returns": returns, "labels": known})


def has_blocks(screen: Screen) -> bool:
    """Tells if the stream's encoding has the characters of a sparkline; most have."""
    from gamekeeper.reporting.text_columns import BLOCKS

    try:
        BLOCKS.encode(getattr(screen.out, "encoding", None) or "utf-8")
    except (UnicodeError, LookupError):
        return False
    return True


def _errors(evidence: Evidence) -> list[dict[str, Any]]:
    rows = evidence.episode_table.select(["episode", "error"]).to_pylist()
    errors = [row for row in rows if row["error"] is not None]
    of_run = evidence.manifest.get("error")
    if of_run and not errors:  # it ended before the first turn was written
        return [{"episode": None, "error": of_run}]
    return errors


def _document(evidence: Evidence, errors: list[dict[str, Any]]) -> dict[str, Any]:
    manifest = evidence.manifest
    kept = ("status", "environment", "contract", "level", "seed", "info_fingerprint")
    ends = evidence.episode_table["end"].to_pylist()
    return {
        **evidence.to_json(),
        **{key: manifest.get(key) for key in kept},
        "ends": {end or "open": ends.count(end) for end in dict.fromkeys(ends)},
        "errors": errors,
    }
