import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gamekeeper.contract import Contract
from gamekeeper.errors import EnvError, PolicyError, RunError, SpecError
from gamekeeper.runs.load_run import load
from gamekeeper.runs.recording import record, rollout
from tests.runs.plays import step_through, write_env
from tests.runs.walks import Turns, Walk


class Closing(Walk):
    """It counts how often it was closed, and may raise."""

    def __init__(self, *, step_raises: bool = False, close_raises: bool = False) -> None:
        super().__init__()
        self.closed, self.step_raises, self.close_raises = 0, step_raises, close_raises

    def step(self, actions: Any) -> Any:
        if self.step_raises and self.turn == 2:
            raise ZeroDivisionError("division by turns")
        return super().step(actions)

    def close(self) -> None:
        self.closed += 1
        if self.close_raises:
            raise OSError("the window is gone")


def test_rollout_keeps_a_failed_episode(tmp_path: Path) -> None:
    """The turns until the environment raised are finalized as failed, the traceback as text."""
    env = Closing(step_raises=True)

    with pytest.raises(EnvError, match="raised ZeroDivisionError: division by turns") as caught:
        rollout(env, episodes=3, out=tmp_path / "run")

    evidence = load(tmp_path / "run")
    (row,) = evidence.episode_table.to_pylist()
    assert (evidence.manifest["status"], row["end"], row["turns"]) == ("failed", "failed", 3)
    assert row["error"].startswith("Traceback (most recent call last):")
    assert row["error"].endswith("ZeroDivisionError: division by turns\n")
    assert evidence.agent_steps["raised"].drop_null()[0].as_py() == "ZeroDivisionError"
    assert "episode 0" in str(caught.value)
    assert env.closed == 1


@pytest.mark.parametrize("kind", [Walk, Turns])
@pytest.mark.parametrize("where", ["reset", "step"])
def test_rollout_outlives_an_environment_that_exits(
    kind: type, where: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """sys.exit() in an environment is its failure like any other, and ends no process."""

    def leave(*_: Any, **__: Any) -> None:
        sys.exit(4)

    monkeypatch.setattr(kind, where, leave)
    with pytest.raises(EnvError, match=r"called sys.exit\(4\)"):
        rollout(kind(), episodes=3, out=tmp_path / "run")

    evidence = load(tmp_path / "run")
    (row,) = evidence.episode_table.to_pylist()
    assert (evidence.manifest["status"], row["end"]) == ("failed", "failed")
    assert row["error"].endswith("SystemExit: 4\n")
    assert ["SystemExit"] * (where == "step") == list(
        dict.fromkeys(evidence.agent_steps["raised"].drop_null().to_pylist())
    )


def test_rollout_checksums_though_closing_raises(tmp_path: Path) -> None:
    """An environment that can't be closed loses no evidence."""
    with pytest.raises(EnvError, match="the window is gone"):
        rollout(Closing(close_raises=True), episodes=2, out=tmp_path / "run")

    assert (
        load(tmp_path / "run").manifest["status"],
        load(tmp_path / "run").episode_table.num_rows,
    ) == ("finalized", 2)


@pytest.mark.parametrize("policies", ["nobody", {"c": "random"}, "walks:missing"])
def test_rollout_makes_no_folder_for_a_wrong_policy(tmp_path: Path, policies: Any) -> None:
    """A policy that can't be found leaves nothing behind, and the environment is closed."""
    env = Closing()

    with pytest.raises(PolicyError):
        rollout(env, policies=policies, out=tmp_path / "run")

    assert not (tmp_path / "run").exists()
    assert env.closed == 1


def test_rollout_keeps_what_a_policy_did_before_it_failed(tmp_path: Path) -> None:
    """A policy that gives None is named, and the episode is kept as cut."""

    def tires(observation: Any, agent: Any, info: Any, rng: Any) -> Any:
        return None if info.get("turn") == 2 else 1

    with pytest.raises(PolicyError):
        rollout(Walk(), policies=tires, out=tmp_path / "run")

    evidence = load(tmp_path / "run")
    assert (
        evidence.manifest["status"],
        *(evidence.episode_table[name].to_pylist() for name in ("end", "turns")),
    ) == ("finalized", ["cut"], [2])


def test_rollout_keeps_what_was_played_before_an_interrupt(tmp_path: Path) -> None:
    """Ctrl-C in the midst of a rollout finalizes what was played."""
    turns = iter(range(100))

    def interrupt() -> None:
        if next(turns) == 7:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        rollout(Walk(), episodes=9, out=tmp_path / "run", after_turn=interrupt)

    evidence = load(tmp_path / "run")
    assert (evidence.manifest["status"], evidence.episode_table["end"].to_pylist()) == (
        "finalized",
        ["ended", "cut"],
    )


@pytest.mark.parametrize("kind", [Walk, Turns])
def test_rollout_in_memory_equals_the_recorded_one(tmp_path: Path, kind: type) -> None:
    """Memory, a run, and the user's own loop over a recorded environment get the same rows."""
    memory = rollout(kind(), episodes=3, seed=5)
    run_files = rollout(kind(), episodes=3, seed=5, out=tmp_path / "run")

    assert memory.fingerprint == run_files.fingerprint == load(tmp_path / "run").fingerprint
    assert memory.manifest["info_fingerprint"] == run_files.manifest["info_fingerprint"]
    assert memory.agent_steps.num_rows == run_files.agent_steps.num_rows
    for one, two in zip(memory.episodes, run_files.episodes, strict=True):
        assert one.header == two.header
        for left, right in zip(one.turns, two.turns, strict=True):
            assert (left.order, left.rewards, left.digests) == (
                right.order,
                right.rewards,
                right.digests,
            )


def test_rollout_plays_each_episode_from_its_own_seed() -> None:
    """Episode k is the same however many are played, and other seeds play others."""
    few, many = (list(rollout(Walk(), episodes=n, seed=4).episodes) for n in (2, 4))
    other = rollout(Walk(), episodes=1, seed=5).episodes[0]

    assert [episode.header["fingerprint"] for episode in few] == [
        episode.header["fingerprint"] for episode in many[:2]
    ]
    assert few[0].header["fingerprint"] != other.header["fingerprint"]


@pytest.mark.parametrize("most_turns", [0, 1, 4])
def test_rollout_cuts_episodes_that_are_longer(most_turns: int) -> None:
    """An episode has no more turns than asked for, none where none are."""
    evidence = rollout(Walk(), episodes=2, most_turns=most_turns)

    assert [most_turns] * 2 == evidence.episode_table["turns"].to_pylist()
    assert evidence.episode_table["end"].to_pylist() == ["cut"] * 2


def test_rollout_knows_terms_and_volatile_infos(tmp_path: Path) -> None:
    """A contract's volatile infos are recorded, and stay out of the info fingerprint."""
    contract = Contract.from_json({"infos": {"turn": {"volatile": True}}})
    path = write_env(tmp_path, ('{"turn": self.turn}', '{"turn": id(self)}'))

    one, two = (
        rollout(f"{path}:Walk", episodes=1, out=tmp_path / name, contract=contract)
        for name in ("one", "two")
    )

    assert one.manifest["info_fingerprint"] == two.manifest["info_fingerprint"]
    assert "turn" in next(iter(one.episodes[0].turns[1].infos.values()))


def test_rollout_says_what_it_cannot_open(tmp_path: Path) -> None:
    """No folder is made for an environment that isn't there."""
    with pytest.raises(SpecError):
        rollout(f"{tmp_path}/nothing.py:make", out=tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_rollout_closes_what_it_opened_where_the_folder_is_taken(tmp_path: Path) -> None:
    """A folder that holds something is refused, and the environment isn't left open."""
    (tmp_path / "mine").touch()
    env = Closing()

    with pytest.raises(RunError, match="isn't empty"):
        rollout(env, out=tmp_path)
    assert env.closed == 1


def test_record_cannot_be_told_from_the_environment(tmp_path: Path) -> None:
    """The same observations, rewards and attributes come out, recorded or not."""
    plain, recorded = Walk(), record(Walk(), tmp_path / "run")
    for seed in (3, None):
        one, two = plain.reset(seed=seed), recorded.reset(seed=seed)
        while plain.agents:
            for agent in plain.agents:
                assert np.array_equal(one[0][agent], two[0][agent])
            one, two = (env.step({"a": 2, "b": 0}) for env in (plain, recorded))
            assert one[1:] == two[1:]
            assert plain.agents == recorded.agents
    recorded.close()

    assert isinstance(recorded.unwrapped, Walk)
    assert plain.metadata == recorded.metadata
    assert load(tmp_path / "run").episode_table["seed"].to_pylist() == [3, None]


def test_record_without_a_reset_is_an_empty_run(tmp_path: Path) -> None:
    """A recording in which nothing happened is finalized, without episodes."""
    record(Walk(), tmp_path / "run").close()

    evidence = load(tmp_path / "run")
    assert (
        evidence.manifest["status"],
        evidence.episode_table.num_rows,
        evidence.agent_steps.num_rows,
    ) == ("finalized", 0, 0)


def test_record_keeps_cut_episodes(tmp_path: Path) -> None:
    """A reset in the middle cuts an episode, closing cuts the last one."""
    env = record(Walk(), tmp_path / "run")
    step_through(env, seed=1, turns=2)
    step_through(env, seed=2)
    step_through(env, seed=3, turns=1)
    env.close()

    rows = load(tmp_path / "run").episode_table.to_pylist()
    assert [(row["end"], row["turns"]) for row in rows] == [("cut", 2), ("ended", 5), ("cut", 1)]
