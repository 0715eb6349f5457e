"""What of an evaluation still holds: the digests of its environments and policies, then and now."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gamekeeper.cli._against import EVALUATION, canonical, looked
from gamekeeper.errors import BundleError, PolicyError

if TYPE_CHECKING:
    from gamekeeper.record.against import Against, Standing

BYTES: Final = 1 << 28
"""Of an evaluation's document, at most."""
UNLOOKED: Final = "code that evidence names; --allow-import looks at it"


def evaluation_against(
    folder: Path,
    env: str,
    *,
    kwargs: Mapping[str, Any] | None,
    allow_import: bool,
    contract: Path | None,
    silence_s: float,
) -> Against:
    """The environments of an evaluation that are opened as `env`, and the policies that played.

    Where it has one environment alone, it is that one, whatever it is called.

    Raises:
        BundleError: the document is damaged, or has no such environment.
        GamekeeperError: the environment can't be opened.
    """
    from gamekeeper.record.against import Against

    document = _document(folder)
    rows: list[Standing] = []
    for name, then in _environments(document, env, folder).items():
        given = then.get("kwargs") or {} if kwargs is None else kwargs
        opening = {
            "spec": env, "kwargs": canonical(given),
            "contract": None if contract is None else str(contract),
        }  # fmt: skip
        policies = document.get("policies") or {}
        choices = _choices(policies, allow_import=allow_import)
        files = {who: _files(policies[who]) for who in choices}
        now, why_not = _look(opening, then.get("options"), choices, files, silence_s)
        rows += _environment_rows(name, then, now, _again(document))
        rows += _policy_rows(name, policies, now["policies"], why_not, _again(document))
    return Against(str(folder), env, tuple(rows))


def _document(folder: Path) -> dict[str, Any]:
    from gamekeeper.record.files.folder import inside, read_bounded, reading

    path = inside(folder, EVALUATION)
    with reading(path):
        document = json.loads(read_bounded(path, BYTES))
        if not isinstance(document["environments"], dict):
            raise ValueError("its environments are no object")
    found: dict[str, Any] = document
    return found


def _environments(document: Mapping[str, Any], env: str, folder: Path) -> dict[str, Any]:
    environments: dict[str, Any] = document["environments"]
    named = {name: each for name, each in environments.items() if each.get("spec") == env}
    if named or len(environments) == 1:
        return named or environments
    raise BundleError(
        f"the evaluation has no environment {env!r}", where=str(folder / EVALUATION),
        expected=", ".join(str(each.get("spec")) for each in environments.values()), seen=env,
    )  # fmt: skip


def _choices(policies: Mapping[str, Any], *, allow_import: bool) -> dict[str, list[Any]]:
    """Who plays under each policy's name, of those that may be looked at."""
    from gamekeeper.record.now import askable

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


def _look(
    opening: Mapping[str, Any],
    options: Any,
    choices: Mapping[str, Any],
    files: Mapping[str, list[str]],
    silence_s: float,
) -> tuple[Any, str]:
    """What is there now; policies that can't be found are left out, and why is said."""
    from gamekeeper.evaluate.look import LOOK

    told = None if options is None else canonical(options)
    arguments = {"opening": opening, "options": told}
    try:
        given = {**arguments, "policies": choices, "files": files}
        return looked(LOOK, given, silence_s=silence_s), UNLOOKED
    except PolicyError as error:
        given = {**arguments, "policies": {}, "files": {}}
        return looked(LOOK, given, silence_s=silence_s), error.what


def _environment_rows(
    name: str, then: Mapping[str, Any], now: Mapping[str, Any], command: str
) -> Iterator[Standing]:
    from gamekeeper.record.against import Standing

    for what, key in (("source and arguments", "digest"), ("version", "version"), ("api", "api")):
        same = then.get(key) == now[key]
        yield Standing(
            f"{name}: {what}", then.get(key), now[key], "holds" if same else "stale",
            "" if same else f"every result in {name}", "" if same else command,
        )  # fmt: skip


def _policy_rows(
    name: str,
    policies: Mapping[str, Any],
    now: Mapping[str, Any],
    why_not: str,
    command: str,
) -> Iterator[Standing]:
    from gamekeeper.record.against import Standing

    for policy, each in policies.items():
        then = (each.get("by_environment") or {}).get(name) or each.get("digests") or []
        what, recorded = f"{name}: policy {policy}", ", ".join(map(str, then)) or None
        again = f"results of {policy} in {name}"
        if policy not in now:
            yield Standing(what, recorded, why_not, "unknown", again, command)
            continue
        same = list(now[policy]) == list(then)
        yield Standing(
            what, recorded, ", ".join(now[policy]), "holds" if same else "stale",
            "" if same else again, "" if same else command,
        )  # fmt: skip


def _again(document: Mapping[str, Any]) -> str:
    """The command that the evaluation says it came from; it plays only what is stale."""
    commands = document.get("commands")
    first = commands[0] if isinstance(commands, list) and commands else None
    return str(first) if first else shlex.join(["gamekeeper", "evaluate", "SPEC.toml"])
