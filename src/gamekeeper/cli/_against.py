"""`show RUN --against ENV`: results of a run or an evaluation that still hold, or are stale."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.cli._worker import value_of_task
from gamekeeper.errors import PolicyError, RunError

if TYPE_CHECKING:
    from gamekeeper.runs.standing import Against, Standing

EVALUATION: Final = "evaluation.json"
CODES: Final = {"holds": 0, "stale": 1, "unknown": 2}
MANNERS: Final = {"holds": "good", "stale": "bad", "unknown": "unsure"}


def show_against(screen: Screen, run: Path, env: str, **options: Any) -> CommandResult:
    """Shows what a run or an evaluation depends on, beside what is installed now.

    Args:
        env: names the environment; it is opened in a worker.
        options: as of `evaluation_against`.
    Raises:
        GamekeeperError: the evidence is damaged, or the environment can't be opened.
    """
    from gamekeeper.reporting.changes_text import against_text

    is_evaluation = (run / EVALUATION).is_file() and not (run / "manifest.json").is_file()
    compared = evaluation_against if is_evaluation else _run_against
    found = compared(run, env, **options)
    document = found.to_json()
    screen.verdict(against_text(document, width=screen.width), MANNERS[found.status])
    if found.commands:
        screen.program("\n" + "\n".join(f"  {command}" for command in found.commands))
    return CommandResult(document, CODES[found.status])


def _run_against(
    run: Path,
    env: str,
    *,
    kwargs: Mapping[str, Any] | None,
    allow_import: bool,
    contract: Path | None,
    silence_s: float,
) -> Against:
    from gamekeeper.runs.load_run import load
    from gamekeeper.runs.replay_runner import compact
    from gamekeeper.runs.standing import policies_of, standing
    from gamekeeper.runs.worker_tasks import TASK, askable

    evidence = load(run)
    identity = evidence.manifest.get("environment") or {}
    names = list(dict.fromkeys(name for name, _ in policies_of(evidence)))
    opening = {
        "spec": env,
        "contract": None if contract is None else str(contract),
        "kwargs": compact(identity.get("kwargs") or {}) if kwargs is None else canonical(kwargs),
        "api": identity.get("api"),
        "policies": askable(names, allow_import=allow_import),
    }
    now = value_of_task(TASK, opening, silence_s=silence_s)
    typed = None if kwargs is None else json.dumps(dict(kwargs))
    return standing(evidence, now, environment=env, kwargs=typed)


def canonical(kwargs: Mapping[str, Any]) -> str:
    """Arguments as canonical JSON, which another process builds the same from."""
    from gamekeeper.episodes.canonical import to_json

    return to_json(dict(kwargs))


MOST_BYTES: Final = 1 << 28
"""Largest document of an evaluation."""
NOT_ALLOWED: Final = "code that only the run names; --allow-import looks at it"


def evaluation_against(
    folder: Path,
    env: str,
    *,
    kwargs: Mapping[str, Any] | None,
    allow_import: bool,
    contract: Path | None,
    silence_s: float,
) -> Against:
    """Compares the environments of an evaluation that are opened as `env`, and its policies.

    An evaluation of a single environment is compared whatever that was called.

    Args:
        kwargs: the environment's arguments; None: the recorded ones.
        allow_import: policies that are code which evidence names are looked at too.
        contract: in place of the one beside it.
        silence_s: longest time that opening it may take, in seconds.
    Raises:
        RunError: the document is damaged, or has no such environment.
        GamekeeperError: the environment can't be opened.
    """
    from gamekeeper.runs.standing import Against

    document = _document(folder)
    rows: list[Standing] = []
    for name, then in _environments(document, env, folder).items():
        given = then.get("kwargs") or {} if kwargs is None else kwargs
        opening = {
            "spec": env,
            "kwargs": canonical(given),
            "contract": None if contract is None else str(contract),
        }
        policies = document.get("policies") or {}
        choices = _choices(policies, allow_import=allow_import)
        files = {name: _files(policies[name]) for name in choices}
        now, why_not = _inspection(opening, then.get("options"), choices, files, silence_s)
        rows += _environment_rows(name, then, now, _again(document))
        rows += _policy_rows(name, policies, now["policies"], why_not, _again(document))
    return Against(str(folder), env, tuple(rows))


def _document(folder: Path) -> dict[str, Any]:
    from gamekeeper.runs.files.folder import inside, read_bounded, reading

    path = inside(folder, EVALUATION)
    with reading(path):
        document: dict[str, Any] = json.loads(read_bounded(path, MOST_BYTES))
        if not isinstance(document["environments"], dict):
            raise ValueError("its `environments` is not an object")
    return document


def _environments(document: Mapping[str, Any], env: str, folder: Path) -> dict[str, Any]:
    environments: dict[str, Any] = document["environments"]
    named = {name: each for name, each in environments.items() if each.get("spec") == env}
    if named or len(environments) == 1:
        return named or environments
    raise RunError(
        f"the evaluation has no environment {env!r}",
        where=str(folder / EVALUATION),
        expected=", ".join(str(each.get("spec")) for each in environments.values()),
        actual=env,
        fix="name one of these with --against",
    )


def _choices(policies: Mapping[str, Any], *, allow_import: bool) -> dict[str, list[Any]]:
    """The runs' choices of agents' policies by name, where these may be looked at."""
    from gamekeeper.runs.worker_tasks import askable

    found = {}
    for name, each in policies.items():
        runs = each.get("choices") or []
        words = [str(choice) for run in runs for choice in run.values()]
        if runs and askable(words, allow_import=allow_import) == words:
            found[name] = runs
    return found


def _files(policy: Mapping[str, Any]) -> list[str]:
    """The files that a policy names beside its own; a device or a pipe might never end."""
    named = [str(name) for name in policy.get("files") or ()]
    return [name for name in named if not Path(name).exists() or Path(name).is_file()]


def _inspection(
    opening: Mapping[str, Any],
    options: Any,
    choices: Mapping[str, Any],
    files: Mapping[str, list[str]],
    silence_s: float,
) -> tuple[Any, str]:
    """Inspects what is installed now; leaves out policies that can't be found, with the reason."""
    from gamekeeper.evaluation.inspection import INSPECT

    arguments = {"opening": opening, "options": None if options is None else canonical(options)}
    try:
        given = {**arguments, "policies": choices, "files": files}
        return value_of_task(INSPECT, given, silence_s=silence_s), NOT_ALLOWED
    except PolicyError as error:
        given = {**arguments, "policies": {}, "files": {}}
        return value_of_task(INSPECT, given, silence_s=silence_s), error.what


def _environment_rows(
    name: str, then: Mapping[str, Any], now: Mapping[str, Any], command: str
) -> Iterator[Standing]:
    from gamekeeper.runs.standing import Standing

    for what, key in (("source and arguments", "digest"), ("version", "version"), ("api", "api")):
        same = then.get(key) == now[key]
        yield Standing(
            f"{name}: {what}",
            then.get(key),
            now[key],
            "holds" if same else "stale",
            "" if same else f"every result in {name}",
            "" if same else command,
        )


def _policy_rows(
    name: str, policies: Mapping[str, Any], now: Mapping[str, Any], why_not: str, command: str
) -> Iterator[Standing]:
    from gamekeeper.runs.standing import Standing

    for policy, each in policies.items():
        then = (each.get("by_environment") or {}).get(name) or each.get("digests") or []
        what, recorded = f"{name}: policy {policy}", ", ".join(map(str, then)) or None
        again = f"results of {policy} in {name}"
        if policy not in now:
            yield Standing(what, recorded, why_not, "unknown", again, command)
            continue
        same = list(now[policy]) == list(then)
        yield Standing(
            what,
            recorded,
            ", ".join(now[policy]),
            "holds" if same else "stale",
            "" if same else again,
            "" if same else command,
        )


def _again(document: Mapping[str, Any]) -> str:
    """The command that the evaluation says it came from; it plays only what is stale."""
    commands = document.get("commands")
    first = commands[0] if isinstance(commands, list) and commands else None
    return str(first) if first else shlex.join(["gamekeeper", "evaluate", "SPEC.toml"])
