"""Environments whose objects attack: their failure is recorded, and is theirs."""

from pathlib import Path
from typing import Any

import pytest

import gamekeeper as gk
from benchmarks.attacking.hostile import AGENTS, FILE, GIVEN, SPACES, TEXTS, WAYS
from benchmarks.attacking.hostile_env import HostileTicks, HostileTurns
from gamekeeper.errors import EnvError, PolicyError
from gamekeeper.runs.run_check import verify
from tests.cli.lines import run_apart

KINDS = [HostileTicks, HostileTurns]
UNFIT = [("mask", "escape"), ("mask", "surrogate")]
"""Texts in place of masks: plain values of a wrong form."""
RAISING = ("raises", "raises-base", "raises-exit", "attribute", "class")
MEETING = [("agent", way) for way in AGENTS]
MEETING += [(what, way) for what in ("space", "action-space") for way in SPACES]
MEETING += [(what, way) for what in GIVEN for way in WAYS if (what, way) not in UNFIT]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("way", TEXTS)
@pytest.mark.parametrize("at", ["reset", "step"])
def test_hostile_exception_is_the_environments_recorded_failure(
    kind: Any, way: str, at: str, tmp_path: Path
) -> None:
    """Whatever its `__str__` does, the run is finalized as failed, and names the class raised."""
    with pytest.raises(EnvError):
        gk.rollout(kind("error", way, at), episodes=1, out=tmp_path / "run")
    evidence = gk.load(tmp_path / "run")
    assert evidence.manifest["status"] == "failed"
    assert "hostile_env.py" in evidence.episode_table["error"][0].as_py()
    assert verify(tmp_path / "run").ok


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("what", "way"), MEETING)
def test_hostile_object_leaves_a_run_that_verifies(
    kind: Any, what: str, way: str, tmp_path: Path
) -> None:
    """It is kept as it was, or the environment fails: never is the run left in disorder."""
    is_failed = False
    try:
        gk.rollout(kind(what, way), episodes=1, out=tmp_path / "run")
    except EnvError:
        is_failed = True
    status = gk.load(tmp_path / "run").manifest["status"]
    assert status == ("failed" if is_failed else "finalized")
    assert verify(tmp_path / "run").ok


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("way", "holds"), [(way, False) for way in RAISING] + [(way, True) for way in RAISING[:-1]]
)
@pytest.mark.parametrize("policy", ["random", "first-legal"])
def test_mask_whose_code_raises_is_the_environments_failure(
    kind: Any, way: str, policy: str, holds: bool, tmp_path: Path
) -> None:
    """Also where a plain list holds it; the run is failed, and the error says why."""

    class Wrapped(kind):  # type: ignore[misc]
        def given(self, what: str, plain: Any) -> Any:
            given = super().given(what, plain)
            return [given, 1] if holds and what == self.what and self.now >= 2 else given

    with pytest.raises(EnvError, match=r"hostile|can't be read"):
        gk.rollout(Wrapped("mask", way), episodes=1, policies=policy, out=tmp_path / "run")
    assert gk.load(tmp_path / "run").manifest["status"] == "failed"
    assert verify(tmp_path / "run").ok


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("way", ["escape", "surrogate"])
def test_plain_mask_of_a_wrong_form_is_wrong_use(kind: Any, way: str, tmp_path: Path) -> None:
    """The environment did not raise: the run is finalized up to there; the policy can't choose."""
    with pytest.raises(PolicyError, match="doesn't fit"):
        gk.rollout(kind("mask", way), episodes=1, out=tmp_path / "run")
    assert gk.load(tmp_path / "run").manifest["status"] == "finalized"


@pytest.mark.parametrize("api", ["ticks", "turns"])
@pytest.mark.parametrize(("way", "code"), [("raises", 1), ("class", 1), ("escape", 2)])
def test_command_tells_a_mask_that_raises_from_one_that_is_unfit(
    api: str, way: str, code: int, tmp_path: Path
) -> None:
    """Exit code 1: the environment failed; 2: its mask has another form."""
    words = "--kwargs", f'{{"what": "mask", "way": "{way}"}}', "--out", "run"
    done = run_apart("rollout", f"{FILE}:{api}", *words, cwd=tmp_path)
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stdout
    assert gk.load(tmp_path / "run").manifest["status"] == ("failed" if code == 1 else "finalized")


@pytest.mark.parametrize("way", ["tuple", "dict", "recursive-tuple", "recursive-dict", "wide"])
def test_space_without_end_is_named(way: str, tmp_path: Path) -> None:
    """A space nested without end, or in more parts than can be counted, is told as one."""
    with pytest.raises(EnvError, match="no end that can be recorded"):
        gk.rollout(HostileTicks("space", way), episodes=1, out=tmp_path / "run")
    assert gk.load(tmp_path / "run").manifest["status"] == "failed"


@pytest.mark.parametrize(
    ("what", "way"),
    [("error", "escape"), ("meddle-raise", "streams-none"), ("meddle-raise", "streams-closed")],
)
def test_hostile_text_steers_no_terminal(what: str, way: str, tmp_path: Path) -> None:
    """In a process of its own, whatever it made of its streams before: exit code 1, no ESC."""
    words = "--kwargs", f'{{"what": "{what}", "way": "{way}", "at": "step"}}', "--out", "run"
    done = run_apart("rollout", f"{FILE}:ticks", *words, cwd=tmp_path)
    assert done.returncode == 1, done.stderr
    assert "\x1b" not in done.stdout + done.stderr
    assert "fault of gamekeeper" not in done.stderr
    assert gk.load(tmp_path / "run").manifest["status"] == "failed"


@pytest.mark.parametrize("way", ["chdir", "cwd-gone"])
def test_environment_that_leaves_the_folder_takes_no_run_along(way: str, tmp_path: Path) -> None:
    """A path that was typed means where it was typed, also where opening goes elsewhere."""
    words = "--kwargs", f'{{"what": "meddle", "way": "{way}", "at": "init"}}', "--out", "run"
    done = run_apart("rollout", f"{FILE}:ticks", *words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert verify(tmp_path / "run").ok


def test_program_that_is_shown_steers_no_terminal(tmp_path: Path) -> None:
    """An audit quotes what an environment raised in programs that are meant to be copied."""
    kwargs = '{"what": "error", "way": "escape", "at": "step"}'
    done = run_apart("audit", f"{FILE}:ticks", "--kwargs", kwargs, "--quick", cwd=tmp_path)
    assert done.returncode == 1, done.stderr
    assert "\x1b" not in done.stdout + done.stderr
