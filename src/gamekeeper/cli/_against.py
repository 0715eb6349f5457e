"""`show RUN --against ENV`: what of a run or an evaluation still holds."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gamekeeper.cli._screen import Answer, Screen
from gamekeeper.cli._worker import error_in
from gamekeeper.run.workers import run_task

if TYPE_CHECKING:
    from gamekeeper.record.against import Against

EVALUATION: Final = "evaluation.json"
CODES: Final = {"holds": 0, "stale": 1, "unknown": 2}
MANNERS: Final = {"holds": "good", "stale": "bad", "unknown": "unsure"}


def show_against(
    screen: Screen,
    run: Path,
    env: str,
    *,
    kwargs: Mapping[str, Any] | None,
    contract: Path | None,
    allow_import: bool,
    silence_s: float,
) -> Answer:
    """Shows what a run or an evaluation hangs on, beside what is installed now.

    Args:
        screen: takes it.
        run: the folder of a run or an evaluation.
        env: names the environment; it is opened in a worker.
        kwargs: its arguments; None: the recorded ones.
        contract: in place of the one beside it.
        allow_import: policies that are code which evidence names are looked at too.
        silence_s: how long opening it may take.
    Raises:
        GamekeeperError: the evidence is damaged, or the environment can't be opened.
    """
    from gamekeeper.report.against_text import against_text

    if (run / EVALUATION).is_file() and not (run / "manifest.json").is_file():
        from gamekeeper.cli._evaluation_against import evaluation_against

        found = evaluation_against(
            run, env, kwargs=kwargs, allow_import=allow_import, contract=contract,
            silence_s=silence_s,
        )  # fmt: skip
    else:
        found = _of_run(
            run, env, kwargs=kwargs, allow_import=allow_import, contract=contract,
            silence_s=silence_s,
        )  # fmt: skip
    document = found.to_json()
    screen.verdict(against_text(document, width=screen.width), MANNERS[found.status])
    if found.commands:
        screen.program("\n" + "\n".join(f"  {command}" for command in found.commands))
    return Answer(document, CODES[found.status])


def _of_run(
    run: Path, env: str, *, kwargs: Mapping[str, Any] | None, allow_import: bool, **options: Any
) -> Against:
    from gamekeeper.record.against import standing
    from gamekeeper.record.bundle import load
    from gamekeeper.record.now import askable
    from gamekeeper.record.played import policies_of
    from gamekeeper.record.stage import compact

    evidence = load(run)
    identity = evidence.manifest.get("environment") or {}
    names = list(dict.fromkeys(name for name, _ in policies_of(evidence)))
    now = _now(
        env,
        kwargs=compact(identity.get("kwargs") or {}) if kwargs is None else canonical(kwargs),
        api=identity.get("api"), policies=askable(names, allow_import=allow_import), **options,
    )  # fmt: skip
    typed = None if kwargs is None else json.dumps(dict(kwargs))
    return standing(evidence, now, environment=env, kwargs=typed)


def _now(env: str, *, contract: Path | None, silence_s: float, **arguments: Any) -> Any:
    """The environment as it is installed now."""
    from gamekeeper.record.now import TASK

    given = {"spec": env, "contract": None if contract is None else str(contract), **arguments}
    return looked(TASK, given, silence_s=silence_s)


def looked(task: str, arguments: Mapping[str, Any], *, silence_s: float) -> Any:
    """What a task saw of an environment in a worker.

    Raises:
        GamekeeperError: it can't be opened.
        KeyboardInterrupt: by Ctrl-C.
    """
    outcome = run_task(task, dict(arguments), silence_s=silence_s)
    if outcome.status == "interrupted":
        raise KeyboardInterrupt
    error = error_in(outcome)
    if error is not None:
        raise error
    return outcome.value


def canonical(kwargs: Mapping[str, Any]) -> str:
    """Arguments as canonical JSON, which another process builds the same from."""
    from gamekeeper.core.canon import to_json

    return to_json(dict(kwargs))
