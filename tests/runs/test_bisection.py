"""The first commit that differs is found by halving, and the repository is only read."""

import subprocess
from pathlib import Path

import pytest

from gamekeeper.errors import RunError
from gamekeeper.runs.bisection import Outcome, bisect, halved

COMMITS = 64


def git(repo: Path, *words: str) -> str:
    """What git says, whoever the user is."""
    own = ["-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false"]
    done = subprocess.run(["git", "-C", str(repo), *own, *words], capture_output=True, check=True)
    return done.stdout.decode().strip()


@pytest.fixture(scope="module")
def numbered(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """A repository of commits, in each of which a file holds the commit's number."""
    repo = tmp_path_factory.mktemp("repo")
    git(repo, "init", "-q")
    stream = []
    for number in range(COMMITS):
        text = str(number)
        stream += [
            "commit refs/heads/main",
            f"committer a <a@example.org> {1_700_000_000 + number} +0000",
            f"data {len(text) + 7}\ncommit {text}",
            f"M 100644 inline number\ndata {len(text)}\n{text}",
        ]
    fed = "\n".join([*stream, ""]).encode()
    subprocess.run(
        ["git", "-C", str(repo), "fast-import", "--quiet"], input=fed, check=True, timeout=60
    )
    return repo, git(repo, "rev-list", "--reverse", "main").split()


@pytest.mark.parametrize("planted", [0, 1, 31, 32, 40, 62, 63])
def test_planted_commit_is_found_in_seven_steps(
    numbered: tuple[Path, list[str]], planted: int
) -> None:
    """Of 64 commits the right one; the last one is tried first, then halves."""
    repo, commits = numbered

    def attempt(folder: Path) -> tuple[Outcome, str]:
        number = int((folder / "number").read_text())
        return ("differs" if number >= planted else "same"), str(number)

    found = bisect(repo, attempt, until="main")
    assert found.first == commits[planted]
    assert found.subject == f"commit {planted}"
    assert len(found.tested) <= 7
    assert found.candidates == COMMITS
    assert not (repo / "number").exists()  # the work tree is as it was


def test_every_place_is_found_in_seven_steps() -> None:
    """Wherever the first of 64 is, six halves find it after the last one was seen to differ."""
    for planted in range(COMMITS):
        tried: list[int] = []

        def attempt(place: int, planted: int = planted, tried: list[int] = tried) -> Outcome:
            tried.append(place)
            return "differs" if place >= planted else "same"

        assert halved(COMMITS - 1, attempt) == (planted, ())
        assert len(tried) <= 6


def test_commits_that_cannot_be_tried_are_named() -> None:
    """Where one that can't be opened stands before the first that differs, it may be the first."""
    outcomes: list[Outcome] = ["same", "same", "unknown", "unknown", "differs", "differs"]
    assert halved(5, outcomes.__getitem__) == (4, (2, 3))


def test_nothing_is_found_where_nothing_changed(numbered: tuple[Path, list[str]]) -> None:
    """One step, as the last commit is the same."""
    found = bisect(numbered[0], lambda folder: ("same", ""), since="main~5", until="main")
    assert (found.first, len(found.tested), found.candidates) == (None, 1, 5)


@pytest.mark.parametrize("names", [{"until": "no-such"}, {"until": "-x"}, {"since": "main"}])
def test_commits_that_are_not_there_are_told(
    numbered: tuple[Path, list[str]], names: dict[str, str]
) -> None:
    """Names that git doesn't know, and an empty range."""
    with pytest.raises(RunError):
        bisect(numbered[0], lambda folder: ("same", ""), **{"until": "main", **names})
