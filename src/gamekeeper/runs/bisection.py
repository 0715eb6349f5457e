"""First commit or version at which something comes out otherwise, by halving.

A repository is only read: a commit's files are written into a folder of their own, so neither the
work tree nor the index changes.
"""

import io
import json
import re
import subprocess
import sys
import tarfile
import tempfile
import venv
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal

from gamekeeper.episodes.plain_json import fields_json
from gamekeeper.errors import RunError
from gamekeeper.import_guard import unguarded

# -- Versions of a package, each tried in a virtual environment that differs in that alone

PIP: Final = (sys.executable, "-m", "pip", "--disable-pip-version-check")
PIP_S: Final = 600.0
"""Longest time that pip may take for one answer."""
NAME: Final = re.compile(r"[A-Za-z0-9]([A-Za-z0-9._-]*[A-Za-z0-9])?")
VERSION: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9.!+_-]*")
LISTED: Final = re.compile(r"^Available versions: (.+)$", re.MULTILINE)


def versions_between(package: str, since: str | None, until: str | None) -> list[str]:
    """Versions that pip can install here, the oldest first: after `since`, up to `until`.

    Raises:
        RunError: pip knows no such package or version.
    """
    found = LISTED.search(_pip("index", "versions", _plain(NAME, package)))
    names = [each.strip() for each in found[1].split(",")][::-1] if found else []
    for each in filter(None, (since, until)):
        if each not in names:
            raise _none(package, f"no version {each} among {', '.join(names[-8:])}")
    first = 0 if since is None else names.index(since) + 1
    chosen = names[first : len(names) if until is None else names.index(until) + 1]
    if not chosen:
        raise _none(package, "no version between --from and --to")
    return chosen


@contextmanager
def python_with(package: str, version: str) -> Iterator[Path]:
    """Interpreter of a virtual environment with one package in another version, all else as here.

    Raises:
        RunError: pip can't install it.
    """
    wanted = f"{_plain(NAME, package)}=={_plain(VERSION, version)}"
    with tempfile.TemporaryDirectory(prefix="gamekeeper-") as folder:
        builder = venv.EnvBuilder()
        builder.create(folder)
        python = Path(builder.ensure_directories(folder).env_exe)
        code = "import sysconfig; print(sysconfig.get_path('purelib'))"
        site = subprocess.run([python, "-c", code], capture_output=True, text=True, check=True)
        _pip("--python", str(python), "install", "--quiet", "--no-deps", wanted)
        here = [each for each in sys.path if Path(each).is_absolute() and Path(each).is_dir()]
        lines = [each for each in here if not _is_standard(each)]
        (Path(site.stdout.strip()) / "here.pth").write_text("\n".join([*lines, ""]))
        yield python


def answer_of(python: Path, words: Sequence[str], timeout_s: float) -> dict[str, Any] | str:
    """Document that a gamekeeper command prints there; a text: what it says in its place."""
    line = [str(python), "-m", "gamekeeper", *words, "--json"]
    try:
        done = subprocess.run(line, capture_output=True, text=True, timeout=timeout_s, check=False)
        document = json.loads(done.stdout)
    except subprocess.TimeoutExpired:
        return f"no answer in {timeout_s:g} s"
    except ValueError:
        return (done.stderr.strip().splitlines() or ["no answer"])[-1][:300]
    return document if isinstance(document, dict) else str(document)[:300]


def _is_standard(folder: str) -> bool:
    """Tells if a folder of the import path is the standard library's, which a venv has anyway."""
    return Path(folder).is_relative_to(sys.base_prefix) and "site-packages" not in folder


def _plain(form: re.Pattern[str], text: str) -> str:
    if form.fullmatch(text) is None:
        raise _none(text, "no name of a package or version")
    return text


def _pip(*words: str) -> str:
    """Output of a pip command.

    Raises:
        RunError: it fails.
    """
    try:
        done = subprocess.run(
            [*PIP, *words], capture_output=True, text=True, check=True, timeout=PIP_S
        )
    except (OSError, subprocess.SubprocessError) as error:
        lines = str(getattr(error, "stderr", "") or error).strip().splitlines()
        raise _none(" ".join(words), (lines or ["no answer"])[-1]) from error
    return done.stdout


def _none(where: str, actual: str) -> RunError:
    return RunError(
        "pip has no such version",
        where=where[:200],
        expected="a package and versions that pip can install here",
        actual=actual[:300],
        fix="name them with --versions 1.0,1.1, or ask: pip index versions PACKAGE",
    )


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
        return {**fields_json(self), "steps": len(self.tested)}


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
    verify = ("rev-parse", "--verify", "--end-of-options")
    named = [f"{name}^{{commit}}" for name in (since, until) if name is not None]
    ends = [_git(repo, *verify, name).strip() for name in named]
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
        output = getattr(error, "stderr", b"") or str(error).encode()
        raise RunError(
            "git gives no answer",
            where=f"git -C {repo} {' '.join(words)}"[:200],
            actual=output.decode(errors="replace").strip()[:300],
            fix="name a git repository with --repo, and commits of it with --from and --to",
        ) from error
    return done.stdout
