"""What is opened unasked imports nothing from the current folder; an own run needs no flag."""

import json
import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from gamekeeper.errors import TrustError
from gamekeeper.runs import own_runs
from gamekeeper.runs.comparison import replay
from gamekeeper.runs.consent import consented
from gamekeeper.runs.files.checksums import root_digest
from gamekeeper.runs.load_run import load
from gamekeeper.runs.recording import rollout
from tests.interface.toys import PARALLEL_TEXT
from tests.runs.finalize_again import finalize_again
from tests.runs.plays import played, write_env

HERD = "herd_that_is_not_installed"
LOOKS = f"""
import subprocess, sys
sys.path.append(".")
try:
    import {HERD}
except ImportError:
    pass
subprocess.run([sys.executable, "-c", "import {HERD}"], stderr=subprocess.DEVNULL)
def parallel_env(**kwargs):
    return Pair(**kwargs)
"""
"""An environment that looks for an optional package, here and in a process that it starts."""


@pytest.fixture(autouse=True)
def own_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty folder of own runs."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    before = set(sys.modules)
    yield tmp_path / "state" / "gamekeeper" / "own-runs"
    for name in set(sys.modules) - before:
        if str(tmp_path) in str(getattr(sys.modules[name], "__file__", "")):
            del sys.modules[name]


@pytest.fixture
def pasture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A run of an installed environment, in whose folder lies the optional package."""
    site = tmp_path / "site"
    info = site / "pasture-1.2.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: pasture\nVersion: 1.2\nRequires-Dist: pettingzoo\n"
    )
    (info / "top_level.txt").write_text("pasture")
    (info / "RECORD").write_text("pasture-1.2.dist-info/METADATA,,\npasture.py,,\n")
    (site / "pasture.py").write_text(PARALLEL_TEXT + LOOKS)
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.setenv("PYTHONPATH", str(site))
    monkeypatch.chdir(tmp_path)
    rollout("pasture:parallel_env", episodes=1, out=tmp_path / "run", most_turns=3)
    (tmp_path / "run" / f"{HERD}.py").write_text("open(__file__ + '.ran', 'a').close()\n")
    return tmp_path / "run"


@pytest.mark.parametrize("is_own", [True, False])
def test_replay_never_imports_from_the_runs_folder(
    pasture: Path, own_state: Path, monkeypatch: pytest.MonkeyPatch, is_own: bool
) -> None:
    """A file with the name of an optional package that isn't installed is not executed."""
    if not is_own:
        shutil.rmtree(own_state)
    elsewhere = str(pasture.parent / "site")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(["", elsewhere, str(pasture), "."]))
    monkeypatch.chdir(pasture)
    for entry in (str(pasture), "."):
        monkeypatch.syspath_prepend(entry)

    result = replay(".")

    assert result.verified, str(result)
    assert not list(pasture.glob("*.ran"))
    assert result.consent is not None
    assert ("own_run" if is_own else "installed", (elsewhere,)) == (
        result.consent.rule,
        result.consent.pythonpath,
    )
    assert {"rule": result.consent.rule, "pythonpath": [elsewhere]} == result.to_json()["consent"]
    assert elsewhere in str(result)


def test_own_run_replays_without_a_flag_until_its_files_change(tmp_path: Path) -> None:
    """A run of an environment in a file is the user's own, and needs no word while unchanged."""
    played(tmp_path)
    result = replay(tmp_path / "run")
    assert result.verified, str(result)
    assert result.consent is not None
    assert result.consent.rule == "own_run"

    write_env(tmp_path, ("TURNS = 5", "TURNS = 4"))
    with pytest.raises(TrustError, match=r"walks.py has changed since you recorded this run"):
        replay(tmp_path / "run")

    (tmp_path / "walks.py").unlink()
    with pytest.raises(TrustError, match=r"walks.py is gone since (?s:.*) now with --env"):
        replay(tmp_path / "run")


def test_own_policies_need_no_flag_beside_an_environment_that_is_named(tmp_path: Path) -> None:
    """Naming the environment takes nothing back of what an own run may do."""
    spec = f"{write_env(tmp_path)}:Walk"
    policies = tmp_path / "mine.py"
    policies.write_text("def still(observation, agent, info, rng):\n    return 0\n")
    run = tmp_path / "still"
    rollout(spec, policies=f"{policies}:still", episodes=1, out=run, most_turns=2)

    def opened() -> str:
        names = [f"{policies}:still"]
        with consented(load(run), doing="trying", env=spec, policies=names) as consent:
            return consent.rule

    assert opened() == "named"
    policies.write_text("def still(observation, agent, info, rng):\n    return 1\n")
    with pytest.raises(TrustError, match=r"mine.py has changed"):
        opened()


def test_replay_of_actions_asks_for_no_changed_policy(tmp_path: Path) -> None:
    """A policy may move on, as recorded actions need none; what the environment imports may not."""
    spec = f"{write_env(tmp_path, ('TURNS = 5', 'import beside' + chr(10) + 'TURNS = 5'))}:Walk"
    beside, policies = tmp_path / "beside.py", tmp_path / "mine.py"
    beside.write_text("")
    policies.write_text("def still(observation, agent, info, rng):\n    return 0\n")
    run = tmp_path / "still"
    rollout(spec, policies=f"{policies}:still", episodes=1, out=run, most_turns=2)
    policies.write_text("")
    result = replay(run)
    assert result.verified, str(result)
    with pytest.raises(TrustError, match=r"mine.py has changed"):
        replay(run, policies=True)
    beside.write_text("raise SystemExit\n")
    assert "the file of beside isn't the one" in str(replay(run).reason)


def test_own_run_of_workers_replays_without_a_flag(tmp_path: Path, own_state: Path) -> None:
    """The whole of parts is an own run, and nothing is remembered of the parts."""
    played(tmp_path, workers=2)
    assert [f"{root_digest(tmp_path / 'run')}.json"] == [file.name for file in own_state.iterdir()]
    assert replay(tmp_path / "run").verified


def test_changed_run_is_not_an_own_one(tmp_path: Path) -> None:
    """One other byte, and it may have been changed by anybody."""
    played(tmp_path)
    finalize_again(tmp_path / "run", seed=7)
    with pytest.raises(TrustError):
        replay(tmp_path / "run")


def test_own_run_imports_only_what_it_was_recorded_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A namesake in the current folder, or a new file beside the environment, is passed over."""
    write_env(
        tmp_path,
        (
            "TURNS = 5",
            f"import beside\ntry:\n    import {HERD}\nexcept ImportError:\n    pass\nTURNS = 5",
        ),
    )
    (tmp_path / "beside.py").write_text("")
    rollout(f"{tmp_path / 'walks.py'}:Walk", episodes=1, out=tmp_path / "run")
    folder = tmp_path / "other"
    folder.mkdir()
    for place in (folder / "beside.py", folder / f"{HERD}.py", tmp_path / f"{HERD}.py"):
        place.write_text("open(__file__ + '.ran', 'a').close()\n")
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(str(folder))

    result = replay(tmp_path / "run")

    assert result.verified, str(result)
    assert not list(tmp_path.rglob("*.ran"))


def test_recording_needs_no_state_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where own runs can't be remembered, recording goes on, and replaying asks."""
    monkeypatch.setenv("XDG_STATE_HOME", os.devnull)
    played(tmp_path)
    with pytest.raises(TrustError):
        replay(tmp_path / "run")


def test_module_that_fails_to_be_looked_at_fails_no_recording(
    tmp_path: Path, own_state: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What lies among the imported modules may be anything; the run is an own one all the same."""

    class Asked:
        def __getattr__(self, name: str) -> object:
            raise KeyError(name)

    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "module_that_raises", Asked())
        rollout("two_robot_line", episodes=1, out=tmp_path / "run")
    assert (own_state / f"{root_digest(tmp_path / 'run')}.json").is_file()


def test_own_runs_are_private(tmp_path: Path, own_state: Path) -> None:
    """Only the user reads them, and a folder that others may write into vouches for nothing."""
    played(tmp_path)
    (file,) = own_state.iterdir()
    assert [path.stat().st_mode & 0o777 for path in (file, own_state, own_state.parent)] == [
        0o600,
        0o700,
        0o700,
    ]
    own_state.chmod(0o777)
    assert own_runs.recall(file.stem) is None


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"format": 1, "modules": {"a": 3}}', "[" * 9999])
def test_damaged_own_run_is_anybodys(tmp_path: Path, own_state: Path, text: str) -> None:
    """What `remember` didn't write vouches for nothing."""
    played(tmp_path)
    (file,) = own_state.iterdir()
    assert json.loads(file.read_text())["modules"]
    file.write_text(text)
    assert own_runs.recall(file.stem) is None
