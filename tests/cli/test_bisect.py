"""`gamekeeper bisect` names commit, place and both values."""

from pathlib import Path

import pytest

from tests.cli.lines import document, said
from tests.runs.plays import played, write_env
from tests.runs.test_bisection import git


def test_commit_that_changed_a_reward_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Of commits that change nothing, one that pays otherwise, and one that can't be opened."""
    played(tmp_path, out="run")
    monkeypatch.chdir(tmp_path)
    git(tmp_path, "init", "-q")
    pays = ("float(actions.get(agent, 0))", "float(actions.get(agent, 0)) + 0.5")
    edits: list[tuple[tuple[str, str], ...]] = [
        (), (("TURNS = 5", "TURNS = 5  # turns"),), (pays,), (pays, ("TURNS = 5", "TURNS = 5 #")),
    ]  # fmt: skip
    for number, each in enumerate(edits):
        write_env(tmp_path, *each)
        git(tmp_path, "add", "walks.py")
        git(tmp_path, "commit", "-q", "-m", f"step {number}")
    code, found = document(capfd, "bisect", "run", "--repo", ".")
    assert (code, found["subject"], found["steps"]) == (1, "step 2", 3)
    seen = next(each["seen"] for each in found["tested"] if each["commit"] == found["first"])
    assert seen.startswith("episode 0, turn 0, reward of a: ")
    assert " → " in seen
    code, out, _ = said(capfd, "bisect", "run", "--repo", ".", "--to", "HEAD~2")
    assert (code, out.splitlines()[0]) == (0, "no change up to HEAD~2; 1 of 2 commits tried")
