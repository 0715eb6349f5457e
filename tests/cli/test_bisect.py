"""`gamekeeper bisect` names commit, place and both values."""

import zipfile
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
    seen = next(each["seen"] for each in found["tested"] if each["name"] == found["first"])
    assert seen.startswith("episode 0, turn 0, reward of a: ")
    assert " → " in seen
    code, out, _ = said(capfd, "bisect", "run", "--repo", ".", "--to", "HEAD~2")
    assert (code, out.splitlines()[0]) == (0, "no change up to HEAD~2; 1 of 2 commits tried")


def wheel(folder: Path, version: str, paid: float) -> Path:
    """A wheel of `payer`, a module with one number."""
    path = folder / f"payer-{version}-py3-none-any.whl"
    info = f"payer-{version}.dist-info"
    files = {
        "payer.py": f"PAID = {paid}\n",
        f"{info}/METADATA": f"Metadata-Version: 2.1\nName: payer\nVersion: {version}\n",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{info}/RECORD": "",
    }
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in files.items():
            archive.writestr(name, text)
    return path


def test_version_that_changed_a_reward_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Versions are installed one by one, beside everything that is here."""
    first = wheel(tmp_path, "1.0", 0.0)
    wheel(tmp_path, "1.2", 0.5)
    with zipfile.ZipFile(first) as archive:
        archive.extractall(tmp_path / "site")
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    pays = ("float(actions.get(agent, 0))", "float(actions.get(agent, 0)) + payer.PAID")
    played(tmp_path, ("TURNS = 5", "import payer\nTURNS = 5"), pays, out="run", episodes=1)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path))
    line = ["bisect", tmp_path / "run", "--package", "payer", "--versions", "1.0,1.2"]
    code, found = document(capfd, *line)
    assert (code, found["first"], found["steps"]) == (1, "1.2", 2), found
    seen = found["tested"][0]["seen"]
    assert seen.startswith("episode 0, turn 0, reward of a: ")


def test_search_is_of_commits_or_versions(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Neither and both are refused."""
    played(tmp_path, out="run", episodes=1)
    for more in ([], ["--repo", ".", "--package", "numpy"], ["--repo", ".", "--versions", "1"]):
        code, _, error = said(capfd, "bisect", tmp_path / "run", *more)
        assert (code, "--repo . or --package numpy" in error) == (2, True)
