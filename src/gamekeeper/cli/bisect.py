"""`gamekeeper bisect RUN --repo DIR`: the commit at which a run first comes out otherwise."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from gamekeeper.cli._options import SILENCE_S, RunArgument, TimeoutOption
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.errors import GamekeeperError
from gamekeeper.import_guard import unguarded

if TYPE_CHECKING:
    from gamekeeper.runs.bisection import Outcome

ORDER: Final = 55
BUDGET: Final = 3_000
"""Environment steps of an audit at one commit."""

RepoOption = Annotated[
    Path,
    typer.Option(
        "--repo", metavar="DIR", help="Git repository of the environment; only read (required)."
    ),
]
SinceOption = Annotated[
    str | None,
    typer.Option(
        "--from", metavar="A", help="Commit at which it is still the same (default: before all)."
    ),
]
UntilOption = Annotated[str, typer.Option("--to", metavar="B", help="Last commit.")]
EnvOption = Annotated[
    str | None,
    typer.Option(
        "--env",
        metavar="ENV",
        help="Environment as it lies in the repository: path/in/repo.py:factory or "
        "module:factory (default: the run's).",
    ),
]
CheckOption = Annotated[
    str | None,
    typer.Option(
        "--check",
        metavar="ID",
        help="Look for the commit at which the audit first fails this check (default: at which "
        "the replay first diverges).",
    ),
]


@unguarded()  # the user names the repository whose code runs
def command(
    screen: Screen,
    run: RunArgument,
    repo: RepoOption,
    since: SinceOption = None,
    until: UntilOption = "HEAD",
    env: EnvOption = None,
    check: CheckOption = None,
    timeout: TimeoutOption = SILENCE_S,
) -> CommandResult:
    """Finds the commit at which a run first replays otherwise, or a check first fails.

    Halves the commits between --from and --to; each that is tried is laid out in a folder of its
    own, and its code runs there. A commit that can't be opened is skipped, and named where it may
    be the first.

    Exit code 0: the last commit is still the same. 1: a commit was found. 2: no answer.

    Example: gamekeeper bisect runs/mine --repo . --from v1.0
    """
    from gamekeeper.runs.bisection import bisect, env_in, modules_of
    from gamekeeper.runs.load_run import load

    identity = load(run).manifest.get("environment") or {}
    judge = _replayed(run, timeout) if check is None else _audited(identity, check, timeout)

    def attempt(folder: Path) -> tuple[Outcome, str]:
        spec = env_in(folder, identity, env, repo)
        try:
            with modules_of(folder):
                outcome, seen = judge(spec)
        except GamekeeperError as error:
            outcome, seen = "unknown", error.what
        screen.note(f"{outcome}: {seen}")
        return outcome, seen

    found = bisect(repo, attempt, since=since, until=until)
    document = {"run": str(run), "check": check, **found.to_json()}
    steps = f"{len(found.tested)} of {found.candidates} commits tried"
    if found.first is None:
        last = found.tested[-1]
        is_same = last.outcome == "same"
        screen.verdict(
            f"no change up to {until}; {steps}" if is_same else f"can't tell: {last.seen}",
            "good" if is_same else "unsure",
        )
        return CommandResult(document, 0 if is_same else 2)
    seen = next(each.seen for each in found.tested if each.commit == found.first)
    screen.verdict(f"behavior changed in {found.first[:12]} {found.subject}", "bad")
    screen.show(f"{seen}\n{steps}")
    if found.skipped:
        listed = ", ".join(each[:12] for each in found.skipped)
        screen.show(f"or in one of these, which couldn't be tried: {listed}")
    return CommandResult(document, 1)


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
