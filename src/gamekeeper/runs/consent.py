"""Consent to run code that a run names: the rule, and the folders in which its imports look."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from os import PathLike
from pathlib import Path, PurePath
from typing import Any, Final

from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.plain_json import fields_json
from gamekeeper.errors import TrustError
from gamekeeper.import_guard import active, guarded, pythonpath, unguarded
from gamekeeper.interface.opening import distrust
from gamekeeper.interface.policy import distrust_policy, is_schemed
from gamekeeper.runs import own_runs
from gamekeeper.runs.files.checksums import root_digest
from gamekeeper.runs.load_run import load

RULES: Final = {
    "allow_import": "you allowed it with --allow-import",
    "named": "you named it with --env",
    "own_run": "the run is your own: recorded here, files unchanged",
    "installed": "it is an installed package",
    "in_memory": "this process has just played it",
}


@dataclass(frozen=True, slots=True)
class Consent:
    """Rule by which code that a run names was run.

    Attributes:
        rule: `allow_import`, `named` (with `env`), `own_run`, `installed` or `in_memory`.
        pythonpath: entries of PYTHONPATH in which its imports were looked for.
    """

    rule: str
    pythonpath: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Plain data, as it stands in results."""
        return fields_json(self)

    def __str__(self) -> str:
        entries = ", ".join(entry or "the current folder" for entry in self.pythonpath)
        return f"environment opened because {RULES[self.rule]}" + (
            f"; PYTHONPATH: {entries}" if entries else ""
        )


def evidence_of(run: Evidence | str | PathLike[str]) -> Evidence:
    """The evidence of a run; reading it imports nothing that lies there.

    Raises:
        RunError: there is no run, or it is damaged.
    """
    if isinstance(run, Evidence):
        return run
    with guarded(run):
        return load(run)


@contextmanager
def consented(
    evidence: Evidence,
    *,
    doing: str,
    env: object | None,
    policies: Iterable[str] = (),
    chosen: Iterable[object] = (),
    allow_import: bool = False,
) -> Iterator[Consent]:
    """Lets code that a run names run in this context, with its imports under a guard.

    Without the user's consent nothing is imported from the current folder or the run's, neither
    here nor in workers.

    Args:
        doing: the action, for the error: "replaying this run".
        env: environment that the user named in place of the run's; None: the run's is opened.
        policies: names of policies that the run names, and that are to choose.
        chosen: policies that the user named.
        allow_import: the user allows whatever the run names.
    Raises:
        TrustError: it would run code that the user has not consented to.
    """
    names = sorted(set(policies))
    imports: AbstractContextManager[object]
    if evidence.path is None or allow_import:
        imports, rule = unguarded(), "in_memory" if evidence.path is None else "allow_import"
    else:
        with guarded(evidence.path):
            rule, modules = _rule(evidence.path, evidence.manifest, doing, env, names)
        if rule == "named":
            imports = unguarded()
        elif any(not isinstance(each, str) or ":" in each for each in chosen):
            # code that the user named may lie here, and import what lies beside it
            imports = guarded(evidence.path, is_here_closed=False)
        else:
            imports = guarded(evidence.path, modules=modules)
    with imports:
        guard = active()
        entries = [each for each in pythonpath() if guard is None or guard.allows(each)]
        yield Consent(rule, tuple(entries))


def _rule(
    path: PurePath, manifest: Mapping[str, Any], doing: str, env: object | None, policies: list[str]
) -> tuple[str, own_runs.Modules]:
    """The first rule that consents, and the modules that may be imported besides."""
    is_open = env is None or any(map(distrust_policy, policies))
    modules = _own(path) if is_open else None
    identity = manifest.get("environment")
    changed = [] if modules is None else own_runs.changed(_opened(modules, identity, policies))
    # First of all an own run: it alone may import files that aren't installed.
    if modules is not None and not changed and not any(map(is_schemed, policies)):
        return ("own_run" if env is None else "named"), modules
    reason = None
    if env is None:
        reason = distrust(identity if isinstance(identity, Mapping) else {})
    fix = "if you trust it, allow it (--allow-import); or name the environment yourself with --env"
    if reason is None:
        fix = "if you trust it, allow it (--allow-import)"
        reason = next(filter(None, map(distrust_policy, policies)), None)
    if reason is None:
        return ("installed" if env is None else "named"), {}
    if changed:
        reason = f"{changed[0]} has changed since you recorded this run"
        fix = "run the changed file by adding --allow-import"
        if not Path(changed[0]).exists():
            reason = f"{changed[0]} is gone since you recorded this run"
            fix = "put it back, or name the environment where it is now with --env"
    raise TrustError(
        f"{doing} would execute code that its evidence names",
        where=str(path),
        actual=reason,
        fix=fix,
    )


def _opened(modules: own_runs.Modules, identity: object, policies: list[str]) -> own_runs.Modules:
    """Modules that must be as they were: all where policies choose, else the environment's own.

    Any other one, such as a recorded policy's or a script's that has moved on, is compared once the
    environment imports it.
    """
    if policies or not isinstance(identity, Mapping):
        return modules
    place, module = identity.get("path"), str(identity.get("entry_point")).partition(":")[0]
    found = {name: each for name, each in modules.items() if name == module or each[0] == place}
    return found or modules


def _own(path: PurePath) -> own_runs.Modules | None:
    """Modules that an own, unchanged run was imported from; None for any other run."""
    root = root_digest(path, check=False)
    modules = own_runs.recall(root)
    is_unchanged = modules is not None and root == root_digest(path)
    return modules if is_unchanged else None
