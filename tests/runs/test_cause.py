from pathlib import Path
from typing import Any

import pytest

from gamekeeper.episodes.divergence import Divergence
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.interface.opening import open_env
from gamekeeper.rollouts.workers import TaskOutcome
from gamekeeper.runs import replay_runner as cause
from gamekeeper.runs.comparison import replay
from gamekeeper.runs.recording import record
from tests.runs.plays import played, step_through, write_env

HASHES = ("self.rng.normal(size=3)", "np.array([hash(agent) % 97] * 3, float)")


def told(
    monkeypatch: pytest.MonkeyPatch,
    evidence: Evidence,
    *plays: Any,
    changed: Any = None,
    env: str | None = None,
) -> str | None:
    """The cause that is told when playing an episode again came out as in `plays`, one by one."""
    values = iter(plays)

    def run_task(*_: Any, **__: Any) -> TaskOutcome:
        return TaskOutcome("done", next(values), None, None, 0.0)

    monkeypatch.setattr(cause, "run_task", run_task)
    where = Divergence(1, 2, "a", "obs", 0, 1)
    return cause.cause_of(evidence, where, env=env, changed=changed or {}, timeout_s=1.0)


def play(prints: str, *drew: str) -> dict[str, Any]:
    """What one more play of an episode answers."""
    return {"prints": [prints, ""], "drew": list(drew)}


def test_cause_is_told_from_how_plays_differ(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Equal and different plays tell chance, hash seeds, earlier episodes and changes apart."""
    evidence = played(tmp_path)

    def say(*plays: Any, changed: Any = None) -> str:
        return str(told(monkeypatch, evidence, *plays, changed=changed))

    assert "the clock" in say(play("x"), play("y"))
    assert "the global generator random and numpy.random" in say(
        play("x", "random", "numpy.random"), play("y")
    )
    assert "hash seed" in say(play("x"), play("x"), play("y"))
    assert "episode 1 depends on what was played before it" in say(
        play("x"), play("x"), play("x"), play("y")
    )
    same = [play("x")] * 4
    assert "changed since the recording (its source, numpy)" in say(
        *same, changed={"source": ["1", "2"], "numpy": ["1", "2"]}
    )
    assert "not as recorded" in say(*same)
    after = say(*same[:3], play("y"), changed={"source": ["1", "2"]})
    assert after.index("(its source)") < after.index("depends on what was played before it")
    assert say(None, play("x")) == "None"


def test_cause_names_another_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where --env names another entry point than was recorded, that is the cause; else it isn't."""
    evidence = played(tmp_path)

    def say(entry_point: str, env: str | None = "walks.py:Any") -> str:
        plays = [{**play("x"), "entry_point": entry_point}] * 4
        return str(told(monkeypatch, evidence, *plays, env=env))

    assert "isn't the recorded one: walks.py:Walk was recorded, walks.py:Other replayed" in say(
        "walks.py:Other"
    )
    assert "not as recorded" in say("walks.py:Walk")
    assert "not as recorded" in say("walks:Walk")
    assert "not as recorded" in say("walks.py:Other", env=None)


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (
            ("self.rng = np.random.default_rng(seed)", "self.rng = np.random"),
            "draws from the global generator numpy.random, which its reset doesn't seed",
        ),
        (HASHES, "depends on Python's hash seed"),
    ],
)
def test_cause_of_a_divergence_is_named(tmp_path: Path, edit: tuple[str, str], words: str) -> None:
    """An environment that doesn't replay is told what it depends on."""
    played(tmp_path, edit, episodes=1)

    result = replay(tmp_path / "run", allow_import=True)

    assert result.divergence is not None
    assert words in str(result.cause)
    assert f"cause: {result.cause}" in str(result)


def test_cause_is_what_was_played_before(tmp_path: Path) -> None:
    """An environment that keeps something over a seeded reset is told so, where that matters."""
    path = write_env(
        tmp_path, ("self.turn, self.total = 0, (", "self.turn, self.total = 0, KEPT() + (")
    )
    path.write_text(
        path.read_text(encoding="utf-8") + "\n\nKEPT = __import__('itertools').count().__next__\n",
        encoding="utf-8",
    )
    env = record(open_env(f"{path}:Walk").env, tmp_path / "run")
    for episode in range(2):
        if episode == 1:
            env.unwrapped.reset(seed=9)
        step_through(env, seed=episode)
    env.close()

    result = replay(tmp_path / "run", env=f"{path}:Walk")

    assert result.divergence is not None
    assert (result.divergence.episode, result.divergence.field) == (1, "state")
    assert "episode 1 depends on what was played before it" in str(result.cause)
