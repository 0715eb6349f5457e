"""`gamekeeper contract ENV`: the structure as a card, and declarations that are missing."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, Literal

from gamekeeper.cli._audit import audit_with_progress
from gamekeeper.cli._form import GameForm, look_at
from gamekeeper.cli._options import SILENCE_S, json_object
from gamekeeper.cli._screen import CommandResult, Screen, document_text
from gamekeeper.errors import GamekeeperError
from gamekeeper.import_guard import unguarded

ORDER: Final = 20
SUFFIXES: Final = {".toml": "toml", ".json": "json", ".txt": "text"}


@unguarded()  # the user names what is run
def command(
    screen: Screen,
    env: str,
    format: Literal["text", "toml", "json"] | None = None,
    out: Path | None = None,
    contract: Path | None = None,
    kwargs: str | None = None,
    measure: bool = False,
    draft: bool = False,
    seed: int = 0,
    timeout: float = SILENCE_S,
) -> CommandResult:
    """Shows the structure of an environment, and asks for missing declarations.

    The structure: the order in which agents act, observe, are rewarded and end. The environment
    is opened, not stepped, unless --measure plays it to propose answers. With --out my_env.toml a
    draft to fill in is written; beside my_env.py it is found automatically. --draft asks least: it
    declares what holds of nearly every environment, proposes what it measures, and says of each
    question that is left why it matters.

    Example: gamekeeper contract path/to/my_env.py:make --out path/to/my_env.toml

    Args:
        format (--format): Format (default: by the suffix of --out, or text).
        out (--out FILE): File to write (default: stdout).
        measure (--measure): Play the environment (some 20,000 env steps), and propose answers from
            what it does.
        draft (--draft): Write a contract to begin with: few questions, usual values declared,
            others measured by playing (some 20,000 env steps).
    """
    env_kwargs = json_object(kwargs, option="--kwargs")
    form = look_at(env, env_kwargs=env_kwargs, contract=contract, silence_s=timeout)
    audited: dict[str, Any] = {}
    if measure or draft:
        audited = audit_with_progress(
            screen,
            env,
            contract=None if contract is None else str(contract),
            seed=seed,
            env_kwargs=env_kwargs,
            silence_s=timeout,
        ).to_json()
        form = _with_measured(form, audited["measured"])
    if draft:
        form = _proposed(form, audited["measured"])
    usual = "toml" if draft else "text"
    chosen = format or SUFFIXES.get("" if out is None else out.suffix, usual)
    text = _written(form, chosen, width=screen.width, audited=audited, declares=draft)
    if out is None:
        screen.show(text)
    else:
        _write(out, text)
        screen.note(f"written: {out}")
    written = {} if out is None else {"out": str(out)}
    measured = {"measured": audited["measured"]} if audited else {}
    return CommandResult({**form.to_json(), **measured, **written})


def _with_measured(form: GameForm, measured: Mapping[str, Any]) -> GameForm:
    """The form with measured answers to its questions."""
    from gamekeeper.reporting.measured_draft import measured_questions

    return replace(form, questions=measured_questions(form.questions, measured))


def _proposed(form: GameForm, measured: Mapping[str, Any]) -> GameForm:
    """The form with usual values declared, and the few questions that are left."""
    from gamekeeper.reporting.contract_proposal import proposal

    contract, questions = proposal(form.contract, form.questions, measured, form.agents)
    return replace(form, contract=contract, questions=questions)


def _written(
    form: GameForm, chosen: str, *, width: int, audited: Mapping[str, Any], declares: bool
) -> str:
    from gamekeeper.reporting.card import card_text, card_toml
    from gamekeeper.reporting.measured_draft import draft_note
    from gamekeeper.reporting.measured_text import measured_text

    parts = form.contract, form.agents
    if chosen == "json":
        return f"{document_text(form.to_json())}\n"
    if chosen == "toml":
        played = {"steps": audited["steps"], "seed": audited["seed"]} if audited else None
        note = draft_note(**played, declares=declares) if played else ""
        return note + card_toml(*parts, questions=form.questions)
    text = card_text(*parts, width=width, questions=form.questions)
    measured = measured_text(audited, width=width) if audited else ""
    return f"{text}\n{measured}\n" if measured else text


def _write(out: Path, text: str) -> None:
    """Writes a new file; a file that is there, perhaps filled in, is never overwritten."""
    try:
        with out.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise GamekeeperError(
            "the file exists already",
            where=str(out),
            fix="name another one, or remove it first; it is never overwritten",
        ) from None
    except OSError as error:
        raise GamekeeperError(
            "the file can't be written",
            where=str(out),
            actual=error.strerror or str(error),
            fix="make its folder first, or name a place that you may write to",
        ) from None
