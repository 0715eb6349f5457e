"""A run as arrays: every row is there, nothing is pickled, nothing is written over."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

import gamekeeper as gk
from gamekeeper.adapters import spool
from gamekeeper.adapters.numpy_arrays import decisions, export, prefix_of, texts
from gamekeeper.episodes import tables
from gamekeeper.errors import EvidenceError, RunError
from tests.adapters.data_games import DAY, NIGHT, SPARE, Shift, of_terms, rows_of
from tests.runs.finalize_again import finalize_again_table

TAG = "mpe2.simple_tag_v3:parallel_env"


def exported(run: Any, out: Path, **options: Any) -> Any:
    """The arrays of a run, and what was said to be lost."""
    said: list[str] = []
    written = export(run, out, say=said.append, **options)
    assert [f"lost: {each}" for each in written.lost] == said
    with np.load(written.path) as arrays:
        return dict(arrays), written


@pytest.mark.parametrize("spec", ["two_robot_line", "handover", "warehouse", TAG, Shift])
def test_arrays_hold_every_row_of_the_trace(spec: Any, tmp_path: Path) -> None:
    """Observations, actions, rewards, ends and masks stand as the episode has them, row by row."""
    evidence = gk.rollout(spec, episodes=2, seed=3)
    arrays, written = exported(evidence, tmp_path / "run")
    assert written.rows == evidence.agent_steps.num_rows
    places = dict.fromkeys(written.agents, 0)
    for episode in evidence.episodes:
        for turn in episode.turns:
            for agent in turn.agents:
                row, head = places[agent], f"{agent}/"
                places[agent] += 1
                key = (arrays[head + "episode"][row], arrays[head + "turn"][row])
                assert key == (episode.episode, turn.index)
                assert arrays[head + "live"][row] == (agent in turn.live)
                for name, by_agent in (("obs", turn.observations), ("action", turn.actions)):
                    assert arrays[f"{head}{name}.valid"][row] == (agent in by_agent)
                    if agent in by_agent and not isinstance(by_agent[agent], dict):
                        np.testing.assert_array_equal(by_agent[agent], arrays[head + name][row])
                for name in ("terminated", "truncated"):
                    assert arrays[head + name][row] == getattr(turn, name).get(agent, False)
                assert arrays[head + "reward"][row] == turn.rewards.get(agent, 0.0)
                assert arrays[head + "reward.valid"][row] == (agent in turn.rewards)
                assert arrays[head + "cumulative_reward"][row] == turn.cumulative_reward.get(
                    agent, 0.0
                )
                order = turn.order.index(agent) if agent in turn.order else -1
                assert arrays[head + "order"][row] == order
                if agent in turn.masks and head + "mask" in arrays:
                    np.testing.assert_array_equal(turn.masks[agent], arrays[head + "mask"][row])


def test_arrays_hold_pictures_texts_and_states(tmp_path: Path) -> None:
    """Each leaf of a Dict space is an array of its own dtype and shape; `texts` reads texts."""
    evidence = gk.rollout(Shift, episodes=1)
    arrays, _ = exported(evidence, tmp_path / "run")
    turns = list(evidence.episodes[0].turns)
    seen = [turn.observations[NIGHT] for turn in turns]
    assert arrays[f"{NIGHT}/obs.picture"].dtype == np.uint8
    for row, value in enumerate(seen):
        np.testing.assert_array_equal(value["picture"], arrays[f"{NIGHT}/obs.picture"][row])
        assert value["count"] == arrays[f"{NIGHT}/obs.count"][row]
    assert [value["word"] for value in seen] == texts(arrays, f"{NIGHT}/obs.word")
    told = [turn.infos[SPARE] for turn in turns if SPARE in turn.infos]
    kept = [text for text in texts(arrays, f"{SPARE}/info") if text is not None]
    assert told == [json.loads(text) for text in kept]
    np.testing.assert_array_equal([turn.state for turn in turns], arrays["state/value"])
    assert arrays["state/turn"].tolist() == [turn.index for turn in turns]
    assert texts(arrays, "state/nonconforming") == [None] * len(turns)


def test_metadata_says_what_the_run_was(tmp_path: Path) -> None:
    """Fingerprint, environment, seed and spaces stand as JSON; episodes have theirs as arrays."""
    evidence = gk.rollout("two_robot_line", episodes=3, seed=7)
    arrays, _ = exported(evidence, tmp_path / "run.npz")
    about = json.loads(str(arrays["metadata"]))
    assert about["fingerprint"] == evidence.fingerprint
    assert about["environment"]["source_digest"]
    assert (about["seed"], about["agents"]["picker"]) == (7, "picker")
    header = evidence.episode_table.to_pydict()
    assert arrays["episodes/seed"].tolist() == header["seed"]
    assert texts(arrays, "episodes/fingerprint") == header["fingerprint"]
    assert texts(arrays, "episodes/end") == header["end"]


def test_arrays_are_the_same_whatever_waits_in_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Memory or run, all at once or part by part: equal evidence gives equal bytes."""
    kept = gk.rollout("handover", episodes=4, seed=1)
    gk.rollout("handover", episodes=4, seed=1, out=tmp_path / "run")
    at_once = Path(exported(kept, tmp_path / "a")[1].path).read_bytes()
    monkeypatch.setattr(spool, "BUDGET_BYTES", 100)
    apart = Path(exported(tmp_path / "run", tmp_path / "b")[1].path).read_bytes()
    with np.load(tmp_path / "a.npz") as one, np.load(tmp_path / "b.npz") as two:
        for name in set(one) - {"metadata"}:
            np.testing.assert_array_equal(one[name], two[name])
    status = b'"status": "finalized"'  # of the run alone; all else is the same
    assert len(at_once) == pytest.approx(len(apart), abs=len(status) * 4)
    assert exported(tmp_path / "run", tmp_path / "c")[1].rows == kept.agent_steps.num_rows
    assert (tmp_path / "c.npz").read_bytes() == apart


@pytest.mark.parametrize("spec", ["handover", "connect_four", "warehouse", Shift])
def test_arrays_are_the_same_whatever_is_read_at_a_time(
    spec: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Masks, texts and states that begin in a later part stand where they stood."""
    kept = gk.rollout(spec, episodes=3, seed=1, most_turns=30)
    at_once = Path(exported(kept, tmp_path / "a")[1].path).read_bytes()
    monkeypatch.setattr(tables, "PART_ROWS", 5)
    apart = Path(exported(kept, tmp_path / "b")[1].path).read_bytes()

    assert at_once == apart


def test_value_that_is_nonconforming_is_kept_as_it_was(tmp_path: Path) -> None:
    """A value outside its space stands in `nonconforming`, in no array, as `.valid` says."""
    evidence = gk.rollout(lambda: Shift(nonconforming="observation"), episodes=1)
    arrays, _ = exported(evidence, tmp_path / "run")
    row = arrays[f"{DAY}/turn"].tolist().index(1)
    assert not arrays[f"{DAY}/obs.valid"][row]
    assert not arrays[f"{DAY}/obs"][row].any()
    kept = json.loads(str(texts(arrays, f"{DAY}/nonconforming")[row]))["obs"]["value"]
    assert kept["dtype"] == "<f8"


def test_run_of_digests_says_that_observations_are_lost(tmp_path: Path) -> None:
    """At level "digest" the digests of rows stand in their place."""
    gk.rollout("two_robot_line", episodes=1, level="digest", out=tmp_path / "run")
    arrays, written = exported(tmp_path / "run", tmp_path / "out")
    assert "digest" in written.lost[0]
    assert "picker/obs" not in arrays
    assert not arrays["picker/obs.valid"].any()
    assert arrays["picker/digest"].shape == (len(arrays["picker/turn"]), 16)


@pytest.mark.parametrize(
    ("spec", "level", "column", "values"),
    [
        ("two_robot_line", "full", "cumulative_reward", pa.nulls(1)),
        ("two_robot_line", "full", "info", pa.array([1.5])),
        ("two_robot_line", "full", "nonconforming", None),
        ("two_robot_line", "full", "agent", pa.array([7])),
        ("tictactoe", "full", "action_mask", pa.array([b"1"])),
        ("tictactoe", "full", "info", pa.array(['{"action_mask": "[1]"}'])),
        ("two_robot_line", "digest", "digest", pa.array([b"short"])),
        ("two_robot_line", "digest", "digest", pa.nulls(1, pa.binary())),
    ],
)
def test_columns_that_say_what_cannot_be_are_refused(
    spec: str, level: str, column: str, values: Any, tmp_path: Path
) -> None:
    """A table that was altered, and its run finalized again, is an error that says so."""
    steps = gk.rollout(spec, episodes=1, level=level, out=tmp_path / "run").agent_steps
    place = steps.schema.get_field_index(column)
    if values is None:
        steps = steps.remove_column(place)
    else:
        others = pa.concat_arrays([values] * len(steps))
        steps = steps.set_column(place, column, others)
    finalize_again_table(tmp_path / "run", "agent_steps", steps)
    with pytest.raises(EvidenceError):
        export(tmp_path / "run", tmp_path / "out")
    assert not (tmp_path / "out.npz").exists()


def test_frames_are_said_to_be_lost(tmp_path: Path) -> None:
    """Arrays hold no frames, and say so."""
    gk.rollout(Shift, episodes=1, frames=True, out=tmp_path / "run")
    assert exported(tmp_path / "run", tmp_path / "out")[1].lost[0].startswith("frames")


def test_only_those_who_are_asked_for_are_exported(tmp_path: Path) -> None:
    """Other agents have no arrays; a name that nobody has is refused before anything is written."""
    evidence = gk.rollout("two_robot_line", episodes=1)
    arrays, written = exported(evidence, tmp_path / "run", agents=["carrier"])
    assert written.agents == ("carrier",)
    assert not [name for name in arrays if name.startswith("picker/")]
    assert written.rows == len(rows_of(evidence, "carrier"))
    with pytest.raises(EvidenceError, match="the run has no agent called 'wolf'"):
        export(evidence, tmp_path / "other", agents=["wolf"])
    assert not (tmp_path / "other.npz").exists()


def test_earlier_file_is_replaced_and_a_failure_leaves_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file is overwritten once all is written; an export that fails leaves the earlier one."""
    evidence = gk.rollout("two_robot_line", episodes=1)
    (tmp_path / "run.npz").write_text("mine")
    export(evidence, tmp_path / "run")
    assert (tmp_path / "run.npz").read_bytes()[:2] == b"PK"
    (tmp_path / "other.npz").mkdir()
    with pytest.raises(RunError, match="a folder has this name"):
        export(evidence, tmp_path / "other")
    (tmp_path / "other.npz").rmdir()

    def fail(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(spool.Spool, "write", fail)
    before = (tmp_path / "run.npz").read_bytes()
    with pytest.raises(RunError, match="No space left"):
        export(evidence, tmp_path / "run")
    assert (tmp_path / "run.npz").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["run.npz"]


@pytest.mark.parametrize("agent", ["a/b", "..", "state", "metadata", "", '["robot",1]', "è"])
def test_name_of_an_agent_is_safe_in_an_archive(agent: str) -> None:
    """No name leaves its folder when the archive is unpacked, or stands for something else."""
    prefix = prefix_of(agent)
    assert prefix
    assert not {"/", "\\"} & set(prefix)
    assert prefix.strip(".")
    assert prefix not in ("state", "episodes", "metadata")


@pytest.mark.parametrize("spec", ["handover", "tictactoe", "warehouse", Shift])
def test_decisions_are_paid_until_the_next(spec: Any, tmp_path: Path) -> None:
    """What is paid while others act belongs to the last decision, in its own episode."""
    policies = "reference" if spec == "handover" else "first-legal"
    evidence = gk.rollout(spec, episodes=4, seed=3, policies=policies)
    arrays, written = exported(evidence, tmp_path / "run")
    for agent in written.agents:
        rows, paid = decisions(arrays, agent)
        expected: list[float] = []
        for episode in evidence.episodes:
            is_open = False
            for turn in episode.turns:
                if turn.actions.get(agent) is not None:
                    expected.append(0.0)
                    is_open = True
                if is_open:
                    expected[-1] += turn.rewards.get(agent, 0.0)
        np.testing.assert_allclose(paid, expected)
        assert arrays[f"{agent}/action.valid"][rows].all()


def test_decisions_of_a_giver_are_paid_what_the_receiver_delivers(tmp_path: Path) -> None:
    """Deliveries are made in the other's turns: none would be the giver's own."""
    evidence = gk.rollout("handover", episodes=4, seed=3, policies="reference")
    arrays, _ = exported(evidence, tmp_path / "run")
    rows, paid = decisions(arrays, "giver_0", "reward.delivery")
    assert paid.sum() == pytest.approx(arrays["giver_0/reward.delivery"].sum())
    assert paid.sum() > arrays["giver_0/reward.delivery"][rows].sum()


def test_terms_that_nothing_tells_are_no_numbers(tmp_path: Path) -> None:
    """0.0 would say that a reward was paid by none of its terms; the loss is said."""
    evidence = of_terms()
    arrays, written = exported(evidence, tmp_path / "run")
    was_paid = [row["reward"] is not None for row in rows_of(evidence, DAY)]
    np.testing.assert_array_equal(np.isnan(arrays[f"{DAY}/reward.care"]), was_paid)
    assert any("by which terms" in each for each in written.lost)
