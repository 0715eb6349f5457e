"""`gamekeeper show RUN`: what a bundle holds; `show ENV`: what an environment is made of."""

from __future__ import annotations

from pathlib import Path
from textwrap import indent
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from gamekeeper.cli._form import look_at
from gamekeeper.cli._options import SILENCE_S, KwargsOption, TimeoutOption, json_object
from gamekeeper.cli._screen import Answer, Screen

if TYPE_CHECKING:
    from gamekeeper.core.evidence import Evidence

ORDER: Final = 110


ThingArgument = Annotated[
    str,
    typer.Argument(
        metavar="RUN|ENV", show_default=False, help="The folder of evidence, or an environment."
    ),
]


def command(
    screen: Screen,
    thing: ThingArgument,
    kwargs: KwargsOption = None,
    timeout: TimeoutOption = SILENCE_S,
) -> Answer:
    """Shows what a run holds, agent by agent, or what an environment is made of.

    Also of a run that is still being recorded, or was killed. Of an environment, which wrappers
    `gk.make` replaces by one face with the same promises, and which stay.
    """
    if Path(thing).is_dir():
        return _show_run(screen, Path(thing))
    return _show_env(screen, thing, kwargs, timeout)


def _show_env(screen: Screen, env: str, kwargs: str | None, timeout: float) -> Answer:
    from gamekeeper.report.text import brief_card

    form = look_at(
        env,
        env_kwargs=json_object(kwargs, option="--kwargs"),
        contract=None,
        silence_s=timeout,
    )
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


def _show_run(screen: Screen, run: Path) -> Answer:
    from gamekeeper.diagnose.labels import labels
    from gamekeeper.record.bundle import load
    from gamekeeper.report.labels_text import labels_text
    from gamekeeper.report.text import errors_text, facts_text, summary_text

    evidence = load(run)
    errors = _errors(evidence)
    screen.show(f"Run  {run}")
    screen.show(facts_text(evidence, width=screen.width))
    screen.show(f"\nAgents\n{summary_text(evidence.summary, width=screen.width)}")
    if errors:
        screen.show(f"\nErrors\n{errors_text(errors, width=screen.width)}")
    said = [each.to_json() for each in labels(run)]
    if said:
        screen.show(f"\nFailure labels\n{indent(labels_text(said, width=screen.width - 2), '  ')}")
    return Answer({**_document(evidence, errors), "labels": said})


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
