"""First commit or version at which something comes out otherwise, by halving.

A repository is only read: a commit's files are written into a folder of their own, so neither the
work tree nor the index changes.
"""

from __future__ import annotations

import io
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal

from gamekeeper.errors import RunError
from gamekeeper.import_guard import unguarded

Outcome = Literal["same", "differs", "unknown"]
TIMEOUT_S: Final = 60.0
"""Longest time that git may take for one answer."""
ROOTS: Final = ("", "src")
"""Folders of a repository in which its modules are looked for."""


@dataclass(frozen=True, slots=True)
class BisectionStep:
    """One commit or version that was tried: its outcome, and what was seen."""

    name: str
    outcome: Outcome
    seen: str


@dataclass(frozen=True, slots=True)
class Bisection:
    """Outcome of a search.

    Attributes:
        first: the first commit or version that differs; None: none does, or it can't be told.
        subject: first line of a commit's message.
        skipped: those before it that couldn't be tried, so that one of them may be the first.
        tested: those that were tried, in that order.
        candidates: how many were searched.
    """

    first: str | None
    subject: str
    skipped: tuple[str, ...]
    tested: tuple[BisectionStep, ...]
    candidates: int

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper bisect --json` prints."""
        return {
            "first": self.first,
            "subject": self.subject,
            "skipped": list(self.skipped),
            "steps": len(self.tested),
            "candidates": self.candidates,
            "tested": [
                {"name": each.name, "outcome": each.outcome, "seen": each.seen}
                for each in self.tested
            ],
        }


def bisect(
    repo: Path,
    attempt: Callable[[Path], tuple[Outcome, str]],
    *,
    since: str | None = None,
    until: str = "HEAD",
) -> Bisection:
    """Finds the first commit for which `attempt` differs, if it differs from there on.

    Args:
        repo: a git repository.
        attempt: outcome of one commit, whose files lie in the folder it is given, and what it saw.
        since: a commit that is the same; None: the first one is searched too.
        until: the last commit.
    Raises:
        RunError: there is no such repository or commit, or no commit between them.
    """

    def laid_out(commit: str) -> tuple[Outcome, str]:
        with _laid_out(repo, commit) as folder:
            return attempt(folder)

    found = first_that_differs(_commits(repo, since, until), laid_out)
    if found.first is None:
        return found
    return replace(found, subject=_git(repo, "log", "-1", "--format=%s", found.first).strip())


def first_that_differs(
    names: Sequence[str], attempt: Callable[[str], tuple[Outcome, str]]
) -> Bisection:
    """First of several names for which `attempt` differs: the last is tried, then halves."""
    tested: dict[int, BisectionStep] = {}

    def tried(place: int) -> Outcome:
        if place not in tested:
            tested[place] = BisectionStep(names[place], *attempt(names[place]))
        return tested[place].outcome

    last = len(names) - 1
    first: str | None = None
    skipped: tuple[str, ...] = ()
    if tried(last) == "differs":
        place, unknown = halved(last, tried)
        first, skipped = names[place], tuple(names[each] for each in unknown)
    return Bisection(first, "", skipped, tuple(tested.values()), len(names))


def halved(last: int, tried: Callable[[int], Outcome]) -> tuple[int, tuple[int, ...]]:
    """First place that differs, where the last one does, and unknown places just before it.

    Args:
        last: a place that differs; those before it are 0 and up.
        tried: outcome of a place; all after the first that differs are taken to differ too.
    """
    same, differs = -1, last
    unknown: set[int] = set()
    while True:
        left = [place for place in range(same + 1, differs) if place not in unknown]
        if not left:
            return differs, tuple(sorted(p for p in unknown if same < p < differs))
        middle = left[(len(left) - 1) // 2]
        outcome = tried(middle)
        if outcome == "unknown":
            unknown.add(middle)
        elif outcome == "differs":
            differs = middle
        else:
            same = middle


def env_in(folder: Path, identity: Mapping[str, Any], named: str | None, repo: Path) -> str:
    """Text that opens the run's environment, or the named one, in a laid-out commit.

    Args:
        identity: of the run's environment.
        named: `path/in/repo.py:factory` or `module:factory`; None: the run's.
        repo: the repository; a file of the run's must lie in it.
    Raises:
        RunError: the run's environment doesn't lie in the repository.
    """
    kind, entry = identity.get("kind"), str(identity.get("entry_point"))
    if named is not None:
        path, _, factory = named.rpartition(":")
        return f"{folder / path}:{factory}" if path.endswith(".py") else named
    lay = identity.get("path")
    if kind == "file" and isinstance(lay, str):
        try:
            inside = Path(lay).resolve().relative_to(repo.resolve())
            return f"{folder / inside}:{entry.rpartition(':')[2]}"
        except ValueError:
            pass
    elif kind == "module":
        return entry
    raise RunError(
        "the run's environment doesn't lie in the repository",
        where=str(repo),
        actual=str(lay or entry),
        fix="name it as it lies there: --env path/in/repo.py:factory, or module:factory",
    )


@contextmanager
def modules_of(folder: Path) -> Iterator[None]:
    """Has workers import a laid-out commit's modules before any others: the user named them."""
    with unguarded():
        sys.path[:0] = [str(folder / root) for root in reversed(ROOTS) if (folder / root).is_dir()]
        yield


def _commits(repo: Path, since: str | None, until: str) -> list[str]:
    """Commits after `since` up to `until`, the oldest first."""
    ends = [_commit(repo, name) for name in (since, until) if name is not None]
    span = "..".join(ends)
    found = _git(repo, "rev-list", "--reverse", "--first-parent", span).split()
    if not found:
        raise RunError(
            "there is no commit to search",
            where=str(repo),
            expected="--to after --from",
            actual=span,
            fix="name an earlier commit with --from",
        )
    return found


def _commit(repo: Path, name: str) -> str:
    return _git(repo, "rev-parse", "--verify", "--end-of-options", f"{name}^{{commit}}").strip()


@contextmanager
def _laid_out(repo: Path, commit: str) -> Iterator[Path]:
    """A folder with the files of a commit."""
    data = _run(repo, ["archive", "--format=tar", commit])
    with tempfile.TemporaryDirectory(prefix="gamekeeper-") as folder:
        with tarfile.open(fileobj=io.BytesIO(data)) as archive:
            archive.extractall(folder, filter="data")
        yield Path(folder)


def _git(repo: Path, *words: str) -> str:
    return _run(repo, words).decode(errors="replace")


def _run(repo: Path, words: Sequence[str]) -> bytes:
    """Output of a git command.

    Raises:
        RunError: it isn't there, or refuses.
    """
    try:
        done = subprocess.run(
            ["git", "-C", str(repo), *words], capture_output=True, check=True, timeout=TIMEOUT_S
        )
    except (OSError, subprocess.SubprocessError) as error:
        said = getattr(error, "stderr", b"") or str(error).encode()
        raise RunError(
            "git gives no answer",
            where=f"git -C {repo} {' '.join(words)}"[:200],
            actual=said.decode(errors="replace").strip()[:300],
            fix="name a git repository with --repo, and commits of it with --from and --to",
        ) from error
    return done.stdout
