"""`gamekeeper bisect RUN`: commit or package version at which it first comes out otherwise."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gamekeeper.cli._options import SILENCE_S
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.errors import GamekeeperError
from gamekeeper.import_guard import unguarded

if TYPE_CHECKING:
    from gamekeeper.runs.bisection import Bisection, Outcome

ORDER: Final = 55
BUDGET: Final = 3_000
"""Environment steps of an audit at one commit or version."""
LONGEST_S: Final = 3_600.0
"""Longest time of one version's replay or audit, in seconds."""


@unguarded()  # the user names the repository whose code runs
def command(
    screen: Screen,
    run: Path,
    repo: Path | None = None,
    package: str | None = None,
    versions: str | None = None,
    since: str | None = None,
    until: str | None = None,
    env: str | None = None,
    check: str | None = None,
    timeout: float = SILENCE_S,
) -> CommandResult:
    """Finds the commit, or a package's version, at which a run's replay first differs.

    Tries the last one, then halves. A commit is laid out in a folder of its own, and its code runs
    there; a version is installed into a virtual environment of its own, in which all other packages
    are as here. With --check: at which the audit first fails that check. One that can't be opened
    is skipped, and named where it may be the first.

    Exit code 0: the last one is still the same. 1: one was found. 2: no answer.

    Example: gamekeeper bisect runs/mine --repo . --from v1.0

    Args:
        repo (--repo DIR): Git repository of the environment, which is only read (default: none;
            this or --package is required).
        package (--package NAME): Installed package whose versions are tried, as pip lists them
            (default: none; this or --repo is required).
        versions (--versions LIST): With --package: these versions, the oldest first, as in
            2.0.0,2.1.3 (default: all that pip can install here, from --from to --to).
        since (--from A): Commit or version at which it is still the same (default: before all).
        until (--to B): Last commit or version (default: HEAD; the newest).
        env (--env ENV): Environment as it lies in the repository: path/in/repo.py:factory or
            module:factory (default: the run's).
        check (--check ID): Look for where the audit first fails this check (default: where the
            replay first diverges).
    """
    from gamekeeper.runs.bisection import first_that_differs
    from gamekeeper.runs.load_run import load

    identity = load(run).manifest.get("environment") or {}
    if (repo is None) == (package is None) or (versions and not package):
        raise GamekeeperError(
            "bisect searches the commits of a repository or the versions of a package",
            where="bisect",
            expected="--repo DIR, or --package NAME",
            actual="both" if repo and package else "--versions alone" if versions else "neither",
            fix="--repo . or --package numpy",
        )
    found: Bisection
    if repo is not None:
        judge = _replayed(run, timeout) if check is None else _audited(identity, check, timeout)
        found = _commits(screen, identity, repo, judge, since=since, until=until, env=env)
    else:
        attempt = _at_version(run, identity, str(package), env=env, check=check, timeout=timeout)
        names = _versions(str(package), versions, since, until)
        found = first_that_differs(names, _noted(screen, attempt))
    document = {"run": str(run), "check": check, "package": package, **found.to_json()}
    return CommandResult(document, _show(screen, found, package, since, until))


def _versions(package: str, listed: str | None, since: str | None, until: str | None) -> list[str]:
    """Versions to search: those that were listed, or those that pip knows."""
    from gamekeeper.runs.bisection import versions_between

    if listed is None:
        return versions_between(package, since, until)
    return [each.strip() for each in listed.split(",") if each.strip()]


def _commits(
    screen: Screen,
    identity: Any,
    repo: Path,
    judge: Callable[[str], tuple[Outcome, str]],
    *,
    since: str | None,
    until: str | None,
    env: str | None,
) -> Bisection:
    """Searches the commits of a repository."""
    from gamekeeper.runs.bisection import bisect, env_in, modules_of

    def attempt(folder: Path) -> tuple[Outcome, str]:
        spec = env_in(folder, identity, env, repo)
        with modules_of(folder):
            return judge(spec)

    return bisect(repo, _noted(screen, attempt), since=since, until=until or "HEAD")


def _noted(
    screen: Screen, attempt: Callable[[Any], tuple[Outcome, str]]
) -> Callable[[Any], tuple[Outcome, str]]:
    """The same, which says what it saw; what can't be opened is unknown."""

    def noted(thing: Any) -> tuple[Outcome, str]:
        outcome: Outcome
        try:
            outcome, seen = attempt(thing)
        except GamekeeperError as error:
            said = f"{error.what}: {error.actual}" if error.actual else error.what
            outcome, seen = "unknown", f"{said}; {error.fix}" if error.fix else said
        name = "" if isinstance(thing, Path) else f"{thing}: "
        screen.note(f"{name}{outcome}: {seen}")
        return outcome, seen

    return noted


def _show(
    screen: Screen, found: Bisection, package: str | None, since: str | None, until: str | None
) -> int:
    """Shows what was found, and returns the exit code."""
    kind = "commits" if package is None else "versions"
    steps = f"{len(found.tested)} of {found.candidates} {kind} tried"
    last = found.tested[0]
    if found.first is None:
        is_same, name = last.outcome == "same", until or last.name[:12]
        screen.verdict(
            f"no change up to {name}; {steps}" if is_same else f"can't tell: {name}: {last.seen}",
            "good" if is_same else "unsure",
        )
        return 0 if is_same else 2
    seen = next(each.seen for each in found.tested if each.name == found.first)
    place = f"{package} {found.first}" if package else f"{found.first[:12]} {found.subject}"
    is_place = seen.startswith("episode")
    screen.verdict(f"behavior changed{' at ' if is_place else ': '}{seen}", "bad")
    screen.show(f"since {place}\n{steps}")
    if not since and all(each.outcome != "same" for each in found.tested):
        screen.show(f"or earlier: none of the {kind} that were tried comes out the same")
    if found.skipped:
        listed = ", ".join(each[:12] for each in found.skipped)
        screen.show(f"or at one of these, which couldn't be tried: {listed}")
    return 1


def _at_version(
    run: Path, identity: Any, package: str, *, env: str | None, check: str | None, timeout: float
) -> Callable[[str], tuple[Outcome, str]]:
    """Judge of a version: does the run replay under it, or the audit fail the check."""
    from gamekeeper.runs.bisection import answer_of, python_with

    limit = ["--timeout", f"{timeout:g}"]
    named = [] if env is None else ["--env", env]
    words = ["replay", str(run), "--allow-import", *named, *limit]
    if check is not None:
        kwargs = json.dumps(identity.get("kwargs") or {})
        spec = env or _spec_of(identity)
        words = ["audit", spec, "--select", check, "--budget", str(BUDGET), "--kwargs", kwargs]

    def judge(version: str) -> tuple[Outcome, str]:
        with python_with(package, version) as python:
            return _outcome_of(answer_of(python, words, LONGEST_S), check)

    return judge


def _spec_of(identity: Any) -> str:
    """Text that opens a run's environment."""
    factory = str(identity.get("entry_point"))
    path = identity.get("path")
    return f"{path}:{factory.rpartition(':')[2]}" if path else factory


def _outcome_of(answer: dict[str, Any] | str, check: str | None) -> tuple[Outcome, str]:
    """Outcome of a version, by the document of a command or what it says in its place."""
    from gamekeeper.reporting.results_text import change_text
    from gamekeeper.runs.comparison import divergence_from_json

    if isinstance(answer, str) or "error" in answer:
        return "unknown", answer if isinstance(answer, str) else str(answer["error"])[:300]
    if check is not None:
        failed = [each for each in answer["verdicts"] if each["outcome"] == "failed"]
        if failed:
            return "differs", f"{failed[0]['id']} failed: {failed[0]['claim']}"
        return "same", f"{check} didn't fail"
    if answer["verified"]:
        return "same", "verified"
    if answer["divergence"] is None:
        return "unknown", str(answer["reason"])
    return "differs", change_text(divergence_from_json(answer["divergence"]))


def _replayed(run: Path, timeout: float) -> Callable[[str], tuple[Outcome, str]]:
    """Judge of a commit: does the run replay there."""
    from gamekeeper.reporting.results_text import change_text
    from gamekeeper.runs.comparison import replay

    def judge(spec: str) -> tuple[Outcome, str]:
        played = replay(run, env=spec, timeout_s=timeout, explain=False)
        if played.verified:
            return "same", "verified"
        if played.divergence is None:
            return "unknown", str(played.reason)
        return "differs", change_text(played.divergence)

    return judge


def _audited(identity: Any, check: str, timeout: float) -> Callable[[str], tuple[Outcome, str]]:
    """Judge of a commit: does the audit fail the check there."""
    from gamekeeper.auditing.audit_process import audit
    from gamekeeper.episodes.canonical import from_json
    from gamekeeper.runs.replay_runner import compact

    kwargs: Any = from_json(compact(identity.get("kwargs") or {}))

    def judge(spec: str) -> tuple[Outcome, str]:
        result = audit(spec, select=(check,), budget=BUDGET, silence_s=timeout, env_kwargs=kwargs)
        if result.failed:
            return "differs", f"{result.failed[0].id} failed: {result.failed[0].claim}"
        return "same", f"{check} didn't fail"

    return judge
